"""NavFn, Nav2's global planner: Dijkstra's potential on the costmap and the path down its gradient.

Re-implemented from its rules (NavFn by Kurt Konolige; nav2_navfn_planner): cost conversion, buffers with rising
threshold, single precision, half-cell steps. Cells count from the lower left corner, index = row * columns + column.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner, kernel
from rvsg.simulation.costmap import INSCRIBED, UNKNOWN

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]


NEUTRAL = 50
BLOCKED = 254
HIGH = np.float32(1e10)
FIRST_THRESHOLD = np.float32(254.0)
THRESHOLD_STEP = np.float32(100.0)
BUFFER = 10_000
SPARE = np.float32(1500.0)
"""Six cells of the highest cost: more than the neighbours of a path can cost beyond the path itself."""
STEP_CELLS = np.float32(0.5)
HALF_ROOT = 0.707106781


def reaches() -> Singles:
    """0.7071 times every cost of a cell: how much lower a potential must be to lower the next cell's."""
    return (HALF_ROOT * np.arange(256)).astype(np.float32)


def conversion() -> Bytes:
    """NavFn's cost of every costmap value: 50 + 0.8 c up to 253; unknown 253; inscribed and lethal blocked."""
    table = np.full(256, BLOCKED, np.uint8)
    for value in range(INSCRIBED):
        table[value] = min(int(NEUTRAL + 0.8 * value), BLOCKED - 1)
    table[UNKNOWN] = BLOCKED - 1
    return table


@kernel
def convert(costs: Bytes, master: Bytes, table: Bytes, top: int, left: int, bottom: int, right: int) -> None:
    """Refresh NavFn's costs (a flat grid) from the master map within rows top..bottom and columns left..right.

    The map's border is blocked.
    """
    rows, columns = master.shape
    for r in range(top, bottom):
        base = r * columns
        for c in range(left, right):
            costs[base + c] = table[master[r, c]]
        if r == 0 or r == rows - 1:
            for c in range(left, right):
                costs[base + c] = BLOCKED
        costs[base] = BLOCKED
        costs[base + columns - 1] = BLOCKED


@inner
def planar_wave(across: np.float32, along: np.float32, cost: np.float32) -> np.float32:
    """The potential of a cell of that cost from the least of its neighbours in either direction.

    A quadratic stands for the exact planar wave; a direction that is more than the cell's cost behind has no part.
    """
    base = across if across < along else along
    difference = (along if across < along else across) - base
    if difference >= cost:
        return base + cost
    q = difference / cost
    return base + cost * np.float32(-0.2301 * q * q + 0.5307 * q + 0.7040)


@inner
def sweep(
    potential: Singles, costs: Bytes, reach: Singles, waiting: Bytes, buffer: Ints, filled: int, ahead: Ints,
    later: Ints, left: int, width: np.uintp, threshold: np.float32, rest: Singles, bound: np.float32,
) -> tuple[int, int]:  # fmt: skip
    """Update every cell of a buffer: lower its potential if its neighbours allow, and pass the wave on.

    Neighbours that a lowered cell may lower in turn join a buffer: `ahead` for a potential below the threshold, else
    `later`, which already holds `left`; none joins twice (`waiting`; blocked cells always seem to wait) or joins a full
    one. `reach` is 0.7071 times every cost. A cell that leads to the target only by more than `bound` in all is not
    followed; `rest` is the least cost from every cell to the target. Returns the fills of both buffers.
    """
    one = np.uintp(1)
    new = 0
    for i in range(filled):
        n = np.uintp(buffer[i])
        west = potential[n - one]
        east = potential[n + one]
        south = potential[n - width]
        north = potential[n + width]
        across = west if west < east else east
        along = south if south < north else north
        value = planar_wave(across, along, np.float32(costs[n]))
        if not value < potential[n]:
            continue
        potential[n] = value
        if value + rest[n] > bound:
            continue
        low = value < threshold
        target = ahead if low else later
        fill = new if low else left
        if waiting[n - one] == 0 and west > value + reach[costs[n - one]] and fill < BUFFER:
            target[fill] = n - one
            waiting[n - one] = 1
            fill += 1
        if waiting[n + one] == 0 and east > value + reach[costs[n + one]] and fill < BUFFER:
            target[fill] = n + one
            waiting[n + one] = 1
            fill += 1
        if waiting[n - width] == 0 and south > value + reach[costs[n - width]] and fill < BUFFER:
            target[fill] = n - width
            waiting[n - width] = 1
            fill += 1
        if waiting[n + width] == 0 and north > value + reach[costs[n + width]] and fill < BUFFER:
            target[fill] = n + width
            waiting[n + width] = 1
            fill += 1
        if low:
            new = fill
        else:
            left = fill
    return new, left


