"""Nav2's costmaps: obstacle layers that lidars mark and clear, and inflation.

Grids are uint8 (rows along y, columns along x). A layer cell is UNKNOWN, FREE or LETHAL.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner, kernel

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]


FAR = 1e9
"""A return beyond the reach of a cast scan: all of them do the same to the costmaps."""
FREE = 0
INSCRIBED = 253
LETHAL = 254
UNKNOWN = 255
VOXEL_SHORTENING_CELLS = 2.0
CHUNK = 64
"""Cells of a row that are looked at together: few hold a mark."""


def inflation_kernel(resolution_m: float, radius_m: float, scaling: float, inscribed_m: float) -> Bytes:
    """Return the costs around a lethal cell, (2R+1, 2R+1).

    254, 253 within the inscribed radius r, then 252·exp(-scaling (d - r)) up to `radius_m`.
    """
    reach = math.ceil(radius_m / resolution_m - 1e-9)
    offsets = np.arange(-reach, reach + 1, dtype=np.float64)
    cells = np.hypot(offsets[:, None], offsets[None, :])
    distance = cells * resolution_m
    cost = np.floor(252.0 * np.exp(-scaling * (distance - inscribed_m)))
    cost[distance <= inscribed_m] = INSCRIBED
    cost[cells > radius_m / resolution_m + 1e-9] = 0
    cost[reach, reach] = LETHAL
    return cost.astype(np.uint8)


@kernel
def clear_line(grid: Bytes, x0: int, y0: int, x1: int, y1: int, longest: float) -> None:
    """Free the cells of a Bresenham line between two cells, as far as `longest` cells; marks on it vanish."""
    dx = x1 - x0
    dy = y1 - y0
    length = math.sqrt(float(dx * dx + dy * dy))
    scale = min(1.0, longest / length) if length > 0.0 else 1.0
    step_x = 1 if dx > 0 else -1
    step_y = 1 if dy > 0 else -1
    dx = abs(dx)
    dy = abs(dy)
    x = x0
    y = y0
    if dx >= dy:
        error = dx // 2
        for _ in range(int(scale * dx)):
            grid[y, x] = FREE
            x += step_x
            error += dy
            if error >= dx:
                y += step_y
                error -= dx
    else:
        error = dy // 2
        for _ in range(int(scale * dy)):
            grid[y, x] = FREE
            y += step_y
            error += dx
            if error >= dy:
                x += step_x
                error -= dy
    grid[y, x] = FREE


@kernel
def clip_to_grid(sensor_x: float, sensor_y: float, x: float, y: float, columns: int, rows: int) -> tuple[float, float]:
    """Pull the end of a ray back onto the grid; all in cells, the sensor's place is on the grid."""
    share = 1.0
    dx = x - sensor_x
    dy = y - sensor_y
    if x < 0.0:
        share = min(share, -sensor_x / dx)
    if y < 0.0:
        share = min(share, -sensor_y / dy)
    if x > columns:
        share = min(share, (columns - sensor_x) / dx)
    if y > rows:
        share = min(share, (rows - sensor_y) / dy)
    return sensor_x + share * dx, sensor_y + share * dy


@kernel
def observe(
    grid: Bytes,
    ranges: Floats,
    directions: Floats,
    sensor_x: float,
    sensor_y: float,
    bearing: float,
    resolution: float,
    shorten_cells: float,
    obstacle_range: float,
    clearing_range: float,
    min_range: float,
) -> None:
    """Enter one scan into an obstacle layer: clear along every ray that returned, then mark what it hit.

    `sensor_x`, `sensor_y`: the sensor in cells from the grid's lower left corner. Rays clear 3.0 m at most (the
    voxel layer of the local map `shorten_cells` before the hit), hits nearer than 2.5 m are marked. Nothing happens
    where the sensor is off the grid.
    """
    rows, columns = grid.shape
    if not (0.0 <= sensor_x < columns and 0.0 <= sensor_y < rows):
        return
    cos = math.cos(bearing)
    sin = math.sin(bearing)
    start_x = int(sensor_x)
    start_y = int(sensor_y)
    longest = math.ceil(clearing_range / resolution - 1e-9)
    reach = clearing_range + 0.5
    last_x = -1
    last_y = -1
    for k in range(ranges.size):
        if ranges[k] < min_range:
            continue
        cells = min(ranges[k], reach) / resolution
        if ranges[k] < FAR:
            cells = max(0.0, cells - shorten_cells)
        ux = cos * directions[k, 0] - sin * directions[k, 1]
        uy = sin * directions[k, 0] + cos * directions[k, 1]
        x, y = clip_to_grid(sensor_x, sensor_y, sensor_x + cells * ux, sensor_y + cells * uy, columns, rows)
        end_x = min(columns - 1, max(0, int(x)))
        end_y = min(rows - 1, max(0, int(y)))
        if end_x != last_x or end_y != last_y:
            clear_line(grid, start_x, start_y, end_x, end_y, longest)
            last_x = end_x
            last_y = end_y
    for k in range(ranges.size):
        if min_range <= ranges[k] < obstacle_range:
            cells = ranges[k] / resolution
            x = sensor_x + cells * (cos * directions[k, 0] - sin * directions[k, 1])
            y = sensor_y + cells * (sin * directions[k, 0] + cos * directions[k, 1])
            if 0.0 <= x < columns and 0.0 <= y < rows:
                grid[int(y), int(x)] = LETHAL


