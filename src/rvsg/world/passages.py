"""Free widths: how wide the way is, measured from wall to wall across the direction of travel.

A width is the length of a chord: a straight line through a point of the way, from the obstacle on its left to the one
on its right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Record
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg.world.space import Space, human_space
from rvsg.world.world import World

Floats = NDArray[np.float64]

PERSON_M = 0.8
"""Diameter of a person."""
SWERVE_RAD = math.radians(20.0)
"""Turn with which a robot that cannot move sideways gets past a person."""
WIDEST_M = 20.0  # a chord is not followed farther than this to either side
FAN_RAD = math.radians(30.0)  # a chord may lean this far from the perpendicular; more would cut corners
FAN_STEPS = 13  # chords tried in that fan
SAMPLE_M = 0.1  # distance between two points of a line at which its width is measured
TOUCHING_M = 0.4  # an area this close to the end of a chord is the thing that bounds the passage
SEPARATE_M = 1.0  # two narrow places closer together than this on the way are one


def passing_m(robot: Robot | None = None) -> float:
    """Return the width below which a robot and a person who meet often cannot pass each other.

    It is the width of both side by side, for a robot that cannot move sideways turned by `SWERVE_RAD`.
    The documentation says how this compares with meetings in the simulator.
    """
    robot = robot or load_robot(DEFAULT_ROBOT)
    taken = robot.width_m
    if robot.drive.kind != "omnidirectional":
        taken = taken * math.cos(SWERVE_RAD) + robot.length_m * math.sin(SWERVE_RAD)
    return round(taken + PERSON_M, 2)


class Passage(Record):
    """A place on a way and its free width.

    `along_m` is the distance from the start of the way, `yaw` the direction of travel (radians, world frame),
    `waypoint` the nearest waypoint, `left` and `right` the areas that bound the passage as seen in the direction of
    travel (None: a wall or something without a label).
    """

    x: float
    y: float
    yaw: float
    along_m: float
    width_m: float
    waypoint: str
    left: str | None = None
    right: str | None = None

    @property
    def between(self) -> tuple[str, ...]:
        """The names of the areas that bound the passage, without repetition."""
        return tuple(dict.fromkeys(name for name in (self.left, self.right) if name))


def free_width_m(world: World, x: float, y: float, yaw: float | None = None) -> float:
    """Return the free width in metres at a point of the floor; 0 inside an obstacle.

    Args:
        yaw: Direction of travel in radians. With it, the width is measured across that direction. Without it, the
            width is the shortest straight line from obstacle to obstacle through the point.
    """
    at = np.array([[x, y]])
    if yaw is None:
        return float(free_widths_m(world, at)[0])
    return float(widths_m(human_space(world), at, np.array([yaw]))[0])


def free_widths_m(world: World, points: Floats) -> Floats:
    """Return the shortest straight lines (N,) from obstacle to obstacle through points (N, 2), in metres."""
    angles = np.linspace(0.0, math.pi, 36, endpoint=False)
    return np.asarray(_chords(human_space(world), points, angles[None, :]).sum(axis=-1).min(axis=1))


def widths_m(space: Space, points: Floats, yaws: Floats) -> Floats:
    """Return the free width in metres across each direction of travel: points (N, 2), yaws (N,) to widths (N,).

    The width is the shortest of the straight lines through the point that are within 30 degrees of the perpendicular,
    so that a way that crosses an aisle slightly askew does not make the aisle wider.
    """
    return np.asarray(_widths(space, points, yaws)[0])


def narrow_passages(
    world: World, line: Floats, *, robot: Robot | None = None, most: int | None = None
) -> tuple[Passage, ...]:
    """Return the narrow places along a line, in the order of travel, one per stretch at its narrowest point.

    Args:
        line: The way as points (N, 2) in metres.
        robot: Leave out places where this robot and a person can pass each other; None: the default robot.
        most: Keep only this many, the narrowest ones.
    """
    found = [
        min(stretch, key=lambda sample: (sample[1], sample[0])) for stretch in _stretches(world, line, passing_m(robot))
    ]
    if most is not None:
        found = sorted(sorted(found, key=lambda sample: sample[1])[:most])
    return tuple(_passage(world, line, along) for along, _ in found)


def narrowest_passage(world: World, line: Floats) -> Passage | None:
    """Return the narrowest place on a line (N, 2); None if the whole line lies in obstacles."""
    points, yaws, along = _along(line)
    widths = widths_m(human_space(world), points, yaws)
    free = widths > 0.0
    if not free.any():
        return None
    return _passage(world, line, float(along[np.where(free, widths, np.inf).argmin()]))


def narrowest_m(world: World, lines: Sequence[Floats]) -> list[float]:
    """Return the free width in metres at the narrowest place of each line (N, 2); 0 where all of it is in obstacles."""
    sampled = [_along(line) for line in lines]
    points, yaws = (np.concatenate(each) for each in list(zip(*sampled, strict=True))[:2])
    widths = widths_m(human_space(world), points, yaws)
    parts = np.split(widths, np.cumsum([len(each[0]) for each in sampled])[:-1])
    return [round(float(part[part > 0.0].min()), 3) if part.any() else 0.0 for part in parts]


def _stretches(world: World, line: Floats, limit: float) -> Iterator[list[tuple[float, float]]]:
    """Yield every stretch of the line that is narrower than the limit as (distance along the line, width)."""
    points, yaws, along = _along(line)
    widths = widths_m(human_space(world), points, yaws)
    stretch: list[tuple[float, float]] = []
    for where, width in zip(along.tolist(), widths.tolist(), strict=True):
        if not 0.0 < width < limit:
            continue
        if stretch and where - stretch[-1][0] > SEPARATE_M:
            yield stretch
            stretch = []
        stretch.append((where, width))
    if stretch:
        yield stretch


def _passage(world: World, line: Floats, along_m: float) -> Passage:
    """Measure the passage at a distance along a line."""
    points, yaws, along = _along(line)
    i = int(np.abs(along - along_m).argmin())
    at, yaw = points[i], float(yaws[i])
    widths, left, right = _widths(human_space(world), at[None, :], yaws[i : i + 1])
    x, y = float(at[0]), float(at[1])
    return Passage(
        x=round(x, 3),
        y=round(y, 3),
        yaw=round(yaw, 4),
        along_m=round(float(along[i]), 3),
        width_m=round(float(widths[0]), 3),
        waypoint=world.grid.nearest(x, y),
        left=_bounding_area(world, left[0]),
        right=_bounding_area(world, right[0]),
    )


def _bounding_area(world: World, end: Floats) -> str | None:
    """Return the labelled thing that the end of a chord touches; open floor bounds nothing."""
    from shapely import Point, Polygon

    from rvsg.world.lattice import open_share

    point = Point(*end)
    near = []
    for area in world.areas:
        shape = Polygon(area.outline)
        away = float(shape.distance(point))
        if away <= TOUCHING_M and open_share(area.outline, human_space(world)) <= 0.5:
            near.append((away, float(shape.area), area.name))
    return min(near)[2] if near else None


def _along(line: Floats) -> tuple[Floats, Floats, Floats]:
    """Return samples of a line: points (N, 2), directions (N,) and distances from its start (N,)."""
    points, yaws, along = [], [], []
    passed = 0.0
    for a, b in pairwise(np.asarray(line, float)):
        length = float(np.hypot(*(b - a)))
        if length == 0.0:
            continue
        count = max(1, math.ceil(length / SAMPLE_M))
        shares = np.arange(count) / count
        points.append(a + (b - a) * shares[:, None])
        yaws.append(np.full(count, math.atan2(b[1] - a[1], b[0] - a[0])))
        along.append(passed + shares * length)
        passed += length
    if not points:
        return np.asarray(line, float)[:1], np.zeros(1), np.zeros(1)
    points.append(np.asarray(line, float)[-1:])
    yaws.append(yaws[-1][-1:])
    along.append(np.array([passed]))
    return np.concatenate(points), np.concatenate(yaws), np.concatenate(along)


def _widths(space: Space, points: Floats, yaws: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the widths (N,) and the two ends (N, 2) of the shortest chord, left and right of the travel direction."""
    angles = yaws[:, None] + math.pi / 2 + np.linspace(-FAN_RAD, FAN_RAD, FAN_STEPS)[None, :]
    reach = _chords(space, points, angles)
    best = reach.sum(axis=-1).argmin(axis=1)
    row = np.arange(len(points))
    chosen, angle = reach[row, best], angles[row, best]
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    return chosen.sum(axis=1), points + chosen[:, :1] * direction, points - chosen[:, 1:] * direction


def _chords(space: Space, points: Floats, angles: Floats) -> Floats:
    """Return how far it is to the obstacle ahead and behind: points (N, 2), angles (N or 1, K) to (N, K, 2) metres.

    Follows each ray in steps of the clearance, which no obstacle can be nearer than.
    """
    forward = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    rays = np.stack([forward, -forward], axis=2)
    rays = np.broadcast_to(rays, (len(points), *rays.shape[1:]))
    reach = np.zeros(rays.shape[:-1])
    starts = np.broadcast_to(points[:, None, None, :], rays.shape).reshape(-1, 2)
    directions, far = rays.reshape(-1, 2), reach.reshape(-1)
    least = space.frame.resolution / 4
    moving = np.arange(len(far))
    while len(moving):
        clear = space.clearances(starts[moving] + directions[moving] * far[moving, None])
        free = clear > 0.0
        moving = moving[free]
        far[moving] += np.maximum(clear[free], least)
        moving = moving[far[moving] < WIDEST_M]
    return np.minimum(reach, WIDEST_M)