@kernel
def propagate(
    potential: Singles,
    costs: Bytes,
    reach: Singles,
    waiting: Bytes,
    buffers: Ints,
    columns: int,
    rows: int,
    source: int,
    target: int,
    rest: Singles,
    bound: np.float32,
) -> None:
    """Spread the potential from `source` until `target` has one, all is done, or the rounds run out.

    Cells off every way to the target of at most `bound` are left out (see `sweep`). `buffers` is (3, 10000): the
    current, the next and the overflow buffer take turns.
    """
    for n in range(potential.size):
        potential[n] = HIGH
        waiting[n] = 1 if costs[n] >= BLOCKED else 0
    current = 0
    following = 1
    overflow = 2
    width = np.uintp(columns)
    potential[source] = np.float32(0.0)
    filled = 0
    for n in (source + 1, source - 1, source - columns, source + columns):
        if waiting[n] == 0:
            buffers[current, filled] = n
            waiting[n] = 1
            filled += 1
    left = 0
    threshold = FIRST_THRESHOLD
    for _ in range(max(columns * rows // 20, columns + rows)):
        if filled == 0:
            return
        buffer = buffers[current]
        for i in range(filled):
            waiting[np.uintp(buffer[i])] = 0
        filled, left = sweep(
            potential, costs, reach, waiting, buffer, filled, buffers[following], buffers[overflow], left, width,
            threshold, rest, bound,
        )  # fmt: skip
        current, following = following, current
        if filled == 0:
            threshold += THRESHOLD_STEP
            filled = left
            left = 0
            current, overflow = overflow, current
        if potential[target] < HIGH:
            return


@kernel
def rest_of_way(static: Bytes, reach: Singles, table: Bytes, column: int, row: int) -> Singles:
    """NavFn's potential from the goal's cell on the inflated static map, unknown cells taken as free."""
    rows, columns = static.shape
    costs = np.zeros(rows * columns, np.uint8)
    convert(costs, static, table, 0, 0, rows, columns)
    potential = np.zeros(rows * columns, np.float32)
    waiting = np.zeros(rows * columns, np.uint8)
    buffers = np.zeros((3, BUFFER), np.int32)
    propagate(
        potential, costs, reach, waiting, buffers, columns, rows, row * columns + column, 0, potential,
        np.float32(math.inf),
    )  # fmt: skip
    return potential


@kernel
def gradient(potential: Singles, n: int, columns: int, cells: int) -> tuple[np.float32, np.float32]:
    """The unit vector along which the potential falls at a cell (columns, rows); zero where it is flat."""
    zero = np.float32(0.0)
    if n < columns or n > cells - columns:
        return zero, zero
    here = potential[n]
    dx = zero
    dy = zero
    if here >= HIGH:
        if potential[n - 1] < HIGH:
            dx = np.float32(-BLOCKED)
        elif potential[n + 1] < HIGH:
            dx = np.float32(BLOCKED)
        if potential[n - columns] < HIGH:
            dy = np.float32(-BLOCKED)
        elif potential[n + columns] < HIGH:
            dy = np.float32(BLOCKED)
    else:
        if potential[n - 1] < HIGH:
            dx += potential[n - 1] - here
        if potential[n + 1] < HIGH:
            dx += here - potential[n + 1]
        if potential[n - columns] < HIGH:
            dy += potential[n - columns] - here
        if potential[n + columns] < HIGH:
            dy += here - potential[n + columns]
    norm = np.float32(math.sqrt(dx * dx + dy * dy))
    if norm > zero:
        return dx / norm, dy / norm
    return zero, zero


@kernel
def lowest_neighbour(potential: Singles, n: int, columns: int) -> int:
    """The neighbour of least potential; values are compared with the best one cut to an integer, as NavFn does."""
    lowest = n
    least = int(potential[n])
    for offset in (-columns - 1, -columns, -columns + 1, -1, 1, columns - 1, columns, columns + 1):
        if potential[n + offset] < least:
            least = int(potential[n + offset])
            lowest = n + offset
    return lowest


@kernel
def has_gap(potential: Singles, n: int, columns: int) -> bool:
    """Whether one of the nine cells around has no potential."""
    for row in (-columns, 0, columns):
        for column in (-1, 0, 1):
            if potential[n + row + column] >= HIGH:
                return True
    return False


@kernel
def rounded(value: np.float32) -> int:
    """The nearest integer, halves away from zero (C's round)."""
    return int(value + np.float32(0.5)) if value >= 0 else -int(np.float32(0.5) - value)


@kernel
def descend(path: Singles, potential: Singles, columns: int, rows: int, source: int, target: int) -> int:
    """Walk from the target's cell down to the source in half-cell steps.

    Writes points into `path` (2, P), in cells; returns their number, 0 where the way is lost.
    """
    cells = columns * rows
    n = target
    dx = np.float32(0.0)
    dy = np.float32(0.0)
    one = np.float32(1.0)
    count = 0
    for _ in range(4 * max(columns, rows)):
        nearest = min(cells - 1, max(0, n + rounded(dx) + columns * rounded(dy)))
        if potential[nearest] < NEUTRAL:
            path[0, count] = np.float32(source % columns)
            path[1, count] = np.float32(source // columns)
            return count + 1
        if n < columns + 1 or n >= cells - columns - 1:
            return 0
        path[0, count] = np.float32(n % columns) + dx
        path[1, count] = np.float32(n // columns) + dy
        count += 1
        stuck = count > 2 and path[0, count - 1] == path[0, count - 3] and path[1, count - 1] == path[1, count - 3]
        if stuck or has_gap(potential, n, columns):
            n = lowest_neighbour(potential, n, columns)
            dx = np.float32(0.0)
            dy = np.float32(0.0)
            if potential[n] >= HIGH:
                return 0
            continue
        ax, ay = gradient(potential, n, columns, cells)
        bx, by = gradient(potential, n + 1, columns, cells)
        cx, cy = gradient(potential, n + columns, columns, cells)
        ex, ey = gradient(potential, n + columns + 1, columns, cells)
        gx = (one - dy) * ((one - dx) * ax + dx * bx) + dy * ((one - dx) * cx + dx * ex)
        gy = (one - dy) * ((one - dx) * ay + dx * by) + dy * ((one - dx) * cy + dx * ey)
        if gx == np.float32(0.0) and gy == np.float32(0.0):
            return 0
        step = STEP_CELLS / np.float32(math.sqrt(gx * gx + gy * gy))
        dx += gx * step
        dy += gy * step
        if dx > one:
            n += 1
            dx -= one
        if dx < -one:
            n -= 1
            dx += one
        if dy > one:
            n += columns
            dy -= one
        if dy < -one:
            n -= columns
            dy += one
    return 0


@kernel
def cell_of(x: float, y: float, origin_x: float, origin_y: float, resolution: float, columns: int, rows: int) -> int:
    """NavFn's cell of a point: *rounded*, half a cell off the costmap's convention; -1 off the map or on its border."""
    column = math.floor((x - origin_x) / resolution + 0.5)
    row = math.floor((y - origin_y) / resolution + 0.5)
    if column < 1 or row < 1 or column >= columns - 1 or row >= rows - 1:
        return -1
    return row * columns + column


@kernel
def reachable_goal(
    potential: Singles,
    goal_x: float,
    goal_y: float,
    origin_x: float,
    origin_y: float,
    resolution: float,
    columns: int,
    rows: int,
    tolerance: float,
) -> tuple[float, float, bool]:
    """Return the goal if it has a potential, else the nearest point with one, in cell steps within ±`tolerance`."""
    n = cell_of(goal_x, goal_y, origin_x, origin_y, resolution, columns, rows)
    if n >= 0 and potential[n] < HIGH:
        return goal_x, goal_y, True
    nearest = 1e300
    found = False
    best_x = goal_x
    best_y = goal_y
    y = goal_y - tolerance
    while y <= goal_y + tolerance:
        x = goal_x - tolerance
        while x <= goal_x + tolerance:
            n = cell_of(x, y, origin_x, origin_y, resolution, columns, rows)
            square = (x - goal_x) * (x - goal_x) + (y - goal_y) * (y - goal_y)
            if n >= 0 and potential[n] < HIGH and square < nearest:
                nearest = square
                best_x = x
                best_y = y
                found = True
            x += resolution
        y += resolution
    return best_x, best_y, found


@kernel
def plan(
    path: Floats,
    begin: int,
    start_x: float,
    start_y: float,
    goal_x: float,
    goal_y: float,
    master: Bytes,
    costs: Bytes,
    reach: Singles,
    rest: Singles,
    potential: Singles,
    waiting: Bytes,
    buffers: Ints,
    cells: Singles,
    origin_x: float,
    origin_y: float,
    resolution: float,
    tolerance: float,
) -> int:
    """Plan from start to goal (metres, map frame) and write the points to `path` (P, 2) from row `begin` on.

    Returns the row past the last point, `begin` where there is no path. The start's cell becomes free in the master
    map itself until its next update. The end is the goal, or the reachable point nearest to it within `tolerance` (m).
    """
    rows, columns = master.shape
    source = cell_of(start_x, start_y, origin_x, origin_y, resolution, columns, rows)
    if source < 0:
        return begin
    target = cell_of(goal_x, goal_y, origin_x, origin_y, resolution, columns, rows)
    master[source // columns, source % columns] = 0
    costs[source] = NEUTRAL
    target = max(target, 0)
    # First only where a way to the target can be near to the best one on the static map, `rest`: people can only add to
    # it. Where the target's potential turns out at least SPARE below the bound, no cell that was left out can have had
    # a part in the potentials along the path, nor in those around it from which its gradient is taken. Else everywhere.
    bound = np.float32(math.inf)
    if rest[source] < HIGH and costs[target] < BLOCKED:
        bound = np.float32(1.02) * rest[source] + np.float32(2.0) * SPARE
        propagate(potential, costs, reach, waiting, buffers, columns, rows, source, target, rest, bound)
    if bound == math.inf or not potential[target] + SPARE < bound:
        propagate(potential, costs, reach, waiting, buffers, columns, rows, source, target, rest, np.float32(math.inf))
    end_x, end_y, found = reachable_goal(
        potential, goal_x, goal_y, origin_x, origin_y, resolution, columns, rows, tolerance
    )
    if not found:
        return begin
    target = cell_of(end_x, end_y, origin_x, origin_y, resolution, columns, rows)
    count = descend(cells, potential, columns, rows, source, target)
    if count == 0 or begin + count + 1 > path.shape[0]:
        return begin
    for i in range(count):
        path[begin + i, 0] = origin_x + cells[0, count - 1 - i] * resolution
        path[begin + i, 1] = origin_y + cells[1, count - 1 - i] * resolution
    end = begin + count
    if count >= 2:  # the goal replaces a last point that lies farther on
        sx = path[end - 2, 0]
        sy = path[end - 2, 1]
        last = (path[end - 1, 0] - sx) ** 2 + (path[end - 1, 1] - sy) ** 2
        if last > (end_x - sx) ** 2 + (end_y - sy) ** 2:
            end -= 1
    path[end, 0] = end_x
    path[end, 1] = end_y
    return end + 1
