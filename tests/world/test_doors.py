"""Doors in a world's files, in its id and in what the checker says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rvsg
from rvsg.app.campaign import Campaign
from rvsg.campaign.run_set import judge
from rvsg.core.documents import DocumentError
from rvsg.core.errors import InvalidScenario, UnknownName
from rvsg.report.page import write_runs_page
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Scenario, Task
from rvsg.scenario.validity import check
from rvsg.scenario.variation import migrate
from rvsg.scenario.world_lookup import doors_in
from rvsg.simulation.run import Outcome
from rvsg.world.diff import differences
from rvsg.world.lattice import with_doors
from rvsg.world.schema import save_world
from rvsg.world.space import driving_space, robot_space
from rvsg.world.world import Door, OrientedBox, SolidObject, State, World
from rvsg.world.world_folder import load_world

FILES = {
    "world.yaml": "name: rooms\nmap: {from: objects}\nobjects: objects.yaml\ndoors: doors.yaml\n"
    "actors: [trolley, wheelchair]\ngrid: {spacing_m: 1.0}\n",
    "objects.yaml": """\
objects:
  - {name: wall, footprint: [[0, 0], [8, 0], [8, 5], [0, 5]], height: 2.5,
     holes: [[[0.1, 0.1], [7.9, 0.1], [7.9, 4.9], [0.1, 4.9]]]}
  - {name: low, box: {center: [4, 1, 1], size: [0.1, 1.8, 2]}}
  - {name: high, box: {center: [4, 4.1, 1], size: [0.1, 1.6, 2]}}
""",
    "labels.yaml": "areas: []\n",
    "routes.yaml": "routes:\n  - {name: across, start: {x: 1.5, y: 2.5}, goal: {x: 6.5, y: 2.5}, time_limit_s: 30}\n",
    "doors.yaml": "doors:\n  - {name: Door, hinge: [4, 1.9], end: [4, 3.3], state: closed}\n",
}


@pytest.fixture
def rooms(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_doors_and_actors_are_read_and_written(rooms: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    world = load_world(rooms)
    assert [door.name for door in world.doors] == ["Door"]
    assert world.actors == ("trolley", "wheelchair")
    copy = tmp_path_factory.mktemp("copy")
    save_world(world, copy)
    again = load_world(copy)
    assert again.doors == world.doors and again.actors == world.actors and again.floor_id == world.floor_id


def test_a_closed_door_across_the_only_way_is_found(rooms: Path) -> None:
    world = load_world(rooms)
    nobody = HumanConfiguration(humans=())
    assert [f.rule for f in check(nobody, Mission.of(world, world.routes[0]), world)] == ["door-blocks-route"]
    (rooms / "doors.yaml").write_text(FILES["doors.yaml"].replace("closed", "automatic"))
    opened = load_world(rooms)
    assert check(nobody, Mission.of(opened, opened.routes[0]), opened) == ()
    assert [(d.part, d.matters) for d in differences(world, opened) if d.part == "doors"] == [("doors", True)]


@pytest.mark.parametrize(
    ("wrong", "line"),
    [("end: [4, 2.0]", 2), ("end: [4, 3.3], state: ajar", 2), ("end: [4, 3.3], colour: red", 2), ("end: [4]", 2)],
)
def test_a_mistake_in_a_door_is_told_with_its_line(rooms: Path, wrong: str, line: int) -> None:
    (rooms / "doors.yaml").write_text(f"doors:\n  - {{name: Door, hinge: [4, 1.9], {wrong}}}\n")
    with pytest.raises(DocumentError) as caught:
        load_world(rooms)
    assert {(problem.path.name, problem.line) for problem in caught.value.problems} == {("doors.yaml", line)}


def test_a_leaf_swings_and_slides() -> None:
    swing = Door(name="a", hinge=(0, 0), end=(1, 0))
    assert max(y for _, y in swing.leaf(1.0)) == pytest.approx(1.0)
    assert min(y for _, y in swing.model_copy(update={"turns": "right"}).leaf(1.0)) == pytest.approx(-1.0)
    sliding = Door(name="b", hinge=(0, 0), end=(1, 0), kind="sliding")
    assert max(x for x, _ in sliding.leaf(1.0)) == pytest.approx(0.0)
    assert sliding.model_copy(update={"state": "open"}).still is None


def _two(world: World, path: tuple[str, ...]) -> HumanConfiguration:
    there = Task.between(path[0], path[-1], path)
    return HumanConfiguration(humans=(Human(name="Ada", tasks=(there, Task.between(path[-1], path[0], path[::-1]))),))


def test_a_scenario_opens_and_closes_doors_and_the_world_stays_the_same(rooms: Path) -> None:
    world = load_world(rooms)
    route = world.routes[0]
    opened = with_doors(world, {"Door": "automatic"})
    assert (opened.id, opened.parts, opened.doors) == (world.id, world.parts, world.doors)
    assert opened.place_id != world.id and opened.still_doors == () and len(opened.moving_doors) == 1
    mission = Mission.of(opened, route)
    assert mission.doors == {"Door": "automatic"} and mission.id != Mission.of(world, route).id
    assert mission.place(world).grid == opened.grid
    assert check(HumanConfiguration(humans=()), mission, world) == ()
    again = with_doors(opened, {})
    assert again.grid == world.grid and again.place_id == world.id


def test_a_campaign_whose_only_way_is_closed_does_not_begin(rooms: Path) -> None:
    with pytest.raises(InvalidScenario):
        Campaign.create(world=str(rooms), route="across", out=str(rooms / "campaign"))
    assert not (rooms / "campaign").exists()
    assert Campaign.create(world=str(rooms), route="across", doors={"Door": "open"}, out=str(rooms / "c")).plan


def test_a_hop_through_a_closed_door_is_refused_with_the_reason(rooms: Path) -> None:
    (rooms / "doors.yaml").write_text(FILES["doors.yaml"].replace("closed", "automatic"))
    world = load_world(rooms)
    route = world.routes[0]
    way = world.grid.shortest_path(world.grid.nearest(3.0, 2.6), world.grid.nearest(5.0, 2.6))
    assert way is not None
    people = _two(world, way)
    assert check(people, Mission.of(world, route), world) == ()
    closed = Mission.of(world, route, doors={"Door": "closed"})
    found = check(people, closed, world)
    assert {f.rule for f in found} >= {"door-blocks-route"}
    assert {f.rule for f in found} & {"door-closed", "invalid-waypoint"}
    assert all("Door" in f.reason for f in found)
    place = closed.place(world)
    assert place.grid.shortest_path(way[0], way[-1]) is None


def test_a_door_that_does_not_exist_is_a_finding(rooms: Path) -> None:
    world = load_world(rooms)
    mission = Mission.of(world, world.routes[0], doors={"Door": "open", "Gate": "closed"})
    found = check(HumanConfiguration(humans=()), mission, world)
    assert [f.rule for f in found] == ["unknown-door"] and "Gate" in found[0].reason
    with pytest.raises(UnknownName):
        doors_in(world, {"Gate": "closed"})


def test_a_migrated_scenario_keeps_its_doors_and_moved_objects(rooms: Path) -> None:
    world = load_world(rooms)
    crate = SolidObject(
        name="crate", kind="crate", origin=(2, 4, 0), box=OrientedBox(center=(2, 4, 0.5), size=(0.5, 0.5, 1.0)),
        footprint=((1.75, 3.75), (2.25, 3.75), (2.25, 4.25), (1.75, 4.25)), slices=(),
    )  # fmt: skip
    mission = Mission.of(world, world.routes[0], moved=(crate,), doors={"Door": "open"})
    scenario = Scenario(mission=mission, people=HumanConfiguration(humans=()))
    migrated, _ = migrate(scenario, world)
    assert migrated.mission == mission


def test_a_moved_object_and_a_closed_door_count_in_the_distance_to_obstacles(rooms: Path) -> None:
    world = load_world(rooms)
    opened = with_doors(world, {"Door": "automatic"})
    assert driving_space(opened).clearance(4.0, 2.6) > 0.5
    assert driving_space(world).clearance(4.0, 2.6) == 0.0
    assert robot_space(world).clearance(4.0, 2.6) > 0.5


@pytest.mark.exhaustive
def test_a_robot_takes_another_way_where_a_door_is_closed(tmp_path: Path) -> None:
    (tmp_path / "world.yaml").write_text(FILES["world.yaml"].replace("spacing_m: 1.0", "spacing_m: 0.7"))
    (tmp_path / "labels.yaml").write_text(FILES["labels.yaml"])
    (tmp_path / "objects.yaml").write_text("""\
