"""Names of the waypoints nearest to positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rvsg.world.grid import Grid

Floats = NDArray[np.float64]


class WaypointNames:
    """Looks up the valid waypoint nearest to a point; ties go to the earlier in grid order, as in `Grid.nearest`."""

    def __init__(self, grid: Grid) -> None:
        valid = [w for w in grid.waypoints if w.human]
        self.names = [w.name for w in valid]
        self.at = np.array([(w.x, w.y) for w in valid]).reshape(-1, 2)

    def nearest(self, x: Floats, y: Floats) -> list[str]:
        """Return one name for each of the points x (K,), y (K,), metres; empty names where the grid has no waypoint."""
        if not self.names:
            return [""] * len(x)
        squared = (self.at[None, :, 0] - x[:, None]) ** 2 + (self.at[None, :, 1] - y[:, None]) ** 2
        return [self.names[i] for i in squared.argmin(axis=1)]