@kernel
def footprint_spans(
    spans: NDArray[np.int64],
    x: float,
    y: float,
    yaw: float,
    resolution: float,
    columns: int,
    rows: int,
    footprint: Floats,
) -> tuple[int, int]:
    """The cells under the padded footprint: per column its lowest and highest row into `spans` (columns, 2).

    `x`, `y` in cells. Returns the first column and the one past the last; (0, 0) where a corner is off the grid.
    The outline is drawn with Bresenham lines between the corners' cells, as Nav2 does.
    """
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    first = columns
    last = -1
    px = 0
    py = 0
    corners = footprint.shape[0]
    for corner in range(corners + 1):
        forward = footprint[corner % corners, 0] / resolution
        left = footprint[corner % corners, 1] / resolution
        fx = x + forward * cos - left * sin
        fy = y + forward * sin + left * cos
        if not (0.0 <= fx < columns and 0.0 <= fy < rows):
            return 0, 0
        cx = int(fx)
        cy = int(fy)
        if corner == 0:
            for c in range(columns):
                spans[c, 0] = rows
                spans[c, 1] = -1
        else:
            steps = max(abs(cx - px), abs(cy - py))
            for i in range(steps + 1):
                share = i / steps if steps > 0 else 0.0
                column = math.floor(px + share * (cx - px) + 0.5)
                row = math.floor(py + share * (cy - py) + 0.5)
                spans[column, 0] = min(spans[column, 0], row)
                spans[column, 1] = max(spans[column, 1], row)
                first = min(first, column)
                last = max(last, column)
        px = cx
        py = cy
    return first, last + 1


@kernel
def outline_hits(grid: Bytes, footprint: Floats, x: float, y: float, yaw: float, resolution: float) -> bool:
    """Whether the outline of a footprint at a pose leaves the grid or runs over a lethal cell; `x`, `y` in cells.

    Steps of half a cell along each side visit every cell that the side crosses, but corners of some.
    """
    rows, columns = grid.shape
    cos = math.cos(yaw)
    sin = math.sin(yaw)
    corners = footprint.shape[0]
    for k in range(corners):
        ax, ay = footprint[k, 0] / resolution, footprint[k, 1] / resolution
        bx, by = footprint[(k + 1) % corners, 0] / resolution, footprint[(k + 1) % corners, 1] / resolution
        steps = int(2.0 * math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)) + 1
        for i in range(steps):
            share = i / steps
            forward = ax + share * (bx - ax)
            left = ay + share * (by - ay)
            px = x + forward * cos - left * sin
            py = y + forward * sin + left * cos
            if not (0.0 <= px < columns and 0.0 <= py < rows) or grid[int(py), int(px)] == LETHAL:
                return True
    return False


@kernel
def clear_footprint(
    grid: Bytes, spans: NDArray[np.int64], x: float, y: float, yaw: float, resolution: float, footprint: Floats
) -> None:
    """Free the layer's cells under the robot's padded footprint; `x`, `y` in cells."""
    rows, columns = grid.shape
    first, end = footprint_spans(spans, x, y, yaw, resolution, columns, rows, footprint)
    for column in range(first, end):
        for row in range(spans[column, 0], spans[column, 1] + 1):
            grid[row, column] = FREE


@kernel
def shift(grid: Bytes, columns: int, rows: int) -> None:
    """Move the window by whole cells: what leaves is forgotten, what enters is FREE."""
    if columns == 0 and rows == 0:
        return
    n, m = grid.shape
    order = 1 if rows >= 0 else -1
    for i in range(n):
        row = i if order > 0 else n - 1 - i
        source = row + rows
        if 0 <= source < n:
            if columns >= 0:
                for c in range(m):
                    grid[row, c] = grid[source, c + columns] if c + columns < m else FREE
            else:
                for c in range(m - 1, -1, -1):
                    grid[row, c] = grid[source, c + columns] if c + columns >= 0 else FREE
        else:
            for c in range(m):
                grid[row, c] = FREE


