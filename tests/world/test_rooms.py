"""Rooms come from the floor: divided at doorways, told apart from what is outside."""

import numpy as np
import shapely

from rvsg.core.records import Pose
from rvsg.world.areas import propose_areas
from rvsg.world.lattice import open_share
from rvsg.world.rooms import areas_of_rooms, indoors, rooms_of
from rvsg.world.space import frame_of, human_space_of, inside_cells, inside_window, main_floor, robot_space_of
from rvsg.world.world import OccupancyMap

RESOLUTION_M = 0.05


def office() -> OccupancyMap:
    """A corridor of 16 x 2.5 m along x and four rooms of 4 x 4 m above it, each with a door of 1 m."""
    cells = np.zeros((136, 324), np.uint8)
    cells[[0, 1, -2, -1], :] = cells[:, [0, 1, -2, -1]] = 100
    cells[52:54, :] = 100
    for i in range(1, 4):
        cells[54:, i * 81 : i * 81 + 2] = 100
    for i in range(4):
        cells[52:54, i * 81 + 30 : i * 81 + 50] = 0
    return OccupancyMap(cells=cells, resolution=RESOLUTION_M, origin=Pose(x=0, y=0))


def test_the_floor_is_divided_at_doors_into_rooms_and_a_corridor() -> None:
    space = robot_space_of(office())
    labels, frame, rooms = rooms_of(space, main_floor(space))
    assert sorted(room.kind for room in rooms) == ["corridor", "room", "room", "room", "room"]
    for x in (2.0, 6.0, 10.0, 14.0):
        at, beside = frame.looked_up(labels, np.array([[x, 4.6], [x, 1.2]]))
        assert at != beside and at > 0 and beside > 0


def test_areas_are_named_by_kind_and_numbered_from_left_to_right() -> None:
    space = robot_space_of(office())
    areas = areas_of_rooms(space, main_floor(space))
    assert [area.name for area in areas] == ["Corridor", "Room 1", "Room 2", "Room 3", "Room 4"]
    middles = [shapely.Polygon(area.outline).centroid.x for area in areas if area.kind == "room"]
    assert middles == sorted(middles)
    assert all(open_share(area.outline, space) > 0.9 for area in areas)
    assert [area.name for area in propose_areas((), office())] == [area.name for area in areas]


def test_the_floor_outside_a_building_with_open_doors_is_not_indoors() -> None:
    building = office()
    cells = np.zeros((236, 424), np.uint8)
    cells[50:186, 50:374] = building.cells
    cells[50:52, 150:200] = 0  # an opening of 2.5 m to the outside
    occupancy = OccupancyMap(cells=cells, resolution=RESOLUTION_M, origin=Pose(x=0, y=0))
    inside = indoors(occupancy)
    assert inside[80, 100] and inside[150, 100] and inside[70, 300]
    assert not inside[20, 200] and not inside[120, 20] and not inside[210, 400]


def test_the_window_of_a_polygon_holds_the_cells_inside_it() -> None:
    frame = frame_of(office())
    for outline in (((1.0, 1.0), (3.03, 1.2), (2.0, 4.0)), ((-2, -2), (1, -2), (1, 1)), ((90, 90), (91, 90), (91, 91))):
        window, cells = inside_window(outline, frame)
        whole = np.zeros(frame.shape, bool)
        whole[window] = cells
        assert (whole == inside_cells([outline], frame)).all()


def test_the_parts_of_a_floor_are_the_same_when_asked_again() -> None:
    space = human_space_of((), office())
    first = space.parts(0.3)
    assert space.parts(0.6).max() >= 5
    assert (space.parts(0.3) == first).all()
