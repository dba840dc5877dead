"""A forecast of who is where when: a rough model, good enough to aim with. The simulator has the last word.

Many variants are forecast side by side. The robot drives its expected way at its usual speed, makes room sideways
for people near its line, slows down for one close in front and stops for one closer still; it neither plans nor
senses. People walk from waypoint to waypoint, pulled by the next one and pushed by the robot and each other (desired
and social force of Moussaid et al. 2009, "Experimental study of the behavioural mechanisms underlying
self-organization in human crowds", with the weights HuNavSim gives a regular person); nothing pushes them off walls.
Feedback corrects the paces and the robot's speed to where everybody was measured to be.

Points and vectors are complex numbers, x + iy metres: a turn is a product, a length an absolute value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.generation.walking_graph import Point, WalkingGraph
from rvsg.scenario.brief import Feedback
from rvsg.scenario.scenario import Behaviour, Human

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

STEP_S = 0.1
ROBOT_SPEED_M_S, STARTS_AFTER_S, TURNS_FOR_S = 0.49, 0.5, 1.5
"""An undisturbed run of the study's robot: 0.5 m/s along the way, less the start, and a turn at the goal."""
PERSON_M = 0.4
"""Radius of a person."""
STOPS_AT_M, SLOWS_AT_M, FRONT = 0.7, 1.0, math.radians(40.0)
GOAL_TAKEN_M = 0.6
ROOM_M, ROOM_AHEAD_M, SWERVES_M, SWERVE_STEP_M = 0.9, 1.5, 1.0, 0.025
"""Room the robot makes beside people up to so far ahead, at most how far aside, and how fast (per step)."""
MEETS_AT_M, MEETS_IN = 1.4, math.radians(70.0)
GOAL_WEIGHT, SOCIAL_WEIGHT, RELAXATION_S = 2.0, 5.0, 0.5
LAMBDA, GAMMA, N_ANGLE, N_SPEED = 2.0, 0.35, 2.0, 3.0
ARRIVES_AT_M = 0.4
"""A waypoint counts as reached this near to it, and the person stops for a moment there (HuNavSim's behaviour)."""


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """What is expected of a run: gaps in metres between surfaces, seconds, and how often somebody comes up close in
    front of the robot (`meetings`, each weighed by the speed at which the gap closed, m/s). `swerved_m` is how far
    the robot moves sideways in all to make room."""

    mean_gap_m: float
    least_gap_m: float
    blocked_s: float
    meetings: float
    swerved_m: float
    duration_s: float


class Forecaster:
    """Forecasts for one route.

    `robot_speed_m_s` and `pace` (a factor on everybody's speed) are fitted by `fitted`; `robot_radius_m` is that of the
    disc that stands for the robot.
    """

    def __init__(
        self,
        ground: WalkingGraph,
        time_limit_s: float,
        *,
        robot_speed_m_s: float = ROBOT_SPEED_M_S,
        pace: float = 1.0,
        robot_radius_m: float = 0.35,
    ) -> None:
        self.ground = ground
        self.limit = time_limit_s
        self.robot_speed = robot_speed_m_s
        self.pace = pace
        self.bodies = robot_radius_m + PERSON_M
        self.robot_radius = robot_radius_m
        self._line = _Line(ground.robot_path)

    def __call__(self, humans: Sequence[Human]) -> Forecast:
        """What is expected with these people."""
        return self.compare([humans])[0]

    def compare(self, variants: Sequence[Sequence[Human]]) -> list[Forecast]:
        """What is expected of each of several configurations with the same number of people."""
        if not variants:
            return []
        return self._run(variants, [self.robot_speed] * len(variants), [self.pace] * len(variants)).forecasts()

    def fitted(self, feedback: Feedback) -> Forecaster:
        """The forecaster whose paces and speed come nearest to where everybody was measured to be."""
        humans = feedback.scenario.people.humans
        at = self.ground.at
        seen = [
            (s.time_s, [complex(*at[name]) for name in (s.robot_at, *(s.humans_at[h.name] for h in humans))])
            for s in feedback.series
            if s.time_s <= self.limit and s.robot_at in at and all(s.humans_at.get(h.name) in at for h in humans)
        ]
        if len(seen) < 5:
            return self
        scale = self.robot_speed / ROBOT_SPEED_M_S
        speeds = [speed * scale for speed in (0.42, 0.46, 0.49)]
        choices = [(speed, pace) for speed in speeds for pace in (0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2)]
        run = self._run([humans] * len(choices), [c[0] for c in choices], [c[1] for c in choices], keep=True)
        track = run.track()
        rows = np.clip(np.round([t / STEP_S for t, _ in seen]).astype(int), 0, len(track) - 1)
        errors = (np.abs(track[rows] - np.array([places for _, places in seen])[:, None]) ** 2).sum(axis=(0, 2))
        speed, pace = choices[int(np.argmin(errors))]
        return Forecaster(self.ground, self.limit, robot_speed_m_s=speed, pace=pace, robot_radius_m=self.robot_radius)

    def _run(
        self, variants: Sequence[Sequence[Human]], speeds: Sequence[float], paces: Sequence[float], keep: bool = False
    ) -> _Episode:
        people = _People(variants, self.ground.at, np.asarray(paces))
        run = _Episode(self._line, people, np.asarray(speeds), self.bodies, keep)
        for _ in range(int(self.limit / STEP_S)):
            run.step()
            if run.done.all():
                break
        return run


