"""World folders: what is read, every mistake in its file and line, and the example of the documentation."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from tests.coded import at_key, coded, nearest

from rvsg.core.documents import DocumentError, parse_yaml, validated
from rvsg.core.errors import FileError, RvsgError, UnknownName
from rvsg.world.grid import GridSpec
from rvsg.world.schema import AreaEntry, LabelsFile, ObjectEntry, RouteEntry, WorldFile, save_world
from rvsg.world.space import human_space, robot_space
from rvsg.world.world import Description
from rvsg.world.world_folder import load_world, shipped_worlds

WORLD = """\
name: room
title: A room
map: {from: objects}
objects: objects.yaml
grid: {spacing_m: 1.0}
"""
OBJECTS = """\
objects:
  - {name: wall, footprint: [[0, 0], [6, 0], [6, 5], [0, 5]], height: 2.5,
     holes: [[[0.1, 0.1], [5.9, 0.1], [5.9, 4.9], [0.1, 4.9]]]}
  - {name: table, box: {center: [3, 2.5, 0.7], size: [1.4, 0.8, 0.1]}}
"""
LABELS = """\
areas:
  - {name: Table, kind: desk, rectangle: [2.2, 2, 3.8, 3]}
  - {name: Corner, kind: floor, rectangle: [0.2, 0.2, 2.2, 1.8]}
"""
ROUTES = """\
routes:
  - {name: across, start: A1, goal: {x: 5, y: 0.7}, time_limit_s: 30, via: [A1, B1]}
