"""Names of places: the waypoints nearest to positions, and the labelled areas beside them."""

from __future__ import annotations

import math
from weakref import WeakKeyDictionary

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
    nearest = [(min(math.dist((x, y), at) for at in points), name) for name, points in _areas_of(world)]
    return min(nearest)[1] if nearest else world.grid.nearest(x, y)


def _areas_of(world: World) -> list[tuple[str, list[tuple[float, float]]]]:
    """Return the labelled areas that have waypoints, with where these are; kept for each world."""
    if world not in _areas:
        grid = world.grid
        at = [(area.name, [grid.position(w) for w in area.waypoints if w in grid.by_name]) for area in world.areas]
        _areas[world] = [(name, points) for name, points in at if points]
    return _areas[world]


_areas: WeakKeyDictionary[World, list[tuple[str, list[tuple[float, float]]]]] = WeakKeyDictionary()
