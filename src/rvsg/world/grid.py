"""The grid of named waypoints: rows are letters, columns are numbers, as in `E15`."""

from __future__ import annotations

import heapq
import math
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rvsg.core.errors import UnknownName
from rvsg.core.records import Record

MOST_WALKS = 10_000
"""Shortest walks that a grid remembers."""
Radius = Annotated[float, Field(ge=0, le=5)]


class GridSpec(Record):
    """How the grid of a world is laid: evenly, or with the explicit coordinates of every row and column.

    Rows are lettered A..Z, AA.. from top to bottom and columns numbered from left to right of the floor plan, which
    is drawn with `up` (the x or the y axis) upwards and the world never mirrored.

    Evenly: `spacing_m` between neighbours (None: 1 m, coarser in a large world, finer in a small one), through
    `origin` (None: centred on the map). Explicitly: `rows` letter -> coordinate along the `up` axis, `columns`
    number -> coordinate along the other axis, `moved` name -> (x, y) of single waypoints that lie elsewhere.
    A person fits where no obstacle is nearer than `human_clearance_m`, unless `valid` lists the names that are; the
    robot where its map shows nothing nearer than `robot_clearance_m`. Parts of the floor that are cut off from the
    main one (where the routes start, or the largest) get valid waypoints only with `isolated_parts`. A straight hop
    between adjacent waypoints is free where no obstacle is nearer than `hop_clearance_m` (None: as for standing).
    """

    up: Literal["x", "y"] = "y"
    spacing_m: Annotated[float, Field(ge=0.1, le=50)] | None = None
    origin: tuple[float, float] | None = None
    rows: dict[str, float] | None = None
    columns: dict[int, float] | None = None
    moved: dict[str, tuple[float, float]] = Field(default_factory=dict)
    valid: tuple[str, ...] | None = None
    human_clearance_m: Radius = 0.3
    robot_clearance_m: Radius = 0.3
    hop_clearance_m: Radius | None = None
    isolated_parts: bool = False

    @property
    def hop_radius_m(self) -> float:
        """Return how far a straight hop keeps from obstacles."""
        return self.human_clearance_m if self.hop_clearance_m is None else self.hop_clearance_m

    @model_validator(mode="after")
    def _even_or_explicit(self) -> Self:
        if (self.rows is None) != (self.columns is None):
            raise ValueError("rows and columns are given together or not at all")
        if self.rows is not None and self.columns is not None:
            if self.spacing_m is not None or self.origin is not None:
                raise ValueError("give either spacing_m and origin (even spacing) or rows and columns (coordinates)")
            if not self.rows or not self.columns:
                raise ValueError("rows and columns cannot be empty")
            names = {f"{row}{column}" for row in self.rows for column in self.columns}
            unknown = sorted({*self.moved, *(self.valid or ())} - names)
            if unknown:
                raise ValueError(f"there is no waypoint {', '.join(unknown)} among the rows and columns")
        elif self.moved or self.valid is not None:
            raise ValueError("moved and valid need rows and columns (coordinates)")
        return self


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
    def up(self) -> Literal["x", "y"]:
        """The axis that points up in a floor plan whose first row is on top: the one along which rows differ."""
        if not self.waypoints:
            return "y"
        first = self.waypoints[0]
        below = next((w for w in self.waypoints if w.column == first.column and w.row != first.row), None)
        if below is not None:
            return "x" if abs(below.x - first.x) > abs(below.y - first.y) else "y"
        beside = next((w for w in self.waypoints if w.column != first.column), first)
        return "x" if abs(beside.y - first.y) > abs(beside.x - first.x) else "y"

    @property
    def across(self) -> Literal["x", "y"]:
        """The axis along which columns differ: the other one than `up`."""
        return "x" if self.up == "y" else "y"

    @cached_property
    def row_positions(self) -> dict[str, float]:
        """The coordinate in metres of every row along the `up` axis; the median where its waypoints differ."""
        return self._positions(self.rows, "row", self.up)

    @cached_property
    def column_positions(self) -> dict[str, float]:
        """The coordinate in metres of every column along the `across` axis; the median where its waypoints differ."""
        return self._positions(self.columns, "column", self.across)

    def _positions(self, names: tuple[str, ...], line: str, axis: str) -> dict[str, float]:
        lines: dict[int, list[float]] = {}
        for waypoint in self.waypoints:
            lines.setdefault(getattr(waypoint, line), []).append(getattr(waypoint, axis))
        return {name: sorted(lines[i])[len(lines[i]) // 2] for i, name in enumerate(names) if i in lines}

    @cached_property
    def spacing_m(self) -> float:
        """The smallest distance in metres between neighbouring rows or columns; 0 for a single waypoint."""
        lines = (sorted({w.x for w in self.waypoints}), sorted({w.y for w in self.waypoints}))
        gaps = [b - a for line in lines for a, b in pairwise(line)]
        return round(min(gaps), 3) if gaps else 0.0

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
        neighbours: dict[str, list[str]] = {w.name: [] for w in self.waypoints if w.human}
        for a, b in self.hops:
            neighbours[a].append(b)
            neighbours[b].append(a)
        order = {w.name: i for i, w in enumerate(self.waypoints)}
        return {name: tuple(sorted(others, key=order.__getitem__)) for name, others in neighbours.items()}

    @cached_property
    def _hop_lengths(self) -> dict[str, list[tuple[str, float]]]:
        """For every valid waypoint the names one free hop away and the lengths of the hops in metres."""
        at = {w.name: (w.x, w.y) for w in self.waypoints}

        def length(a: tuple[float, float], b: tuple[float, float]) -> float:
            return float(((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2) ** 0.5)

        return {name: [(o, length(at[name], at[o])) for o in others] for name, others in self.neighbours.items()}

    @cached_property
    def parts(self) -> tuple[frozenset[str], ...]:
        """Groups of valid waypoints between which people can walk, the largest first."""
        left = dict.fromkeys(self.neighbours)
        groups = []
        while left:
            stack = [next(iter(left))]
            part = set(stack)
            while stack:
                name = stack.pop()
                left.pop(name, None)
                fresh = [other for other in self.neighbours[name] if other not in part]
                part.update(fresh)
                stack += fresh
            groups.append(frozenset(part))
        return tuple(sorted(groups, key=len, reverse=True))

    def position(self, name: str) -> tuple[float, float]:
        """Return the waypoint's (x, y) in metres, or UnknownName. Invalid waypoints have a position too."""
        if name not in self.by_name:
            raise UnknownName("waypoint", name, self.valid)
        return (self.by_name[name].x, self.by_name[name].y)

    def nearest(self, x: float, y: float) -> str:
        """Return the name of the valid waypoint nearest to a point; ties go to the earlier one in grid order."""
        standing, at = self._standing
        rows = nearest_rows(at, x, y)
        nearest: Waypoint = min((standing[k] for k in rows), key=lambda w: (w.x - x) ** 2 + (w.y - y) ** 2)
        return nearest.name

    @cached_property
    def _standing(self) -> tuple[list[Waypoint], NDArray[np.float64]]:
        """The valid waypoints and (K, 2) where they are."""
        standing = [w for w in self.waypoints if w.human]
        return standing, np.array([(w.x, w.y) for w in standing]).reshape(-1, 2)

    @cached_property
    def _walks(self) -> dict[tuple[str, str], tuple[str, ...] | None]:
        """Shortest walks by their ends, as far as they were asked for."""
        return {}

    def shortest_path(self, start: str, end: str) -> tuple[str, ...] | None:
        """Return the shortest walk over free hops by length in metres, both ends included; None where there is none."""
        ends = (start, end)
        if ends in self._walks:
            return self._walks[ends]
        best, came, queue = {start: 0.0}, {start: start}, [(0.0, start)]
        walk: list[str] = []
        while queue and start in self.neighbours and end in self.neighbours:
            length, name = heapq.heappop(queue)
            if name == end:
                walk = [end]
                while walk[-1] != start:
                    walk.append(came[walk[-1]])
                break
            for other, hop in self._hop_lengths[name] if length <= best[name] else ():
                if length + hop < best.get(other, math.inf):
                    best[other], came[other] = length + hop, name
                    heapq.heappush(queue, (best[other], other))
        way = tuple(reversed(walk)) or None
        if len(self._walks) < MOST_WALKS:
            self._walks[ends] = way
        return way


def nearest_rows(at: NDArray[np.float64], x: float, y: float) -> NDArray[np.intp]:
    """Return the rows of points (K, 2) nearest to a point: one, or those that rounding does not tell apart."""
    squared = ((at - (x, y)) ** 2).sum(axis=1)
    return np.flatnonzero(squared <= squared.min() * (1.0 + 1e-9) + 1e-12)
