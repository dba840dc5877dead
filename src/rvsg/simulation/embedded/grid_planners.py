"""The planner that the stack under test has.

Smac 2D, after nav2_smac_planner::SmacPlanner2D of Nav2 Jazzy: A* on the costmap, then a smoothed path.

As there, a path runs through the lower left corners of its cells. Not built: downsampled costmaps and the limit of
planning time.

Lazy Theta* P, after nav2_theta_star_planner::ThetaStarPlanner of Nav2 Jazzy: any-angle paths over the costmap.

As there, a path ends up to two cells before the goal's cell, where its last straight part is divided. Searched are
the eight neighbours of a cell, and unknown cells may be crossed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner, kernel
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.costmap import INSCRIBED, UNKNOWN
from rvsg.simulation.embedded.navfn import plan
from rvsg.simulation.embedded.robot_parameters import PLANNERS
from rvsg.simulation.embedded.state import Scene, State

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]


@inner
def on_grid(
    start_x: float, start_y: float, goal_x: float, goal_y: float, origin_x: float, origin_y: float, resolution: float,
    rows: int, columns: int,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Return column and row of start and goal, with their fractions; -1 for all where one is off the grid."""
    sx, sy = (start_x - origin_x) / resolution, (start_y - origin_y) / resolution
    gx, gy = (goal_x - origin_x) / resolution, (goal_y - origin_y) / resolution
    if min(sx, gx) < 0.0 or min(sy, gy) < 0.0 or max(sx, gx) >= columns or max(sy, gy) >= rows:
        return -1.0, -1.0, -1.0, -1.0
    return sx, sy, gx, gy


@inner
def straight(path: Floats, start_x: float, start_y: float, goal_x: float, goal_y: float) -> int:
    """Write the path between two points of one cell; return its number of points."""
    path[0, 0], path[0, 1] = start_x, start_y
    path[1, 0], path[1, 1] = goal_x, goal_y
    return 2


@inner
def sift_up(heap: Ints, hole: int, top: int, entry: int, keys: Any) -> None:
    """Put an entry into a hole, or above it where its key is less than those there."""
    while hole > top:
        parent = (hole - 1) // 2
        if not keys[heap[parent]] > keys[entry]:
            break
        heap[hole] = heap[parent]
        hole = parent
    heap[hole] = entry


@inner
def push(heap: Ints, size: int, entry: int, keys: Any) -> int:
    """Add an entry; return the new size."""
    sift_up(heap, size, 0, entry, keys)
    return size + 1


@inner
def pop(heap: Ints, size: int, keys: Any) -> int:
    """Remove the entry of the least key, which is `heap[0]`; return the new size."""
    size -= 1
    entry = heap[size]
    hole = 0
    child = 2
    while child < size:
        if keys[heap[child]] > keys[heap[child - 1]]:
            child -= 1
        heap[hole] = heap[child]
        hole = child
        child = 2 * hole + 2
    if child == size and size > 0:
        heap[hole] = heap[child - 1]
        hole = child - 1
    if size > 0:
        sift_up(heap, hole, 0, entry, keys)
    return size


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


THETA_HIGHEST = 252
MOVES = np.array([(0, 1), (0, -1), (1, 0), (-1, 0), (1, -1), (-1, 1), (1, 1), (-1, -1)])
"""Columns and rows to the neighbours of a cell, in Nav2's order."""


@inner
def is_free_cell(master: Bytes, x: int, y: int) -> bool:
    """Whether the robot's centre may be in a cell."""
    return bool(master[y, x] <= THETA_HIGHEST or master[y, x] == UNKNOWN)


@inner
def traversal(value: float, weight: float) -> float:
    """Return what entering a cell of a scaled cost costs."""
    return float(weight * value * value / THETA_HIGHEST / THETA_HIGHEST)


@inner
def crossed(master: Bytes, x: int, y: int, weight: float) -> float:
    """Return what a line over a cell costs; -1 where it may not cross it."""
    if not (0 <= y < master.shape[0] and 0 <= x < master.shape[1]):
        return -1.0
    if master[y, x] == UNKNOWN:
        return traversal(253.0, weight)
    value = 26.0 + 0.9 * master[y, x]
    return traversal(value, weight) if value <= THETA_HIGHEST else -1.0


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
def search_any_angle(
    master: Bytes, source: int, target: int, length_weight: float, cost_weight: float
) -> tuple[bool, Ints]:
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
            if not (0 <= r < rows and 0 <= c < columns) or not is_free_cell(master, c, r):
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
    if not is_free_cell(master, int(gx), int(gy)):
        return 0
    reached, parent = search_any_angle(master, source, target, length_weight, cost_weight)
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


NAVFN, SMAC_2D = PLANNERS.index("navfn"), PLANNERS.index("smac_2d")


@inner
def plan_navfn(scene: Scene, state: State, x: float, y: float, goal_x: float, goal_y: float) -> int:
    """Plan from start to goal (map frame) into the first layer of `state.path`; return the number of points."""
    return plan(
        state.path[0], 0, x, y, goal_x, goal_y, state.global_master, state.costs, scene.reach, state.rest,
        state.potential, state.waiting, state.buffers, state.cells, scene.origin_x, scene.origin_y, scene.resolution,
        state.stack.plan_tolerance,
    )  # fmt: skip


def plan_outside(scene: Scene, state: State) -> None:
    """Plan with another planner, which is not part of the compiled loop: it is compiled only for runs that use it."""
    stack, (goal_x, goal_y, _) = state.stack, state.goals[state.nav[st.GOAL]].tolist()
    x, y = state.times[st.PLAN_X : st.PLAN_Y + 1].tolist()
    ends = (state.path[0], x, y, goal_x, goal_y)
    grid = (state.global_master, scene.origin_x, scene.origin_y, scene.resolution)
    if stack.planner == SMAC_2D:
        count = plan_smac(*ends, *grid, stack.smac_cost, stack.smac_tolerance)
    else:
        count = plan_theta(*ends, *grid, stack.theta_length, stack.theta_cost)
    state.nav[st.OUTSIDE_PLAN] = st.PLANNED_FROM + count
