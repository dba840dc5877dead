"""The first proposal of labels, from models, bare maps and rooms."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tests.world.parts import map_of, walled

from rvsg.world.areas import areas_of_floor, areas_of_objects, largest_rectangle, propose_areas, readable_kind
from rvsg.world.lattice import open_share
from rvsg.world.rooms import areas_of_rooms, indoors, rooms_of
from rvsg.world.schema import ObjectEntry
from rvsg.world.space import frame_of, human_space_of, inside_cells, inside_window, main_floor, robot_space_of
from rvsg.world.world import OccupancyMap, OrientedBox, SolidObject


def thing(name: str, kind: str, x: float, y: float, size: tuple[float, float] = (4.0, 1.0)) -> SolidObject:
    box = OrientedBox(center=(x, y, 1.0), size=(*size, 2.0))
    return ObjectEntry(name=name, kind=kind, box=box).solid(0.21)


def room(*filled: tuple[int, int, int, int, int], size: tuple[int, int] = (200, 300)) -> OccupancyMap:
    """A room of 15 x 10 m with blocks of cells: rows, columns and value."""
    cells = walled(*size, thick=2)
    for low, high, left, right, value in filled:
        cells[low:high, left:right] = value
    return map_of(cells, x=-1.0, y=2.0)


def test_walls_floor_and_small_things_are_not_labelled_and_a_larger_namesake_is_called_large_in_parts() -> None:
    things = [thing("w", "WallB_01", 0, 0), thing("p", "Lamp", 5, 0), thing("c", "Cup", 9, 0, (0.1, 0.1))]
    assert areas_of_objects(things) == ()
    areas = areas_of_objects([thing("a", "ShelfD", 0, 0), thing("b", "ShelfF", 20, 0, (2.1, 18.0))])
    assert [a.name for a in areas] == ["Shelf", *(f"Large Shelf {i}" for i in (1, 2, 3, 4))]


TABLE = (80, 100, 60, 100, 100)
LEGS = [(row, row + 2, column, column + 2, 100) for row in (140, 148) for column in (200, 208)]
SOFA = [(60, 100, 60, 120, 100), (66, 100, 72, 108, 0), (84, 92, 86, 94, 100)]


@pytest.mark.parametrize(
    ("blocks", "names", "corner"),
    [
        # a table, four legs that are one thing, and a thin inner wall
        ([TABLE, *LEGS, (2, 60, 150, 152, 100)], ["Obstacle 1", "Obstacle 2"], (2.0, 6.0)),
        (SOFA, ["Obstacle"], (2.0, 5.0)),  # in the shape of a U, with a stool in it
        ([(90, 110, 20, 280, 100)], ["Obstacle 1", "Obstacle 2", "Obstacle 3"], None),  # 13 m long
    ],
    ids=["table-and-legs", "sofa", "long"],
)
def test_a_bare_maps_obstacles_are_labelled_and_its_walls_are_not(
    blocks: list[tuple[int, int, int, int, int]], names: list[str], corner: tuple[float, float] | None
) -> None:
    areas = propose_areas((), room(*blocks))
    obstacles = [a for a in areas if a.kind == "obstacle"]
    assert [a.name for a in obstacles] == names
    assert corner is None or obstacles[-1].outline[0] == pytest.approx(corner)
    assert any(a.kind == "floor" for a in areas)


def test_floor_areas_lie_on_open_floor_and_do_not_overlap_and_a_long_narrow_one_is_a_corridor() -> None:
    hall = room((90, 110, 100, 200, 100))
    taken = np.zeros(hall.cells.shape, int)
    for area in areas_of_floor(human_space_of((), hall)):
        (x0, y0), (x1, y1) = area.outline[0], area.outline[2]
        r0, c0 = round((y0 - 2.0) / 0.05), round((x0 + 1.0) / 0.05)
        r1, c1 = round((y1 - 2.0) / 0.05), round((x1 + 1.0) / 0.05)
        assert (hall.cells[r0:r1, c0:c1] == 0).all()
        taken[r0:r1, c0:c1] += 1
    assert taken.max() == 1
    assert [a.name for a in areas_of_floor(human_space_of((), room(size=(50, 260))))] == ["Corridor"]


@given(arrays(bool, st.tuples(st.integers(1, 7), st.integers(1, 7))))
def test_the_largest_rectangle_is_the_largest(cells: np.ndarray) -> None:
    top, left, high, wide = largest_rectangle(cells)
    assert cells[top : top + high, left : left + wide].all()
    rows, columns = (list(combinations(range(n + 1), 2)) for n in cells.shape)
    best = max(((b - a) * (d - c) for a, b in rows for c, d in columns if cells[a:b, c:d].all()), default=0)
    assert high * wide == best


@pytest.mark.parametrize(
    ("kind", "words"),
    [("ShelfD_01", "Shelf"), ("PalletJackB_01", "Pallet Jack"), ("table", "Table"), ("TV_stand_2", "TV Stand"),
     ("a1", "A"), ("42", "42"), ("", "Object")],
)  # fmt: skip
def test_a_models_name_becomes_readable_words(kind: str, words: str) -> None:
    assert readable_kind(kind) == words


def test_neighbours_of_a_kind_are_one_area_numbered_from_the_top_left() -> None:
    shelves = [thing(f"s{i}", "ShelfD_01", 0.0, -3.0 * i) for i in range(3)]
    shelves.append(thing("s4", "ShelfE_01", 3.2, 0.0, (2.0, 1.0)))  # 0.2 m beside the first: worked as one with it
    areas = areas_of_objects(shelves)
    assert [a.name for a in areas] == ["Shelf 1", "Shelf 2", "Shelf 3"]
    assert areas[0].outline[1][0] == pytest.approx(4.2)
    assert {a.region for a in areas} == {"Shelves"}


def four_offices() -> OccupancyMap:
    """A corridor of 16 x 2.5 m along x and four rooms of 4 x 4 m above it, each with a door of 1 m."""
    cells = walled(136, 324, thick=2)
    cells[52:54, :] = 100
    for i in range(4):
        cells[54:, i * 81 : i * 81 + 2] = 100
        cells[52:54, i * 81 + 30 : i * 81 + 50] = 0
    return map_of(cells)


def test_the_floor_is_divided_at_doors_into_rooms_and_a_corridor_numbered_from_left_to_right() -> None:
    space = robot_space_of(four_offices())
    labels, frame, rooms = rooms_of(space, main_floor(space))
    assert sorted(room.kind for room in rooms) == ["corridor", "room", "room", "room", "room"]
    for x in (2.0, 6.0, 10.0, 14.0):
        at, beside = frame.looked_up(labels, np.array([[x, 4.6], [x, 1.2]]))
        assert at != beside and at > 0 and beside > 0
    areas = areas_of_rooms(space, main_floor(space))
    assert [area.name for area in areas] == ["Corridor", "Room 1", "Room 2", "Room 3", "Room 4"]
    middles = [shapely.Polygon(area.outline).centroid.x for area in areas if area.kind == "room"]
    assert middles == sorted(middles)
    assert all(open_share(area.outline, space) > 0.9 for area in areas)
    assert [area.name for area in propose_areas((), four_offices())] == [area.name for area in areas]


def test_the_floor_outside_a_building_with_open_doors_is_not_indoors() -> None:
    cells = np.zeros((236, 424), np.uint8)
    cells[50:186, 50:374] = four_offices().cells
    cells[50:52, 150:200] = 0  # an opening of 2.5 m to the outside
    inside = indoors(map_of(cells))
    assert inside[80, 100] and inside[150, 100] and inside[70, 300]
    assert not inside[20, 200] and not inside[120, 20] and not inside[210, 400]


def test_the_window_of_a_polygon_holds_the_cells_inside_it() -> None:
    frame = frame_of(four_offices())
    for outline in (((1.0, 1.0), (3.03, 1.2), (2.0, 4.0)), ((-2, -2), (1, -2), (1, 1)), ((90, 90), (91, 90), (91, 91))):
        window, cells = inside_window(outline, frame)
        whole = np.zeros(frame.shape, bool)
        whole[window] = cells
        assert (whole == inside_cells([outline], frame)).all()


def test_the_parts_of_a_floor_are_the_same_when_asked_again() -> None:
    space = human_space_of((), four_offices())
    first = space.parts(0.3)
    assert space.parts(0.6).max() >= 5
    assert (space.parts(0.3) == first).all()
