"""The ends of a path on the grid, as Nav2's planners take them over cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner

Floats = NDArray[np.float64]


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
