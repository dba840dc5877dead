"""Places for labels on a small map: none covers another one, and one that has to move keeps a line to its point."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

Point = tuple[float, float]
Box = tuple[float, float, float, float]
"""Left, top, right, bottom."""

RINGS, DIRECTIONS = 5, 12


def box_around(x: float, y: float, half_width: float, half_height: float) -> Box:
    """Return the box with this middle."""
    return (x - half_width, y - half_height, x + half_width, y + half_height)


def free_place(candidates: Iterable[Point], half: Point, taken: Sequence[Box], inside: Box) -> Point:
    """Return the first candidate at which a label lies inside and covers nothing taken; without any, the first.

    Args:
        half: Half the width and half the height of the label.
    """
    first: Point | None = None
    for x, y in candidates:
        first = first or (x, y)
        left, top, right, bottom = box_around(x, y, *half)
        if left < inside[0] or top < inside[1] or right > inside[2] or bottom > inside[3]:
            continue
        if all(right <= o[0] or o[2] <= left or bottom <= o[1] or o[3] <= top for o in taken):
            return x, y
    assert first is not None, "there is a candidate"
    return first


def around(x: float, y: float, step: float) -> Iterator[Point]:
    """Yield a point and rings of points around it, the nearest ring first, each from the top on."""
    yield x, y
    for ring in range(1, RINGS + 1):
        for k in range(DIRECTIONS):
            angle = 2.0 * math.pi * k / DIRECTIONS
            yield x + ring * step * math.sin(angle), y - ring * step * math.cos(angle)


def beside(x: float, y: float, radius: float, half: Point) -> Iterator[Point]:
    """Yield the places for a name beside a round body: above, below, right, left, then farther away."""
    for away in (radius, 2.5 * radius, 4.0 * radius):
        for dx, dy in ((0, -1), (0, 1), (1, 0), (-1, 0), (1, -1), (-1, -1), (1, 1), (-1, 1)):
            yield x + dx * (away + half[0]), y + dy * (away + half[1])


def spread(points: Sequence[Point], radius: float, inside: Box) -> list[Point]:
    """Return where round markers of one size go so that none covers another one or the point of another one."""
    placed: list[Point] = []
    taken: list[Box] = []
    for x, y in points:
        place = free_place(around(x, y, 1.1 * radius), (radius, radius), taken, inside)
        placed.append(place)
        taken.append(box_around(*place, radius, radius))
    return placed
