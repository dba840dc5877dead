import re
from xml.etree import ElementTree

import numpy as np

from rvsg.core.records import Pose
from rvsg.world.drawing.svg import floor_plan, floor_plan_svg, rectangles
from rvsg.world.lattice import build_world
from rvsg.world.world import Area, OccupancyMap, World
from rvsg.world.world_folder import load_world

SVG = "{http://www.w3.org/2000/svg}"


def hall() -> World:
    cells = np.zeros((40, 60), np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    cells[10:14, 20:30] = 100
    outline = ((0.5, 0.5), (2.5, 0.5), (2.5, 2.0), (0.5, 2.0))
    return build_world(
        name="hall",
        title='Hall <1> & "2"',
        occupancy=OccupancyMap(cells=cells, resolution=0.1, origin=Pose(x=-1, y=-2)),
        areas=[Area(name="<script>alert(1)</script>", outline=outline, waypoints=())],
    )


def test_the_plan_is_well_formed_and_names_are_text_never_markup() -> None:
    root = ElementTree.fromstring(floor_plan_svg(hall()))
    assert root.tag == f"{SVG}svg"
    assert not list(root.iter(f"{SVG}script"))
    assert any("alert(1)" in "".join(text.itertext()) for text in root.iter(f"{SVG}text"))


def test_world_coordinates_land_inside_the_view_box() -> None:
    for world in (hall(), load_world("warehouse")):
        plan = floor_plan(world)
        left, top, width, height = (float(v) for v in plan.view_box.split())
        a, b, c, d, e, f = (float(v) for v in re.findall(r"-?[\d.]+", plan.matrix))
        for waypoint in world.grid.waypoints:
            x, y = a * waypoint.x + c * waypoint.y + e, b * waypoint.x + d * waypoint.y + f
            assert left < x < left + width and top < y < top + height


def test_the_warehouse_lies_as_in_the_pictures_with_row_a_on_top_and_column_1_left() -> None:
    assert floor_plan(load_world("warehouse")).matrix == "matrix(0 -1 -1 0 0 0)"
    assert floor_plan(hall()).matrix == "matrix(1 0 0 -1 0 0)"


def test_every_valid_waypoint_is_drawn_on_request() -> None:
    root = ElementTree.fromstring(floor_plan_svg(load_world("warehouse"), waypoints=True))
    assert len(list(root.iter(f"{SVG}circle"))) == 189


def test_rectangles_cover_exactly_the_cells_once() -> None:
    cells = np.random.default_rng(5).random((30, 40)) < 0.4
    painted = np.zeros(cells.shape, int)
    for left, bottom, right, top in rectangles(cells):
        painted[bottom:top, left:right] += 1
    assert (painted == cells).all()
