"""Grids of waypoints: their names, hops, parts, and the waypoints from which an area is worked."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from tests.coded import coded
from tests.world.parts import map_of

from rvsg.core.errors import InputError
from rvsg.core.records import Pose
from rvsg.world.grid import GridSpec
from rvsg.world.lattice import area_waypoints, build_grid, build_world, fitting_spacing, row_letters
from rvsg.world.schema import ObjectEntry
from rvsg.world.space import Frame, Space, human_space, space_of
from rvsg.world.world import Area, OrientedBox, Polygon, Route, World


def open_hall(width: float, height: float, resolution: float = 0.1) -> Space:
    shape = (round(height / resolution), round(width / resolution))
    return space_of(np.zeros(shape, bool), Frame(Pose(x=-1, y=2), resolution, shape))


def with_wall() -> Space:
    """A hall of 10 x 6 m with a wall across it that leaves a door of 1.2 m at the top."""
    blocked = np.zeros((60, 100), bool)
    blocked[:48, 48:52] = True
    return space_of(blocked, Frame(Pose(x=0, y=0), 0.1, (60, 100)))


def test_rows_are_lettered_as_spreadsheets_name_columns() -> None:
    assert [row_letters(i) for i in (0, 25, 26, 51, 52, 701, 702)] == ["A", "Z", "AA", "AZ", "BA", "ZZ", "AAA"]


def test_rows_read_from_the_top_and_columns_from_the_left() -> None:
    space = open_hall(6, 4)
    for up, across in (("y", "x"), ("x", "y")):
        grid = build_grid(GridSpec(spacing_m=1.0, up=up), space, space)
        a1, b1, a2 = ({"x": x, "y": y} for x, y in map(grid.position, ("A1", "B1", "A2")))
        assert a1[up] > b1[up]
        assert (a1[across] < a2[across]) == (up == "y")
        for narrow in (open_hall(9.0, 1.2), open_hall(1.2, 9.0)):  # one row or column
            assert build_grid(GridSpec(spacing_m=1.0, up=up), narrow, narrow).up == grid.up == up


@settings(max_examples=30)
@given(st.floats(3, 40), st.floats(3, 40), st.sampled_from([0.5, 1.0, 1.7, 2.0]), st.floats(0.1, 0.8))
def test_an_even_grid_is_even_and_keeps_clear(width: float, height: float, spacing: float, clearance: float) -> None:
    space = open_hall(width, height)
    grid = build_grid(GridSpec(spacing_m=spacing, human_clearance_m=clearance), space, space)
    xs, ys = sorted({w.x for w in grid.waypoints}), sorted({w.y for w in grid.waypoints})
    assert np.allclose(np.diff(xs), spacing) and np.allclose(np.diff(ys), spacing)
    assert all(space.clearance(w.x, w.y) >= clearance for w in grid.waypoints if w.human)
    assert all(re.fullmatch(r"[A-Z]+[0-9]+", w.name) for w in grid.waypoints)


def test_the_grid_goes_through_a_given_origin() -> None:
    space = open_hall(8, 8)
    grid = build_grid(GridSpec(spacing_m=1.5, origin=(0.2, 3.3)), space, space)
    assert any(abs(w.x - 0.2) < 1e-9 and abs(w.y - 3.3) < 1e-9 for w in grid.waypoints)


def test_no_hop_leads_through_the_wall_but_the_door_joins_the_halves() -> None:
    space = with_wall()
    grid = build_grid(GridSpec(spacing_m=1.0), space, space)
    for a, b in grid.hops:
        (ax, ay), (bx, by) = grid.position(a), grid.position(b)
        if (ax - 5) * (bx - 5) < 0:
            assert min(ay, by) > 4.8
    path = grid.shortest_path(grid.nearest(1, 1), grid.nearest(9, 1))
    assert path is not None and max(grid.position(name)[1] for name in path) > 4.8


def test_every_free_hop_between_adjacent_waypoints_is_there() -> None:
    space = open_hall(5, 5)
    grid = build_grid(GridSpec(spacing_m=1.0), space, space)
    rows, columns = len(grid.rows), len(grid.columns)
    assert len(grid.valid) == rows * columns
    assert len(grid.hops) == rows * (columns - 1) + columns * (rows - 1) + 2 * (rows - 1) * (columns - 1)


def test_a_part_that_is_cut_off_has_no_waypoints_unless_asked_for() -> None:
    blocked = np.zeros((60, 100), bool)
    blocked[:, 30:34] = True
    space = space_of(blocked, Frame(Pose(x=0, y=0), 0.1, (60, 100)))

    def leftmost(spec: GridSpec, *seeds: tuple[float, float]) -> float:
        grid = build_grid(spec, space, space, seeds=seeds)
        return min(w.x for w in grid.waypoints if w.human)

    assert leftmost(GridSpec(spacing_m=1.0)) > 3.4
    assert leftmost(GridSpec(spacing_m=1.0, isolated_parts=True)) < 3.0
    assert leftmost(GridSpec(spacing_m=1.0), (1.0, 1.0)) < 3.0


def test_a_large_world_gets_a_coarser_grid_and_a_small_one_a_finer() -> None:
    assert fitting_spacing(4.4, 4.4) == 0.5
    assert fitting_spacing(13, 20) == 1.0
    assert fitting_spacing(99, 99) == 4.0
    assert 990 / fitting_spacing(990, 990) <= 40


def test_explicit_coordinates_give_exactly_the_listed_waypoints() -> None:
    space = open_hall(6, 6)
    spec = GridSpec(rows={"A": 7.0, "B": 5.5}, columns={1: 0.0, 2: 2.2}, moved={"B2": (2.4, 5.5)}, valid=("A1", "B2"))
    grid = build_grid(spec, space, space)
    assert grid.valid == {"A1", "B2"}
    assert grid.position("A2") == (2.2, 7.0)
    assert grid.position("B2") == (2.4, 5.5)


@pytest.mark.parametrize(
    ("spec", "reason"),
    [
        ({"rows": {"A": 1.0}}, "together"),
        ({"rows": {"A": 1.0}, "columns": {1: 1.0}, "spacing_m": 1.0}, "either spacing_m"),
        ({"rows": {"A": 1.0}, "columns": {1: 1.0}, "valid": ["A7"]}, "no waypoint A7"),
        ({"valid": ["A1"]}, "need rows and columns"),
        ({"spacing_m": 0.0}, "greater than or equal"),
    ],
)
def test_a_specification_that_contradicts_itself_is_refused(spec: dict[str, object], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        GridSpec.model_validate(spec)


LINES: dict[str, object] = {"rows": {"A": 6.0, "B": 3.0}, "columns": {1: 3.0, 2: 6.0}}


@pytest.mark.parametrize(
    ("size", "spec", "code"),
    [
        ((0.4, 3.0), {}, "grid-no-room"),
        ((60, 60), {"spacing_m": 0.1}, "grid-too-fine"),
        ((10, 10), {**LINES, "moved": {"B2": (1e6, 0.0)}}, "grid-off-map"),
        ((10, 10), {**LINES, "columns": {1: 1.0, 2: -1e11}}, "grid-off-map"),
    ],
)
def test_a_grid_that_cannot_be_laid_is_refused(size: tuple[float, float], spec: dict[str, object], code: str) -> None:
    space = open_hall(*size)
    with pytest.raises(InputError, check=coded(code)):
        build_grid(GridSpec.model_validate(spec), space, space)


def test_an_area_of_open_floor_is_worked_inside_and_a_shelf_from_within_reach() -> None:
    space = with_wall()
    grid = build_grid(GridSpec(spacing_m=1.0), space, space)
    floor = ((0.5, 0.5), (3.5, 0.5), (3.5, 3.5), (0.5, 3.5))
    wall = ((4.8, 0.0), (5.2, 0.0), (5.2, 4.8), (4.8, 4.8))
    inside = area_waypoints(floor, grid, space)
    assert inside and all(0.5 <= grid.position(n)[0] <= 3.5 and 0.5 <= grid.position(n)[1] <= 3.5 for n in inside)
    beside = area_waypoints(wall, grid, space)
    assert beside and all(abs(grid.position(n)[0] - 5) <= 1.2 + 1e-9 for n in beside)
    assert {grid.position(n)[0] > 5 for n in beside} == {True, False}


def test_areas_keep_the_waypoints_that_were_given() -> None:
    outline = ((1, 1), (3, 1), (3, 3), (1, 3))
    world = build_world(
        name="w",
        occupancy=map_of(np.zeros((60, 60), np.uint8), 0.1),
        areas=[Area(name="a", outline=outline, waypoints=("A1",)), Area(name="b", outline=outline, waypoints=())],
        routes=[Route(name="r", start=Pose(x=1, y=1), goal=Pose(x=5, y=5), time_limit_s=20)],
    )
    assert world.area("a").waypoints == ("A1",)
    assert len(world.area("b").waypoints) > 1
    assert all(human_space(world).is_free(*world.grid.position(n), 0.3) for n in world.grid.valid)


def worked(cells: np.ndarray, outline: Polygon, box: OrientedBox | None, origin: tuple[float, float] | None) -> World:
    """A world with one area around one thing."""
    return build_world(
        name="w",
        occupancy=map_of(cells),
        objects=() if box is None else [ObjectEntry(name="thing", box=box).solid(0.21)],
        areas=[Area(name="area", outline=outline, waypoints=())],
        grid_spec=GridSpec(spacing_m=0.5, origin=origin),
    )


def test_a_desk_is_not_worked_through_the_wall_behind_it() -> None:
    cells = np.zeros((80, 120), np.uint8)
    cells[:64, 60:64] = 100  # a wall of 0.2 m at x = 3.0, with a passage at the top
    cells[20:36, 50:60] = 100  # a desk against its left side, on the map too
    desk = ((2.5, 1.0), (3.0, 1.0), (3.0, 1.8), (2.5, 1.8))
    for box in (None, OrientedBox(center=(2.75, 1.4, 0.4), size=(0.5, 0.8, 0.8))):
        world = worked(cells, desk, box, (1.95, 1.4))
        chosen = world.area("area").waypoints
        assert chosen and all(world.grid.position(name)[0] < 3.0 for name in chosen)
        # there are waypoints within arm's length on the other side
        assert [w for w in world.grid.waypoints if w.human and 3.2 < w.x < 4.0 and 1.0 <= w.y <= 1.8]


def test_a_shelf_whose_label_is_smaller_than_itself_is_still_in_reach() -> None:
    label = ((2.3, 1.8), (3.7, 1.8), (3.7, 2.2), (2.3, 2.2))
    box = OrientedBox(center=(3.0, 2.0, 1.0), size=(2.0, 0.8, 2.0))
    world = worked(np.zeros((80, 120), np.uint8), label, box, None)
    assert {world.grid.position(name)[1] > 2.0 for name in world.area("area").waypoints} == {True, False}
