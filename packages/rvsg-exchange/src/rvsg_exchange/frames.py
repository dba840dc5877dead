"""Coordinate frames of a recording: poses of one frame in another, by the transforms that were recorded."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Frames:
    """The transforms of a recording. Between two of them the earlier one holds."""

    def __init__(self, transforms: Mapping[tuple[str, str], Floats]) -> None:
        """Take the poses of each child frame in its parent by (parent, child): time s, x m, y m, yaw rad, (N, 4)."""
        self._edges = {pair: rows for pair, rows in transforms.items() if len(rows)}

    @property
    def children(self) -> tuple[str, ...]:
        """The frames whose pose in another is recorded."""
        return tuple(dict.fromkeys(child for _, child in self._edges))

    def way(self, source: str, target: str) -> list[tuple[tuple[str, str], bool]] | None:
        """Return the transforms that lead from a frame to another, each with whether it is inverted; None without."""
        before: dict[str, tuple[str, tuple[str, str], bool]] = {}
        waiting = deque([source])
        while waiting:
            frame = waiting.popleft()
            if frame == target:
                break
            for parent, child in self._edges:
                for here, there, inverted in ((child, parent, False), (parent, child, True)):
                    if here == frame and there not in before and there != source:
                        before[there] = (frame, (parent, child), inverted)
                        waiting.append(there)
        if target != source and target not in before:
            return None
        found = []
        while target != source:
            target, pair, inverted = before[target]
            found.append((pair, inverted))
        return found[::-1]

    def moved(self, track: Floats, source: str, target: str) -> Floats | None:
        """Return a track (rows begin with t, x, y, yaw) in another frame; None where no transforms lead there."""
        way = self.way(source, target)
        if way is None:
            return None
        for pair, inverted in way:
            track = _applied(track, self._edges[pair], inverted)
        return track

    def times(self, way: Iterable[tuple[tuple[str, str], bool]]) -> Floats:
        """Return the times of the transform on a way that was recorded most often."""
        return max((self._edges[pair][:, 0] for pair, _ in way), key=len)


def _applied(track: Floats, transform: Floats, inverted: bool) -> Floats:
    at = np.clip(np.searchsorted(transform[:, 0], track[:, 0], side="right") - 1, 0, None)
    dx, dy, turn = transform[at, 1], transform[at, 2], transform[at, 3]
    cos, sin = np.cos(turn), np.sin(turn)
    moved = track.copy()
    if inverted:
        x, y = track[:, 1] - dx, track[:, 2] - dy
        moved[:, 1], moved[:, 2], yaw = cos * x + sin * y, -sin * x + cos * y, track[:, 3] - turn
    else:
        moved[:, 1] = dx + cos * track[:, 1] - sin * track[:, 2]
        moved[:, 2] = dy + sin * track[:, 1] + cos * track[:, 2]
        yaw = track[:, 3] + turn
    moved[:, 3] = np.arctan2(np.sin(yaw), np.cos(yaw))
    return moved
