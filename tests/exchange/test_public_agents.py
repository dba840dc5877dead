"""People of agents files that others publish run here, in each dialect of HuNavSim.

The settings of two files under the MIT licence are written down here as data: the cafe of HuNavSim (`agents.yaml` of
robotics-upo/hunav_sim, Copyright (c) 2022 Service Robotics Lab) and the empty room of SFU-MARS/hunavis (Copyright (c)
2025 SFU MARS Lab).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.world.parts import map_of, walled

import rvsg
from rvsg.world.creation import world_from
from rvsg.world.occupancy import write_map
from rvsg.world.world import World
from rvsg_exchange.formats import import_agents

pytestmark = pytest.mark.slow
HALF_M = 12.0
"""Half the side of a free room that holds the people written down here."""

CAFE = {
    "agent1": (4, (3.484565, 6.934117), [(3.378858, -4.586833), (-3.588942, -4.796917), (-2.574025, 1.435859)]),
    "agent2": (6, (3.308198, -10.327183), [(1.558424, 6.16366), (-1.87361, -1.645975), (0.052511, -10.04712)]),
    "agent7": (5, (-4.183384, -9.522011), [(-1.662852, -7.631603), (-4.079139, -4.761907), (0.717925, 1.400831)]),
    "agent4": (2, (-3.554606, 5.953529), [(-2.643059, -9.592029), (1.838239, -3.501402), (-4.325063, 2.766649)]),
    "agent5": (5, (1.067725, -8.156725), [(1.348298, -1.225715), (-0.717789, -3.326329), (-1.522822, -5.986265)]),
}
"""Behaviour, start and goals of each person."""
ROOM_GOALS = [(3.0, -3.0), (-3.0, -3.0), (-3.0, 3.0), (3.0, 3.0)]
WORDS = {1: "Regular", 2: "Impassive", 3: "Surprised", 4: "Scared", 5: "Curious", 6: "Threatening"}
BLOCK = {"duration": 10.0, "once": True, "vel": 1.1, "dist": 0.0}
FACTORS = {
    f"{name}_force_factor": value for name, value in (("goal", 2.0), ("obstacle", 2.0), ("social", 2.0), ("other", 2.0))
}


def person(number: int, behaviour: Any, start: tuple[float, float], goals: dict[Any, Any]) -> dict[str, Any]:
    x, y = start
    pose = {"x": x, "y": y, "z": 1.25, "h": 0.0}
    common = {"id": number, "skin": 0, "group_id": -1, "max_vel": 1.5, "radius": 0.4, "goal_radius": 0.3}
    return {**common, "behavior": behaviour, "init_pose": pose, "cyclic_goals": True, **goals}


def in_the_block(goals: list[tuple[float, float]]) -> dict[str, Any]:
    return {"goals": [f"g{k}" for k in range(len(goals))]} | {
        f"g{k}": {"x": x, "y": y, "h": 1.25} for k, (x, y) in enumerate(goals)
    }


def cafe_flat() -> dict[str, Any]:
    people = {
        name: person(k, b, start, in_the_block(goals)) for k, (name, (b, start, goals)) in enumerate(CAFE.items())
    }
    return {"map": "cafe", "publish_people": True, "agents": list(CAFE), **people}


def room_block() -> dict[str, Any]:
    behaviour = {"type": 1, "configuration": 2, **BLOCK, **FACTORS}
    one = person(1, behaviour, (3.0, 3.0), in_the_block(ROOM_GOALS)) | {"radius": 0.3, "goal_radius": 0.2}
    return {"map": "map_name", "publish_people": True, "agents": ["agent1"], "agent1": one}


def cafe_v2() -> dict[str, Any]:
    places = dict.fromkeys(goal for _, _, goals in CAFE.values() for goal in goals)
    ids = {place: number for number, place in enumerate(places, 1)}
    people = {
        name: person(
            k, {"type": WORDS[b], "configuration": 0, **FACTORS}, start, {"goals": [ids[goal] for goal in goals]}
        )
        for k, (name, (b, start, goals)) in enumerate(CAFE.items())
    }
    shared = {number: {"x": x, "y": y} for (x, y), number in ids.items()}
    head = {"yaml_base_name": "cafe_agents", "simulator": "Isaac Sim", "map": "cafe", "publish_people": True}
    return {**head, "global_goals": shared, "agents": list(CAFE), **people}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A free room: what the maps of the files hold is not tested here."""
    side = round(2 * HALF_M / 0.1)
    folder = tmp_path_factory.mktemp("room")
    write_map(map_of(walled(side, side, thick=8), 0.1, x=-HALF_M, y=-HALF_M), folder)
    return world_from("map", folder / "map.yaml", name="room").world


def written(folder: Path, settings: dict[str, Any]) -> Path:
    file = folder / f"{settings['map']}.yaml"
    file.write_text(yaml.safe_dump({"hunav_loader": {"ros__parameters": settings}}, sort_keys=False))
    return file


@pytest.mark.parametrize(
    "made", [cafe_flat, *(pytest.param(made, marks=pytest.mark.exhaustive) for made in (room_block, cafe_v2))]
)
def test_people_of_public_files_run_to_the_end(made: Any, world: World, tmp_path: Path) -> None:
    settings = made()
    scenario, _ = import_agents(written(tmp_path, settings), world, world.routes[0].name)
    (run,) = rvsg.simulate(scenario, [0], world=world)
    path = run.trajectory
    assert run.human_names == tuple(settings["agents"])
    assert run.completed or path.t[-1] >= scenario.mission.route.time_limit_s
    assert np.isfinite(path.human_x).all()
    for k, name in enumerate(settings["agents"]):
        start = settings[name]["init_pose"]
        assert np.hypot(path.human_x[0, k] - start["x"], path.human_y[0, k] - start["y"]) < 0.1
        assert np.hypot(np.diff(path.human_x[:, k]), np.diff(path.human_y[:, k])).sum() > 2.0, "the person walks"


def test_the_cafe_is_the_same_scenario_in_both_dialects(world: World, tmp_path: Path) -> None:
    scenarios = [import_agents(written(tmp_path, made()), world, world.routes[0].name)[0]
                 for made in (cafe_flat, cafe_v2)]  # fmt: skip
    flat, v2 = (
        [(human.name, human.behaviour, human.start, human.points) for human in scenario.people.humans]
        for scenario in scenarios
    )
    assert flat == v2
