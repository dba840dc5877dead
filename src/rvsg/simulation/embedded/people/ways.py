"""The way of a person through their waypoints: straight from turn to turn and stop to stop, where nothing is near."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner, kernel
from rvsg.simulation.embedded.people.obstacles import RASTER_M, REACH_M, cell_of, on_segment

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BESIDE_M = 1.0
"""People pass waypoints at which they do not stop within this distance."""
SPARE_M = 0.1
"""They cut no corner nearer to walls than this, beside their body."""
TRIES = 4
"""A straight way is not looked for beyond so many waypoints to which there is none."""


@inner
def is_clear(
    segments: Floats, nearest: NDArray[np.int32], inside: NDArray[np.uint8], raster_x: float, raster_y: float,
    x: float, y: float, to_x: float, to_y: float, room: float,
) -> bool:  # fmt: skip
    """Return whether the straight way from (x, y) keeps a distance from walls."""
    length = math.sqrt((to_x - x) ** 2 + (to_y - y) ** 2)
    rows, columns = nearest.shape
    walked = 0.0
    while True:
        share = walked / length if length > 0.0 else 0.0
        px, py = x + share * (to_x - x), y + share * (to_y - y)
        row, column = cell_of(px, py, raster_x, raster_y, rows, columns)
        away = REACH_M
        if row >= 0:
            s = nearest[row, column]
            if s >= 0:
                sx, sy = on_segment(px, py, segments[s, 0], segments[s, 1], segments[s, 2], segments[s, 3])
                away = math.sqrt((sx - px) ** 2 + (sy - py) ** 2)
            if inside[row, column] or away < room:
                return False
        if walked >= length:
            return True
        walked = min(length, walked + max(RASTER_M, away - room - RASTER_M))


@kernel
def find_ends(
    goals: Floats, pauses: Floats, segments: Floats, nearest: NDArray[np.int32], inside: NDArray[np.uint8],
    raster_x: float, raster_y: float, room: float, ends: Ints,
) -> None:  # fmt: skip
    """Write for each goal (G, 2) of a cycle at which goal the straight way to it ends; goal 0 always ends one.

    A way is drawn tight from stop to stop as far as it passes all waypoints in order within `BESIDE_M`.
    """
    count = goals.shape[0]
    first = 0
    ends[0] = 0
    while first < count:
        last, h = first + 1, first + 2
        while h <= count and h <= last + TRIES and pauses[(h - 1) % count] == 0.0:
            x, y = goals[first]
            to_x, to_y = goals[h % count]
            length = math.sqrt((to_x - x) ** 2 + (to_y - y) ** 2)
            along, free = 0.0, length > 0.0
            for k in range(first + 1, h):
                dx, dy = goals[k, 0] - x, goals[k, 1] - y
                before, along = along, (dx * (to_x - x) + dy * (to_y - y)) / max(length, 1e-9)
                aside = abs(dx * (to_y - y) - dy * (to_x - x)) / max(length, 1e-9)
                free = free and before < along < length and aside <= BESIDE_M
            if free and is_clear(segments, nearest, inside, raster_x, raster_y, x, y, to_x, to_y, room):
                last = h
            h += 1
        for k in range(first + 1, last + 1):
            ends[k % count] = last % count
        first = last
