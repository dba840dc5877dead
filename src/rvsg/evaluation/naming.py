"""Names of places: the waypoints nearest to positions, and the labelled areas beside them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.world.grid import Grid
from rvsg.world.world import World

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


def place_name(world: World, x: float, y: float) -> str:
    """Return the name by which findings, failures and maps speak of a position (m).

    It is the labelled area whose waypoints are nearest; where nothing is labelled, the nearest waypoint.
    """
    grid = world.grid
    nearest = [
        (min(math.dist((x, y), grid.position(name)) for name in names), area.name)
        for area in world.areas
        if (names := [name for name in area.waypoints if name in grid.by_name])
    ]
    return min(nearest)[1] if nearest else grid.nearest(x, y)
