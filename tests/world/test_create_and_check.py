"""A world folder made from a map, and everything that `rvsg world check` finds in one."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from shapely import Polygon
from tests.coded import coded
from tests.published_data import published_data

from rvsg.core import plugins
from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError, InputError
from rvsg.robots.robot import load_robot
from rvsg.world.areas import unknown_areas
from rvsg.world.checks import Remark, check_world
from rvsg.world.creation import Created, save_created, world_from
from rvsg.world.drawing import grid_picture, labelled_map
from rvsg.world.drawing.birdseye import birdseye
from rvsg.world.grid import GridSpec
from rvsg.world.rooms import areas_of_rooms
from rvsg.world.routes import propose_routes
from rvsg.world.schema import save_world
from rvsg.world.space import human_space, main_floor
from rvsg.world.world_folder import SHIPPED, load_world


def hall() -> np.ndarray:
    """20 x 12 m at 0.05 m: walls, two shelves with an aisle of 1.1 m between them, a pillar."""
    pixels = np.full((240, 400), 254, np.uint8)
    pixels[:3] = pixels[-3:] = 0
    pixels[:, :3] = pixels[:, -3:] = 0
    pixels[60:80, 60:160] = 0
    pixels[102:122, 60:160] = 0
    pixels[180:190, 300:310] = 0
    return pixels


def write_map(folder: Path, pixels: np.ndarray, origin: str = "[-3, 1, 0]") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(folder / "hall.pgm")
    (folder / "hall.yaml").write_text(
        f"image: hall.pgm\nresolution: 0.05\norigin: {origin}\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return folder / "hall.yaml"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Created]:
    folder = tmp_path_factory.mktemp("made")
    created = world_from("map", write_map(folder, hall()), name="hall")
    save_created(created, folder / "hall")
    return folder / "hall", created


@pytest.fixture
def folder(made: tuple[Path, Created], tmp_path: Path) -> Path:
    return Path(shutil.copytree(made[0], tmp_path / "hall"))


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


FILES = {"areas": "labels.yaml", "routes": "routes.yaml"}


def write_entries(folder: Path, kind: str, *entries: str) -> None:
    (folder / FILES[kind]).write_text(f"{kind}:\n" + "".join(f"  - {{{entry}}}\n" for entry in entries))


def found(remarks: tuple[Remark, ...], code: str, line: int | None = None) -> Remark:
    matching = [remark for remark in remarks if remark.code == code and line in (None, remark.problem.line)]
    assert matching, [str(remark) for remark in remarks]
    return matching[0]


def test_a_map_becomes_a_folder_that_reads_back_and_has_nothing_wrong(made: tuple[Path, Created]) -> None:
    folder, created = made
    world = load_world(folder)
    assert world.id == created.world.id
    assert len(world.areas) >= 4
    assert len(world.routes) == 3
    assert not [str(r) for r in check_world(folder) if r.serious]
    text = (folder / "README.md").read_text()
    assert "labels.yaml" in text
    assert (folder / "labels.yaml").read_text().startswith("# PROPOSED")


def test_proposed_routes_join_different_places_on_ways_the_robot_can_drive(made: tuple[Path, Created]) -> None:
    world = made[1].world
    assert len({(r.start.x, r.start.y) for r in world.routes}) == 3
    for route in propose_routes(world):
        assert all(world.grid.by_name[name].robot for name in route.via)
        assert set(zip(route.via, route.via[1:], strict=False)) <= {
            h for a, b in world.grid.hops for h in ((a, b), (b, a))
        }


def test_a_turned_map_is_laid_straight_and_says_so(tmp_path: Path) -> None:
    created = world_from("map", write_map(tmp_path, hall(), "[-3, 1, 0.3]"), name="hall")
    assert created.world.occupancy.origin.yaw == 0.0
    assert any("turned" in note for note in created.notes)


def test_a_map_on_which_nobody_fits_is_refused_by_name(tmp_path: Path) -> None:
    pixels = np.zeros((40, 40), np.uint8)
    pixels[18:22] = 254
    with pytest.raises(FileError, check=coded("grid-no-room")):
        world_from("map", write_map(tmp_path, pixels), name="hall")


ROOM = {"wall_1": (0, 5, 12, 0.2), "wall_2": (0, -5, 12, 0.2), "wall_3": (6, 0, 0.2, 10.2),
        "wall_4": (-6, 0, 0.2, 10.2), "rack": (0, 0, 4, 1)}  # fmt: skip
"""Middle and size of walls and a rack, 2 m high."""


def objects_yaml(things: dict[str, tuple[float, ...]]) -> str:
    return "objects:\n" + "".join(
        f"  - {{name: {name}, kind: {name.split('_')[0]}, box: {{center: [{x}, {y}, 1], size: [{w}, {h}, 2]}}}}\n"
        for name, (x, y, w, h) in things.items()
    )


def test_our_own_objects_and_a_gazebo_world_become_worlds_too(tmp_path: Path) -> None:
    (tmp_path / "o.yaml").write_text(objects_yaml(ROOM))
    links = "".join(
        f"<model name='{n}'><pose>{x} {y} 1 0 0 0</pose><link name='l'><collision name='c'><geometry><box>"
        f"<size>{w} {h} 2</size></box></geometry></collision></link></model>"
        for n, (x, y, w, h) in ROOM.items()
    )
    (tmp_path / "w.sdf").write_text(f"<sdf version='1.7'><world name='w'>{links}</world></sdf>")
    ours = world_from("objects", tmp_path / "o.yaml", name="w").world
    other = world_from("sdf", tmp_path / "w.sdf", name="w").world
    assert (other.occupancy.cells == ours.occupancy.cells).all()
    assert all("Rack" in {area.name for area in world.areas} for world in (ours, other))


def test_a_world_without_walls_gets_floor_round_its_objects(tmp_path: Path) -> None:
    (tmp_path / "o.yaml").write_text(objects_yaml({"rack_1": (0, 0, 4, 1), "rack_2": (0, 4, 4, 1)}))
    created = world_from("objects", tmp_path / "o.yaml", name="w")
    assert any("no wall encloses" in note for note in created.notes)
    assert created.world.occupancy.cells.shape == (180, 160)
    assert {"Rack 1", "Rack 2"} <= {area.name for area in created.world.areas}
    assert len(created.world.routes) >= 1
    wide = load_robot("tiago_omni").replace(footprint=((4, 4), (-4, 4), (-4, -4), (4, -4)))
    assert world_from("objects", tmp_path / "o.yaml", name="w", robot=wide).world.routes == ()


DESK = "name: Desk, rectangle: [3, 3, 5, 5]"


def way(start: str, goal: str = "{x: 8, y: 3}", limit: str = "60", name: str = "r") -> str:
    return f"name: {name}, start: {start}, goal: {goal}, time_limit_s: {limit}"


LABELS: dict[tuple[str, ...], list[tuple[str, int]]] = {
    ("name: In, rectangle: [0, 5, 2, 7]", "name: Out, rectangle: [50, 50, 60, 60]"): [("area-outside", 3)],
    ("name: A, rectangle: [0, 5, 2, 7]", "name: a, rectangle: [0, 5, 2, 7]"): [("area-alike", 3), ("area-twice", 3)],
    ("name: B5, rectangle: [3, 3, 5, 5]", 'name: " Desk", rectangle: [8, 3, 9, 5]'): [
        ("area-waypoint-name", 2), ("area-spaces", 3),
    ],
    ("name: A, rectangle: [0, 5, 2, 7], kind: Keep-out",): [("area-keepout", 2)],
    ("name: Bow, outline: [[0, 5], [2, 7], [2, 5], [0, 7]]",): [("document", 2)],
    ("name: A, rectangle: [0, 5, 2, 7], waypoints: [Z99]", "name: Far, rectangle: [90, 90, 95, 95]"): [
        ("unknown-waypoint", 2), ("area-outside", 3),
    ],
    (DESK, DESK, "name: Far, rectangle: [90, 90, 95, 95]"): [("name-twice", 3), ("area-outside", 4)],
}  # fmt: skip
ROUTES: dict[tuple[str, ...], list[tuple[str, int]]] = {
    (way("{x: 0.5, y: 9.5}"),): [("pose-in-obstacle", 2)],
    (way("{x: -9, y: 9}"),): [("pose-outside", 2)],
    (way("{x: 8, y: 5}", "{x: 8, y: 1.3}"),): [("pose-tight", 2)],
    (way("{x: 8, y: 5}", "{x: 8, y: 5.1}"),): [("route-goes-nowhere", 2)],
    (way("{x: 8, y: 1.48, yaw: 1.57}", "{x: 8, y: 5}"),): [("pose-touches", 2)],
    (way("{x: -1, y: 3}", "{x: 15, y: 3}", "4"),): [("route-hurried", 2)],
    (way("{x: 1.0e+9, y: 2, yaw: 0}"),): [("document", 2)],
    (way("ZZ9"), way("{x: 0, y: 2}", "{x: 90, y: 2}", name="b")): [
        ("unknown-waypoint", 2), ("pose-outside", 3),
    ],
    (
        way("{x: .nan, y: 2}", "{x: 400, y: 2}"),
        way("{x: 0, y: 2}", "ZZ9", "soon", name="b"),
        way("{x: 401, y: 2}", limit="60, via: [H155]", name="c"),
        "goal: {x: 403, y: 2}",
        way("{x: 0, y: 2}", limit="3, through: [{x: 404, y: 2}, ZZ8]", name="f"),
    ): [
        ("document", 2), ("pose-outside", 2), ("document", 3), ("unknown-waypoint", 3), ("unknown-waypoint", 4),
        ("pose-outside", 4), ("document", 5), ("pose-outside", 5), ("pose-outside", 6), ("unknown-waypoint", 6),
    ],
}  # fmt: skip
SUSPICIOUS = {
    "area-alike", "area-twice", "area-waypoint-name", "area-spaces", "pose-tight", "route-goes-nowhere",
    "route-hurried", "area-keepout",
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "entries", "expected"),
    [*(("areas", *case) for case in LABELS.items()), *(("routes", *case) for case in ROUTES.items())],
)
def test_every_mistake_of_a_file_is_told_at_once_each_with_its_line(
    folder: Path, kind: str, entries: tuple[str, ...], expected: list[tuple[str, int]]
) -> None:
    write_entries(folder, kind, *entries)
    remarks = check_world(folder)
    for code, line in expected:
        remark = found(remarks, code, line)
        assert remark.serious or code in SUSPICIOUS
        assert remark.problem.path.name == FILES[kind]
    assert len({str(remark) for remark in remarks}) == len(remarks)


@pytest.mark.parametrize(
    ("yaw", "radians"), [(90, "1.5708"), (45, "0.7854"), (180, "3.1416"), (270, "4.7124"), (-135, "-2.3562")]
)
def test_every_yaw_in_degrees_is_told_with_its_radians(folder: Path, yaw: int, radians: str) -> None:
    write_entries(folder, "routes", way(f"{{x: 0, y: 2, yaw: {yaw}}}"))
    (told,) = (r for r in check_world(folder) if str(r).endswith(radians))
    assert told.problem.line == 2


def test_an_area_no_waypoint_reaches_is_told_and_routes_only_where_there_are_none(folder: Path) -> None:
    edit(folder / "world.yaml", "spacing_m: 1.0", "spacing_m: 8.0")
    write_entries(folder, "areas", "name: Lonely, rectangle: [16.6, 12.6, 16.8, 12.8]")
    write_entries(folder, "routes", way("ZZ9"))
    remarks = check_world(folder)
    assert found(remarks, "area-no-waypoint").serious
    assert "routes-none" not in [remark.code for remark in remarks]
    (folder / "routes.yaml").write_text("routes: []\n")
    assert found(check_world(folder), "routes-none").serious


def divided(tmp_path: Path, spec: GridSpec, *unknown: tuple[slice, slice, int]) -> Path:
    """The folder of the hall with a wall across it, and with patches of cells."""
    pixels = hall()
    pixels[:, 200:204] = 0
    for rows, columns, value in unknown:
        pixels[rows, columns] = value
    created = world_from("map", write_map(tmp_path, pixels), name="hall", grid_spec=spec)
    save_world(created.world, tmp_path / "w")
    return tmp_path / "w"


def test_a_goal_behind_a_wall_cannot_be_planned(tmp_path: Path) -> None:
    folder = divided(tmp_path, GridSpec(spacing_m=1.0))
    write_entries(folder, "routes", way("{x: 0, y: 3}", "{x: 12, y: 3}"))
    assert found(check_world(folder), "route-no-way").serious


def test_isolated_parts_and_unknown_space_are_told(tmp_path: Path) -> None:
    patches = ((slice(5, 235), slice(210, 390), 205), (slice(100, 160), slice(260, 320), 254))
    remarks = check_world(divided(tmp_path, GridSpec(isolated_parts=True), *patches))
    for code in ("floor-isolated", "grid-isolated", "map-unknown"):
        found(remarks, code)


def test_an_aisle_the_grid_misses_is_named(folder: Path) -> None:
    write_entries(
        folder, "areas", "name: Rack 1, rectangle: [0, 9, 5, 10]", "name: Rack 2, rectangle: [0, 6.9, 5, 7.9]"
    )
    values = yaml.safe_load((folder / "world.yaml").read_text())
    values["grid"] |= {"origin": [0.0, 3.0], "spacing_m": 2.0}
    (folder / "world.yaml").write_text(yaml.safe_dump(values))
    assert found(check_world(folder), "aisle-missed").problem.path.name == "world.yaml"


def test_a_folder_without_world_and_a_broken_one_are_told(tmp_path: Path, folder: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileError, check=coded("world-missing")):
        check_world(tmp_path / "empty")
    (folder / "labels.yaml").write_text("areas: [")
    (folder / "routes.yaml").write_text("route: []")
    remarks = check_world(folder)
    assert {r.problem.path.name for r in remarks} == {"labels.yaml", "routes.yaml"}
    assert all(r.serious for r in remarks)


def _public_maps() -> list[Path]:
    data = published_data()
    return sorted((data / "maps").glob("*.yaml")) if data else []


@pytest.mark.exhaustive
@pytest.mark.skipif(not _public_maps(), reason="the public maps are not here")
@pytest.mark.parametrize("path", _public_maps(), ids=lambda path: path.stem)
def test_every_public_map_becomes_a_world_with_pictures_or_is_refused_with_a_reason(path: Path) -> None:
    if path.stem == "nav2_testmap":  # 1 x 1 m
        with pytest.raises(FileError, check=coded("grid-no-room")):
            world_from("map", path, name="w")
        return
    world = world_from("map", path, name="w").world
    assert len(world.grid.valid) >= 30
    assert len(world.grid.parts[0]) > 0.7 * len(world.grid.valid)
    assert len(world.areas) >= 4
    assert len(world.routes) == 3
    for picture in (draw(world, width_px=500) for draw in (labelled_map, grid_picture, birdseye)):
        assert len(picture.getcolors(maxcolors=1_000_000) or []) > 5


def test_doubled_routes_and_objects_do_not_hide_what_else_is_wrong(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(SHIPPED / "warehouse", tmp_path / "twice"))
    objects = (folder / "objects.yaml").read_text()
    entry = objects[objects.index("\n  - ") :].split("\n  - ")[1]
    (folder / "objects.yaml").write_text(f"{objects.rstrip()}\n  - {entry}\n")
    route = "name: r, start: {x: -0.1, y: -0.35}, goal: {x: 1.75, y: -8.6}, time_limit_s: 25"
    blocked = "name: r, start: {x: -0.1, y: -0.35}, goal: {x: 90, y: 90}, time_limit_s: 25"
    write_entries(folder, "routes", route, blocked, route)
    edit(folder / "world.yaml", "  - count the stock", "  - restock Shelf 99\n  - count the stock")
    remarks = check_world(folder)
    twice = [(r.problem.path.name, r.problem.line) for r in remarks if r.code == "name-twice"]
    assert [file for file, _ in twice] == ["objects.yaml", "routes.yaml", "routes.yaml"]
    assert [line for file, line in twice if file == "routes.yaml"] == [3, 4]
    found(remarks, "pose-outside", 3)
    assert not found(remarks, "activity-unknown-area").serious
    with pytest.raises(DocumentError) as caught:
        load_world(folder)
    assert len(caught.value.problems) == 3


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("pick from Shelf 9 and bring it to Large Shelf 1", ["Shelf 9"]),
        ("pick from shelf 2 and bring it to shelf  1", []),
        ("count Large Shelf 7, then Shelf 1", ["Large Shelf 7"]),
        ("empty the Wast Area", ["Wast Area"]),
        ("clean the waste area", []),
        ("Shelf 1 → Dock", ["Dock"]),
        ("Shelf 1 -> waste area", []),
        ("push 12 boxes along the wall, Mondays only", []),
        ("Two people restock a shelf", []),
        ("walk between Large Shelf 1 and Shelfs 1 and 2", []),
    ],
)
def test_an_activity_that_names_an_unknown_area_is_found_and_free_text_is_not(text: str, names: list[str]) -> None:
    known = ["Shelf 1", "Shelf 2", "Large Shelf 1", "Waste Area"]
    assert unknown_areas(text, known) == names


def test_an_activity_of_an_unknown_area_is_told_with_its_line_and_what_was_meant(folder: Path) -> None:
    write_entries(folder, "areas", "name: Desk 1, rectangle: [3, 3, 5, 5]", "name: Desk 2, rectangle: [7, 7, 9, 9]")
    with (folder / "world.yaml").open("a") as file:
        file.write("\nactivities:\n  - walk from Desk 1 to Desk 2\n  - tidy Desk 3\n")
    lines = (folder / "world.yaml").read_text().splitlines()
    (remark,) = (r for r in check_world(folder) if r.code == "activity-unknown-area")
    assert remark.problem.line == lines.index("  - tidy Desk 3") + 1
    assert remark.fix is not None  # it names the area that was meant


def test_without_its_reader_a_gazebo_world_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "_registered", lambda _kind: {})
    with pytest.raises(InputError, match=r"\[exchange\]", check=coded("format-not-installed")):
        world_from("sdf", tmp_path / "w.sdf", name="w")


def test_a_room_without_a_label_is_told_where_it_is(tmp_path: Path) -> None:
    folder = tmp_path / "office"
    shutil.copytree(SHIPPED / "office", folder)
    assert [r for r in check_world(folder) if r.problem.code == "room-unlabelled"] == []
    world = load_world("office")
    room = next(
        each for each in areas_of_rooms(human_space(world), main_floor(human_space(world))) if each.kind == "room"
    )
    shape = Polygon(room.outline)
    kept = [a for a in world.areas if Polygon(a.outline).intersection(shape).area < 0.05 * shape.area]
    listed = yaml.safe_load((folder / "labels.yaml").read_text())["areas"]
    names = {a.name for a in kept}
    (folder / "labels.yaml").write_text(yaml.safe_dump({"areas": [each for each in listed if each["name"] in names]}))
    told = [r for r in check_world(folder) if r.problem.code == "room-unlabelled"]
    assert len(told) == 1 and not told[0].serious and f"{shape.area:.0f} m2" in told[0].problem.message
    at, half = shape.representative_point(), 0.05  # one label in it is enough, however small it is
    small = {"name": "Small", "rectangle": [at.x - half, at.y - half, at.x + half, at.y + half]}
    listed = [*yaml.safe_load((folder / "labels.yaml").read_text())["areas"], small]
    (folder / "labels.yaml").write_text(yaml.safe_dump({"areas": listed}))
    assert "room-unlabelled" not in {r.problem.code for r in check_world(folder)}