def goals_of(human: Human, at: dict[str, Point]) -> tuple[list[Point], list[float]]:
    """The cyclic points of a person (metres), and how long the person pauses at each (s)."""
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


def push(p: Complexes, v: Complexes, all_p: Complexes, all_v: Complexes) -> Complexes:
    """The social force (m/s2, unit mass) on people at `p` (B, H) moving with `v` from all at `all_p` (B, A), summed
    over A; who is at the very same place, oneself included, does not push."""
    apart = all_p[:, None, :] - p[:, :, None]
    distance = np.abs(apart)
    oneself = distance < 1e-9
    distance = distance + oneself
    towards = apart / distance
    interaction = LAMBDA * (v[:, :, None] - all_v[:, None, :]) + towards
    strength = np.maximum(np.abs(interaction), 1e-6)
    along = interaction / strength
    reach = GAMMA * strength
    angle = np.angle(along.conj() * towards)
    fade, turn = -distance / reach, (reach * angle) ** 2
    slowing = np.exp(fade - N_SPEED**2 * turn)
    turning = np.sign(angle) * np.exp(fade - N_ANGLE**2 * turn)
    force = np.where(oneself, 0.0, -(slowing + 1j * turning) * along)
    return np.asarray(SOCIAL_WEIGHT * force.sum(axis=2))


class _People:
    """The people of B variants, H in each: positions and velocities (B, H), and the waypoints before them."""

    def __init__(self, variants: Sequence[Sequence[Human]], at: dict[str, Point], paces: Floats) -> None:
        routes: dict[int, tuple[list[Point], list[float]]] = {}
        for human in (human for humans in variants for human in humans):
            if id(human) not in routes:
                routes[id(human)] = goals_of(human, at)
        table = [[routes[id(human)] for human in humans] for humans in variants]
        longest = max(len(points) for row in table for points, _ in row)
        shape = (len(variants), len(variants[0]))
        self.goals = np.zeros((*shape, longest), complex)
        self.stops = np.zeros((*shape, longest))
        self.count = np.ones(shape, np.int64)
        for b, row in enumerate(table):
            for h, (points, stops) in enumerate(row):
                self.count[b, h] = len(points)
                self.goals[b, h, : len(points)] = [complex(*point) for point in points]
                self.stops[b, h, : len(points)] = stops
        self.p = self.goals[:, :, 0].copy()
        self.v = np.zeros_like(self.p)
        self.speed = np.array([[h.speed_m_s for h in humans] for humans in variants]) * paces[:, None]
        self.heeds = np.array([[h.behaviour is not Behaviour.IMPASSIVE for h in humans] for humans in variants])
        self.wait = np.array([[h.start_delay_s for h in humans] for humans in variants])
        self.next = np.minimum(1, self.count - 1)
        self._rows = np.ix_(range(shape[0]), range(shape[1]))

    def step(self, robot: Complexes, robot_v: Complexes) -> None:
        """One step among each other and the robots at (B,)."""
        waiting = self.wait > 0.0
        self.wait = np.maximum(0.0, self.wait - STEP_S)
        way = self.goals[(*self._rows, self.next)] - self.p
        length = np.abs(way)
        arrived = (length <= ARRIVES_AT_M) & ~waiting
        pull = way * (self.speed / np.maximum(length, 1e-6))
        force = (pull - self.v) * (GOAL_WEIGHT / RELAXATION_S) + push(self.p, self.v, self.p, self.v)
        force = force + self.heeds * push(self.p, self.v, robot[:, None], robot_v[:, None])
        v = self.v + force * STEP_S
        v /= np.maximum(np.abs(v) / self.speed, 1.0)
        self.v = np.where(arrived | waiting, 0.0, v)
        self.p = self.p + self.v * STEP_S
        if arrived.any():
            self.wait = np.where(arrived, self.stops[(*self._rows, self.next)], self.wait)
            self.next = np.where(arrived, (self.next + 1) % self.count, self.next)


class _Line:
    """A line by its length: points and headings at a number of metres along it."""

    def __init__(self, points: Sequence[Point]) -> None:
        self.points = np.array([complex(*point) for point in points])
        legs = np.diff(self.points)
        self.marks = np.concatenate([[0.0], np.cumsum(np.abs(legs))])
        self.units: Complexes = np.asarray(legs / np.maximum(np.abs(legs), 1e-9), complex)
        self.length = float(self.marks[-1])

    def at(self, s: Floats) -> tuple[Complexes, Complexes]:
        """Points (B,) and unit headings (B,) at `s` (B,) metres."""
        leg = np.clip(np.searchsorted(self.marks, s, side="right") - 1, 0, len(self.units) - 1)
        units = self.units[leg]
        return np.asarray(self.points[leg] + (s - self.marks[leg]) * units, complex), np.asarray(units, complex)


