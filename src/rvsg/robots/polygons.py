"""Plane geometry of outlines given as corner points in order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

Point = tuple[float, float]


def edges(polygon: Sequence[Point]) -> list[tuple[Point, Point]]:
    """Return the sides of a polygon, each as its two ends."""
    return list(pairwise([*polygon, polygon[0]]))


def crosses_itself(polygon: Sequence[Point]) -> bool:
    """Return whether two sides meet other than at the corner they share, or the outline encloses nothing."""
    from shapely import Polygon

    shape = Polygon(polygon)
    return shape.area < 1e-6 or len(set(polygon)) < len(polygon) or not shape.is_valid


def inside(polygon: Sequence[Point], x: float, y: float) -> bool:
    """Return whether a point lies inside a polygon."""
    inside = False
    for (ax, ay), (bx, by) in edges(polygon):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return inside


def distance(polygon: Sequence[Point], x: float, y: float) -> float:
    """Return the distance of a point from the nearest side."""
    best = math.inf
    for (ax, ay), (bx, by) in edges(polygon):
        dx, dy = bx - ax, by - ay
        share = min(1.0, max(0.0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)))
        best = min(best, math.hypot(x - ax - share * dx, y - ay - share * dy))
    return best


def reach(polygon: Sequence[Point]) -> float:
    """Return the distance of the farthest corner from the origin."""
    return max(math.hypot(x, y) for x, y in polygon)


def rectangle(polygon: Sequence[Point]) -> tuple[Point, Point]:
    """Return the lowest and highest corner of the rectangle around a polygon."""
    xs, ys = [x for x, _ in polygon], [y for _, y in polygon]
    return (min(xs), min(ys)), (max(xs), max(ys))


def padded(polygon: Sequence[Point], by_m: float) -> list[Point]:
    """Return the polygon padded as Nav2 does it: every coordinate moves away from zero."""
    return [(x + by_m * ((x > 0) - (x < 0)), y + by_m * ((y > 0) - (y < 0))) for x, y in polygon]