@kernel
def stamp(master: Bytes, costs: Bytes, row: int, column: int, top: int, left: int, bottom: int, right: int) -> None:
    """Raise the cells around a lethal one to their inflated cost, within rows top..bottom and columns left..right."""
    reach = costs.shape[0] // 2
    for r in range(max(top, row - reach), min(bottom, row + reach + 1)):
        first = max(left, column - reach)
        source = costs[r - row + reach, first - column + reach :]
        target = master[r, first : min(right, column + reach + 1)]
        for c in range(target.size):
            target[c] = max(target[c], source[c])


@kernel
def is_border(grid: Bytes, row: int, column: int) -> bool:
    """Whether a lethal cell has a neighbour that is not lethal: only such cells are the nearest to any other."""
    rows, columns = grid.shape
    return (
        (row == 0 or grid[row - 1, column] != LETHAL)
        or (row == rows - 1 or grid[row + 1, column] != LETHAL)
        or (column == 0 or grid[row, column - 1] != LETHAL)
        or (column == columns - 1 or grid[row, column + 1] != LETHAL)
    )


@inner
def has(cells: Bytes, value: int) -> bool:
    """Whether one of the cells holds a value; without a branch per cell."""
    found = 0
    for c in range(cells.size):
        found |= cells[c] == value
    return found != 0


@kernel
def inflate_marks(master: Bytes, layers: Bytes, costs: Bytes) -> None:
    """The local master map: what either layer has marked, inflated."""
    rows, columns = master.shape
    master[:] = FREE
    for r in range(rows):
        marked = False
        for n in range(layers.shape[0]):
            marked = marked or has(layers[n, r], LETHAL)
        if not marked:
            continue
        for c in range(columns):
            for n in range(layers.shape[0]):
                if layers[n, r, c] == LETHAL:
                    if is_border(layers[n], r, c):
                        stamp(master, costs, r, c, 0, 0, rows, columns)
                    else:
                        master[r, c] = LETHAL
                    break


@inner
def stamp_row(
    master: Bytes, static: Bytes, layers: Bytes, costs: Bytes, r: int, begin: int, stop: int, top: int, left: int,
    bottom: int, right: int,
) -> None:  # fmt: skip
    """Inflate the marks of a part of a row that the static map does not hold, within top..bottom and left..right."""
    for c in range(begin, stop):
        if static[r, c] != LETHAL:
            for n in range(layers.shape[0]):
                if layers[n, r, c] == LETHAL:
                    stamp(master, costs, r, c, top, left, bottom, right)
                    break


@kernel
def merge_global(
    master: Bytes,
    static: Bytes,
    inflated_static: Bytes,
    layers: Bytes,
    costs: Bytes,
    row: int,
    column: int,
    half: int,
) -> tuple[int, int, int, int]:
    """Recompute the global master map where it can have changed: `half` cells around (row, column) and the inflation.

    Static map, then both obstacle layers by maximum (a known cell replaces an unknown one), then inflation, which
    overwrites an unknown cell only by 253 or more. Returns the rows and columns (top, left, bottom, right) redone.
    """
    rows, columns = master.shape
    reach = costs.shape[0] // 2
    top = max(0, row - half - reach)
    bottom = min(rows, row + half + reach + 1)
    left = max(0, column - half - reach)
    right = min(columns, column + half + reach + 1)
    for r in range(top, bottom):
        for c in range(left, right):
            master[r, c] = inflated_static[r, c]
    first = max(0, left - reach)
    end = min(columns, right + reach)
    for r in range(max(0, top - reach), min(rows, bottom + reach)):
        for begin in range(first, end, CHUNK):
            stop = min(end, begin + CHUNK)
            marked = False
            for n in range(layers.shape[0]):
                marked = marked or has(layers[n, r, begin:stop], LETHAL)
            if marked:
                stamp_row(master, static, layers, costs, r, begin, stop, top, left, bottom, right)
    for r in range(top, bottom):
        if not has(static[r, left:right], UNKNOWN):
            continue
        for c in range(left, right):
            if static[r, c] == UNKNOWN and master[r, c] < INSCRIBED:
                unknown = True
                for n in range(layers.shape[0]):
                    unknown = unknown and layers[n, r, c] == UNKNOWN
                if unknown:
                    master[r, c] = UNKNOWN
    return top, left, bottom, right


def inflate_static(static: Bytes, costs: Bytes) -> Bytes:
    """Return the inflation of the static map alone, unknown cells taken as free: lethal cells spread their costs."""
    inflated = np.empty_like(static)
    inflate_marks(inflated, static[None], costs)
    return inflated
