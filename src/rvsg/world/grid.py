"""The grid of named waypoints: rows are letters along x, columns numbers along y, as in `E15`."""

from __future__ import annotations

import heapq
from functools import cached_property

from rvsg.errors import UnknownName
from rvsg.world.records import Record


class Waypoint(Record):
    """A named point of the grid. `human` and `robot` say who fits there; `row` and `column` count from 0."""

    name: str
    x: float
    y: float
    row: int
    column: int
    human: bool = True
    robot: bool = True


class Grid(Record):
    """All waypoints and which straight hops between adjacent ones are free.

    `waypoints` holds valid and invalid points (an invalid one has `human` False); `hops` are unordered pairs of
    names of valid waypoints between which a person can walk straight: the neighbourhood.
    """

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    waypoints: tuple[Waypoint, ...]
    hops: tuple[tuple[str, str], ...]

    @cached_property
    def by_name(self) -> dict[str, Waypoint]:
        """Every waypoint, valid or not, by its name."""
        return {waypoint.name: waypoint for waypoint in self.waypoints}

    @cached_property
    def valid(self) -> frozenset[str]:
        """Names of the waypoints a person can stand on."""
        return frozenset(w.name for w in self.waypoints if w.human)

    @cached_property
    def neighbours(self) -> dict[str, tuple[str, ...]]:
        """For every valid waypoint the names one free hop away, in grid order."""
        found: dict[str, list[str]] = {w.name: [] for w in self.waypoints if w.human}
        for a, b in self.hops:
            found[a].append(b)
            found[b].append(a)
        order = {w.name: i for i, w in enumerate(self.waypoints)}
        return {name: tuple(sorted(others, key=order.__getitem__)) for name, others in found.items()}

    def position(self, name: str) -> tuple[float, float]:
        """The waypoint's (x, y) in metres, or UnknownName. Invalid waypoints have a position too."""
        try:
            waypoint = self.by_name[name]
        except KeyError:
            raise UnknownName("waypoint", name, self.valid) from None
        return (waypoint.x, waypoint.y)

    def nearest(self, x: float, y: float) -> str:
        """The name of the valid waypoint nearest to a point; ties go to the earlier one in grid order."""
        best = min((w for w in self.waypoints if w.human), key=lambda w: (w.x - x) ** 2 + (w.y - y) ** 2)
        return best.name

    def shortest_path(self, start: str, end: str) -> tuple[str, ...] | None:
        """The shortest walk over free hops by length in metres, both ends included; None where there is none."""
        if start not in self.neighbours or end not in self.neighbours:
            return None
        best = {start: 0.0}
        came: dict[str, str] = {}
        queue: list[tuple[float, str]] = [(0.0, start)]
        while queue:
            length, name = heapq.heappop(queue)
            if name == end:
                path = [name]
                while path[-1] != start:
                    path.append(came[path[-1]])
                return tuple(reversed(path))
            if length > best[name]:
                continue
            x, y = self.position(name)
            for other in self.neighbours[name]:
                ox, oy = self.position(other)
                longer = length + ((ox - x) ** 2 + (oy - y) ** 2) ** 0.5
                if longer < best.get(other, float("inf")):
                    best[other] = longer
                    came[other] = name
                    heapq.heappush(queue, (longer, other))
        return None
