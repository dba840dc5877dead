"""Smac 2D and Theta*: their paths against an exhaustive search, and whole runs with each planner."""

from __future__ import annotations

import heapq
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from rvsg.core.errors import InvalidOptions
from rvsg.core.kernels import kernel
from rvsg.simulation.embedded import grid_planners
from rvsg.simulation.embedded.simulator import rehearsal, simulate_agents
from rvsg.stacks import StackChoice

SIDE = 0.05


def with_wall() -> np.ndarray[Any, Any]:
    """Return a map of 40 x 60 cells whose wall, with costs around it, leaves a gap at the top."""
    master = np.zeros((40, 60), np.uint8)
    master[:34, 25:34] = 120
    master[:32, 27:32] = 253
    master[:30, 29] = 254
    return master


def least_cost(master: np.ndarray[Any, Any], source: tuple[int, int], target: tuple[int, int], weight: float) -> float:
    """Return the cost of the best way over the eight neighbours, by Dijkstra's algorithm."""
    best = {source: 0.0}
    queue = [(0.0, source)]
    while queue:
        cost, (row, column) = heapq.heappop(queue)
        if (row, column) == target:
            return cost
        for r in (row - 1, row, row + 1):
            for c in (column - 1, column, column + 1):
                if not (0 <= r < master.shape[0] and 0 <= c < master.shape[1]) or master[r, c] >= 253:
                    continue
                found = cost + np.hypot(r - row, c - column) * (1.0 + weight * master[r, c] / 252.0)
                if found < best.get((r, c), np.inf) and (r, c) != (row, column):
                    best[r, c] = found
                    heapq.heappush(queue, (found, (r, c)))
    return float("inf")


def plan(planner: Any, master: np.ndarray[Any, Any], goal: tuple[float, float], *options: float) -> Any:
    path = np.zeros((300, 2))
    count = planner(path, 0.51, 0.26, *goal, master, 0.0, 0.0, SIDE, *options)
    return path[:count]


@kernel
def drained(heap_: Any, keys: Any) -> Any:
    size = 0
    for entry in range(keys.size):
        size = grid_planners.push(heap_, size, entry, keys)
    found = np.zeros(keys.size, np.int32)
    for k in range(keys.size):
        found[k] = heap_[0]
        size = grid_planners.pop(heap_, size, keys)
    return found


def test_the_queue_gives_the_least_key_first() -> None:
    keys = np.random.default_rng(1).integers(0, 40, 200).astype(np.float32)
    found = drained(np.zeros(200, np.int32), keys)
    assert sorted(found) == list(range(200)) and (np.diff(keys[found]) >= 0).all()


@pytest.mark.parametrize("weight", [0.0, 1.0, 5.0])
def test_smac_finds_the_way_of_least_cost(weight: float) -> None:
    master = with_wall()
    end, before = grid_planners.search(master, 5 * 60 + 10, 5 * 60 + 50, 50.5, 5.5, weight, 2.5)
    way = [end]
    while before[way[-1]] >= 0:
        way.append(before[way[-1]])
    cells = [divmod(int(n), 60) for n in way[::-1]]
    cost = sum(np.hypot(b[0] - a[0], b[1] - a[1]) * (1.0 + weight * master[b] / 252.0) for a, b in pairwise(cells))
    assert end == 5 * 60 + 50 and cost == pytest.approx(least_cost(master, (5, 10), (5, 50), weight), rel=1e-5)


def test_smac_smooths_its_path_around_the_wall() -> None:
    master = with_wall()
    path = plan(grid_planners.plan_smac, master, (2.53, 0.27), 5.0, 0.125)
    assert path[0] == pytest.approx((0.5, 0.25)) and path[-1] == pytest.approx((2.5, 0.25))
    assert (master[(path[:, 1] / SIDE).astype(int), (path[:, 0] / SIDE).astype(int)] < 253).all()
    turns = np.abs(np.diff(np.unwrap(np.arctan2(*np.diff(path, axis=0).T[::-1]))))
    assert turns.max() < 0.3  # the grid's are 0.79


@pytest.mark.parametrize(("weight", "aside"), [(0.0, 0.02), (2.0, 0.1)])
def test_theta_star_goes_straight_where_nothing_is_in_the_way(weight: float, aside: float) -> None:
    path = plan(grid_planners.plan_theta, np.zeros((40, 60), np.uint8), (2.53, 1.52), 1.0, weight)
    across = ((path - path[0]) @ np.array([-1.25, 2.0])) / np.hypot(2.0, 1.25)
    assert path[0] == pytest.approx((0.525, 0.275))
    assert np.abs(across).max() < aside  # leaving a cell by its corner crosses fewer cells
    assert np.hypot(2.525 - path[-1, 0], 1.525 - path[-1, 1]) < 2 * SIDE


def test_theta_star_goes_around_the_wall_on_straight_lines() -> None:
    master = with_wall()
    path = plan(grid_planners.plan_theta, master, (2.53, 0.27), 1.0, 2.0)
    assert (master[(path[:, 1] / SIDE).astype(int), (path[:, 0] / SIDE).astype(int)] < 253).all()
    steps = np.hypot(*np.diff(path, axis=0).T)
    best = least_cost(master, (5, 10), (5, 50), 0.0) * SIDE
    assert steps.max() < 2 * SIDE and steps.sum() < best
    headings = np.arctan2(*np.diff(path, axis=0).T[::-1])
    assert (np.abs(np.diff(headings)) > 1e-6).sum() < 20


@pytest.mark.parametrize("planner", [(grid_planners.plan_smac, 1.0, 0.125), (grid_planners.plan_theta, 1.0, 2.0)])
def test_without_a_way_there_is_no_path(planner: Any) -> None:
    closed = with_wall()
    closed[:, 29] = 254
    assert len(plan(planner[0], closed, (2.53, 0.27), *planner[1:])) == 0
    assert len(plan(planner[0], closed, (9.0, 0.27), *planner[1:])) == 0
    assert plan(planner[0], closed, (0.53, 0.27), *planner[1:]).tolist() == [[0.51, 0.26], [0.53, 0.27]]


def test_every_planner_leads_a_run_to_its_goal() -> None:
    world, route, humans = rehearsal()
    route = route.model_copy(update={"time_limit_s": 60.0})
    tracks = {}
    for kind in ("navfn", "smac_2d", "theta_star"):
        stack = StackChoice.of("nav2-dwb", {"planner": {"kind": kind}})
        run = simulate_agents(world, route, humans, seed=1, stack=stack)
        tracks[kind] = run.trajectory.x.tobytes() + run.trajectory.y.tobytes()
        assert run.options["stack"]["options"]["planner"]["kind"] == kind
    assert len(set(tracks.values())) == 3


def test_an_unknown_planner_is_refused() -> None:
    with pytest.raises(InvalidOptions, check=lambda error: error.keys == ("kind",)):
        StackChoice.of("nav2-rpp", {"planner": {"kind": "smac_hybrid"}})
