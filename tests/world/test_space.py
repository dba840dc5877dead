"""Free space and the rasters it is computed on."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import label
from tests.world.parts import map_of, walled

from rvsg.core.records import Pose
from rvsg.world.schema import ObjectEntry
from rvsg.world.space import (
    Frame,
    Space,
    covering,
    human_space_of,
    inside_cells,
    outline_cells,
    robot_space_of,
    space_of,
)
from rvsg.world.world import OrientedBox

HALL = map_of(walled(100, 120))


def pillar_space() -> Space:
    blocked = np.zeros((80, 80), bool)
    blocked[40, 40] = True
    return space_of(blocked, Frame(Pose(x=0, y=0), 0.1, (80, 80)))


def test_off_the_map_and_in_unknown_cells_nothing_is_free() -> None:
    cells = HALL.cells.copy()
    cells[40:60, 40:60] = 255
    space = robot_space_of(map_of(cells))
    assert not space.is_free(-1, -1) and not space.is_free(2.5, 2.5)
    assert space.is_free(1, 1, 0.3)


def test_a_straight_way_through_a_table_is_free_for_the_robot_only() -> None:
    box = OrientedBox(center=(3, 2.5, 0.7), size=(0.8, 0.8, 0.1))
    table = ObjectEntry(name="table", box=box).solid(lidar_height_m=0.21)
    a, b = (1.0, 2.5), (5.0, 2.5)
    assert not human_space_of([table], HALL).segment_free(a, b)
    assert robot_space_of(HALL).segment_free(a, b, 0.3)
    assert human_space_of([table], HALL).segment_free((1.0, 1.0), (5.0, 1.0), 0.3)


def test_a_turned_map_is_read_in_the_world_frame() -> None:
    cells = HALL.cells.copy()
    cells[20:30, 80:90] = 100  # at (4.25, 1.25) before turning
    space = robot_space_of(map_of(cells, x=2, y=1, yaw=np.pi / 2))
    assert not space.is_free(2 - 1.25, 1 + 4.25)
    assert space.is_free(2 - 1.25, 1 + 2.0, 0.3)


def test_cells_of_rings_leave_out_holes_and_what_lies_off_the_raster() -> None:
    frame = Frame(Pose(x=0, y=0), 0.1, (30, 30))
    outer, inner = [(0, 0), (3, 0), (3, 3), (0, 3)], [(1, 1), (2, 1), (2, 2), (1, 2)]
    cells = inside_cells([outer, inner], frame)
    assert cells[5, 5] and not cells[15, 15] and cells.sum() == 900 - 100
    for drawn in (inside_cells, outline_cells):
        assert not drawn([[(5, 5), (6, 5), (6, 6)]], frame).any()
    assert frame.looked_up(np.ones((30, 30)), np.array([[0.5, 0.5], [-0.01, 0.5], [0.5, 3.01]])).tolist() == [1, 0, 0]
    around = covering(np.array([[-6.99, -10.453], [6.99, 10.453]]), 0.05)
    assert (around.origin, around.shape) == (Pose(x=-7.0, y=-10.5), (420, 280))


@given(st.floats(0.6, 7.4), st.floats(0.6, 7.4))
def test_the_clearance_is_the_distance_to_the_obstacle_within_a_cell(x: float, y: float) -> None:
    to_pillar = np.hypot(max(4.0 - x, 0, x - 4.1), max(4.0 - y, 0, y - 4.1))
    to_border = min(x, y, 8 - x, 8 - y)
    assert abs(pillar_space().clearance(x, y) - min(to_pillar, to_border)) < 0.11


def test_many_segments_are_judged_as_one_by_one() -> None:
    space = pillar_space()
    rng = np.random.default_rng(2)
    starts, ends = rng.uniform(0, 8, (60, 2)), rng.uniform(0, 8, (60, 2))
    together = space.segments_free(starts, ends, 0.2)
    assert 0 < together.sum() < 60
    for a, b, free in zip(starts, ends, together, strict=True):
        through = np.hypot(*(np.linspace(a, b, 400) - 4.05).T).min() < 0.1
        at_border = min(*a, *b, *(8 - a), *(8 - b)) < 0.05
        assert not (free and (through or at_border))


def test_parts_are_numbered_from_the_largest() -> None:
    blocked = np.zeros((40, 60), bool)
    blocked[:, 20] = True
    parts = space_of(blocked, Frame(Pose(x=0, y=0), 0.1, (40, 60))).parts(0.1)
    assert parts[20, 40] == 1 and parts[20, 10] == 2 and parts[20, 20] == 0


coordinate = st.floats(-3, 3, allow_nan=False).map(lambda metres: round(metres, 9))
frames = st.builds(
    lambda x, y, yaw: Frame(Pose(x=x, y=y, yaw=yaw), 0.1, (50, 60)), coordinate, coordinate, st.floats(-3.1, 3.1)
)


@given(frames, st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=5))
def test_cells_and_metres_are_inverse_for_any_origin(frame: Frame, points: list[tuple[float, float]]) -> None:
    assert np.allclose(frame.to_metres(frame.to_cells(np.array(points))), points, atol=1e-9)


@settings(max_examples=40)
@given(frames, st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=6, unique=True))
def test_a_cell_is_inside_where_its_centre_is(frame: Frame, corners: list[tuple[float, float]]) -> None:
    polygon = shapely.Polygon(corners)
    if not polygon.is_valid or polygon.area < 1e-3:
        return
    cells = inside_cells([corners], frame)
    rows, columns = np.indices(frame.shape)
    centres = frame.to_metres(np.stack([columns + 0.5, rows + 0.5], axis=-1))
    expected = shapely.contains_xy(polygon, centres[..., 0], centres[..., 1])
    near_edge = shapely.distance(polygon.exterior, shapely.points(centres)) < 1e-6
    assert ((cells == expected) | near_edge).all()


@given(st.tuples(coordinate, coordinate), st.tuples(coordinate, coordinate))
def test_an_outline_leaves_no_gap_between_its_ends(a: tuple[float, float], b: tuple[float, float]) -> None:
    cells = outline_cells([[a, b]], Frame(Pose(x=-4, y=-4), 0.1, (80, 80)))
    assert label(cells, np.ones((3, 3)))[1] == 1
