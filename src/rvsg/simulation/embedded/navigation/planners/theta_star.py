"""Lazy Theta* P, after nav2_theta_star_planner::ThetaStarPlanner of Nav2 Jazzy: any-angle paths over the costmap.

As there, a path ends up to two cells before the goal's cell, where its last straight part is divided. Searched are
the eight neighbours of a cell, and unknown cells may be crossed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner, kernel
from rvsg.simulation.embedded.navigation.costmap import UNKNOWN
from rvsg.simulation.embedded.navigation.planners.ends import on_grid, straight
from rvsg.simulation.embedded.navigation.planners.heap import pop, push

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]

HIGHEST = 252
MOVES = np.array([(0, 1), (0, -1), (1, 0), (-1, 0), (1, -1), (-1, 1), (1, 1), (-1, -1)])
"""Columns and rows to the neighbours of a cell, in Nav2's order."""


@inner
def is_free(master: Bytes, x: int, y: int) -> bool:
    """Whether the robot's centre may be in a cell."""
    return bool(master[y, x] <= HIGHEST or master[y, x] == UNKNOWN)


@inner
def traversal(value: float, weight: float) -> float:
    """Return what entering a cell of a scaled cost costs."""
    return float(weight * value * value / HIGHEST / HIGHEST)


@inner
def crossed(master: Bytes, x: int, y: int, weight: float) -> float:
    """Return what a line over a cell costs; -1 where it may not cross it."""
    if not (0 <= y < master.shape[0] and 0 <= x < master.shape[1]):
        return -1.0
    if master[y, x] == UNKNOWN:
        return traversal(253.0, weight)
    value = 26.0 + 0.9 * master[y, x]
    return traversal(value, weight) if value <= HIGHEST else -1.0


@kernel
def sight(master: Bytes, x0: int, y0: int, x1: int, y1: int, weight: float) -> float:
    """Return what the cells on the line between two cells cost; -1 where there is no line of sight."""
    dx, dy = abs(x1 - x0), abs(y1 - y0)
    steep = dy > dx
    along, across = (dy, dx) if steep else (dx, dy)
    step_x, step_y = 1 if x1 > x0 else -1, 1 if y1 > y0 else -1
    ux, uy = (step_x - 1) // 2, (step_y - 1) // 2
    x, y, f, total = x0, y0, 0, 0.0
    for _ in range(along):
        f += across
        if f >= along:
            cost = crossed(master, x + ux, y + uy, weight)
            if cost < 0.0:
                return -1.0
            total += cost
            if steep:
                x += step_x
            else:
                y += step_y
            f -= along
        if f != 0:
            cost = crossed(master, x + ux, y + uy, weight)
            if cost < 0.0:
                return -1.0
            total += cost
        if across == 0:
            cost = crossed(master, x, y + uy, weight) if steep else crossed(master, x + ux, y, weight)
            if cost < 0.0:
                cost = crossed(master, x - 1, y + uy, weight) if steep else crossed(master, x + ux, y - 1, weight)
            if cost < 0.0:
                return -1.0
            total += cost
        if steep:
            y += step_y
        else:
            x += step_x
    return total


@kernel(arrays=True)
def search(master: Bytes, source: int, target: int, length_weight: float, cost_weight: float) -> tuple[bool, Ints]:
    """Return whether the target is reached, and the parent of each cell, with the source as its own."""
    rows, columns = master.shape
    cells = rows * columns
    g, f = np.full(cells, np.inf), np.full(cells, np.inf)
    parent = np.full(cells, -1, np.int32)
    queued = np.zeros(cells, np.bool_)
    # Nav2 orders its queue by values that change in it, so a cell may be queued once more.
    heap = np.empty(8 * cells, np.int32)
    tx, ty = target % columns, target // columns
    ahead = min(length_weight, 1.0)
    n = source
    g[n] = traversal(26.0 + 0.9 * master[n // columns, n % columns], cost_weight)
    f[n] = g[n] + ahead * math.hypot(n % columns - tx, n // columns - ty)
    parent[n], queued[n] = n, True
    size = push(heap, 0, n, f)
    while size > 0:
        if n == target:
            return True, parent
        x, y = n % columns, n // columns
        queued[n] = False
        p = parent[parent[n]]
        px, py = p % columns, p // columns
        line = sight(master, x, y, px, py, cost_weight)
        if line >= 0.0:
            found = g[p] + length_weight * math.hypot(x - px, y - py) + line
            if found < g[n]:
                g[n], parent[n] = found, p
                f[n] = found + ahead * math.hypot(x - tx, y - ty)
        for i in range(8):
            c, r = x + MOVES[i, 0], y + MOVES[i, 1]
            if not (0 <= r < rows and 0 <= c < columns) or not is_free(master, c, r):
                continue
            k = r * columns + c
            found = g[n] + length_weight * math.hypot(x - c, y - r) + traversal(26.0 + 0.9 * master[r, c], cost_weight)
            whole = found + ahead * math.hypot(c - tx, r - ty)
            if f[k] > whole:
                g[k], f[k], parent[k] = found, whole, n
                if not queued[k] and size < heap.size:
                    queued[k] = True
                    size = push(heap, size, k, f)
        n = heap[0]
        size = pop(heap, size, f)
    return False, parent


@kernel
def plan_theta(
    path: Floats, start_x: float, start_y: float, goal_x: float, goal_y: float, master: Bytes, origin_x: float,
    origin_y: float, resolution: float, length_weight: float, cost_weight: float,
) -> int:  # fmt: skip
    """Plan from start to goal (metres, map frame) into `path` (P, 2); return the number of points, 0 without a path.

    The start's cell becomes free in the master map itself until its next update. Start and goal within one cell give a
    path of these two.
    """
    rows, columns = master.shape
    sx, sy, gx, gy = on_grid(start_x, start_y, goal_x, goal_y, origin_x, origin_y, resolution, rows, columns)
    if sx < 0.0:
        return 0
    source, target = int(sy) * columns + int(sx), int(gy) * columns + int(gx)
    if source == target:
        return straight(path, start_x, start_y, goal_x, goal_y)
    master[int(sy), int(sx)] = 0
    if not is_free(master, int(gx), int(gy)):
        return 0
    reached, parent = search(master, source, target, length_weight, cost_weight)
    if not reached:
        return 0
    return interpolated(path, parent, source, target, columns, origin_x, origin_y, resolution)


@kernel(arrays=True)
def interpolated(path: Floats, parent: Ints, source: int, target: int, columns: int, origin_x: float,
                 origin_y: float, resolution: float) -> int:  # fmt: skip
    """Write the straight parts of a path as points one cell apart; return their number, 0 where they are too many."""
    corners = np.empty(path.shape[0], np.int32)
    last = 0
    corners[0] = target
    while corners[last] != source:
        last += 1
        if last == corners.size:
            return 0
        corners[last] = parent[corners[last - 1]]
    count = 0
    for j in range(last, 0, -1):
        ax = origin_x + (corners[j] % columns + 0.5) * resolution
        ay = origin_y + (corners[j] // columns + 0.5) * resolution
        dx = origin_x + (corners[j - 1] % columns + 0.5) * resolution - ax
        dy = origin_y + (corners[j - 1] // columns + 0.5) * resolution - ay
        away = math.hypot(dx, dy)
        for k in range(max(1, int(away / resolution))):
            if count == path.shape[0]:
                return 0
            path[count, 0] = ax + k * resolution * dx / away
            path[count, 1] = ay + k * resolution * dy / away
            count += 1
    return count
