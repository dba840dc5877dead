"""The compiled loop of a forecast: one variant after another, each step by step.

Points and vectors are complex numbers, x + iy metres: a turn is a product, a length an absolute value.
"""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.compiled import inner, kernel

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
    """Return the social force (unit mass and weight) of somebody on a person.

    Args:
        apart: From the person to the other, metres.
        relative: The velocity of the person less that of the other, m/s.
    """
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

    Args:
        goals: Waypoints of everybody, (B, H, longest).
        stops: Seconds of pause at each of them, of the same shape.
        count: How many waypoints each has, (B, H).
        speed: Walking speeds, (B, H).
        heeds: Whether each makes room for the robot, (B, H).
        delays: Seconds before each starts, (B, H).
        robot_speeds: The robot's usual speed in every variant, (B,).
        tracks: Filled with robot and people over time, (B, steps, 1 + H); (B, 0, 1 + H) where nobody wants them.

    Returns:
        What is measured, (B, 6), and after how many steps each robot was done, (B,).
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
