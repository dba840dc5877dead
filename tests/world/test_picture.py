import hashlib
import os
import subprocess
import sys
from itertools import combinations

import numpy as np
import pytest
from tests.coded import coded, nearest

from rvsg.core.errors import InputError, UnknownName
from rvsg.core.records import Pose
from rvsg.world.drawing import grid_picture, labelled_map, png_bytes
from rvsg.world.drawing.floor_plan import GRID, LABELLED, Picture, draw_plan
from rvsg.world.drawing.layers import time_marks
from rvsg.world.drawing.sheet import PALETTES
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import build_world
from rvsg.world.world import OccupancyMap
from rvsg.world.world_folder import load_world, shipped_worlds


def overlaps(picture: Picture) -> list[tuple[str, str]]:
    found = []
    for a, b in combinations(picture.words, 2):
        if a.box[0] < b.box[2] and b.box[0] < a.box[2] and a.box[1] < b.box[3] and b.box[1] < a.box[3]:
            found.append((a.text, b.text))
    return found


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


def test_every_area_and_every_valid_waypoint_of_the_warehouse_is_named() -> None:
    world = load_world("warehouse")
    words = {word.text.replace("\n", " ") for word in draw_plan(world, show=GRID).words}
    assert {area.name for area in world.areas} <= words
    assert world.grid.valid <= words
    assert not {w.name for w in world.grid.waypoints if not w.human} & words


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


def test_a_picture_is_as_wide_as_asked_for() -> None:
    world = load_world("warehouse")
    assert labelled_map(world).width == 1600
    assert labelled_map(world, width_px=900).width == 900


def test_a_dot_is_drawn_where_its_waypoint_is_and_none_where_nobody_can_stand() -> None:
    world = load_world("warehouse")
    picture = draw_plan(world, show=frozenset({"waypoints"}))
    ink = np.array(PALETTES["light"].dot)
    for waypoint in world.grid.waypoints:
        x, y = picture.view.pixels(np.array([waypoint.x, waypoint.y]))
        colour = np.array(picture.image.getpixel((round(x), round(y))))
        dark = bool(np.abs(colour - ink).max() < 40)
        assert dark == (waypoint.human and waypoint.robot) or not waypoint.human, waypoint


def test_view_and_metres_are_inverse() -> None:
    world = load_world("warehouse")
    view = draw_plan(world, show=frozenset()).view
    points = np.random.default_rng(1).uniform(-8, 8, (50, 2))
    assert np.allclose(view.metres(view.pixels(points)), points)


def test_bad_options_are_answered_with_one_message() -> None:
    world = load_world("warehouse")
    with pytest.raises(InputError, check=coded("picture-width")):
        labelled_map(world, width_px=20)
    with pytest.raises(UnknownName, check=nearest("light")):
        draw_plan(world, show=LABELLED, colours="ligth")
    with pytest.raises(UnknownName, check=nearest("areas")):
        draw_plan(world, show=frozenset({"aeras"}))
    with pytest.raises(InputError, check=coded("window-empty")):
        draw_plan(world, show=LABELLED, window=(1, 1, 1, 3))


def test_the_words_below_the_plan_say_from_where_rows_and_columns_count() -> None:
    occupancy = OccupancyMap(cells=np.zeros((60, 80), np.uint8), resolution=0.1, origin=Pose(x=0, y=0))
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
