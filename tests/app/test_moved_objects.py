"""Objects that a scenario moves into the robot's way: solid, seen by the lidar, and not on the robot's map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.cli.commands import Terminal

import rvsg
from rvsg.core.errors import FileError, InvalidScenario
from rvsg.scenario.builder import load_scenario, save_scenario
from rvsg.world.world import World
from rvsg.world.world_folder import load_world

PALLET = "objects:\n  - {name: pallet, kind: pallet, box: {center: [%s, %s, 0.5], size: [0.8, 0.6, 1.0]}}\n"


@pytest.fixture(scope="module")
def world() -> World:
    return load_world("warehouse")


def pallet(folder: Path, x: float, y: float) -> Path:
    path = folder / "pallet.yaml"
    path.write_text(PALLET % (x, y))
    return path


def on_the_way(world: World) -> tuple[float, float]:
    """Return the middle of the way the robot drives on route_1 with nothing about."""
    path = rvsg.simulate(rvsg.scenario(world, "route_1"), seeds=1)[0].trajectory
    half = len(path) // 2
    return round(float(path.x[half]), 2), round(float(path.y[half]), 2)


def test_the_robot_drives_round_what_its_map_does_not_show(world: World, tmp_path: Path) -> None:
    x, y = on_the_way(world)
    made = rvsg.scenario(world, "route_1", moved=pallet(tmp_path, x, y))
    assert made.id != rvsg.scenario(world, "route_1").id
    assert made.mission.world_id == world.id
    run = rvsg.simulate(made, seeds=1)[0]
    assert run.completed
    away = np.maximum(np.abs(run.trajectory.x - x) - 0.4, np.abs(run.trajectory.y - y) - 0.3)
    assert away.min() > 0.2
    assert rvsg.simulate(made, seeds=1)[0].trajectory.x.tolist() == run.trajectory.x.tolist()


def test_a_scenario_is_stored_with_its_moved_objects_alone(world: World, tmp_path: Path) -> None:
    made = rvsg.scenario(world, "route_1", moved=pallet(tmp_path, *on_the_way(world)))
    save_scenario(made, tmp_path / "s.json")
    assert load_scenario(tmp_path / "s.json") == made
    assert "moved" not in rvsg.scenario(world, "route_1").mission.model_dump(mode="json")


@pytest.mark.parametrize(
    ("at", "says"),
    [((90.0, 90.0), "outside the map"), ((None, None), "where the robot starts")],
)
def test_what_stands_in_the_wrong_place_is_refused(
    world: World, tmp_path: Path, at: tuple[float | None, float | None], says: str
) -> None:
    start = world.route("route_1").start
    x, y = (start.x, start.y) if at[0] is None or at[1] is None else (at[0], at[1])
    with pytest.raises(InvalidScenario) as refused:
        rvsg.scenario(world, "route_1", moved=pallet(tmp_path, x, y))
    assert any(says in finding for finding in refused.value.findings)


def test_people_are_refused_a_way_through_a_moved_object(world: World, tmp_path: Path) -> None:
    a, b = next((a, b) for a, b in world.grid.hops)
    (ax, ay), (bx, by) = world.grid.position(a), world.grid.position(b)
    moved = pallet(tmp_path, (ax + bx) / 2, (ay + by) / 2)
    with pytest.raises(InvalidScenario):
        rvsg.scenario(world, "route_1", [rvsg.walk("Anna", a, b)], moved=moved)


def test_objects_that_close_the_only_way_are_refused(world: World, tmp_path: Path) -> None:
    start = world.route("route_1").start
    around = ((-1.5, 0.0, 0.1, 3.0), (1.5, 0.0, 0.1, 3.0), (0.0, -1.5, 3.0, 0.1), (0.0, 1.5, 3.0, 0.1))
    entries = (
        f"  - {{name: wall {i}, kind: wall, box: {{center: [{start.x + x}, {start.y + y}, 1], size: [{w}, {h}, 2]}}}}\n"
        for i, (x, y, w, h) in enumerate(around)
    )
    (tmp_path / "wall.yaml").write_text("objects:\n" + "".join(entries))
    with pytest.raises(InvalidScenario) as refused:
        rvsg.scenario(world, "route_1", moved=tmp_path / "wall.yaml")
    assert any("no way" in finding for finding in refused.value.findings)


def test_a_file_of_them_is_checked_like_objects(world: World, tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("objects:\n  - {name: pallet}\n")
    with pytest.raises(FileError) as wrong:
        rvsg.scenario(world, "route_1", moved=tmp_path / "bad.yaml")
    assert wrong.value.line == 2


def test_a_campaign_meets_them_and_can_be_opened_again(terminal: Terminal, world: World, tmp_path: Path) -> None:
    pallet(tmp_path, *on_the_way(world))
    few = "--scenarios 1 --refinements 0 --repeats 1 --confirmations 0 --jobs 1"
    for _ in range(2):
        terminal("run --moved pallet.yaml --out c", few)
    campaign = rvsg.Campaign.open("c")
    assert [thing.name for thing in campaign.plan.mission.moved] == ["pallet"]
    assert [thing.name for thing in campaign.world.moved] == ["pallet"]
