"""Smac 2D, after nav2_smac_planner::SmacPlanner2D of Nav2 Jazzy: A* on the costmap, then a smoothed path.

As there, a path runs through the lower left corners of its cells. Not built: downsampled costmaps and the limit of
planning time.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner, kernel
from rvsg.simulation.embedded.navigation.costmap import INSCRIBED, UNKNOWN
from rvsg.simulation.embedded.navigation.planners.ends import on_grid, straight
from rvsg.simulation.embedded.navigation.planners.heap import pop, push

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]

APPROACHES = 1000
"""Cells that are still visited once one within the tolerance of the goal is known."""
HIGHEST = 252
DATA, SMOOTHNESS, CHANGE = 0.2, 0.3, 1e-10
SMOOTHINGS, REFINEMENTS = 1000, 2
ROOT = np.float32(math.sqrt(2.0))
STEPS = np.array([(0, -1), (0, 1), (-1, 0), (1, 0), (-1, -1), (-1, 1), (1, -1), (1, 1)])
"""Rows and columns to the neighbours of a cell, in Nav2's order."""


@kernel(arrays=True)
def search(master: Bytes, source: int, target: int, gx: float, gy: float, cost_weight: float,
           tolerance: float) -> tuple[int, Ints]:  # fmt: skip
    """Return the cell that the search ends at, -1 without one, and the cell before each.

    Args:
        gx: column of the goal with its fraction; `gy` its row.
        tolerance: how far from the goal the search may end, in cells.
    """
    rows, columns = master.shape
    cells = rows * columns
    cost = np.full(cells, np.inf, np.float32)
    before = np.full(cells, -1, np.int32)
    visited = np.zeros(cells, np.bool_)
    heap = np.empty(8 * cells, np.int32)
    keys = np.empty(8 * cells, np.float32)
    place = np.empty(8 * cells, np.int32)
    goal_x, goal_y, weight = np.float32(gx), np.float32(gy), np.float32(cost_weight)
    nearest, nearest_m, approaches = -1, np.float32(np.inf), 0
    cost[source] = np.float32(0.0)
    keys[0], place[0] = np.float32(0.0), source
    entries, size = 1, push(heap, 0, 0, keys)
    while size > 0:
        n = place[heap[0]]
        size = pop(heap, size, keys)
        if visited[n]:
            continue
        visited[n] = True
        if n == target:
            return target, before
        if nearest_m < tolerance:
            approaches += 1
            if approaches >= APPROACHES:
                return nearest, before
        row, column = n // columns, n % columns
        for i in range(8):
            r, c = row + STEPS[i, 0], column + STEPS[i, 1]
            if not (0 <= r < rows and 0 <= c < columns):
                continue
            value = master[r, c]
            k = r * columns + c
            if visited[k] or (value >= INSCRIBED and value != UNKNOWN):
                continue
            step = np.float32(1.0) + weight * (np.float32(value) / np.float32(HIGHEST))
            found = cost[n] + (ROOT * step if i > 3 else step)
            if found < cost[k]:
                cost[k], before[k] = found, n
                dx, dy = goal_x - np.float32(c), goal_y - np.float32(r)
                away = np.float32(math.sqrt(dx * dx + dy * dy))
                if away < nearest_m:
                    nearest, nearest_m = k, away
                keys[entries], place[entries] = found + away, k
                size = push(heap, size, entries, keys)
                entries += 1
    return (nearest if nearest_m < tolerance else -1), before


@inner
def take_over(points: Floats, others: Floats) -> None:
    """Copy points (N, 2); a loop is compiled in a fraction of the time that an assignment of arrays takes."""
    for i in range(points.shape[0]):
        points[i, 0] = others[i, 0]
        points[i, 1] = others[i, 1]


@kernel(arrays=True)
def smoothed(points: Floats, master: Bytes) -> bool:
    """Smooth a path (N, 2), in cells, in place, with its ends fixed; False where it is stopped by an obstacle.

    Then it stays as it was before the change that led into the obstacle.
    """
    new, last = points.copy(), points.copy()
    change = CHANGE
    rounds = 0
    while change >= CHANGE:
        rounds += 1
        change = 0.0
        if rounds >= SMOOTHINGS:
            take_over(points, last)
            return False
        for i in range(1, points.shape[0] - 1):
            for axis in range(2):
                was = new[i, axis]
                new[i, axis] += DATA * (points[i, axis] - was) + SMOOTHNESS * (
                    new[i + 1, axis] + new[i - 1, axis] - 2.0 * was
                )
                change += abs(new[i, axis] - was)
            value = master[int(new[i, 1]), int(new[i, 0])]
            if value > HIGHEST and value != UNKNOWN:
                take_over(points, last)
                return False
        take_over(last, new)
    take_over(points, new)
    return True


@kernel
def plan_smac(
    path: Floats, start_x: float, start_y: float, goal_x: float, goal_y: float, master: Bytes, origin_x: float,
    origin_y: float, resolution: float, cost_weight: float, tolerance: float,
) -> int:  # fmt: skip
    """Plan from start to goal (metres, map frame) into `path` (P, 2); return the number of points, 0 without a path.

    Start and goal within one cell give a path of these two.
    """
    rows, columns = master.shape
    sx, sy, gx, gy = on_grid(start_x, start_y, goal_x, goal_y, origin_x, origin_y, resolution, rows, columns)
    if sx < 0.0:
        return 0
    source, target = int(sy) * columns + int(sx), int(gy) * columns + int(gx)
    if source == target:
        return straight(path, start_x, start_y, goal_x, goal_y)
    end, before = search(master, source, target, gx, gy, cost_weight, tolerance / resolution)
    count = 0
    n = end
    while n >= 0:
        count += 1
        n = before[n]
    if count < 2 or count > path.shape[0]:
        return 0
    points = np.empty((count, 2))
    n = end
    for i in range(count - 1, -1, -1):
        points[i, 0], points[i, 1] = n % columns, n // columns
        n = before[n]
    if count > 11:
        for _ in range(1 + REFINEMENTS):
            if not smoothed(points, master):
                break
    for i in range(count):
        path[i, 0] = origin_x + points[i, 0] * resolution
        path[i, 1] = origin_y + points[i, 1] * resolution
    return count
