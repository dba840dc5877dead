"""Plane geometry of outlines given as corner points in order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

Point = tuple[float, float]


def edges(polygon: Sequence[Point]) -> list[tuple[Point, Point]]:
    """Return the sides of a polygon, each as its two ends."""
    return list(pairwise([*polygon, polygon[0]]))


def area(polygon: Sequence[Point]) -> float:
    """Return the signed area, positive for counter-clockwise corners."""
    return 0.5 * sum(ax * by - bx * ay for (ax, ay), (bx, by) in edges(polygon))


def crosses_itself(polygon: Sequence[Point]) -> bool:
    """Return whether two sides meet other than at the corner they share, or the outline encloses nothing."""
    sides = edges(polygon)
    if abs(area(polygon)) < 1e-6 or any(a == b for a, b in sides):
        return True
    n = len(sides)
    return any(
        _meet(sides[i], sides[j]) for i in range(n) for j in range(i + 1, n) if j != i + 1 and (j + 1) % n != i
    ) or any(_folds(sides[i], sides[(i + 1) % n]) for i in range(n))


def inside(polygon: Sequence[Point], x: float, y: float) -> bool:
    """Return whether a point lies inside a polygon."""
    found = False
    for (ax, ay), (bx, by) in edges(polygon):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            found = not found
    return found


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


def _side(a: Point, b: Point, p: Point) -> float:
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])


def _meet(one: tuple[Point, Point], other: tuple[Point, Point]) -> bool:
    (a, b), (c, d) = one, other
    if _side(a, b, c) * _side(a, b, d) < 0 and _side(c, d, a) * _side(c, d, b) < 0:
        return True
    return any(_lies_on(s, p) for s, p in ((one, c), (one, d), (other, a), (other, b)))


def _lies_on(side: tuple[Point, Point], p: Point) -> bool:
    (ax, ay), (bx, by) = side
    if abs(_side(side[0], side[1], p)) > 1e-12:
        return False
    return min(ax, bx) <= p[0] <= max(ax, bx) and min(ay, by) <= p[1] <= max(ay, by)


def _folds(one: tuple[Point, Point], following: tuple[Point, Point]) -> bool:
    """Return whether a side runs back along the one before."""
    (ax, ay), (bx, by) = one
    _, (cx, cy) = following
    return abs(_side(one[0], one[1], (cx, cy))) < 1e-12 and (bx - ax) * (cx - bx) + (by - ay) * (cy - by) < 0
