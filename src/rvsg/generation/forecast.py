"""A forecast of who is where when: a rough model, good enough to aim with. The simulator has the last word.

Many variants are forecast side by side. The robot drives its expected way at its usual speed, makes room sideways
for people near its line, slows down for one close in front and stops for one closer still; it neither plans nor
senses. People walk from waypoint to waypoint, pulled by the next one and pushed by the robot and each other (desired
and social force of Moussaid et al. 2009, "Experimental study of the behavioural mechanisms underlying
self-organization in human crowds", with the weights HuNavSim gives a regular person); nothing pushes them off walls.
Feedback corrects the paces and the robot's speed to where everybody was measured to be.

The steps are in `rvsg.generation.forecast_kernel`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rvsg.generation.forecast_kernel import (
    BLOCKED,
    DURATION,
    LEAST_GAP,
    MEAN_GAP,
    MEETINGS,
    STEP_S,
    SWERVED,
    Complexes,
    Floats,
    Way,
    run_all,
)
from rvsg.generation.walking_graph import Point, WalkingGraph, walking_graph
from rvsg.scenario.brief import Feedback
from rvsg.scenario.scenario import Behaviour, Human, Mission
from rvsg.world.world import World

ROBOT_SPEED_M_S = 0.49
"""An undisturbed run of the study's robot: 0.5 m/s along the way, less the start, and a turn at the goal."""
PERSON_M = 0.4
"""Radius of a person."""


AIMED = 8
"""At most this many people are forecast; in a larger crowd the others simply work."""


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
        self._way = _way(ground.robot_path, self.bodies)

    def __call__(self, humans: Sequence[Human]) -> Forecast:
        """What is expected with these people."""
        return self.compare([humans])[0]

    def compare(self, variants: Sequence[Sequence[Human]]) -> list[Forecast]:
        """What is expected of each of several configurations with the same number of people."""
        if not variants:
            return []
        measured, _ = self._run(variants, [self.robot_speed] * len(variants), [self.pace] * len(variants))
        return [_forecast(row) for row in measured]

    def tracks(self, variants: Sequence[Sequence[Human]]) -> list[Complexes]:
        """Return for each configuration where robot and people are every `STEP_S` until the robot is done, (N, 1 + H).

        Points are complex numbers, x + iy metres.
        """
        if not variants:
            return []
        count = len(variants)
        measured, tracks = self._run(variants, [self.robot_speed] * count, [self.pace] * count, keep=True)
        ends = np.round(measured[:, DURATION] / STEP_S).astype(int)
        return [tracks[:end, b] for b, end in enumerate(ends)]

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
        wanted = np.round([t / STEP_S for t, _ in seen]).astype(int)
        speeds, paces = [c[0] for c in choices], [c[1] for c in choices]
        _, track = self._run([humans] * len(choices), speeds, paces, keep=True, most=1 + int(wanted.max()))
        rows = np.clip(wanted, 0, len(track) - 1)
        errors = (np.abs(track[rows] - np.array([places for _, places in seen])[:, None]) ** 2).sum(axis=(0, 2))
        speed, pace = choices[int(np.argmin(errors))]
        return Forecaster(self.ground, self.limit, robot_speed_m_s=speed, pace=pace, robot_radius_m=self.robot_radius)

    def _run(
        self,
        variants: Sequence[Sequence[Human]],
        speeds: Sequence[float],
        paces: Sequence[float],
        *,
        keep: bool = False,
        most: float = math.inf,
    ) -> tuple[Floats, Complexes]:
        """Return what is measured of each variant in so many steps, and with `keep` robot and people over time.

        What is kept, (steps, B, 1 + H), ends when the last robot is done.
        """
        walks = _Walks(variants, self.ground.at, np.asarray(paces, float))
        steps = int(min(self.limit / STEP_S, most))
        tracks = np.zeros((len(variants), steps if keep else 0, 1 + walks.goals.shape[1]), complex)
        measured, done = run_all(
            self._way,
            walks.goals,
            walks.stops,
            walks.count,
            walks.speed,
            walks.heeds,
            walks.delays,
            np.asarray(speeds, float),
            steps,
            tracks,
        )
        return measured, tracks[:, : int(done.max())].transpose(1, 0, 2)


def forecaster_of(mission: Mission, world: World) -> Forecaster:
    """Return the forecaster for a mission and its robot."""
    route, robot = mission.route, mission.robot
    ground = walking_graph(world, route)
    if isinstance(robot, str):
        return Forecaster(ground, route.time_limit_s)
    speed, radius = 0.98 * robot.driving_speed_m_s, robot.radius_m
    return Forecaster(ground, route.time_limit_s, robot_speed_m_s=speed, robot_radius_m=radius)


def goals_of(human: Human, at: dict[str, Point]) -> tuple[list[Point], list[float]]:
    """The cyclic points of a person (metres), and how long the person pauses at each (s)."""
    points: list[Point] = []
    stops: list[float] = []
    last = None
    for task in human.tasks:
        waiting = {p.at: p.duration_s for p in task.pauses}
        for name in task.path:
            point = at[name]
            if point != last:
                points.append(point)
                stops.append(0.0)
                last = point
            if waiting:
                stops[-1] += waiting.pop(name, 0.0)
    if len(points) > 1 and points[-1] == points[0]:
        stops[0] += stops.pop()
        points.pop()
    return points, stops


def _way(points: Sequence[Point], bodies: float) -> Way:
    corners = np.array([complex(*point) for point in points])
    legs = np.diff(corners)
    marks = np.concatenate([[0.0], np.cumsum(np.abs(legs))])
    return Way(corners, marks, np.asarray(legs / np.maximum(np.abs(legs), 1e-9), complex), float(bodies))


class _Walks:
    """The walks of the people of B variants, H in each, as arrays for the kernel."""

    def __init__(self, variants: Sequence[Sequence[Human]], at: dict[str, Point], paces: Floats) -> None:
        doing = {id(human.tasks): human for humans in variants for human in humans}  # most variants share their tasks
        routes = [goals_of(human, at) for human in doing.values()]
        longest = max(len(points) for points, _ in routes)
        goals, pauses = np.zeros((len(routes), longest), complex), np.zeros((len(routes), longest))
        for k, (points, stops) in enumerate(routes):
            goals[k, : len(points)] = np.array(points, float).view(complex)[:, 0]
            pauses[k, : len(points)] = stops
        number = {key: k for k, key in enumerate(doing)}
        table = np.array([[number[id(human.tasks)] for human in humans] for humans in variants])
        self.goals, self.stops = goals[table], pauses[table]
        self.count = np.array([len(points) for points, _ in routes])[table]
        self.speed = np.array([[h.speed_m_s for h in humans] for humans in variants]) * paces[:, None]
        self.heeds = np.array([[h.behaviour is not Behaviour.IMPASSIVE for h in humans] for humans in variants])
        self.delays = np.array([[h.start_delay_s for h in humans] for humans in variants], float)


def _forecast(measured: Floats) -> Forecast:
    return Forecast(
        mean_gap_m=float(measured[MEAN_GAP]),
        least_gap_m=float(measured[LEAST_GAP]),
        blocked_s=float(measured[BLOCKED]),
        meetings=float(measured[MEETINGS]),
        swerved_m=float(measured[SWERVED]),
        duration_s=float(measured[DURATION]),
    )
