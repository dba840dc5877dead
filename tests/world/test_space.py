import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rvsg.core.records import Pose
from rvsg.world.schema import ObjectEntry
from rvsg.world.space import Frame, Space, human_space_of, robot_space_of, space_of
from rvsg.world.world import OccupancyMap, OrientedBox


def hall(**changes: Pose) -> OccupancyMap:
    cells = np.zeros((100, 120), np.uint8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    return OccupancyMap(cells=cells, resolution=0.05, origin=changes.get("origin", Pose(x=0, y=0)))


def pillar_space() -> Space:
    blocked = np.zeros((80, 80), bool)
    blocked[40, 40] = True
    return space_of(blocked, Frame(Pose(x=0, y=0), 0.1, (80, 80)))


@settings(deadline=None)
@given(st.floats(0.6, 7.4), st.floats(0.6, 7.4))
def test_the_clearance_is_the_distance_to_the_obstacle_within_a_cell(x: float, y: float) -> None:
    to_pillar = np.hypot(max(4.0 - x, 0, x - 4.1), max(4.0 - y, 0, y - 4.1))
    to_border = min(x, y, 8 - x, 8 - y)
    assert abs(pillar_space().clearance(x, y) - min(to_pillar, to_border)) < 0.11


def test_off_the_map_and_in_unknown_cells_nothing_is_free() -> None:
    occupancy = hall()
    cells = occupancy.cells.copy()
    cells[40:60, 40:60] = 255
    space = robot_space_of(OccupancyMap(cells=cells, resolution=0.05, origin=occupancy.origin))
    assert not space.is_free(-1, -1)
    assert not space.is_free(2.5, 2.5)
    assert space.is_free(1, 1, 0.3)


def test_a_straight_way_through_a_table_is_free_for_the_robot_only() -> None:
    box = OrientedBox(center=(3, 2.5, 0.7), size=(0.8, 0.8, 0.1))
    table = ObjectEntry(name="table", box=box).solid(lidar_height_m=0.21)
    a, b = (1.0, 2.5), (5.0, 2.5)
    assert not human_space_of([table], hall()).segment_free(a, b)
    assert robot_space_of(hall()).segment_free(a, b, 0.3)
    assert human_space_of([table], hall()).segment_free((1.0, 1.0), (5.0, 1.0), 0.3)


def test_inside_a_room_that_is_one_object_with_a_hole_people_can_stand() -> None:
    room = ObjectEntry(
        name="room",
        footprint=((0, 0), (6, 0), (6, 5), (0, 5)),
        height=2.5,
        holes=(((0.2, 0.2), (5.8, 0.2), (5.8, 4.8), (0.2, 4.8)),),
    ).solid(lidar_height_m=0.21)
    space = human_space_of([room], hall())
    assert space.is_free(3, 2.5, 1.0)
    assert not space.is_free(0.1, 2.5)


def test_a_turned_map_is_read_in_the_world_frame() -> None:
    cells = hall().cells.copy()
    cells[20:30, 80:90] = 100  # at (4.25, 1.25) before turning
    turned = OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=2, y=1, yaw=np.pi / 2))
    space = robot_space_of(turned)
    assert not space.is_free(2 - 1.25, 1 + 4.25)
    assert space.is_free(2 - 1.25, 1 + 2.0, 0.3)


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