class _Episode:
    """B runs side by side. `bodies`: radius of the robot and of a person, metres."""

    def __init__(self, line: _Line, people: _People, speeds: Floats, bodies: float, keep: bool) -> None:
        self.line, self.people, self.speeds, self.bodies, self.keep = line, people, speeds, bodies, keep
        count, humans = people.p.shape
        self.rows = np.arange(count)
        self.s, self.turned, self.aside, self.swerved = (np.zeros(count) for _ in range(4))
        self.time, self.gap_sum, self.blocked, self.meetings = (np.zeros(count) for _ in range(4))
        self.least = np.full(count, np.inf)
        self.now = 0.0
        self.before: Floats | None = None
        self.close = np.zeros((count, humans), bool)
        self._track: list[Complexes] = []

    @property
    def done(self) -> NDArray[np.bool_]:
        """Which runs are over (B,)."""
        return self.turned >= TURNS_FOR_S

    def step(self) -> None:
        """One step of everybody; runs that are over count no more."""
        going = ~self.done
        arrived = self.s >= self.line.length
        driving = going & ~arrived if self.now >= STARTS_AFTER_S else np.zeros_like(arrived)
        line, ahead = self.line.at(np.minimum(self.s, self.line.length))
        self._swerve((self.people.p - line[:, None]) * ahead.conj()[:, None], driving)
        here = line + 1j * ahead * self.aside
        apart = (self.people.p - here[:, None]) * ahead.conj()[:, None]
        free = self._measure(np.abs(apart), np.abs(np.angle(apart)), going)
        advance = np.where(driving & ~self._taken(), self.speeds * free, 0.0)
        self.turned += np.where(arrived, STEP_S, 0.0)
        self.s += advance * STEP_S
        if self.keep:
            self._track.append(np.concatenate([here[:, None], self.people.p], axis=1))
        self.people.step(here, ahead * advance)
        self.now += STEP_S

    def _taken(self) -> NDArray[np.bool_]:
        """Where the robot has come to its goal and somebody stands on it (B,)."""
        at_goal = np.abs(self.people.p - self.line.points[-1]).min(axis=1) < GOAL_TAKEN_M
        return np.asarray(at_goal & (self.s > self.line.length - GOAL_TAKEN_M))

    def _swerve(self, apart: Complexes, driving: NDArray[np.bool_]) -> None:
        """Make room for who is close, coming back as fast as one may; `apart` (B, H): ahead + i aside of the line."""
        across = apart.imag - self.aside[:, None]
        room = np.where((apart.real > -0.3) & (apart.real < ROOM_AHEAD_M), ROOM_M - np.abs(across), 0.0)
        worst = room.argmax(axis=1)
        most = room[self.rows, worst]
        away = np.where(across[self.rows, worst] >= 0.0, -most, most)
        wanted = np.where(most > 0.0, np.clip(self.aside + away, -SWERVES_M, SWERVES_M), 0.0)
        change = np.where(driving, np.clip(wanted - self.aside, -SWERVE_STEP_M, SWERVE_STEP_M), 0.0)
        self.aside += change
        self.swerved += np.abs(change)

    def _measure(self, distance: Floats, bearing: Floats, going: NDArray[np.bool_]) -> Floats:
        """Take the gaps and meetings of this step; the share (B,) of its speed the robot keeps."""
        gap = np.maximum(0.0, distance.min(axis=1) - self.bodies)
        self.gap_sum += np.where(going, gap, 0.0)
        self.least = np.where(going, np.minimum(self.least, gap), self.least)
        self.time += np.where(going, STEP_S, 0.0)
        ahead = np.where(bearing < FRONT, distance, np.inf).min(axis=1)
        free = np.where(ahead < STOPS_AT_M, 0.0, np.where(ahead < SLOWS_AT_M, 0.5, 1.0))
        self.blocked += np.where(going & (free < 1.0), STEP_S, 0.0)
        self.close &= distance < MEETS_AT_M + 0.2
        new = (bearing < MEETS_IN) & (distance < MEETS_AT_M) & ~self.close & going[:, None]
        if self.before is not None and new.any():
            self.meetings += np.where(new, np.maximum(0.0, self.before - distance) / STEP_S, 0.0).sum(axis=1)
        self.close |= new
        self.before = distance
        return free

    def track(self) -> Complexes:
        """Robot and people over time, (steps, B, 1 + H); only where it was kept."""
        return np.array(self._track)

    def forecasts(self) -> list[Forecast]:
        """The sums of all steps."""
        steps = np.maximum(1.0, self.time / STEP_S)
        return [
            Forecast(
                mean_gap_m=float(self.gap_sum[b] / steps[b]),
                least_gap_m=float(self.least[b]),
                blocked_s=float(self.blocked[b]),
                meetings=float(self.meetings[b]),
                swerved_m=float(self.swerved[b]),
                duration_s=float(self.time[b]),
            )
            for b in range(len(steps))
        ]
