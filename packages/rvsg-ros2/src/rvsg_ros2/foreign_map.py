"""Whether the map that a system has is that of the world under test."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.world.world import OCCUPIED, OccupancyMap

NEAR_M = 0.15
"""A cell of the other map is where an obstacle of the world is if it lies this close."""
SAME = 0.5
"""A map that has fewer of the world's obstacles shows another place."""


def share_of_obstacles(message: Any, world_map: OccupancyMap) -> float:
    """Return the share of a world's occupied cells that a nav_msgs/OccupancyGrid has, too; both in the map frame."""
    from scipy.ndimage import binary_dilation

    info = message.info
    cells = np.asarray(message.data, np.int16)
    if cells.size != info.width * info.height or not cells.size:
        return 0.0
    occupied = cells.reshape(info.height, info.width) >= 50
    steps = max(1, round(NEAR_M / info.resolution))
    occupied = binary_dilation(np.pad(occupied, steps), iterations=steps)
    x, y = _centres(world_map)
    turn = info.origin.orientation
    column, row = _cells(
        x, y, info.origin.position.x, info.origin.position.y, 2.0 * math.atan2(turn.z, turn.w), info.resolution
    )
    column, row = column + steps, row + steps
    inside = (column >= 0) & (row >= 0) & (column < occupied.shape[1]) & (row < occupied.shape[0])
    return float(occupied[row[inside], column[inside]].sum() / max(1, x.size))


def _centres(world_map: OccupancyMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the middles of the occupied cells, m."""
    row, column = np.nonzero(world_map.cells == OCCUPIED)
    along, up = (column + 0.5) * world_map.resolution, (row + 0.5) * world_map.resolution
    origin = world_map.origin
    cos, sin = math.cos(origin.yaw), math.sin(origin.yaw)
    return origin.x + cos * along - sin * up, origin.y + sin * along + cos * up


def _cells(
    x: NDArray[np.float64], y: NDArray[np.float64], x0: float, y0: float, yaw: float, resolution: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return column and row of points in a map with this origin."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    along, up = cos * (x - x0) + sin * (y - y0), -sin * (x - x0) + cos * (y - y0)
    return np.floor(along / resolution).astype(np.int64), np.floor(up / resolution).astype(np.int64)
