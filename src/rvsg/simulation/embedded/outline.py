"""The outline of a body against an edge of an obstacle, in the frame of the base. Compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner

Floats = NDArray[np.float64]


@inner
def is_inside(outline: Floats, x: float, y: float) -> bool:
    """Whether a point lies inside an outline (K, 2)."""
    found = False
    j = outline.shape[0] - 1
    for i in range(outline.shape[0]):
        ay = outline[i, 1]
        by = outline[j, 1]
        if (ay > y) != (by > y) and x < outline[i, 0] + (y - ay) / (by - ay) * (outline[j, 0] - outline[i, 0]):
            found = not found
        j = i
    return found


@inner
def contact_with(
    outline: Floats, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float, float, float, float]:
    """Return where an edge a-b that overlaps the body presses on it: depth (m), place, direction for the body.

    An end of the edge inside the body presses on the nearest side. An edge that cuts through presses on the corner
    that lies farthest beyond it.
    """
    depth, px, py, nx, ny = _end_inside(outline, ax, ay)
    other, qx, qy, mx, my = _end_inside(outline, bx, by)
    if depth > 0.0 or other > 0.0:
        return (depth, px, py, nx, ny) if depth >= other else (other, qx, qy, mx, my)
    dx = bx - ax
    dy = by - ay
    length = math.sqrt(dx * dx + dy * dy)
    here = dy * ax - dx * ay
    sign = 1.0 if here >= 0.0 else -1.0
    for k in range(outline.shape[0]):
        beyond = -sign * (dx * (outline[k, 1] - ay) - dy * (outline[k, 0] - ax)) / length
        if beyond > depth:
            depth = beyond
            px = outline[k, 0]
            py = outline[k, 1]
    return depth, px, py, -sign * dy / length, sign * dx / length


@inner
def _end_inside(outline: Floats, x: float, y: float) -> tuple[float, float, float, float, float]:
    """Return depth, place and direction for the body of a point that may lie inside it; depth 0 where it does not."""
    if not is_inside(outline, x, y):
        return 0.0, x, y, 0.0, 0.0
    best = math.inf
    nx = 0.0
    ny = 0.0
    corners = outline.shape[0]
    for k in range(corners):
        px, py = outline[k, 0], outline[k, 1]
        ex, ey = outline[(k + 1) % corners, 0] - px, outline[(k + 1) % corners, 1] - py
        share = min(1.0, max(0.0, ((x - px) * ex + (y - py) * ey) / (ex * ex + ey * ey)))
        dx = x - px - share * ex
        dy = y - py - share * ey
        away = math.sqrt(dx * dx + dy * dy)
        if 1e-12 < away < best:
            best = away
            nx = dx / away
            ny = dy / away
    return best, x, y, nx, ny
