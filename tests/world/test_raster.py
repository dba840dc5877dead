import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from rvsg.core.records import Pose
from rvsg.world.space import Frame, covering, inside_cells, outline_cells

coordinate = st.floats(-3, 3, allow_nan=False).map(lambda metres: round(metres, 9))
frames = st.builds(
    lambda x, y, yaw: Frame(Pose(x=x, y=y, yaw=yaw), 0.1, (50, 60)), coordinate, coordinate, st.floats(-3.1, 3.1)
)


@settings(deadline=None)
@given(frames, st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=5))
def test_cells_and_metres_are_inverse_for_any_origin(frame: Frame, points: list[tuple[float, float]]) -> None:
    assert np.allclose(frame.to_metres(frame.to_cells(np.array(points))), points, atol=1e-9)


@settings(deadline=None, max_examples=40)
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


def test_a_ring_is_its_outline_without_its_hole() -> None:
    frame = Frame(Pose(x=0, y=0), 0.1, (30, 30))
    outer, inner = [(0, 0), (3, 0), (3, 3), (0, 3)], [(1, 1), (2, 1), (2, 2), (1, 2)]
    cells = inside_cells([outer, inner], frame)
    assert cells[5, 5] and not cells[15, 15]
    assert cells.sum() == 900 - 100


@settings(deadline=None)
@given(st.tuples(coordinate, coordinate), st.tuples(coordinate, coordinate))
def test_an_outline_leaves_no_gap_between_its_ends(a: tuple[float, float], b: tuple[float, float]) -> None:
    from scipy.ndimage import label

    cells = outline_cells([[a, b]], Frame(Pose(x=-4, y=-4), 0.1, (80, 80)))
    assert label(cells, np.ones((3, 3)))[1] == 1


def test_what_lies_off_the_raster_is_left_out_and_looked_up_as_nothing() -> None:
    frame = Frame(Pose(x=0, y=0), 0.1, (10, 10))
    assert not inside_cells([[(5, 5), (6, 5), (6, 6)]], frame).any()
    assert not outline_cells([[(5, 5), (6, 5), (6, 6)]], frame).any()
    assert frame.looked_up(np.ones((10, 10)), np.array([[0.5, 0.5], [-0.01, 0.5], [0.5, 1.01]])).tolist() == [1, 0, 0]


def test_the_covering_frame_lies_on_multiples_of_the_resolution() -> None:
    frame = covering(np.array([[-6.99, -10.453], [6.99, 10.453]]), 0.05)
    assert frame.origin == Pose(x=-7.0, y=-10.5)
    assert frame.shape == (420, 280)
