"""The lidars: exact ranges to the outlines that the scan plane cuts and to people's legs."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner, kernel
from rvsg.simulation.costmap import FAR
from rvsg.simulation.embedded.base import into_frame
from rvsg.simulation.embedded.robot_parameters import LIDAR_VIEW, LIDAR_X, LIDAR_Y, LIDAR_YAW

Floats = NDArray[np.float64]


NO_RETURN = -1.0
LEG_RADIUS_M = 0.07
LEG_APART_M = 0.09
STRIDE_M = 0.22
STEP_LENGTH_M = 1.2
"""Two lower legs at 0.21 m height: discs beside the body's middle that swing against each other while it walks."""


@lru_cache(maxsize=8)
def ray_directions(rays: int, field_of_view: float) -> Floats:
    """(rays, 2) cosine and sine of every ray's angle after the first ray's; the last ray ends the field of view."""
    angles = np.arange(rays) * (field_of_view / (rays - 1))
    return np.column_stack([np.cos(angles), np.sin(angles)])


@inner
def shorten(ranges: Floats, directions: Floats, ex: float, ey: float, cross: float) -> None:
    """Shorten the ranges of rays that meet the line along (ex, ey); without a branch, so that it becomes vector code.

    `cross`: cross product of a point of the line and (ex, ey).
    """
    for k in range(ranges.size):
        known = ranges[k]
        distance = cross / (directions[k, 0] * ey - directions[k, 1] * ex)
        ranges[k] = distance if 0.0 < distance < known else known


@kernel
def cast_edge(ranges: Floats, directions: Floats, step: float, ax: float, ay: float, bx: float, by: float) -> None:
    """Shorten the ranges of all rays that meet the edge a-b; points in the frame whose x axis is the first ray."""
    cross = ax * by - ay * bx
    if cross < 0.0:
        ax, ay, bx, by, cross = bx, by, ax, ay, -cross
    if cross == 0.0:
        return
    begin = math.atan2(ay, ax)
    if begin < 0.0:
        begin += 2.0 * math.pi
    extent = math.atan2(cross, ax * bx + ay * by)
    ex = bx - ax
    ey = by - ay
    rays = ranges.size
    turn = 0.0
    while turn <= begin + extent:
        first = max(0, math.ceil((begin - turn) / step))
        last = min(rays - 1, math.floor((begin + extent - turn) / step))
        if first <= last:
            shorten(ranges[first : last + 1], directions[first : last + 1], ex, ey, cross)
        turn += 2.0 * math.pi


@kernel
def cast_disc(ranges: Floats, directions: Floats, step: float, x: float, y: float, radius: float) -> None:
    """Shorten the ranges of all rays that meet the disc; a disc around the sensor itself is not seen."""
    outside = x * x + y * y - radius * radius
    if outside <= 0.0:
        return
    half = math.asin(radius / math.sqrt(x * x + y * y))
    begin = math.atan2(y, x) - half
    if begin < 0.0:
        begin += 2.0 * math.pi
    rays = ranges.size
    turn = 0.0
    while turn <= begin + 2.0 * half:
        first = max(0, math.ceil((begin - turn) / step))
        last = min(rays - 1, math.floor((begin + 2.0 * half - turn) / step))
        for k in range(first, last + 1):
            along = directions[k, 0] * x + directions[k, 1] * y
            distance = along - math.sqrt(max(0.0, along * along - outside))
            if distance < ranges[k]:
                ranges[k] = distance
        turn += 2.0 * math.pi


@kernel
def scan(
    ranges: Floats,
    directions: Floats,
    x: float,
    y: float,
    bearing: float,
    edges: Floats,
    near: NDArray[np.int32],
    legs: Floats,
    closed: bool,
    field_of_view: float,
    reach: float,
) -> None:
    """One scan from (x, y), its first ray at `bearing`, into `ranges` (metres).

    `near` indexes the `edges` (E, 4) worth looking at, `legs` (L, 2) are leg centres, all in the world frame. A ray
    that meets nothing there is FAR if the place is `closed` by walls within the sensor's range, else NO_RETURN.
    """
    step = field_of_view / (ranges.size - 1)
    cos = math.cos(bearing)
    sin = math.sin(bearing)
    ranges[:] = FAR
    for i in range(near.size):
        ax, ay, bx, by = into_frame(edges[near[i]], x, y, cos, sin)
        cast_edge(ranges, directions, step, ax, ay, bx, by)
    for i in range(legs.shape[0]):
        dx = legs[i, 0] - x
        dy = legs[i, 1] - y
        if dx * dx + dy * dy < reach * reach:
            cast_disc(ranges, directions, step, cos * dx + sin * dy, cos * dy - sin * dx, LEG_RADIUS_M)
    if not closed:
        for k in range(ranges.size):
            if ranges[k] >= FAR:
                ranges[k] = NO_RETURN


@kernel
def full_scan(
    ranges: Floats, directions: Floats, step: float, x: float, y: float, bearing: float, edges: Floats, legs: Floats
) -> None:
    """Cast a scan like `scan`, at all edges and legs; infinite where a ray meets nothing. `step` (rad) between rays."""
    cos = math.cos(bearing)
    sin = math.sin(bearing)
    ranges[:] = math.inf
    for e in range(edges.shape[0]):
        ax, ay, bx, by = into_frame(edges[e], x, y, cos, sin)
        cast_edge(ranges, directions, step, ax, ay, bx, by)
    for i in range(legs.shape[0]):
        dx = legs[i, 0] - x
        dy = legs[i, 1] - y
        cast_disc(ranges, directions, step, cos * dx + sin * dy, cos * dy - sin * dx, LEG_RADIUS_M)


@kernel
def first_ray(mount: Floats, robot: Floats) -> tuple[float, float, float]:
    """Return the place of a lidar in the world and the bearing of its first ray; `robot`: the pose x, y, yaw."""
    yaw = robot[2]
    x = robot[0] + mount[LIDAR_X] * math.cos(yaw) - mount[LIDAR_Y] * math.sin(yaw)
    y = robot[1] + mount[LIDAR_X] * math.sin(yaw) + mount[LIDAR_Y] * math.cos(yaw)
    return x, y, yaw + mount[LIDAR_YAW] - 0.5 * mount[LIDAR_VIEW]


@kernel
def place_legs(legs: Floats, x: Floats, y: Floats, yaw: Floats, walked: Floats) -> None:
    """Centres of everybody's two legs (2N, 2), swung by the distance walked (metres, with its random phase)."""
    for i in range(x.size):
        cos = math.cos(yaw[i])
        sin = math.sin(yaw[i])
        swing = STRIDE_M * math.sin(2.0 * math.pi * walked[i] / STEP_LENGTH_M)
        legs[2 * i, 0] = x[i] + swing * cos - LEG_APART_M * sin
        legs[2 * i, 1] = y[i] + swing * sin + LEG_APART_M * cos
        legs[2 * i + 1, 0] = x[i] - swing * cos + LEG_APART_M * sin
        legs[2 * i + 1, 1] = y[i] - swing * sin - LEG_APART_M * cos
