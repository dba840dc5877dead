"""NavFn's rules against a slow reading of them, and what a plan must be."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rvsg.simulation.embedded.navfn import (
    BLOCKED,
    BUFFER,
    HIGH,
    cell_of,
    conversion,
    convert,
    plan,
    propagate,
    reaches,
    rest_of_way,
)

Costs = NDArray[np.uint8]
UNBOUNDED = np.float32(np.inf)


def maze(rng: np.random.Generator, rows: int, columns: int) -> Costs:
    """Random costs with walls, lethal border."""
    costs = rng.integers(0, 120, (rows, columns)).astype(np.uint8)
    for _ in range(6):
        r, c = rng.integers(2, rows - 2), rng.integers(2, columns - 12)
        costs[r, c : c + 10] = 254
    return costs


def slow_potential(costs: Costs, source: int, target: int) -> NDArray[np.float32]:
    """NavFn's propagation, word by word."""
    rows, columns = costs.shape
    flat = costs.ravel()
    f = np.float32
    potential = np.full(flat.size, HIGH, np.float32)
    potential[source] = 0
    current, overflow = [], []
    pending = set()
    for n in (source + 1, source - 1, source - columns, source + columns):
        if flat[n] < BLOCKED:
            current.append(n)
            pending.add(n)
    threshold = f(254)
    for _ in range(max(rows * columns // 20, rows + columns)):
        if not current:
            break
        pending.difference_update(current)
        following: list[int] = []
        for n in current:
            left, right, below, above = (potential[n + d] for d in (-1, 1, -columns, columns))
            tc, ta = min(left, right), min(below, above)
            hf = f(flat[n])
            dc = f(tc - ta)
            if dc < 0:
                dc, ta = -dc, tc
            if dc >= hf:
                new = f(ta + hf)
            else:
                d = float(f(dc / hf))
                new = f(ta + f(hf * f(-0.2301 * d * d + 0.5307 * d + 0.7040)))
            if not new < potential[n]:
                continue
            potential[n] = new
            into = following if new < threshold else overflow
            for d, old in ((-1, left), (1, right), (-columns, below), (columns, above)):
                m = n + d
                if old > f(new + f(0.707106781 * flat[m])) and flat[m] < BLOCKED and m not in pending:
                    into.append(m)
                    pending.add(m)
        current = following
        if not current:
            threshold = f(threshold + f(100))
            current, overflow = overflow, []
        if potential[target] < HIGH:
            break
    return potential


def converted(master: Costs) -> Costs:
    costs = np.zeros(master.size, np.uint8)
    convert(costs, master, conversion(), 0, 0, *master.shape)
    return costs


def potential_of(costs: Costs, shape: tuple[int, int], source: int, target: int) -> NDArray[np.float32]:
    potential = np.zeros(costs.size, np.float32)
    propagate(
        potential, costs, reaches(), np.zeros(costs.size, np.uint8), np.zeros((3, BUFFER), np.int32), shape[1],
        shape[0], source, target, potential, UNBOUNDED,
    )  # fmt: skip
    return potential


def test_costs_convert_as_navfn_does() -> None:
    table = conversion()
    assert [int(table[c]) for c in (0, 1, 100, 251, 252, 253, 254, 255)] == [50, 50, 130, 250, 251, 254, 254, 253]


@pytest.mark.parametrize("seed", range(3))
def test_the_potential_is_that_of_the_slow_reading_bit_for_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs = converted(maze(rng, 40, 50))
    source, target = 20 * 50 + 8, 31 * 50 + 41
    fast = potential_of(costs, (40, 50), source, target)
    assert np.array_equal(fast, slow_potential(costs.reshape(40, 50), source, target))


def test_the_border_of_the_map_is_blocked() -> None:
    costs = converted(np.zeros((10, 12), np.uint8)).reshape(10, 12)
    assert (costs[[0, -1]] == BLOCKED).all()
    assert (costs[:, [0, -1]] == BLOCKED).all()
    assert (costs[1:-1, 1:-1] == 50).all()


def test_points_fall_into_cells_by_rounding() -> None:
    assert cell_of(0.524, 0.526, 0.0, 0.0, 0.05, 100, 100) == 11 * 100 + 10
    assert cell_of(-0.03, 0.5, 0.0, 0.0, 0.05, 100, 100) == -1


def planned(
    master: Costs, start: tuple[float, float], goal: tuple[float, float], *, guided: bool
) -> NDArray[np.float64]:
    rows, columns = master.shape
    column, row = round(goal[0] / 0.05), round(goal[1] / 0.05)
    rest = np.full(master.size, HIGH, np.float32)
    if guided:
        rest = rest_of_way(master, reaches(), conversion(), column, row)
    longest = 4 * max(rows, columns) + 2
    path = np.zeros((longest, 2))
    end = plan(
        path, 0, *start, *goal, master.copy(), converted(master), reaches(), rest, np.zeros(master.size, np.float32),
        np.zeros(master.size, np.uint8), np.zeros((3, BUFFER), np.int32), np.zeros((2, longest), np.float32), 0.0, 0.0,
        0.05, 0.5,
    )  # fmt: skip
    return path[:end]


@pytest.mark.parametrize("seed", range(6))
def test_looking_near_the_best_way_first_gives_the_very_same_plan(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    master = maze(rng, 120, 160)
    start, goal = (1.0, 1.2), (float(rng.uniform(5, 7.5)), float(rng.uniform(1, 5)))
    full = planned(master, start, goal, guided=False)
    near = planned(master, start, goal, guided=True)
    assert len(full) > 50
    assert np.array_equal(full, near)


def test_a_plan_leads_from_the_robots_cell_to_the_goal_in_half_cells_round_walls() -> None:
    master = np.zeros((80, 80), np.uint8)
    master[40, 10:60] = 254
    path = planned(master, (2.0, 1.0), (2.0, 3.3), guided=True)
    assert np.allclose(path[0], [2.0, 1.0])
    assert tuple(path[-1]) == (2.0, 3.3)
    steps = np.hypot(*np.diff(path[:-2], axis=0).T)
    assert np.median(steps) == pytest.approx(0.025, abs=1e-3)
    cells = np.floor(path / 0.05 + 1e-6).astype(int)
    assert (master[cells[:, 1], cells[:, 0]] < 253).all()
    assert np.hypot(*np.diff(path, axis=0).T).sum() > 3.0


def test_a_goal_in_an_obstacle_is_replaced_by_the_nearest_reachable_point_within_half_a_metre() -> None:
    master = np.zeros((80, 80), np.uint8)
    master[30:51, 30:51] = 254
    path = planned(master, (0.5, 0.5), (2.3, 2.0), guided=False)
    assert 0.15 < np.hypot(path[-1][0] - 2.3, path[-1][1] - 2.0) <= 0.5
    assert len(planned(master, (0.5, 0.5), (2.0, 2.0), guided=False)) == 0


def test_no_way_is_no_plan() -> None:
    master = np.zeros((60, 60), np.uint8)
    master[:, 30] = 254
    assert len(planned(master, (0.5, 0.5), (2.5, 2.5), guided=False)) == 0
    assert len(planned(master, (-5.0, 0.5), (2.5, 2.5), guided=False)) == 0
