"""The obstacle nearest to a person: on the true surface (default), or HuNavSim's point towards a model's origin."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import kernel
from rvsg.simulation.embedded.walls import cell_borders, edges_of
from rvsg.world.world import Polygon, SolidObject, World

Floats = NDArray[np.float64]

WALL_GAP_M = 0.15
"""The nearest a person's centre comes to a wall: half of the depth of a body, for who turns sideways."""
RASTER_M = 0.1
REACH_M = 2.0
"""Farther obstacles are neglected: at 2 m from the body's edge the force is 10·exp(-8) = 0.003 m/s²."""


@kernel
def entry_point(
    x: float, y: float, z: float, ox: float, oy: float, oz: float, box: Floats
) -> tuple[float, float, float]:
    """Where the segment from (x, y, z) to the origin (ox, oy, oz) enters the axis-aligned box: x, y, distance in 3-D.

    `box` holds (x_min, x_max, y_min, y_max, z_min, z_max). The distance is -1 where the segment misses the box and 0
    where it begins inside: HuNavSim then ignores the model.
    """
    near = 0.0
    far = 1.0
    start = (x, y, z)
    step = (ox - x, oy - y, oz - z)
    for axis in range(3):
        low = box[2 * axis] - start[axis]
        high = box[2 * axis + 1] - start[axis]
        if abs(step[axis]) < 1e-12:
            if low > 0.0 or high < 0.0:
                return 0.0, 0.0, -1.0
        else:
            a = low / step[axis]
            b = high / step[axis]
            near = max(near, min(a, b))
            far = min(far, max(a, b))
    if near > far:
        return 0.0, 0.0, -1.0
    length = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    return x + near * step[0], y + near * step[1], near * length


@kernel
def point_towards_origin(
    x: float, y: float, z: float, boxes: Floats, origins: Floats, robot_x: float, robot_y: float, robot_yaw: float,
    robot_box: Floats, robot_height: float,
) -> tuple[float, float, bool]:  # fmt: skip
    """HuNavSim's one obstacle point of a human: nearest entry into a model's box on the way to the model's origin.

    `boxes` (M, 6) and `origins` (M, 3) are the models; the robot's turned body is one more. Points beyond 2 m (in
    3-D) do not count. The last value says whether there is one.
    """
    best = REACH_M
    found = False
    px = 0.0
    py = 0.0
    for m in range(boxes.shape[0]):
        box = boxes[m]
        gap_x = max(box[0] - x, x - box[1])
        gap_y = max(box[2] - y, y - box[3])
        if gap_x > best or gap_y > best:
            continue
        hx, hy, distance = entry_point(x, y, z, origins[m, 0], origins[m, 1], origins[m, 2], box)
        if 0.0 < distance <= best:
            best, px, py, found = distance, hx, hy, True
    if abs(robot_x - x) < REACH_M + 1.0 and abs(robot_y - y) < REACH_M + 1.0:
        cos = abs(math.cos(robot_yaw))
        sin = abs(math.sin(robot_yaw))
        half_length = 0.5 * (robot_box[1] - robot_box[0])
        half_width = 0.5 * (robot_box[3] - robot_box[2])
        half_x = half_length * cos + half_width * sin
        half_y = half_length * sin + half_width * cos
        # The robot's box has its origin at its centre on the floor; written out to allocate nothing.
        dx, dy, near = x - robot_x, y - robot_y, 0.0
        if z > robot_height:
            near = (z - robot_height) / z
        if abs(dx) > half_x:
            near = max(near, (abs(dx) - half_x) / abs(dx))
        if abs(dy) > half_y:
            near = max(near, (abs(dy) - half_y) / abs(dy))
        if 0.0 < near * math.sqrt(dx * dx + dy * dy + z * z) <= best:
            px, py, found = robot_x + (dx - near * dx), robot_y + (dy - near * dy), True
    return px, py, found


@kernel
def on_segment(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> tuple[float, float]:
    """The point of the segment a-b nearest to (x, y)."""
    dx = bx - ax
    dy = by - ay
    length = dx * dx + dy * dy
    share = 0.0
    if length > 0.0:
        share = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / length))
    return ax + share * dx, ay + share * dy


