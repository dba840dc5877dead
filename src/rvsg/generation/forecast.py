"""A forecast of who is where when: a rough model, good enough to aim with. The simulator has the last word.

The robot drives its expected way at its usual mean speed, slows down for a person close in front and stops for one
closer still. People walk their paths at the pace that stops at every waypoint leave them; they do not react.
Feedback corrects both: the paces are fitted to where everybody was measured to be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rvsg.generation.ground import Ground, Point
from rvsg.scenario.brief import Feedback
from rvsg.scenario.scenario import Human

Floats = NDArray[np.float64]

STEP_S = 0.25
ROBOT_SPEED_M_S, STARTS_AFTER_S, TURNS_FOR_S = 0.49, 0.5, 1.5
"""An undisturbed run of the study's robot: 0.5 m/s along the way, less the start, and a turn at the goal."""
BODIES_M = 0.75
"""Radius of the robot (0.35 m) and of a person (0.40 m): what lies between centre distance and gap."""
STOPS_AT_M, SLOWS_AT_M, FRONT = 0.95, 1.35, math.radians(40.0)
MEETS_AT_M, MEETS_IN = 1.4, math.radians(70.0)


def pace(speed_m_s: float) -> float:
    """The mean speed over a path of waypoints about a metre apart of a person who wants to walk at `speed_m_s`."""
    return speed_m_s / (1.0 + 0.286 * speed_m_s)


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """What is expected of a run: gaps in metres between surfaces, seconds, and how often somebody comes up close in
    front of the robot (`meetings`, each weighed by the speed at which the gap closed, m/s)."""

    mean_gap_m: float
    least_gap_m: float
    blocked_s: float
    meetings: float
    duration_s: float


class Forecaster:
    """Forecasts for one route; `robot_speed_m_s` and `paces` (by human's name) are fitted by `fitted`."""

    def __init__(
        self,
        ground: Ground,
        time_limit_s: float,
        *,
        robot_speed_m_s: float = ROBOT_SPEED_M_S,
        paces: dict[str, float] | None = None,
    ) -> None:
        self.ground = ground
        self.limit = time_limit_s
        self.robot_speed = robot_speed_m_s
        self.paces = paces or {}
        self.times = np.arange(0.0, time_limit_s + STEP_S / 2, STEP_S)
        self._line = _Line(ground.robot_path)

    def walk(self, human: Human, *, factor: float | None = None) -> Floats:
        """Where a person is at `times`: (K, 2) metres."""
        factor = self.paces.get(human.name, 1.0) if factor is None else factor
        return walk(human, self.ground.at, self.times, factor)

    def __call__(self, humans: Sequence[Human]) -> Forecast:
        """What is expected with these people."""
        return self.expect([self.walk(human) for human in humans])

    def expect(self, walks: Sequence[Floats]) -> Forecast:
        """What is expected of people at these positions over time, (K, 2) each."""
        robot = _Drive(self._line, self.robot_speed)
        people = [list(map(tuple, w.tolist())) for w in walks]
        for k in range(len(self.times)):
            robot.meet([person[k] for person in people])
            if robot.arrived:
                break
        return robot.forecast()

    def fitted(self, feedback: Feedback) -> Forecaster:
        """This forecaster with paces that fit where everybody was measured to be at the time of the feedback."""
        samples = [s for s in feedback.series if s.time_s <= self.limit]
        if len(samples) < 3:
            return self
        rows = np.clip(np.round([s.time_s / STEP_S for s in samples]).astype(int), 0, len(self.times) - 1)
        paces = dict(self.paces)
        for human in feedback.scenario.people.humans:
            seen = [(row, self.ground.at[at]) for row, s in zip(rows, samples, strict=True)
                    if (at := s.humans_at.get(human.name)) in self.ground.at]  # fmt: skip
            if len(seen) >= 3:
                paces[human.name] = self._fit(human, np.array([r for r, _ in seen]), np.array([p for _, p in seen]))
        robot = [(s.time_s, nearest) for s in samples if s.robot_at in self.ground.at
                 for nearest in (self.ground.along(s.robot_at)[0],)]  # fmt: skip
        return Forecaster(self.ground, self.limit, robot_speed_m_s=self._speed(robot), paces=paces)

    def _fit(self, human: Human, rows: NDArray[np.int_], seen: Floats) -> float:
        factors = np.linspace(0.6, 1.5, 19)
        errors = [float(((self.walk(human, factor=f)[rows] - seen) ** 2).sum()) for f in factors]
        return float(factors[int(np.argmin(errors))])

    def _speed(self, robot: list[tuple[float, float]]) -> float:
        """The robot's speed while it moved: metres along its way over the time in which it advanced."""
        moving = [(t1 - t0, s1 - s0) for (t0, s0), (t1, s1) in pairwise(robot) if s1 > s0 + 0.05]
        spent, driven = sum(t for t, _ in moving), sum(s for _, s in moving)
        return min(0.5, max(0.3, driven / spent)) if spent > 3.0 else self.robot_speed


