"""Floor between the wings of a building, which lies open to the outside: the court of a U-shaped one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.world.raster import Bools

GATE_M = 3.0
"""An opening this wide is no door."""
MOUTH = 0.5
"""A court is open by this share of its width at least; a hall with a gate is not."""
BACKED = 0.5
"""Behind this share of a court's walls is closed floor of the building; behind those of an open hall is nothing."""
WALL_M = 1.0
LEAST_M2 = 8.0
SLIVER_M2 = 3.0


def open_courts(free: Bools, inside: Bools, closed: Bools, resolution: float) -> list[Bools]:
    """Return the parts of the inside that are courts: wide open to the outside, with rooms of the building behind.

    Args:
        free: The floor that hangs together with the outside, at the edges of the map.
        inside: The part of it that lies between walls.
        closed: Other floor, in closed walls.
        resolution: Metres per cell.
    """
    from scipy.ndimage import distance_transform_edt, label

    clear = distance_transform_edt(free) * resolution
    found = []
    parts, count = label(inside & _reached(clear, GATE_M / 2, resolution))
    sizes = np.bincount(parts.ravel(), minlength=count + 1) * resolution**2
    for number in np.flatnonzero(sizes[1:] >= LEAST_M2) + 1:
        court = parts == number
        mouth = MOUTH * float(clear[court].max())
        if np.count_nonzero(court & _reached(clear, mouth, resolution)) < MOUTH * np.count_nonzero(court):
            continue
        whole = _with_slivers(court, inside, resolution)
        rooms = closed | (inside & ~whole)
        if _share_backed(whole, rooms, free & ~inside, resolution) >= BACKED:
            found.append(whole)
    return found


def widely_open(parts: NDArray[np.int32], resolution: float) -> set[int]:
    """Return the numbers of the parts that meet an edge of the map in an opening that is no door."""
    wide = set()
    for edge in (parts[0], parts[-1], parts[:, 0], parts[:, -1]):
        starts = np.flatnonzero(np.diff(edge, prepend=-1))
        lengths = np.diff([*starts, len(edge)]) * resolution
        wide |= set(edge[starts[lengths > GATE_M]].tolist())
    return wide - {0}


def _reached(clear: NDArray[np.float64], radius: float, resolution: float) -> Bools:
    """Return where a disc of this radius comes from the edges of the map without meeting a wall."""
    from scipy.ndimage import distance_transform_edt, label

    cores, _ = label(clear > radius)
    edges = np.unique(np.concatenate([cores[0], cores[-1], cores[:, 0], cores[:, -1]]))
    outer = np.isin(cores, edges[edges > 0])
    if not outer.any():
        return np.zeros_like(outer)
    # the disc covers every cell that is nearer to its middle than the wall is
    return np.asarray(distance_transform_edt(~outer) * resolution < radius + resolution) & (clear > 0)


def _with_slivers(court: Bools, inside: Bools, resolution: float) -> Bools:
    """Return a court with its corners, which no disc reaches, and strips along its walls."""
    from scipy.ndimage import binary_dilation, label

    rest, count = label(inside & ~court)
    sizes = np.bincount(rest.ravel(), minlength=count + 1) * resolution**2
    touching = np.unique(rest[binary_dilation(court)])
    small = [n for n in touching if n and sizes[n] < SLIVER_M2]
    return np.asarray(court | np.isin(rest, small))


def _share_backed(court: Bools, rooms: Bools, outside: Bools, resolution: float) -> float:
    """Return the share of the walls round a court behind which is floor of the building, not the outside."""
    from scipy.ndimage import binary_dilation, distance_transform_edt

    walls = binary_dilation(court, np.ones((3, 3), bool), 2) & ~court & ~rooms & ~outside
    count = np.count_nonzero(walls)
    if not count or not rooms.any():
        return 0.0
    near = math.ceil(WALL_M / resolution)
    return float(np.count_nonzero(distance_transform_edt(~rooms)[walls] <= near) / count)