@kernel
def on_outline(
    outline: Floats, x: float, y: float, robot_x: float, robot_y: float, robot_yaw: float
) -> tuple[float, float, bool]:
    """Return the point of the robot's outline nearest to (x, y), and whether (x, y) lies within it.

    `outline` (K, 2): corners in the robot's frame, in order.
    """
    cos = math.cos(robot_yaw)
    sin = math.sin(robot_yaw)
    forward = (x - robot_x) * cos + (y - robot_y) * sin
    left = (y - robot_y) * cos - (x - robot_x) * sin
    best = math.inf
    on_x = 0.0
    on_y = 0.0
    inside = False
    corners = outline.shape[0]
    for k in range(corners):
        ax, ay = outline[k, 0], outline[k, 1]
        bx, by = outline[(k + 1) % corners, 0], outline[(k + 1) % corners, 1]
        px, py = on_segment(forward, left, ax, ay, bx, by)
        square = (px - forward) ** 2 + (py - left) ** 2
        if square < best:
            best, on_x, on_y = square, px, py
        if (ay > left) != (by > left) and forward < ax + (left - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return robot_x + on_x * cos - on_y * sin, robot_y + on_x * sin + on_y * cos, inside


@kernel
def cell_of(x: float, y: float, raster_x: float, raster_y: float, rows: int, columns: int) -> tuple[int, int]:
    """Row and column of the raster cell at (x, y), or (-1, -1) outside."""
    if not (math.isfinite(x) and math.isfinite(y)):
        return -1, -1
    column = math.floor((x - raster_x) / RASTER_M)
    row = math.floor((y - raster_y) / RASTER_M)
    if row < 0 or column < 0 or row >= rows or column >= columns:
        return -1, -1
    return row, column


@kernel
def _nearest_segments(segments: Floats, raster_x: float, raster_y: float, rows: int, columns: int) -> NDArray[np.int32]:
    """For every raster cell the index of the segment nearest to its middle, -1 where none is within reach."""
    nearest = np.full((rows, columns), -1, np.int32)
    best = np.full((rows, columns), (REACH_M + RASTER_M) ** 2)
    reach = REACH_M + RASTER_M
    for s in range(segments.shape[0]):
        ax, ay, bx, by = segments[s]
        c0 = max(0, int((min(ax, bx) - reach - raster_x) / RASTER_M))
        c1 = min(columns, int((max(ax, bx) + reach - raster_x) / RASTER_M) + 1)
        r0 = max(0, int((min(ay, by) - reach - raster_y) / RASTER_M))
        r1 = min(rows, int((max(ay, by) + reach - raster_y) / RASTER_M) + 1)
        for r in range(r0, r1):
            y = raster_y + (r + 0.5) * RASTER_M
            for c in range(c0, c1):
                x = raster_x + (c + 0.5) * RASTER_M
                sx, sy = on_segment(x, y, ax, ay, bx, by)
                square = (sx - x) ** 2 + (sy - y) ** 2
                if square < best[r, c]:
                    best[r, c] = square
                    nearest[r, c] = s
    return nearest


@kernel
def _flip_inside(inside: NDArray[np.uint8], segments: Floats, raster_x: float, raster_y: float) -> None:
    """Even-odd fill of one closed outline, added modulo two to `inside` (a cell counts by its middle)."""
    for r in range(inside.shape[0]):
        y = raster_y + (r + 0.5) * RASTER_M
        for s in range(segments.shape[0]):
            ax, ay, bx, by = segments[s]
            if (ay > y) != (by > y):
                cross = ax + (y - ay) / (by - ay) * (bx - ax)
                first = max(0, math.ceil((cross - raster_x) / RASTER_M - 0.5))
                for c in range(first, inside.shape[1]):
                    inside[r, c] ^= 1


class Surfaces:
    """The outlines of everything solid: segments, and a raster that says which one is near and what lies within.

    `segments` (S, 4) in metres; `nearest` (rows, columns) int32 indices into them, -1 beyond reach; `inside`
    (rows, columns) uint8; the raster's lower left corner `x`, `y`; cells of 0.1 m.
    """

    def __init__(self, world: World) -> None:
        cells = world.occupancy.cells
        resolution = world.occupancy.resolution
        offset_x = world.occupancy.origin.x + world.map_offset[0]
        offset_y = world.occupancy.origin.y + world.map_offset[1]
        self.x = offset_x - 1.0
        self.y = offset_y - 1.0
        self.columns = math.ceil((cells.shape[1] * resolution + 2.0) / RASTER_M)
        self.rows = math.ceil((cells.shape[0] * resolution + 2.0) / RASTER_M)
        self.inside = np.zeros((self.rows, self.columns), np.uint8)
        edges = [edges_of(outline) for thing in world.solids for outline in outlines_of(thing)]
        for thing in world.solids:
            body = np.zeros_like(self.inside)
            for outline in outlines_of(thing):
                _flip_inside(body, edges_of(outline), self.x, self.y)
            self.inside |= body
        if not world.objects:
            edges.append(cell_borders(cells == 100, resolution, offset_x, offset_y))
            rows = ((self.y + (np.arange(self.rows) + 0.5) * RASTER_M - offset_y) // resolution).astype(int)
            columns = ((self.x + (np.arange(self.columns) + 0.5) * RASTER_M - offset_x) // resolution).astype(int)
            within = np.ix_((rows >= 0) & (rows < cells.shape[0]), (columns >= 0) & (columns < cells.shape[1]))
            known = cells[np.ix_(rows[within[0].ravel()], columns[within[1].ravel()])]
            self.inside[within] |= (known == 100).astype(np.uint8)
        self.segments = np.concatenate(edges)
        self.nearest = _nearest_segments(self.segments, self.x, self.y, self.rows, self.columns)


def outlines_of(thing: SolidObject) -> tuple[Polygon, ...]:
    """What a person cannot walk through, filled by the even-odd rule: the footprint with its holes."""
    return (thing.footprint, *thing.holes)


def boxes_of(objects: tuple[SolidObject, ...]) -> tuple[Floats, Floats]:
    """Axis-aligned boxes (M, 6) and origins (M, 3) of the models that HuNavSim's obstacle search considers.

    Models with an origin at x = 0 or y = 0 exactly are left out, as it does.
    """
    boxes: list[tuple[float, ...]] = []
    origins: list[tuple[float, float, float]] = []
    for thing in objects:
        if thing.origin[0] == 0.0 or thing.origin[1] == 0.0:
            continue
        cos, sin = abs(math.cos(thing.box.yaw)), abs(math.sin(thing.box.yaw))
        half_x = 0.5 * (thing.box.size[0] * cos + thing.box.size[1] * sin)
        half_y = 0.5 * (thing.box.size[0] * sin + thing.box.size[1] * cos)
        x, y, z = thing.box.center
        half_z = 0.5 * thing.box.size[2]
        boxes.append((x - half_x, x + half_x, y - half_y, y + half_y, z - half_z, z + half_z))
        origins.append(thing.origin)
    return np.asarray(boxes, np.float64).reshape(-1, 6), np.asarray(origins, np.float64).reshape(-1, 3)