objects:
  - {name: wall, footprint: [[0, 0], [12, 0], [12, 10], [0, 10]], height: 2.5,
     holes: [[[0.1, 0.1], [11.9, 0.1], [11.9, 9.9], [0.1, 9.9]]]}
  - {name: low, box: {center: [6, 1.15, 1], size: [0.1, 2.1, 2]}}
  - {name: middle, box: {center: [6, 5.1, 1], size: [0.1, 3.0, 2]}}
  - {name: high, box: {center: [6, 9.0, 1], size: [0.1, 2.0, 2]}}
""")
    (tmp_path / "routes.yaml").write_text(
        "routes: [{name: across, start: {x: 1.5, y: 2.5}, goal: {x: 10.5, y: 2.5}, time_limit_s: 90}]"
    )
    (tmp_path / "doors.yaml").write_text(
        "doors:\n  - {name: South, hinge: [6, 2.2], end: [6, 3.6], kind: sliding, state: open}\n"
        "  - {name: North, hinge: [6, 6.6], end: [6, 8.0], kind: sliding, state: open}\n"
    )
    crossed: dict[State, float] = {}
    for state in ("open", "closed"):
        made = rvsg.scenario(tmp_path, "across", doors={"South": state})
        runs = rvsg.simulate(made, seeds=1, world=tmp_path)
        way = runs[0].trajectory
        assert runs[0].outcome is Outcome.REACHED
        crossed[state] = float(way.y[np.abs(way.x - 6.0).argmin()])
        write_runs_page(
            tmp_path / f"{state}.html", judge(runs, "R1", scenario=made), runs, scenario=made, world=tmp_path
        )
        assert f"South is {state}" in (tmp_path / f"{state}.html").read_text()
    assert crossed["open"] < 4.0 and crossed["closed"] > 6.5
