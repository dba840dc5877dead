"""Forecast of the positions of people and robot: a rough model, good enough to aim with.

Many variants are forecast side by side. The robot drives its expected way at its usual speed, makes room sideways
for people near its line, slows down for one close in front and stops for one closer still; it neither plans nor
senses. People walk from waypoint to waypoint, pulled by the next one and pushed by the robot and each other (desired
and social force of Moussaid et al. 2009, "Experimental study of the behavioural mechanisms underlying
self-organization in human crowds", with the weights HuNavSim gives a regular person); nothing pushes them off walls.
Feedback corrects the paces and the robot's speed to where everybody was measured to be.

Points and vectors are complex numbers, x + iy metres: a turn is a product, a length an absolute value.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import boolean, complex128, float64, inner, int64, kernel, type_of
from rvsg.generation.workplaces import Point, WalkingGraph, walking_graph
from rvsg.scenario.brief import Feedback
from rvsg.scenario.requirement import Aim
from rvsg.scenario.scenario import BODY_RADIUS_M, Behaviour, Human, HumanConfiguration, Mission
from rvsg.world.world import World

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

STEP_S = 0.1
STARTS_AFTER_S, TURNS_FOR_S = 0.5, 1.5
"""The robot starts after, and turns at its goal for."""
STOPS_AT_M, SLOWS_AT_M, FRONT = 0.7, 1.0, math.radians(40.0)
GOAL_TAKEN_M = 0.6
ROOM_M, ROOM_AHEAD_M, SWERVES_M, SWERVE_STEP_M = 0.9, 1.5, 1.0, 0.025
"""Room the robot makes beside people up to so far ahead, at most how far aside, and how fast (per step)."""
MEETS_AT_M, MEETS_IN, MET_UNTIL_M = 1.4, math.radians(70.0), 1.6
GOAL_WEIGHT, SOCIAL_WEIGHT, RELAXATION_S = 2.0, 5.0, 0.5
LAMBDA, GAMMA, N_ANGLE, N_SPEED = 2.0, 0.35, 2.0, 3.0
ARRIVES_AT_M = 0.4
"""A waypoint counts as reached this near to it, and the person stops for a moment there (HuNavSim's behaviour)."""

MEAN_GAP, LEAST_GAP, BLOCKED, MEETINGS, SWERVED, DURATION = range(6)
"""The columns of what is measured."""


class Way(NamedTuple):
    """The robot's way: corners, metres along it at each corner, unit vectors of its legs, and the radius of a disc
    that stands for the robot plus that of a person."""

    points: Complexes
    marks: Floats
    units: Complexes
    bodies: float


class Walks(NamedTuple):
    """What the people of one variant do: arrays over people, `goals` and `stops` over people and waypoints."""

    goals: Complexes
    stops: Floats
    lengths: NDArray[np.int64]
    speed: Floats
    heeds: NDArray[np.bool_]


class People(NamedTuple):
    """The state of the people of one variant, arrays over people."""

    p: Complexes
    v: Complexes
    force: Complexes
    wait: Floats
    stands: NDArray[np.bool_]
    next: NDArray[np.int64]
    before: Floats
    close: NDArray[np.bool_]


@kernel
def push(apart: complex, relative: complex) -> complex:
    """Return the social force (unit mass and weight) of somebody `apart` metres, at a `relative` velocity in m/s."""
    distance = abs(apart)
    if distance < 1e-9:
        return 0j
    towards = apart / distance
    interaction = LAMBDA * relative + towards
    strength = max(abs(interaction), 1e-6)
    along = interaction / strength
    reach = GAMMA * strength
    angle = cmath.phase(along.conjugate() * towards)
    fade, turn = -distance / reach, (reach * angle) ** 2
    slowing = math.exp(fade - N_SPEED**2 * turn)
    turning = np.sign(angle) * math.exp(fade - N_ANGLE**2 * turn)
    return -complex(slowing, turning) * along


@inner
def _leg(s: float, way: Way) -> int:
    """Return the leg of the way at `s` metres."""
    leg = 0
    while leg < len(way.units) - 1 and way.marks[leg + 1] <= s:
        leg += 1
    return leg


@inner
def _swerved(aside: float, here: complex, ahead: complex, people: People) -> float:
    """Return how far aside the robot is after this step, to make room for who is close."""
    most, across = -1.0, 0.0
    for h in range(len(people.p)):
        apart = (people.p[h] - here) * ahead.conjugate()
        beside = apart.imag - aside
        near = -0.3 < apart.real < ROOM_AHEAD_M
        room = ROOM_M - abs(beside) if near else 0.0
        if room > most:
            most, across = room, beside
    wanted = 0.0
    if most > 0.0:
        wanted = max(-SWERVES_M, min(SWERVES_M, aside - most if across >= 0.0 else aside + most))
    return aside + max(-SWERVE_STEP_M, min(SWERVE_STEP_M, wanted - aside))


@inner
def _measure(out: Floats, here: complex, ahead: complex, people: People, first: bool, bodies: float) -> float:
    """Add the gaps and meetings of this step; return the share of its speed the robot keeps."""
    nearest = nearest_ahead = math.inf
    for h in range(len(people.p)):
        apart = (people.p[h] - here) * ahead.conjugate()
        distance, bearing = abs(apart), abs(cmath.phase(apart))
        nearest = min(nearest, distance)
        if bearing < FRONT:
            nearest_ahead = min(nearest_ahead, distance)
        if distance >= MET_UNTIL_M:
            people.close[h] = False
        if bearing < MEETS_IN and distance < MEETS_AT_M and not people.close[h]:
            if not first:
                out[MEETINGS] += max(0.0, people.before[h] - distance) / STEP_S
            people.close[h] = True
        people.before[h] = distance
    gap = max(0.0, nearest - bodies)
    free = 0.0 if nearest_ahead < STOPS_AT_M else (0.5 if nearest_ahead < SLOWS_AT_M else 1.0)
    out[MEAN_GAP] += gap
    out[LEAST_GAP] = min(out[LEAST_GAP], gap)
    out[DURATION] += STEP_S
    if free < 1.0:
        out[BLOCKED] += STEP_S
    return free


@inner
def _walk(walks: Walks, people: People, robot: complex, robot_v: complex) -> None:
    """Move the people by one step among each other and the robot."""
    count = len(people.p)
    for h in range(count):
        way = walks.goals[h, people.next[h]] - people.p[h]
        people.stands[h] = people.wait[h] > 0.0 or abs(way) <= ARRIVES_AT_M
        if people.stands[h]:
            continue  # nothing moves them in this step
        pull = way * (walks.speed[h] / max(abs(way), 1e-6))
        force = (pull - people.v[h]) * (GOAL_WEIGHT / RELAXATION_S)
        social = 0j
        for other in range(count):
            social += push(people.p[other] - people.p[h], people.v[h] - people.v[other])
        force += SOCIAL_WEIGHT * social
        if walks.heeds[h]:
            force += SOCIAL_WEIGHT * push(robot - people.p[h], people.v[h] - robot_v)
        people.force[h] = force
    for h in range(count):
        waiting = people.wait[h] > 0.0
        people.wait[h] = max(0.0, people.wait[h] - STEP_S)
        arrived = people.stands[h] and not waiting
        if people.stands[h]:
            people.v[h] = 0j
        else:
            v = people.v[h] + people.force[h] * STEP_S
            people.v[h] = v / max(abs(v) / walks.speed[h], 1.0)
            people.p[h] += people.v[h] * STEP_S
        if arrived:
            people.wait[h] = walks.stops[h, people.next[h]]
            people.next[h] = (people.next[h] + 1) % walks.lengths[h]


@inner
def _goal_is_taken(s: float, way: Way, people: People) -> bool:
    """Return whether the robot has come to its goal and somebody stands on it."""
    taken = False
    for h in range(len(people.p)):
        taken = taken or abs(people.p[h] - way.points[-1]) < GOAL_TAKEN_M
    return taken and s > way.marks[-1] - GOAL_TAKEN_M


@inner(arrays=True)
def _episode(way: Way, walks: Walks, people: People, speed: float, steps: int, out: Floats, track: Complexes) -> int:
    """Run one variant; return after how many steps the robot was done. `track` is filled where it has rows."""
    s = turned = aside = now = 0.0
    length, done = way.marks[-1], 0
    for k in range(steps):
        going = turned < TURNS_FOR_S
        if going:
            done = k + 1
        elif len(track) == 0:
            break
        arrived = s >= length
        driving = going and not arrived and now >= STARTS_AFTER_S
        at = min(s, length)
        leg = _leg(at, way)
        ahead = way.units[leg]
        here = way.points[leg] + (at - way.marks[leg]) * ahead
        if driving:
            moved = _swerved(aside, here, ahead, people)
            out[SWERVED] += abs(moved - aside)
            aside = moved
        here += 1j * ahead * aside
        advance = 0.0
        if going:
            free = _measure(out, here, ahead, people, k == 0, way.bodies)
            if driving and not _goal_is_taken(s, way, people):
                advance = speed * free
        if arrived:
            turned += STEP_S
        s += advance * STEP_S
        if len(track):
            track[k, 0] = here
            track[k, 1:] = people.p
        _walk(walks, people, here, ahead * advance)
        now += STEP_S
    out[MEAN_GAP] /= max(1.0, out[DURATION] / STEP_S)
    return done


@kernel
def run_all(
    way: Way,
    goals: Complexes,
    stops: Floats,
    count: NDArray[np.int64],
    speed: Floats,
    heeds: NDArray[np.bool_],
    delays: Floats,
    robot_speeds: Floats,
    steps: int,
    tracks: Complexes,
) -> tuple[Floats, NDArray[np.int64]]:
    """Run B variants with H people each, for at most so many steps.

    `goals` (B, H, longest) are waypoints, `stops` seconds of pause at them, `count` how many each has; `tracks`
    (B, steps, 1 + H) is filled with robot and people over time, or empty. Returns what is measured, (B, 6), and after
    how many steps each robot was done, (B,).
    """
    variants, humans, _ = goals.shape
    out, done = np.zeros((variants, 6)), np.zeros(variants, np.int64)
    out[:, LEAST_GAP] = math.inf
    for b in range(variants):
        people = People(
            goals[b, :, 0].copy(),
            np.zeros(humans, np.complex128),
            np.zeros(humans, np.complex128),
            delays[b].copy(),
            np.zeros(humans, np.bool_),
            np.minimum(1, count[b] - 1),
            np.zeros(humans),
            np.zeros(humans, np.bool_),
        )
        walks = Walks(goals[b], stops[b], count[b], speed[b], heeds[b])
        done[b] = _episode(way, walks, people, robot_speeds[b], steps, out[b], tracks[b])
    return out, done


ROBOT_SPEED_M_S = 0.49
"""An undisturbed run of the study's robot: 0.5 m/s along the way, less the start, and a turn at the goal."""
PERSON_M = BODY_RADIUS_M
PACE = 0.9
"""Radius of a person, and the share of a scenario's speed at which people walk on average."""


AIMED = 8
"""At most this many people are forecast; in a larger crowd the others simply work."""


class Forecast(NamedTuple):
    """What is expected of a run, in the order of the columns that are measured; gaps in metres between surfaces."""

    mean_gap_m: float
    least_gap_m: float
    blocked_s: float
    meetings: float
    """How often somebody comes up close in front of the robot, each weighed by the speed at which the gap closed."""
    swerved_m: float
    """How far the robot moves sideways in all to make room."""
    duration_s: float


class Forecaster:
    """Forecasts for one route; `fitted` fits `robot_speed_m_s` and `pace`, a factor on everybody's speed."""

    def __init__(
        self,
        ground: WalkingGraph,
        time_limit_s: float,
        *,
        robot_speed_m_s: float = ROBOT_SPEED_M_S,
        pace: float = PACE,
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
        measured, _ = self._run(variants, [self.robot_speed], [self.pace])
        return [Forecast(*row) for row in measured.tolist()]

    def tracks(self, variants: Sequence[Sequence[Human]]) -> list[Complexes]:
        """Return where robot and people of each configuration are every `STEP_S`, (N, 1 + H), as x + iy metres."""
        if not variants:
            return []
        measured, tracks = self._run(variants, [self.robot_speed], [self.pace], keep=True)
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
        choices = [(speed, pace) for speed in speeds for pace in (0.7, 0.8, 0.85, 0.9, 0.95, 1.0, 1.1)]
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
        """Return what is measured of each variant, and with `keep` places over time, (steps, B, 1 + H)."""
        number: dict[int, int] = {}  # most variants share their tasks
        routes: list[tuple[list[Point], list[float]]] = []
        for human in (human for humans in variants for human in humans):
            if id(human.tasks) not in number:
                number[id(human.tasks)] = len(routes)
                routes.append(goals_of(human, self.ground.at))
        count = np.array([len(points) for points, _ in routes])
        goals, pauses = np.zeros((len(routes), count.max()), complex), np.zeros((len(routes), count.max()))
        for k, (points, stops) in enumerate(routes):
            goals[k, : len(points)] = np.array(points, float).view(complex)[:, 0]
            pauses[k, : len(points)] = stops
        table = np.array([[number[id(human.tasks)] for human in humans] for humans in variants])
        steps = int(min(self.limit / STEP_S, most))
        tracks = np.zeros((len(variants), steps if keep else 0, 1 + table.shape[1]), complex)
        measured, done = run_all(
            self._way,
            goals[table],
            pauses[table],
            count[table],
            np.array([[h.speed_m_s for h in humans] for humans in variants]) * np.array(paces, float)[:, None],
            np.array([[h.behaviour is not Behaviour.IMPASSIVE for h in humans] for humans in variants]),
            np.array([[h.start_delay_s for h in humans] for humans in variants], float),
            np.full(len(variants), speeds, float),
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


def kinds_of_run_all() -> tuple[Any, ...]:
    """Return numba's types of the arguments of `run_all`, to compile it beforehand."""
    way = type_of(_way([(0.0, 0.0), (1.0, 0.0)], 0.6))
    paths, places, people = complex128[:, :, ::1], float64[:, :, ::1], float64[:, ::1]
    return (way, paths, places, int64[:, ::1], people, boolean[:, ::1], people, float64[::1], int64, paths)


# How many of a refinement's variants count as equally promising. The forecast ranks nearness as the simulator does
# (rank correlation 0.95), braking and delay hardly (0.3 to 0.4): there what is measured has to choose.
FINALISTS = {Aim.SHARE: 5, Aim.MEET: 10, Aim.DISTURB: 20, Aim.DELAY: 20, Aim.NONE: 1}


def promise(aim: Aim, forecast: Forecast) -> float:
    """Return how much of the aim a forecast promises: larger is worse for the robot. Comparable only within one aim.

    The weights for braking follow a regression on 180 simulated scenarios, those for delay one on 1200: there the
    forecast says little (rank correlation 0 to 0.4, by the route), so what is measured decides.
    """
    near = -forecast.mean_gap_m
    if aim is Aim.MEET:
        return 0.5 * near - 2.0 * forecast.least_gap_m + 0.5 * min(forecast.meetings, 6.0) + forecast.swerved_m
    if aim is Aim.DISTURB:
        return forecast.meetings + 0.7 * forecast.blocked_s + 0.3 * forecast.swerved_m
    if aim is Aim.DELAY:
        return 0.25 * forecast.swerved_m + 0.12 * forecast.meetings + 0.15 * near
    return near


FEATURES = 8
"""Promise, mean and least gap, seconds blocked, meetings, swerve, duration, and people who do not step aside."""


class Screen:
    """Forecasts of configurations of one mission by the aim that people should bring about."""

    def __init__(self, mission: Mission, world: World, aim: Aim) -> None:
        self.aim = aim
        self.forecaster: Forecaster = forecaster_of(mission, world)

    def __call__(self, configurations: Sequence[HumanConfiguration]) -> Floats:
        """Return the features of each configuration, (n, FEATURES)."""
        features = np.zeros((len(configurations), FEATURES))
        sizes: dict[int, list[int]] = {}
        for k, people in enumerate(configurations):
            sizes.setdefault(min(AIMED, len(people.humans)), []).append(k)
        for size, members in sizes.items():
            if not size:
                continue
            forecasts = self.forecaster.compare([configurations[k].humans[:size] for k in members])
            for k, forecast in zip(members, forecasts, strict=True):
                heedless = sum(human.behaviour != "regular" for human in configurations[k].humans)
                features[k] = (promise(self.aim, forecast), *forecast, heedless)
        return features
