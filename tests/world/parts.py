"""Maps of small halls."""

from __future__ import annotations

import numpy as np

from rvsg.core.records import Pose
from rvsg.world.world import OccupancyMap


def walled(rows: int, columns: int, *, thick: int = 1) -> np.ndarray:
    """Free cells with a wall around them, `thick` cells thick."""
    cells = np.full((rows, columns), 100, np.uint8)
    cells[thick:-thick, thick:-thick] = 0
    return cells


def map_of(
    cells: np.ndarray, resolution: float = 0.05, *, x: float = 0.0, y: float = 0.0, yaw: float = 0.0
) -> OccupancyMap:
    return OccupancyMap(cells=cells, resolution=resolution, origin=Pose(x=x, y=y, yaw=yaw))
