"""Floor plans as pictures and as SVG: what is written where, also of a hall of 100 x 100 m."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.coded import coded, nearest
from tests.world.parts import map_of, walled

from rvsg.core.errors import InputError, UnknownName
from rvsg.world.drawing import grid_picture, labelled_map, png_bytes
from rvsg.world.drawing.birdseye import birdseye
from rvsg.world.drawing.floor_plan import GRID, LABELLED, DrawnPlan, draw_plan, tiles
from rvsg.world.drawing.layers import time_marks
from rvsg.world.drawing.sheet import PALETTES
from rvsg.world.drawing.svg import floor_plan, floor_plan_svg, rectangles
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import build_world
from rvsg.world.occupancy import load_nav2_map, occupancy_from_objects, write_map
from rvsg.world.schema import ObjectEntry
from rvsg.world.world import Area, OccupancyMap, World
from rvsg.world.world_folder import load_world, shipped_worlds


@pytest.mark.parametrize(
    "name",
    [name if name == "warehouse" else pytest.param(name, marks=pytest.mark.exhaustive) for name in shipped_worlds()],
)
@pytest.mark.parametrize("show", [LABELLED, GRID], ids=["labelled", "grid"])
@pytest.mark.parametrize("with_route", [False, True], ids=["bare", "route"])
def test_no_word_covers_another_in_any_shipped_world(name: str, show: frozenset[str], with_route: bool) -> None:
    world = load_world(name)
    for route in world.routes[:2] if with_route else (None,):
        picture = draw_plan(world, show=show, route=route)
        assert overlaps(picture) == []
        width, height = picture.image.size
        for word in picture.words:
            assert word.box[0] >= 0 and word.box[1] >= 0 and word.box[2] <= width and word.box[3] <= height, word
            assert word.size >= 10


def test_the_warehouse_is_drawn_with_a_name_and_a_dot_where_somebody_can_stand() -> None:
    world = load_world("warehouse")
    picture = draw_plan(world, show=GRID)
    words = {word.text.replace("\n", " ") for word in picture.words}
    assert {area.name for area in world.areas} <= words
    assert world.grid.valid <= words
    assert not {w.name for w in world.grid.waypoints if not w.human} & words
    picture = draw_plan(world, show=frozenset({"waypoints"}))
    ink = np.array(PALETTES["light"].dot)
    for waypoint in world.grid.waypoints:
        x, y = picture.view.pixels(np.array([waypoint.x, waypoint.y]))
        colour = np.array(picture.image.getpixel((round(x), round(y))))
        dark = bool(np.abs(colour - ink).max() < 40)
        assert dark == (waypoint.human and waypoint.robot) or not waypoint.human, waypoint
    assert (labelled_map(world).width, labelled_map(world, width_px=900).width) == (1600, 900)
    points = np.random.default_rng(1).uniform(-8, 8, (50, 2))
    assert np.allclose(picture.view.metres(picture.view.pixels(points)), points)


@pytest.mark.slow
def test_another_process_draws_the_same_bytes() -> None:
    code = (
        "import hashlib; from rvsg.world.world_folder import load_world;"
        "from rvsg.world.drawing import grid_picture, png_bytes;"
        "print(hashlib.sha256(png_bytes(grid_picture(load_world('warehouse')))).hexdigest())"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "77", "PYTHONPATH": os.pathsep.join(sys.path)}
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    here = hashlib.sha256(png_bytes(grid_picture(load_world("warehouse")))).hexdigest()
    assert other.stdout.strip() == here


def test_rows_read_from_top_to_bottom_and_columns_from_left_to_right() -> None:
    for name in shipped_worlds():
        world = load_world(name)
        view = draw_plan(world, show=frozenset()).view
        places = {w.name: view.pixels(np.array([w.x, w.y])) for w in world.grid.waypoints}
        for w in world.grid.waypoints:
            below, right = world.grid.rows[w.row + 1 : w.row + 2], world.grid.columns[w.column + 1 : w.column + 2]
            if below:
                assert places[below[0] + world.grid.columns[w.column]][1] > places[w.name][1]
            if right:
                assert places[world.grid.rows[w.row] + right[0]][0] > places[w.name][0]


def test_bad_options_are_answered_with_one_message() -> None:
    world = load_world("warehouse")
    for draw in (partial(draw_plan, show=LABELLED), birdseye):
        with pytest.raises(InputError, check=coded("picture-width")):
            draw(world, width_px=10)
        with pytest.raises(UnknownName, check=nearest("light")):
            draw(world, colours="ligth")
    with pytest.raises(UnknownName, check=nearest("areas")):
        draw_plan(world, show=frozenset({"aeras"}))
    with pytest.raises(InputError, check=coded("window-empty")):
        draw_plan(world, show=LABELLED, window=(1, 1, 1, 3))


def test_the_words_below_the_plan_say_from_where_rows_and_columns_count() -> None:
    occupancy = map_of(np.zeros((60, 80), np.uint8), 0.1)
    rows = {"A": 1.0, "B": 2.0, "C": 3.0}
    for columns, across in (({1: 1.0, 2: 4.0}, "left to right"), ({1: 4.0, 2: 1.0}, "right to left")):
        world = build_world(name="w", occupancy=occupancy, grid_spec=GridSpec(rows=rows, columns=columns))
        words = " ".join(word.text for word in draw_plan(world, show=GRID).words)
        assert "Rows A to C from bottom to top" in words
        assert f"columns 1 to 2 from {across}" in words


def test_the_way_has_a_mark_every_five_seconds_with_its_time() -> None:
    world = load_world("warehouse")
    route = world.route("route_2")
    way = [(t * 0.5, route.start.x + (route.goal.x - route.start.x) * t / 40, route.start.y) for t in range(41)]
    assert [time for time, _, _ in time_marks(way)] == [5.0, 10.0, 15.0, 20.0]
    assert time_marks(way)[1][1] == pytest.approx((route.start.x + route.goal.x) / 2)
    texts = {word.text for word in draw_plan(world, show=GRID, route=route, way=way).words}
    assert {"5 s", "10 s", "15 s"} <= texts


def test_coordinates_stand_where_they_are_on_the_page() -> None:
    picture = draw_plan(load_world("warehouse"), show=GRID | {"metres"})
    x, y = picture.view.up, "y" if picture.view.up == "x" else "x"
    found = {word.text: word for word in picture.words if word.text[:2] in ("x ", "y ")}
    assert {text.split()[0] for text in found} == {x, y}
    for text, word in found.items():
        axis, value = text.split()
        point = (float(value), 0.0) if axis == "x" else (0.0, float(value))
        across, down = picture.view.pixels(np.array(point))
        where, wanted = (word.centre[1], down) if axis == x else (word.centre[0], across)
        assert where == pytest.approx(wanted, abs=2)


SVG = "{http://www.w3.org/2000/svg}"


def small_hall() -> World:
    cells = walled(40, 60)
    cells[10:14, 20:30] = 100
    outline = ((0.5, 0.5), (2.5, 0.5), (2.5, 2.0), (0.5, 2.0))
    return build_world(
        name="small_hall",
        title='Hall <1> & "2"',
        occupancy=map_of(cells, 0.1, x=-1, y=-2),
        areas=[Area(name="<script>alert(1)</script>", outline=outline, waypoints=())],
    )


def test_a_plan_is_well_formed_and_names_are_text_never_markup() -> None:
    root = ElementTree.fromstring(floor_plan_svg(small_hall()))
    assert root.tag == f"{SVG}svg" and not list(root.iter(f"{SVG}script"))
    assert any("alert(1)" in "".join(text.itertext()) for text in root.iter(f"{SVG}text"))
    root = ElementTree.fromstring(floor_plan_svg(load_world("warehouse"), waypoints=True))
    assert len(list(root.iter(f"{SVG}circle"))) == 189


@pytest.mark.parametrize(
    ("world", "matrix"),
    [
        (small_hall(), "matrix(1 0 0 -1 0 0)"),
        (load_world("warehouse"), "matrix(0 -1 -1 0 0 0)"),  # row A on top and column 1 left, as in the pictures
    ],
    ids=["hall", "warehouse"],
)
def test_world_coordinates_land_inside_the_view_box(world: World, matrix: str) -> None:
    plan = floor_plan(world)
    assert plan.matrix == matrix
    left, top, width, height = (float(v) for v in plan.view_box.split())
    a, b, c, d, e, f = (float(v) for v in re.findall(r"-?[\d.]+", plan.matrix))
    for waypoint in world.grid.waypoints:
        x, y = a * waypoint.x + c * waypoint.y + e, b * waypoint.x + d * waypoint.y + f
        assert left < x < left + width and top < y < top + height


@pytest.fixture(scope="module")
def hall() -> tuple[OccupancyMap, list[Area]]:
    rng = np.random.default_rng(3)
    cells = walled(2000, 2000, thick=3)
    areas = []
    for i in range(60):
        (x, y), (w, h) = rng.integers(50, 1850, 2), rng.integers(20, 140, 2)
        cells[y : y + h, x : x + w] = 100
        x0, y0, x1, y1 = (float(v) * 0.05 for v in (x, y, x + w, y + h))
        outline = ((x0, y0), (x1, y0), (x1, y1), (x0, y1))
        areas.append(Area(name=f"Store {i + 1}", kind=("shelf", "desk")[i % 2], outline=outline, waypoints=()))
    return map_of(cells), areas


def test_rectangles_cover_exactly_the_cells_once() -> None:
    cells = np.random.default_rng(5).random((30, 40)) < 0.4
    painted = np.zeros(cells.shape, int)
    for left, bottom, right, top in rectangles(cells):
        painted[bottom:top, left:right] += 1
    assert (painted == cells).all()


def overlaps(picture: DrawnPlan) -> list[tuple[str, str]]:
    boxes = np.array([word.box for word in picture.words])
    a, b = np.triu_indices(len(boxes), 1)
    hit = (boxes[a, :2] < boxes[b, 2:]).all(axis=1) & (boxes[b, :2] < boxes[a, 2:]).all(axis=1)
    return [(picture.words[i].text, picture.words[j].text) for i, j in zip(a[hit], b[hit], strict=True)]


@pytest.mark.slow
def test_a_map_of_2000_by_2000_cells_is_drawn_in_seconds(hall: tuple[OccupancyMap, list[Area]], tmp_path: Path) -> None:
    write_map(hall[0], tmp_path)
    began = time.process_time()
    world = build_world(name="hall", occupancy=load_nav2_map(tmp_path / "map.yaml")[0], areas=hall[1])
    pictures = [draw_plan(world, show=show) for show in (LABELLED, GRID)]
    assert all(png_bytes(picture.image) for picture in pictures)
    assert time.process_time() - began < 20.0  # far from quadratic; a busy machine takes longer
    assert world.grid.spacing_m == 4.0  # coarser, so that it can be read
    named = {word.text.replace("\n", " ") for word in pictures[1].words}
    assert world.grid.valid <= named
    assert {area.name for area in world.areas} <= {w.text.replace("\n", " ") for w in pictures[0].words}
    assert any("Waypoints 4 m apart." in word.text for word in pictures[1].words)


def test_a_grid_too_fine_for_one_picture_is_drawn_in_tiles(hall: tuple[OccupancyMap, list[Area]]) -> None:
    corner = map_of(hall[0].cells[:400, :400])
    areas = [area for area in hall[1] if max(max(point) for point in area.outline) < 19]
    world = build_world(name="hall", occupancy=corner, areas=areas, grid_spec=GridSpec(spacing_m=0.5))
    whole = draw_plan(world, show=GRID, width_px=900)
    assert any("too dense" in note for note in whole.notes)
    assert any("too dense" in word.text for word in whole.words)
    parts = tiles(world, width_px=900)
    assert len(parts) == 4
    named = {word.text for tile in parts.values() for word in tile.words}
    assert world.grid.valid <= named
    assert overlaps(parts[0, 0]) == []


def test_tiles_are_one_for_a_small_room_and_refused_without_end(hall: tuple[OccupancyMap, list[Area]]) -> None:
    world = build_world(name="hall", occupancy=hall[0], grid_spec=GridSpec(spacing_m=0.6))
    with pytest.raises(InputError, check=coded("tiles-too-many")):
        tiles(world, width_px=500)
    room = build_world(name="room", occupancy=map_of(walled(100, 100)))
    assert room.grid.spacing_m == 0.5
    assert room.grid.valid <= {word.text for word in tiles(room)[0, 0].words}


def test_what_is_in_front_hides_what_is_behind() -> None:
    box = ObjectEntry(name="box", footprint=((4, 5), (5, 5), (5, 6), (4, 6)), height=0.3)
    screen = ObjectEntry(name="screen", footprint=((2, 4.5), (7, 4.5), (7, 4.6), (2, 4.6)), height=3.0)
    hole = ((0.2, 0.2), (9.8, 0.2), (9.8, 9.8), (0.2, 9.8))
    walls = ObjectEntry(name="wall", footprint=((0, 0), (10, 0), (10, 10), (0, 10)), height=1.0, holes=(hole,))
    pictures = []
    for entries in ((walls, screen), (walls, screen, box), (walls, box, screen), (walls,), (walls, box)):
        things = tuple(entry.solid(0.21) for entry in entries)
        world = build_world(name="w", objects=things, occupancy=occupancy_from_objects(things))
        pictures.append(birdseye(replace(world, objects=things), width_px=500).tobytes())
    hidden, behind, other_order, empty, alone = pictures
    assert hidden == behind == other_order
    assert empty != alone


def test_a_map_without_objects_is_raised_from_its_cells() -> None:
    world = load_world("office")
    bare = replace(world, objects=())
    image = birdseye(bare, width_px=500)
    assert (np.asarray(image).max(axis=-1) < 140).mean() > 0.02
