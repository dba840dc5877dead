"""Doors in a world's files, in its id and in what the checker says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rvsg
from rvsg.app.campaign import Campaign
from rvsg.core.documents import DocumentError
from rvsg.core.errors import InvalidScenario, UnknownName
from rvsg.report.page import write_runs_page
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Scenario, Task
from rvsg.scenario.validity import check
from rvsg.scenario.variation import migrate
from rvsg.scenario.world_lookup import doors_in
from rvsg.search.run_set import judge
from rvsg.simulation.run import Outcome
from rvsg.world.diff import differences
from rvsg.world.lattice import with_doors
from rvsg.world.schema import save_world
from rvsg.world.space import driving_space, robot_space
from rvsg.world.world import Door, OrientedBox, SolidObject, State, World
from rvsg.world.world_folder import load_world

WORLD_YAML = "name: rooms\nmap: {from: objects}\nobjects: objects.yaml\ndoors: doors.yaml\n"
OBJECTS = """\
objects:
  - {name: wall, footprint: [[0, 0], [8, 0], [8, 5], [0, 5]], height: 2.5,
     holes: [[[0.1, 0.1], [7.9, 0.1], [7.9, 4.9], [0.1, 4.9]]]}
  - {name: low, box: {center: [4, 1, 1], size: [0.1, 1.8, 2]}}
  - {name: high, box: {center: [4, 4.1, 1], size: [0.1, 1.6, 2]}}
"""
ACROSS = "{name: across, start: {x: 1.5, y: 2.5}, goal: {x: 6.5, y: 2.5}, time_limit_s: 30}"
DOOR = "{name: Door, hinge: [4, 1.9], end: [4, 3.3], state: closed}"
NOBODY = HumanConfiguration(humans=())


def write(folder: Path, *doors: str, objects: str = OBJECTS, route: str = ACROSS, spacing_m: float = 1.0) -> Path:
    texts = {
        "world": f"{WORLD_YAML}actors: [trolley, wheelchair]\ngrid: {{spacing_m: {spacing_m}}}\n",
        "objects": objects,
        "labels": "areas: []\n",
        "routes": f"routes:\n  - {route}\n",
        "doors": f"doors: [{', '.join(doors)}]\n",
    }
    for name, text in texts.items():
        (folder / f"{name}.yaml").write_text(text)
    return folder


@pytest.fixture
def rooms(tmp_path: Path) -> Path:
    return write(tmp_path, DOOR)


def rules(world: World, mission: Mission, people: HumanConfiguration = NOBODY) -> list[str]:
    return [finding.rule for finding in check(people, mission, world)]


def test_doors_and_actors_are_read_and_written(rooms: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    world = load_world(rooms)
    assert [door.name for door in world.doors] == ["Door"]
    assert world.actors == ("trolley", "wheelchair")
    copy = tmp_path_factory.mktemp("copy")
    save_world(world, copy)
    again = load_world(copy)
    assert again.doors == world.doors and again.actors == world.actors and again.floor_id == world.floor_id


@pytest.mark.parametrize(
    "wrong", ["end: [4, 2.0]", "end: [4, 3.3], state: ajar", "end: [4, 3.3], colour: red", "end: [4]"]
)
def test_a_mistake_in_a_door_is_told_with_its_line(tmp_path: Path, wrong: str) -> None:
    write(tmp_path, f"\n  {{name: Door, hinge: [4, 1.9], {wrong}}}")
    with pytest.raises(DocumentError) as caught:
        load_world(tmp_path)
    assert {(problem.path.name, problem.line) for problem in caught.value.problems} == {("doors.yaml", 2)}


def test_a_leaf_swings_and_slides() -> None:
    swing = Door(name="a", hinge=(0, 0), end=(1, 0))
    assert max(y for _, y in swing.leaf(1.0)) == pytest.approx(1.0)
    assert min(y for _, y in swing.model_copy(update={"turns": "right"}).leaf(1.0)) == pytest.approx(-1.0)
    sliding = Door(name="b", hinge=(0, 0), end=(1, 0), kind="sliding")
    assert max(x for x, _ in sliding.leaf(1.0)) == pytest.approx(0.0)
    assert sliding.model_copy(update={"state": "open"}).still is None


def test_a_closed_door_across_the_only_way_is_found_and_blocks_hops(tmp_path: Path) -> None:
    shut = load_world(write(tmp_path, DOOR))
    route = shut.routes[0]
    assert rules(shut, Mission.of(shut, route)) == ["door-blocks-route"]
    world = load_world(write(tmp_path, DOOR.replace("closed", "automatic")))
    assert rules(world, Mission.of(world, route)) == []
    assert [(d.part, d.matters) for d in differences(shut, world) if d.part == "doors"] == [("doors", True)]
    way = world.grid.shortest_path(world.grid.nearest(3.0, 2.6), world.grid.nearest(5.0, 2.6))
    assert way is not None
    walks = (Task.between(way[0], way[-1], way), Task.between(way[-1], way[0], way[::-1]))
    people = HumanConfiguration(humans=(Human(name="Ada", tasks=walks),))
    assert rules(world, Mission.of(world, route), people) == []
    closed = Mission.of(world, route, doors={"Door": "closed"})
    found = check(people, closed, world)
    assert {f.rule for f in found} >= {"door-blocks-route"}
    assert {f.rule for f in found} & {"door-closed", "invalid-waypoint"}
    assert all("Door" in f.reason for f in found)
    assert closed.place(world).grid.shortest_path(way[0], way[-1]) is None


def test_a_door_that_does_not_exist_is_a_finding(rooms: Path) -> None:
    world = load_world(rooms)
    (found,) = check(NOBODY, Mission.of(world, world.routes[0], doors={"Door": "open", "Gate": "closed"}), world)
    assert found.rule == "unknown-door" and "Gate" in found.reason
    with pytest.raises(UnknownName):
        doors_in(world, {"Gate": "closed"})


def test_a_closed_door_counts_in_the_distance_to_obstacles(rooms: Path) -> None:
    world = load_world(rooms)
    assert driving_space(with_doors(world, {"Door": "automatic"})).clearance(4.0, 2.6) > 0.5
    assert driving_space(world).clearance(4.0, 2.6) == 0.0
    assert robot_space(world).clearance(4.0, 2.6) > 0.5


@pytest.mark.exhaustive
def test_a_robot_takes_another_way_where_a_door_is_closed(tmp_path: Path) -> None:
    objects = """\
