"""Whether a person can walk a hop between two neighbouring waypoints."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rvsg.world.space import human_space
from rvsg.world.world import World

BODY_HALF_WIDTH_M = 0.125
"""A person who turns sideways gets through where this much is free on either side."""
SIDE_M = 0.5
"""How far a person may leave the straight line to get past a corner."""
REACHED_M = 0.3
"""A waypoint is reached from this far."""

_known: WeakKeyDictionary[World, dict[tuple[str, str], bool]] = WeakKeyDictionary()


def is_walkable(a: str, b: str, world: World) -> bool:
    """Return whether a person fits through between two valid waypoints; kept for each world.

    They do if the straight line is free and a way leads from one to the other that stays within `SIDE_M` of it and
    keeps `BODY_HALF_WIDTH_M` from obstacles. The clearances of the world's raster are exact to half
    a cell.
    """
    known = _known.setdefault(world, {})
    key = (a, b) if a < b else (b, a)
    if key not in known:
        known[key] = _leads_through(np.array(world.grid.position(a)), np.array(world.grid.position(b)), world)
    return known[key]


def _leads_through(start: NDArray[np.float64], end: NDArray[np.float64], world: World) -> bool:
    from scipy.ndimage import label

    space = human_space(world)
    if not space.segments_free(start[None], end[None])[0]:
        return False
    step = space.frame.resolution
    if space.segments_free(start[None], end[None], BODY_HALF_WIDTH_M + 2 * step)[0]:
        return True  # nothing is near, as on most hops
    low, high = np.minimum(start, end) - SIDE_M, np.maximum(start, end) + SIDE_M
    x, y = (np.arange(first, last + step, step) for first, last in zip(low, high, strict=True))
    points = np.stack(np.meshgrid(x, y), axis=-1)
    along = end - start
    share = np.clip(((points - start) @ along) / max(float(along @ along), 1e-12), 0.0, 1.0)
    beside = np.linalg.norm(points - (start + share[..., None] * along), axis=-1)
    fits = (space.clearances(points) >= BODY_HALF_WIDTH_M - step / 2) & (beside <= SIDE_M)
    parts, _ = label(fits, np.ones((3, 3)))
    near_start, near_end = (
        set(parts[np.linalg.norm(points - point, axis=-1) <= REACHED_M].tolist()) - {0} for point in (start, end)
    )
    return bool(near_start & near_end)
