"""The leaves of automatic doors: their motion, and the edges that people and the robot meet."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from rvsg.simulation.embedded.people.crowd import PERIOD_S, Crowd
from rvsg.simulation.embedded.people.obstacles import RASTER_M, REACH_M
from rvsg.simulation.events import DoorMoved
from rvsg.world.world import Door

Floats = NDArray[np.float64]

SAFE_M = 0.3
"""A leaf does not close while a body is this near to where it moves."""
PATIENCE_S = 1.5
"""A person who is in the way of a leaf for so long is pushed out of it; the robot never is."""
_FAR_M2 = (REACH_M + RASTER_M) ** 2


def edges_of(corners: Any) -> Floats:
    """Return the closed outline of corners (K, 2) as segments (K, 4)."""
    points = np.asarray(corners, np.float64)
    return np.hstack([points, np.roll(points, -1, axis=0)])


@dataclass(frozen=True)
class Body:
    """Somebody near a door: the robot or a person."""

    x: float
    y: float
    shape: Any
    is_robot: bool


@dataclass
class Leaf:
    """A leaf on its way."""

    door: Door
    row: int
    """Its first segment among those that people meet."""
    share: float = 0.0
    opens: bool = False
    seen_t: float = -math.inf
    window: tuple[slice, slice] = (slice(0), slice(0))
    sweep: Any = None
    shape: Any = None
    held_s: float = 0.0
    """For how long somebody has been in the way."""
    moves: list[DoorMoved] = field(default_factory=list)

    def step(self, t: float, bodies: Sequence[Body]) -> bool:
        """Open, wait or close for one tick; whether the leaf moved."""
        door, (x, y) = self.door, self.door.middle
        for body in bodies:
            welcome = ("robot" if body.is_robot else "people") in door.opens_for
            if welcome and math.hypot(body.x - x, body.y - y) <= door.range_m:
                self.seen_t = t
        kept = self.share > 0.0 and any(self.sweep.distance(body.shape) < SAFE_M for body in bodies)
        opens = t - self.seen_t <= door.hold_s or (kept and self.opens)
        if opens != self.opens:
            self._turn(t, opens)
        goal = 1.0 if self.opens else 0.0
        if self.share == goal or (kept and not self.opens):
            return False
        change = PERIOD_S / door.opening_s
        share = min(goal, self.share + change) if self.opens else max(goal, self.share - change)
        shape = shapely.Polygon(door.leaf(share))
        held = [body for body in bodies if _enters(shape, self.shape, body.shape)]
        self.held_s = self.held_s + PERIOD_S if held else 0.0
        if any(body.is_robot or self.held_s < PATIENCE_S for body in held):
            return False
        self.share, self.shape = share, shape
        return True

    def _turn(self, t: float, opens: bool) -> None:
        self.opens = opens
        if self.moves and self.moves[-1].until_s > t:
            self.moves[-1] = self.moves[-1].model_copy(update={"until_s": round(t, 3)})
        left = (1.0 - self.share if opens else self.share) * self.door.opening_s
        x, y = self.door.middle
        self.moves.append(
            DoorMoved(
                time_s=round(t, 3), x=round(x, 3), y=round(y, 3), door=self.door.name, opens=opens,
                share=round(self.share, 3), until_s=round(t + left, 3),
            )
        )  # fmt: skip


def _enters(shape: Any, before: Any, body: Any) -> bool:
    """Return whether a leaf that moves on covers more of a body."""
    return bool(shape.intersects(body)) and shape.intersection(body).area > before.intersection(body).area + 1e-6


class Leaves:
    """All automatic doors of a world, and what people know of them in `crowd.segments` and `crowd.nearest`."""

    def __init__(self, doors: Iterable[Door], crowd: Crowd) -> None:
        rows, columns = crowd.nearest.shape
        self.leaves = [Leaf(door, len(crowd.segments) + 4 * number) for number, door in enumerate(doors)]
        added = [edges_of(leaf.door.leaf(0.0)) for leaf in self.leaves]
        self.crowd = crowd._replace(segments=np.concatenate([crowd.segments, *added]), nearest=crowd.nearest.copy())
        self._walls = crowd.nearest
        for leaf in self.leaves:
            corners = np.concatenate([leaf.door.leaf(share) for share in (0.0, 0.5, 1.0)])
            low, high = corners.min(axis=0) - REACH_M - RASTER_M, corners.max(axis=0) + REACH_M + RASTER_M
            (c0, r0), (c1, r1) = (
                np.floor((at - (crowd.raster_x, crowd.raster_y)) / RASTER_M).astype(int) for at in (low, high)
            )
            leaf.window = (
                slice(min(rows, max(0, r0)), min(rows, max(0, r1 + 1))),
                slice(min(columns, max(0, c0)), min(columns, max(0, c1 + 1))),
            )
            leaf.sweep = shapely.MultiPoint(corners).convex_hull
            leaf.shape = shapely.Polygon(leaf.door.leaf(0.0))
        for leaf in self.leaves:
            self._show(leaf)

    def step(self, t: float, bodies: Sequence[Body]) -> list[Leaf]:
        """Move the leaves for one tick; return those that moved."""
        moved = [leaf for leaf in self.leaves if leaf.step(t, bodies)]
        for leaf in moved:
            self.crowd.segments[leaf.row : leaf.row + 4] = edges_of(leaf.door.leaf(leaf.share))
            self._show(leaf)
        return moved

    def _show(self, changed: Leaf) -> None:
        """Write around a leaf which segment is nearest, among walls and all leaves."""
        rows, columns = changed.window
        near = self._walls[rows, columns].copy()
        if not near.size:
            return
        crowd = self.crowd
        x = crowd.raster_x + (np.arange(columns.start, columns.stop) + 0.5) * RASTER_M
        y = crowd.raster_y + (np.arange(rows.start, rows.stop) + 0.5) * RASTER_M
        x, y = np.meshgrid(x, y)
        best = np.where(near >= 0, _square(crowd.segments[near], x, y), _FAR_M2)
        for leaf in self.leaves:
            if leaf is not changed and not _meet(leaf.window, changed.window):
                continue
            for row in range(leaf.row, leaf.row + 4):
                square = _square(crowd.segments[row], x, y)
                nearer = square < best
                best[nearer], near[nearer] = square[nearer], row
        crowd.nearest[rows, columns] = near


def _meet(a: tuple[slice, slice], b: tuple[slice, slice]) -> bool:
    return all(p.start < q.stop and q.start < p.stop for p, q in zip(a, b, strict=True))


def _square(segment: Floats, x: Floats, y: Floats) -> Floats:
    """Return the squared distance of points from segments (..., 4), one for each or one for all."""
    ax, ay, bx, by = (segment[..., k] for k in range(4))
    dx, dy = bx - ax, by - ay
    length = np.maximum(dx * dx + dy * dy, 1e-12)
    share = np.clip(((x - ax) * dx + (y - ay) * dy) / length, 0.0, 1.0)
    square: Floats = (ax + share * dx - x) ** 2 + (ay + share * dy - y) ** 2
    return square
