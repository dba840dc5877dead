"""The costmaps' rules."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.simulation.parts import FOOTPRINT, INFLATION, RANGES

from rvsg.simulation.costmap import (
    FREE,
    LETHAL,
    UNKNOWN,
    clear_footprint,
    clear_line,
    inflate_marks,
    inflate_static,
    merge_global,
    observe,
    shift,
)
from rvsg.simulation.embedded.lidar import FAR, NO_RETURN, ray_directions

Bytes = NDArray[np.uint8]


def slow_inflation(lethal: NDArray[np.bool_]) -> Bytes:
    """Every cell's cost from its distance to the nearest lethal cell."""
    rows, columns = lethal.shape
    costs = np.zeros(lethal.shape, np.uint8)
    places = np.argwhere(lethal)
    for r in range(rows):
        for c in range(columns):
            if not len(places):
                continue
            cells = math.sqrt(float(((places - (r, c)) ** 2).sum(axis=1).min()))
            distance = cells * 0.05
            if cells == 0:
                costs[r, c] = 254
            elif distance <= 0.24999999977:
                costs[r, c] = 253
            elif cells <= 11:
                costs[r, c] = int(252 * math.exp(-3.0 * (distance - 0.24999999977)))
    return costs


def test_a_cell_exactly_five_cells_off_is_not_inscribed() -> None:
    costs = INFLATION
    assert costs.shape == (23, 23)
    assert [int(costs[11, 11 + k]) for k in (0, 1, 4, 5, 6, 11)] == [254, 253, 253, 251, 216, 102]
    assert costs[0, 0] == 0


@pytest.mark.parametrize("seed", range(3))
def test_inflation_is_that_of_the_nearest_lethal_cell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    front = np.where(rng.random((60, 60)) < 0.01, LETHAL, FREE).astype(np.uint8)
    rear = np.where(rng.random((60, 60)) < 0.01, LETHAL, FREE).astype(np.uint8)
    front[20:30, 20:26] = LETHAL
    rear[26:34, 24:30] = LETHAL
    master = np.zeros((60, 60), np.uint8)
    inflate_marks(master, np.stack([front, rear]), INFLATION)
    assert np.array_equal(master, slow_inflation((front == LETHAL) | (rear == LETHAL)))


def test_the_global_map_redone_around_the_robot_is_the_map_redone_everywhere() -> None:
    rng = np.random.default_rng(4)
    costs = INFLATION
    static = np.where(rng.random((150, 180)) < 0.004, LETHAL, FREE).astype(np.uint8)
    static[:, :20] = UNKNOWN
    inflated = inflate_static(static, costs)
    front = np.full(static.shape, UNKNOWN, np.uint8)
    rear = front.copy()
    master = np.zeros_like(static)
    merge_global(master, static, inflated, np.stack([front, rear]), costs, 75, 90, 200)
    front[70:74, 15:90] = FREE
    rear[60:80, 92:95] = LETHAL
    everywhere = master.copy()
    merge_global(master, static, inflated, np.stack([front, rear]), costs, 75, 60, 46)
    merge_global(everywhere, static, inflated, np.stack([front, rear]), costs, 75, 90, 200)
    assert np.array_equal(master, everywhere)
    assert (master[70:74, 15:20] != UNKNOWN).all()
    expected = slow_inflation((static == LETHAL) | (rear == LETHAL))
    unknown = (static == UNKNOWN) & (front == UNKNOWN) & (expected < 253)
    assert np.array_equal(master, np.where(unknown, UNKNOWN, expected))


def test_a_line_clears_at_most_its_length_and_both_ends() -> None:
    grid = np.full((80, 80), LETHAL, np.uint8)
    clear_line(grid, 5, 5, 75, 40, 60.0)
    cleared = np.argwhere(grid == FREE)
    assert tuple(cleared[0]) == (5, 5)
    assert np.hypot(*(cleared[-1] - 5)) == pytest.approx(60, abs=1.5)
    steps = np.abs(np.diff(cleared[np.argsort(cleared[:, 1])], axis=0)).max(axis=1)
    assert (steps == 1).all()


@pytest.mark.parametrize(
    ("distance", "keep_m", "cleared", "lethal"),
    [
        (2.0, 0.0, [(100, 100), (100, 139)], [(100, 140)]),
        (2.0, 2.0, [(100, 138)], [(100, 139)]),
        (2.6, 0.0, [(100, 150)], [(100, 154)]),
        (FAR, 0.0, [(100, 160)], [(100, 162), (50, 50)]),
        (NO_RETURN, 0.0, [], [(100, 101)]),
    ],
    ids=["marks its hit", "voxel layer: two cells before it", "out of reach", "open: three metres", "no return"],
)
def test_a_scan_marks_hits_within_reach_and_clears_what_lies_before_them(
    distance: float, keep_m: float, cleared: list[tuple[int, int]], lethal: list[tuple[int, int]]
) -> None:
    """The cell (50, 50) lies behind, outside the field of view of 270 degrees."""
    for before in (LETHAL, FREE):
        grid = np.full((200, 200), before, np.uint8)
        ranges, directions = np.full(818, distance), ray_directions(818, math.radians(270.0))
        observe(grid, ranges, directions, 100.5, 100.5, 0.0, 0.05, keep_m, *RANGES)
        if before == LETHAL:
            assert all(grid[cell] == FREE for cell in cleared)
            assert all(grid[cell] == LETHAL for cell in lethal)
            assert (grid == LETHAL).all() == (not cleared)
        else:
            assert (grid == LETHAL).any() == (distance == 2.0)


def test_the_padded_footprint_becomes_free() -> None:
    grid = np.full((60, 60), LETHAL, np.uint8)
    spans = np.zeros((60, 2), np.int64)
    clear_footprint(grid, spans, 30.5, 30.5, 0.0, 0.05, FOOTPRINT)
    rows, columns = np.nonzero(grid == FREE)
    assert (columns.min(), columns.max()) == (23, 37)
    assert (rows.min(), rows.max()) == (25, 35)
    assert len(rows) == 15 * 11
    grid[:] = LETHAL
    clear_footprint(grid, spans, 30.5, 30.5, math.pi / 2, 0.05, FOOTPRINT)
    rows, columns = np.nonzero(grid == FREE)
    assert (columns.max() - columns.min(), rows.max() - rows.min()) == (10, 14)


@pytest.mark.parametrize(("columns", "rows"), [(3, 0), (0, -2), (-4, 5), (70, 0), (0, 0)])
def test_the_window_forgets_what_leaves_it(columns: int, rows: int) -> None:
    rng = np.random.default_rng(1)
    grid = np.where(rng.random((60, 60)) < 0.3, LETHAL, FREE).astype(np.uint8)
    wide = np.full((220, 220), FREE, np.uint8)
    wide[80:140, 80:140] = grid
    shift(grid, columns, rows)
    assert np.array_equal(grid, wide[80 + rows : 140 + rows, 80 + columns : 140 + columns])