"""


@pytest.fixture
def room(tmp_path: Path) -> Path:
    for name, text in (("world", WORLD), ("objects", OBJECTS), ("labels", LABELS), ("routes", ROUTES)):
        (tmp_path / f"{name}.yaml").write_text(text)
    return tmp_path


def edited(file: str, old: str, new: str) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        text = (folder / file).read_text()
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1))

    return edit


def test_a_folder_written_by_hand_becomes_a_world(room: Path) -> None:
    world = load_world(room)
    assert world.title == "A room"
    assert world.grid.spacing_m == 1.0
    assert world.route("across").start.x == world.grid.position("A1")[0]
    assert load_world(room / "world.yaml").id == world.id


def test_a_table_above_the_lidar_plane_stops_a_person_but_is_not_on_the_map(room: Path) -> None:
    world = load_world(room)
    table = next(thing for thing in world.objects if thing.name == "table")
    assert table.slices == ()
    assert all(not (2.3 < w.x < 3.7 and 2.1 < w.y < 2.9) for w in world.grid.waypoints if w.human)
    assert any(w.robot and not w.human for w in world.grid.waypoints)


@pytest.mark.parametrize("name", shipped_worlds())
def test_a_saved_world_reads_back_equal(name: str, tmp_path: Path) -> None:
    words = Description(layout='Shelves: "six" of them.\n\nAnd a # sign, äöü.', grid="Rows: A to D.", reviewed=True)
    for world in (load_world(name), replace(load_world(name), description=words)):
        save_world(world, tmp_path / "copy")
        copy = load_world(tmp_path / "copy")
        assert copy.id == world.id
        assert (copy.title, copy.activities, copy.description) == (world.title, world.activities, world.description)
        assert copy.objects == world.objects


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (edited("world.yaml", "name: room", "format: 2\nname: room"), ("world.yaml", 1)),
        (edited("world.yaml", "title", "tilte"), ("world.yaml", 2)),
        (edited("world.yaml", "1.0", "-1.0"), ("world.yaml", 5)),
        (edited("world.yaml", "{from: objects}", "map.yaml"), ("map.yaml", None)),
        (edited("world.yaml", "{from: objects}", "../map.yaml"), ("world.yaml", None)),
        (edited("world.yaml", "spacing_m: 1.0", "human_clearance_m: 4.9"), ("world.yaml", 5)),
        (edited("objects.yaml", "height: 2.5,", ""), ("objects.yaml", 2)),
        (edited("objects.yaml", "name: table", "name: wall"), ("objects.yaml", 4)),
        (edited("labels.yaml", "Corner", "Table"), ("labels.yaml", 3)),
        (edited("labels.yaml", "rectangle: [2.2,", "outline: [2.2,"), ("labels.yaml", 2)),
        (
            edited("labels.yaml", "rectangle: [2.2, 2, 3.8, 3]", "outline: [[2, 2], [4, 3], [4, 2], [2, 3]]"),
            ("labels.yaml", 2),
        ),
        (edited("labels.yaml", "3]}", "3], waypoints: [A1, ZZ9]}"), ("labels.yaml", 2)),
        (edited("routes.yaml", "start: A1", "start: A11"), ("routes.yaml", 2)),
        (edited("routes.yaml", "30", "0"), ("routes.yaml", 2)),
        (lambda folder: (folder / "routes.yaml").unlink(), ("routes.yaml", None)),
    ],
)
def test_a_mistake_has_file_and_line(
    room: Path, edit: Callable[[Path], None], expected: tuple[str, int | None]
) -> None:
    edit(room)
    with pytest.raises(DocumentError) as caught:
        load_world(room)
    assert {(problem.path.name, problem.line) for problem in caught.value.problems} == {expected}


def test_a_place_where_no_world_is_says_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(FileError) as empty:
        load_world(tmp_path)
    assert empty.value.path == tmp_path
    with pytest.raises(UnknownName, check=nearest("warehouse")):
        load_world("warehuose")
    (tmp_path / "file").touch()
    with pytest.raises(FileError) as file:
        load_world(tmp_path / "file")
    assert file.value.path == tmp_path / "file"


def test_a_folder_that_cannot_be_written_is_one_clear_message(room: Path) -> None:
    (room / "blocked").write_text("a file, not a folder")
    with pytest.raises(RvsgError, check=coded("world-not-written")):
        save_world(load_world(room), room / "blocked")


def test_an_activity_may_say_whether_it_needs_a_trolley(tmp_path: Path) -> None:
    world = load_world("office")
    work = ("take parcels to the kitchen", "push chairs aside")
    save_world(replace(world, activities=work, trolley_work={work[0]: True}), tmp_path)
    again = load_world(tmp_path)
    assert again.activities == work
    assert [again.needs_trolley(text) for text in work] == [True, True]
    (tmp_path / "world.yaml").write_text(
        (tmp_path / "world.yaml").read_text().replace("trolley: true", "trolley: false")
    )
    assert [load_world(tmp_path).needs_trolley(text) for text in work] == [False, True]


@pytest.mark.parametrize("name", ["no", "12", "2001-01-01"])
def test_a_name_that_yaml_reads_as_something_else_is_told_to_be_quoted(name: str) -> None:
    text = f"areas:\n  - {{name: {name}, rectangle: [0, 0, 1, 1]}}\n"
    with pytest.raises(DocumentError, check=at_key("areas", 0, "name")) as caught:
        validated(parse_yaml(text, Path("labels.yaml")), LabelsFile)
    assert "quotes" in caught.value.reason  # what to do


PAGE = Path(__file__).parents[2] / "docs" / "reference" / "world-files.md"


@pytest.fixture
def documented_room(tmp_path: Path) -> Path:
    folder = tmp_path / "room"
    folder.mkdir()
    files = re.findall(r"^`(\w+\.yaml)`\n\n```yaml\n(.*?)```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    assert [name for name, _ in files] == ["world.yaml", "objects.yaml", "labels.yaml", "routes.yaml"]
    for name, text in files:
        (folder / name).write_text(text)
    return folder


def test_the_example_is_a_world(documented_room: Path) -> None:
    world = load_world(documented_room)
    assert world.title == "Meeting room"
    assert [area.name for area in world.areas] == ["Table", "Coffee Shelf"]
    assert all(area.waypoints for area in world.areas)
    start, goal = world.routes[0].start, world.routes[0].goal
    assert robot_space(world).is_free(start.x, start.y, 0.3) and robot_space(world).is_free(goal.x, goal.y, 0.3)
    assert not human_space(world).is_free(3.0, 2.5)


MISTAKES = """\
3 things are wrong:
  - room/world.yaml:2: there is no key "tilte". Did you mean "title"? Known: format, name, title, map
  - room/labels.yaml:4: areas[0].rectangle[2]: expected a number, got 'wide'
  - room/routes.yaml:2: routes[0]: "start" is missing"""


def test_all_mistakes_of_all_files_are_listed(documented_room: Path) -> None:
    for file, old, new in (
        ("world.yaml", "format: 1\nname: room\ntitle", "name: room\ntilte"),
        ("labels.yaml", "2.1, 3.8", "2.1, wide"),
        ("routes.yaml", "    start: {x: 0.8, y: 0.8, yaw: 0.0}\n", ""),
    ):
        text = (documented_room / file).read_text()
        assert old in text
        (documented_room / file).write_text(text.replace(old, new))
    with pytest.raises(DocumentError) as caught:
        load_world(documented_room)
    given = str(caught.value).replace(str(documented_room.parent) + "/", "").splitlines()
    for line, said in zip(given, MISTAKES.splitlines(), strict=True):
        assert line.startswith(said)


@pytest.mark.parametrize("model", [WorldFile, GridSpec, ObjectEntry, AreaEntry, RouteEntry])
def test_every_key_is_on_the_page(model: type) -> None:
    page = PAGE.read_text()
    for name, field in model.model_fields.items():  # type: ignore[attr-defined]
        assert f"`{field.alias or name}`" in page or f"{field.alias or name}:" in page, name
