"""People of agents files that others publish run here, in each dialect of HuNavSim.

The settings of two files under the MIT licence are written down here as data: the cafe of HuNavSim (`agents.yaml` of
robotics-upo/hunav_sim, Copyright (c) 2022 Service Robotics Lab) and the empty room of SFU-MARS/hunavis (Copyright (c)
2025 SFU MARS Lab). Files of your own are read from the folder in `RVSG_AGENTS_FILES`.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import rvsg
from rvsg.world.creation import world_from
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


def room(folder: Path, half_m: float) -> World:
    """A free room: what the maps of the files hold is not tested here."""
    side = round(2 * half_m / 0.1)
    pixels = np.full((side, side), 254, np.uint8)
    for edge in (pixels[:8], pixels[-8:], pixels[:, :8], pixels[:, -8:]):
        edge[:] = 0
    (folder / "map.pgm").write_bytes(b"P5\n%d %d\n255\n" % (side, side) + pixels.tobytes())
    (folder / "map.yaml").write_text(
        f"image: map.pgm\nresolution: 0.1\norigin: [{-half_m}, {-half_m}, 0]\nnegate: 0\noccupied_thresh: 0.65\n"
        "free_thresh: 0.196\n"
    )
    return world_from("map", folder / "map.yaml", name="room").world


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return room(tmp_path_factory.mktemp("room"), HALF_M)


def farthest(settings: dict[str, Any]) -> float:
    """The largest coordinate in a file, as a number or in what holds numbers."""
    known = [abs(float(value)) for key, value in settings.items() if key in ("x", "y")]
    return max([*known, *(farthest(value) for value in settings.values() if isinstance(value, dict))], default=0.0)


def run_of(file: Path, world: World) -> rvsg.Run:
    scenario, _ = import_agents(file, world, world.routes[0].name)
    (run,) = rvsg.simulate(scenario, [0], world=world)
    settings = yaml.safe_load(file.read_text())["hunav_loader"]["ros__parameters"]
    assert run.human_names == tuple(settings["agents"])
    assert run.completed or run.trajectory.t[-1] >= scenario.mission.route.time_limit_s
    assert np.isfinite(run.trajectory.human_x).all()
    for k, name in enumerate(settings["agents"]):
        start = settings[name]["init_pose"]
        path = run.trajectory
        assert np.hypot(path.human_x[0, k] - start["x"], path.human_y[0, k] - start["y"]) < 0.1
        assert np.hypot(np.diff(path.human_x[:, k]), np.diff(path.human_y[:, k])).sum() > 2.0, "the person walks"
    return run


@pytest.mark.parametrize(
    "made", [cafe_flat, *(pytest.param(made, marks=pytest.mark.exhaustive) for made in (room_block, cafe_v2))]
)
def test_people_of_public_files_run_to_the_end(made: Any, world: World, tmp_path: Path) -> None:
    file = tmp_path / "agents.yaml"
    file.write_text(yaml.safe_dump({"hunav_loader": {"ros__parameters": made()}}, sort_keys=False))
    run_of(file, world)


def test_the_cafe_is_the_same_scenario_in_both_dialects(world: World, tmp_path: Path) -> None:
    found = []
    for made in (cafe_flat, cafe_v2):
        file = tmp_path / f"{made.__name__}.yaml"
        file.write_text(yaml.safe_dump({"hunav_loader": {"ros__parameters": made()}}, sort_keys=False))
        scenario, _ = import_agents(file, world, world.routes[0].name)
        found.append([(human.name, human.behaviour, human.start, human.points) for human in scenario.people.humans])
    assert found[0] == found[1]


@pytest.mark.exhaustive
def test_agents_files_of_a_folder_run_to_the_end(tmp_path: Path) -> None:
    folder = os.environ.get("RVSG_AGENTS_FILES")
    files = sorted(Path(folder).glob("*.yaml")) if folder else []
    if not files:
        pytest.skip("RVSG_AGENTS_FILES names no folder with agents files")
    for file in files:
        settings = yaml.safe_load(file.read_text())["hunav_loader"]["ros__parameters"]
        (tmp_path / file.stem).mkdir()
        run_of(file, room(tmp_path / file.stem, 3.0 + farthest(settings)))
