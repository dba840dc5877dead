"""Tracks of people whose source gives places without names: detections, and what moves in laser scans.

Each person has a constant-velocity Kalman filter. Places are given to people by the least sum of distances within a
gate. What the map explains, what is no leg and what never moves is no person; who was never seen cannot be known.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.recording.tracks import PersonTrack
from rvsg.world.space import frame_of
from rvsg.world.world import OCCUPIED, OccupancyMap

Floats = NDArray[np.float64]

PLACE_M, JERK_M_S2 = 0.1, 1.5
"""Standard deviation of a place, and of the acceleration of people."""
GATE_M = 0.5
"""A place belongs to nobody who is expected farther away than this and three standard deviations."""
FORGET_S = 1.0
LEAST_PLACES = 8
MOVES_M = 0.6
"""Who comes no farther than this from the first place in a scan is taken for an object."""


class _Filter:
    """A person: state (place, velocity) with one covariance for both axes."""

    def __init__(self, t: float, place: Floats) -> None:
        self.t, self.place, self.velocity = t, place.copy(), np.zeros(2)
        self.p, self.c, self.v = PLACE_M**2, 0.0, 1.0
        self.rows: list[tuple[float, float, float]] = [(t, float(place[0]), float(place[1]))]
        self.errors: list[float] = []

    def expected(self, t: float) -> tuple[Floats, float]:
        """Return where the person is expected, and the standard deviation of that, m."""
        place, p, _, _ = self._predicted(t)
        return place, math.sqrt(p)

    def update(self, t: float, place: Floats) -> None:
        """Take a place as that of the person."""
        expected, p, c, v = self._predicted(t)
        gain, slope = p / (p + PLACE_M**2), c / (p + PLACE_M**2)
        change = place - expected
        self.place, self.velocity = expected + gain * change, self.velocity + slope * change
        self.p, self.c, self.v = (1.0 - gain) * p, (1.0 - gain) * c, v - slope * c
        self.t = t
        self.rows.append((t, float(place[0]), float(place[1])))
        self.errors.append(math.sqrt(self.p))

    def _predicted(self, t: float) -> tuple[Floats, float, float, float]:
        """Return the place at a time, its variance, its covariance with the velocity, and the velocity's variance."""
        dt, q = t - self.t, JERK_M_S2**2
        p = self.p + 2.0 * dt * self.c + dt * dt * self.v + q * dt**4 / 4.0
        return self.place + dt * self.velocity, p, self.c + dt * self.v + q * dt**3 / 2.0, self.v + q * dt * dt


def track_places(frames: Iterable[tuple[float, Floats]], *, moving: bool = False) -> tuple[PersonTrack, ...]:
    """Return the tracks of places (N, 2) at times, by the order in which people appear.

    Args:
        moving: leave out who never moves.
    """
    from scipy.optimize import linear_sum_assignment

    present: list[_Filter] = []
    done: list[_Filter] = []
    for t, places in frames:
        done += [person for person in present if t - person.t > FORGET_S]
        present = [person for person in present if t - person.t <= FORGET_S]
        taken: set[int] = set()
        if present and len(places):
            expected = [person.expected(t) for person in present]
            away = np.hypot(*(np.array([at for at, _ in expected])[:, None] - places[None]).transpose(2, 0, 1))
            reach = np.array([min(2.0 * GATE_M, GATE_M + 3.0 * (deviation - PLACE_M)) for _, deviation in expected])
            cost = np.where(away <= reach[:, None], away, 1e3)
            for row, column in zip(*linear_sum_assignment(cost), strict=True):
                if cost[row, column] < 1e3 and t > present[row].t:
                    present[row].update(t, places[column])
                    taken.add(int(column))
        present += [_Filter(t, place) for k, place in enumerate(places) if k not in taken]
    people = [person for person in (*done, *present) if len(person.rows) >= LEAST_PLACES]
    people.sort(key=lambda person: person.rows[0])
    tracks: list[PersonTrack] = []
    for person in people:
        rows = np.array(person.rows)
        if moving and np.hypot(*(rows[:, 1:3] - rows[0, 1:3]).T).max() < MOVES_M:
            continue
        whole = np.column_stack([rows, np.zeros(len(rows)), np.full(len(rows), np.nan)])
        tracks.append(PersonTrack(name=f"Person {len(tracks) + 1}", rows=whole, spread_m=float(np.mean(person.errors))))
    return tuple(tracks)