objects:
  - {name: wall, footprint: [[0, 0], [12, 0], [12, 10], [0, 10]], height: 2.5,
     holes: [[[0.1, 0.1], [11.9, 0.1], [11.9, 9.9], [0.1, 9.9]]]}
  - {name: low, box: {center: [6, 1.15, 1], size: [0.1, 2.1, 2]}}
  - {name: middle, box: {center: [6, 5.1, 1], size: [0.1, 3.0, 2]}}
  - {name: high, box: {center: [6, 9.0, 1], size: [0.1, 2.0, 2]}}
"""
    route = ACROSS.replace("x: 6.5", "x: 10.5").replace("30", "90")
    south = "{name: South, hinge: [6, 2.2], end: [6, 3.6], kind: sliding, state: open}"
    north = "{name: North, hinge: [6, 6.6], end: [6, 8.0], kind: sliding, state: open}"
    write(tmp_path, south, north, objects=objects, route=route, spacing_m=0.7)
    crossed: dict[State, float] = {}
    for state in ("open", "closed"):
        made = rvsg.scenario(tmp_path, "across", doors={"South": state})
        runs = rvsg.simulate(made, seeds=1, world=tmp_path)
        way = runs[0].trajectory
        assert runs[0].outcome is Outcome.REACHED
        crossed[state] = float(way.y[np.abs(way.x - 6.0).argmin()])
        page = tmp_path / f"{state}.html"
        write_runs_page(page, judge(runs, "R1", scenario=made), runs, scenario=made, world=tmp_path)
        assert f"South is {state}" in page.read_text()
    assert crossed["open"] < 4.0 and crossed["closed"] > 6.5


def test_a_scenario_opens_and_closes_doors_and_the_world_stays_the_same(rooms: Path) -> None:
    world = load_world(rooms)
    route = world.routes[0]
    opened = with_doors(world, {"Door": "automatic"})
    assert (opened.id, opened.parts, opened.doors) == (world.id, world.parts, world.doors)
    assert opened.place_id != world.id and opened.still_doors == () and len(opened.moving_doors) == 1
    mission = Mission.of(opened, route)
    assert mission.doors == {"Door": "automatic"} and mission.id != Mission.of(world, route).id
    assert mission.place(world).grid == opened.grid
    assert rules(world, mission) == []
    again = with_doors(opened, {})
    assert again.grid == world.grid and again.place_id == world.id


def test_a_campaign_whose_only_way_is_closed_does_not_begin(rooms: Path) -> None:
    with pytest.raises(InvalidScenario):
        Campaign.create(world=str(rooms), route="across", out=str(rooms / "campaign"))
    assert not (rooms / "campaign").exists()
    assert Campaign.create(world=str(rooms), route="across", doors={"Door": "open"}, out=str(rooms / "c")).plan


def test_a_migrated_scenario_keeps_its_doors_and_moved_objects(rooms: Path) -> None:
    world = load_world(rooms)
    crate = SolidObject(
        name="crate", kind="crate", origin=(2, 4, 0), box=OrientedBox(center=(2, 4, 0.5), size=(0.5, 0.5, 1.0)),
        footprint=((1.75, 3.75), (2.25, 3.75), (2.25, 4.25), (1.75, 4.25)), slices=(),
    )  # fmt: skip
    mission = Mission.of(world, world.routes[0], moved=(crate,), doors={"Door": "open"})
    scenario = Scenario(mission=mission, people=NOBODY)
    migrated, _ = migrate(scenario, world)
    assert migrated.mission == mission