def walk(human: Human, at: dict[str, Point], times: Floats, factor: float = 1.0) -> Floats:
    """Where a person is at `times` (K,) s: (K, 2) metres. `factor` multiplies the expected pace."""
    points, stops = _goals(human, at)
    speed = max(0.05, pace(human.speed_m_s) * factor)
    marks, places, now = [0.0], [points[0]], stops[0]
    for index in range(1, len(points) + 1):
        marks.append(now)
        places.append(points[index - 1])
        now += math.dist(points[index - 1], points[index % len(points)]) / speed
        marks.append(now)
        places.append(points[index % len(points)])
        now += stops[index % len(points)] if index < len(points) else 0.0
    walked = np.mod(np.maximum(times - human.start_delay_s, 0.0), max(now, 1e-6))
    line = np.asarray(places)
    return np.stack([np.interp(walked, marks, line[:, 0]), np.interp(walked, marks, line[:, 1])], axis=1)


def _goals(human: Human, at: dict[str, Point]) -> tuple[list[Point], list[float]]:
    """The cyclic points of a person, and how long the person pauses at each."""
    points: list[Point] = []
    stops: list[float] = []
    for task in human.tasks:
        waiting = {p.at: p.duration_s for p in task.pauses}
        for name in task.path:
            if not points or points[-1] != at[name]:
                points.append(at[name])
                stops.append(0.0)
            stops[-1] += waiting.pop(name, 0.0)
    if len(points) > 1 and points[-1] == points[0]:
        stops[0] += stops.pop()
        points.pop()
    return points, stops


class _Line:
    """A line by its length: the point and the heading at a number of metres along it."""

    def __init__(self, points: Sequence[Point]) -> None:
        self.points = points
        self.marks = [0.0]
        for a, b in pairwise(points):
            self.marks.append(self.marks[-1] + math.dist(a, b))
        self.length = self.marks[-1]

    def at(self, s: float, leg: int) -> tuple[Point, float, int]:
        """Point, heading (rad) and leg at `s` metres; `leg` is where to begin to look."""
        while leg < len(self.marks) - 2 and s >= self.marks[leg + 1]:
            leg += 1
        if len(self.points) < 2:
            return self.points[0], 0.0, 0
        (ax, ay), (bx, by) = self.points[leg], self.points[leg + 1]
        span = self.marks[leg + 1] - self.marks[leg]
        share = min(1.0, (s - self.marks[leg]) / span) if span > 0.0 else 1.0
        return (ax + share * (bx - ax), ay + share * (by - ay)), math.atan2(by - ay, bx - ax), leg


class _Drive:
    """The robot of the forecast, step by step."""

    def __init__(self, line: _Line, speed: float) -> None:
        self.line, self.speed = line, speed
        self.s, self.leg, self.steps = 0.0, 0, 0
        self.gaps: list[float] = []
        self.blocked, self.meetings = 0, 0.0
        self._before: list[float] = []
        self._close: set[int] = set()
        self._turned = 0.0

    @property
    def arrived(self) -> bool:
        return self.s >= self.line.length and self._turned >= TURNS_FOR_S

    def meet(self, people: Sequence[Sequence[float]]) -> None:
        """One step among people at these points."""
        here, heading, self.leg = self.line.at(self.s, self.leg)
        nearest, factor, distances = math.inf, 1.0, []
        for index, (x, y) in enumerate(people):
            distance = math.hypot(x - here[0], y - here[1])
            distances.append(distance)
            nearest = min(nearest, distance)
            if distance > SLOWS_AT_M + 0.1:
                self._close.discard(index)
                continue
            bearing = abs(_wrapped(math.atan2(y - here[1], x - here[0]) - heading))
            if bearing < FRONT:
                factor = min(factor, 0.0 if distance < STOPS_AT_M else 0.5 if distance < SLOWS_AT_M else 1.0)
            if bearing < MEETS_IN and distance < MEETS_AT_M and index not in self._close and self._before:
                self._close.add(index)
                self.meetings += max(0.0, self._before[index] - distance) / STEP_S
        self._before = distances
        self.gaps.append(max(0.0, nearest - BODIES_M) if people else 0.0)
        self.blocked += factor < 1.0
        if self.s >= self.line.length:
            self._turned += STEP_S
        elif self.steps * STEP_S >= STARTS_AFTER_S:
            self.s += self.speed * STEP_S * factor
        self.steps += 1

    def forecast(self) -> Forecast:
        """The sum of all steps."""
        return Forecast(
            mean_gap_m=sum(self.gaps) / max(1, len(self.gaps)),
            least_gap_m=min(self.gaps, default=0.0),
            blocked_s=self.blocked * STEP_S,
            meetings=self.meetings,
            duration_s=self.steps * STEP_S,
        )


def _wrapped(angle: float) -> float:
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