EXPLAINED_M = 0.25
"""A return this near to a wall of the map is of the wall."""
APART_M = 0.13
"""Returns of one leg are no farther apart."""
LEG_WIDTHS_M = (0.03, 0.45)
LEGS_APART_M = 0.75
LEG_RADIUS_M = 0.06
"""The middle of a leg is so far behind what the lidar sees."""
FARTHEST_M = 10.0
TOGETHER_S, TOGETHER_M = 0.02, 0.4
"""Scans and people this near to each other are of one moment and one person."""


class LaserScan(NamedTuple):
    """One laser scan: time, pose of the lidar in the map (x, y, yaw), angles (rad) and ranges (m)."""

    t: float
    pose: tuple[float, float, float]
    angles: Floats
    ranges: Floats


@dataclass
class LegDetector:
    """Finds people in scans as pairs of legs that the map does not explain."""

    occupancy: OccupancyMap
    _far: Floats = field(init=False)

    def __post_init__(self) -> None:
        from scipy.ndimage import distance_transform_edt

        self._far = distance_transform_edt(self.occupancy.cells != OCCUPIED) * self.occupancy.resolution

    def places(self, scan: LaserScan) -> Floats:
        """Return where people are in the map, (N, 2)."""
        valid = np.isfinite(scan.ranges) & (scan.ranges > 0.05) & (scan.ranges < FARTHEST_M)
        ranges = scan.ranges[valid] + LEG_RADIUS_M
        x, y, yaw = scan.pose
        points = np.column_stack(
            [x + ranges * np.cos(yaw + scan.angles[valid]), y + ranges * np.sin(yaw + scan.angles[valid])]
        )
        points = points[frame_of(self.occupancy).looked_up(self._far, points) > EXPLAINED_M]
        if not len(points):
            return np.empty((0, 2))
        near = [self._leg(part) for part in _parts(points)]
        legs = np.array([leg for leg in near if leg is not None]).reshape(-1, 2)
        return np.array([legs[group].mean(axis=0) for group in _pairs(legs)]).reshape(-1, 2)

    def _leg(self, part: Floats) -> Floats | None:
        width = float(np.hypot(*(part[-1] - part[0])))
        if len(part) < 2 or not LEG_WIDTHS_M[0] <= width <= LEG_WIDTHS_M[1]:
            return None
        return np.asarray(part.mean(axis=0))


def _parts(points: Floats) -> Iterator[Floats]:
    """Yield runs of points that follow each other closely."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    yield from np.split(points, np.flatnonzero(steps > APART_M) + 1)


def _pairs(legs: Floats) -> Iterator[list[int]]:
    """Yield the legs of each person: the nearest two first, and those that are left alone."""
    free = set(range(len(legs)))
    apart = [
        (math.dist(legs[a], legs[b]), a, b)
        for a in range(len(legs))
        for b in range(a + 1, len(legs))
        if math.dist(legs[a], legs[b]) <= LEGS_APART_M
    ]
    for _, a, b in sorted(apart):
        if a in free and b in free:
            free -= {a, b}
            yield [a, b]
    for one in sorted(free):
        yield [one]


def people_in_scans(scans: Iterable[LaserScan], occupancy: OccupancyMap) -> tuple[PersonTrack, ...]:
    """Return the people who move in scans of one or more lidars, in the frame of the map."""
    detector = LegDetector(occupancy)
    return track_places(_frames((scan.t, detector.places(scan)) for scan in scans), moving=True)


def _frames(seen: Iterable[tuple[float, Floats]]) -> Iterator[tuple[float, Floats]]:
    """Join what several lidars see at the same time: a person whom two see counts once."""
    now, places = -math.inf, np.empty((0, 2))
    for t, seen_now in seen:
        if t - now > TOGETHER_S:
            if math.isfinite(now):
                yield now, places
            now, places = t, seen_now
            continue
        new = [at for at in seen_now if not len(places) or np.hypot(*(places - at).T).min() > TOGETHER_M]
        places = np.concatenate([places, np.array(new).reshape(-1, 2)])
    if math.isfinite(now):
        yield now, places
