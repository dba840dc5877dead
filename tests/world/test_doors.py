"""Doors in a world's files, in its id and in what the checker says."""

from __future__ import annotations

from pathlib import Path

import pytest

from rvsg.core.documents import DocumentError
from rvsg.scenario.scenario import HumanConfiguration, Mission
from rvsg.scenario.validity import check
from rvsg.world.compare import differences
from rvsg.world.doors import Door
from rvsg.world.io.load import load_world
from rvsg.world.io.save import save_world

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
