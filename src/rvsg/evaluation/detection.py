"""Detection of the events of a run from the simulator's records, the trajectory and the outcome.

What the simulator records is taken from it. The rest is detected in the trajectory: near misses, hard braking, standing
still, a blocked goal, how the run ended, and, where the simulator records nothing of them, contacts and people who are
stuck, arrive or pause.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from rvsg.evaluation.events import (
    Abort,
    Arrival,
    BlockedGoal,
    Contact,
    Event,
    Events,
    HardBrake,
    NearMiss,
    ObstacleContact,
    Place,
    PlaceAt,
    Recovery,
    Replan,
    StandStill,
    TimeOut,
)
from rvsg.evaluation.naming import WaypointNames
from rvsg.evaluation.people import people_events
from rvsg.evaluation.sampled import Flags, Sampled, Touch, joined, sampled, stretches, wrap
from rvsg.scenario.scenario import Scenario
from rvsg.simulation import run as recorded
from rvsg.simulation.run import Outcome, RobotContact, Run
from rvsg.world.world import Door, World

Floats = NDArray[np.float64]

Reason = Literal["person_ahead", "person_close", "obstacle", "recovery", "contact", "unknown"]

NEAR_MISS_M = 0.25
"""A gap below this without contact is a near miss: half of the clearance that ISO 3691-4 asks for beside a truck."""
APART_S = 2.0
"""Near misses with one person that are closer together than this are one."""
BRAKE_WINDOW_S = 0.5
HARD_BRAKE_M_S2 = 0.6
"""Mean deceleration over the window from which braking is hard; 0.3 m/s lost within half a second."""
ARRIVING_S = 1.5
"""Braking in the last seconds before the arrival belongs to the arrival."""
STANDSTILL_S = 1.0
BESIDE_M = 1.0
"""A person with a smaller gap may be the reason for standing still."""
AHEAD_RAD = np.pi / 3
OBSTACLE_M = 0.15
ON_LEAF_M = 0.02
"""A contact within this of the leaf of a door is one with the door."""
LEAF_STEPS, AT_FRAME = 100, 0.1
"""Positions of a leaf that are looked at, and the share up to which its end is at the frame of the door."""
NEAR_M = 2.0
GOAL_NEAR_M = 3.0
GOAL_TOLERANCE_M = 0.25
BLOCKED_S = 1.0


def events_of(run: Run, *, world: World | None = None, scenario: Scenario | None = None) -> Events:
    """Return the events of a run, in order of time.

    Args:
        world: Names the places, and is needed for events that concern obstacles.
        scenario: What people are asked to do; with `world` it is needed for people who arrive, pause or are stuck.
    """
    s = sampled(run, world)
    if not len(s):
        return ()
    at = place_namer(world)
    found: list[Event] = []
    if s.people:
        found += [*contacts(s, at), *near_misses(s, at), *blocked_goals(s, at)]
    found += [*obstacle_contacts(s, at), *navigation(s, at), *hard_brakes(s, at), *standstills(s, at), ending(s, at)]
    if s.people:
        found += people_events(s, scenario, world, at)
    return tuple(sorted(found, key=lambda event: event.time_s))


@lru_cache(maxsize=8)
def place_namer(world: World | None) -> PlaceAt:
    """Return a function from x and y in metres to a place with the name of its waypoint."""
    names = WaypointNames(world.grid) if world is not None else None

    def at(x: float, y: float) -> Place:
        name = names.nearest(np.array([x]), np.array([y]))[0] if names is not None else ""
        return Place(x=round(float(x), 3), y=round(float(y), 3), waypoint=name)

    return at


def obstacle_contacts(s: Sampled, at: PlaceAt) -> Iterator[ObstacleContact]:
    """Yield the recorded contacts of the robot's body with walls, objects and doors."""
    for event in s.run.events:
        if isinstance(event, recorded.ObstacleContact):
            yield ObstacleContact(
                time_s=event.time_s,
                place=at(event.x, event.y),
                until_s=event.until_s,
                speed_m_s=event.speed_m_s,
                door=_door_at(s, event),
            )


def _door_at(s: Sampled, touch: recorded.ObstacleContact) -> str:
    """Return the name of the door whose leaf is where the robot touches something; empty where there is none."""
    place, near = shapely.Point(touch.x, touch.y), []
    for door in s.world.staged_doors if s.world is not None else ():
        away = min((shapely.Polygon(leaf).distance(place) for leaf in _leaves(door, s.run, touch.time_s)), default=1.0)
        if away < ON_LEAF_M:
            near.append((away, door.name))
    return min(near)[1] if near else ""


def _leaves(door: Door, run: Run, t: float) -> list[tuple[tuple[float, float], ...]]:
    """Return where the leaf of a door may be at a time, as corners; nowhere for one that has slid into the wall.

    The movements of an automatic door are recorded, but not who is in the way of its leaf and holds it up. A swing leaf
    may therefore be anywhere on its way since it began to move, but for the first part, where its end is at the frame.
    """
    if door.state != "automatic":
        return [door.still] if door.still is not None else []
    begin = share = 0.0
    for move in run.events:
        if isinstance(move, recorded.DoorMoved) and move.door == door.name and move.time_s <= t:
            way = (min(t, move.until_s) - move.time_s) / door.opening_s
            begin, share = move.share, min(1.0, max(0.0, move.share + (way if move.opens else -way)))
    if door.kind == "sliding":
        return [door.leaf(share)] if share < 1.0 else []
    held = [float(each) for each in np.linspace(begin, share, LEAF_STEPS) if each > AT_FRAME]
    return [door.leaf(each) for each in (share, *held)]


def navigation(s: Sampled, at: PlaceAt) -> Iterator[Replan | Recovery]:
    """Yield the recorded recoveries, and the paths that differ clearly from those before."""
    for event in s.run.events:
        if isinstance(event, recorded.Replan):
            yield Replan(
                time_s=event.time_s,
                place=at(event.x, event.y),
                length_m=event.length_m,
                deviation_m=event.deviation_m,
            )
        elif isinstance(event, recorded.Recovery):
            yield Recovery(
                time_s=event.time_s,
                place=at(event.x, event.y),
                until_s=min(event.until_s, float(s.series.t[-1])),
                action=event.action,
            )


def contacts(s: Sampled, at: PlaceAt) -> Iterator[Contact]:
    """Yield one event for each contact of the robot with a person, as the metric `contacts` counts them."""
    for touch in s.contacts:
        if touch.recorded is not None:
            yield _recorded_contact(s, touch, touch.recorded, at)
            continue
        first, last, person = touch.first, touch.last, touch.person
        before = max(0, first - 1)
        towards = max(0.0, *(float(s.closing_speed[k, person]) for k in (before, first)))
        yield Contact(
            **_start(s, first, at),
            until_s=_time(s, last),
            person=s.run.human_names[person],
            closing_speed_m_s=round(towards, 3),
            robot_speed_m_s=_fastest(s, touch),
            bearing_rad=_bearing(s, first, person),
            overlap_m=round(float(-s.gap[first : last + 1, person].min()), 3),
            moved_by=_mover(s, before, person),
        )


def _recorded_contact(s: Sampled, touch: Touch, recorded: RobotContact, at: PlaceAt) -> Contact:
    return Contact(
        time_s=recorded.time_s,
        place=at(recorded.x, recorded.y),
        until_s=min(recorded.until_s, float(s.series.t[-1])),
        person=recorded.person,
        closing_speed_m_s=recorded.closing_speed_m_s,
        robot_speed_m_s=_fastest(s, touch),
        bearing_rad=recorded.bearing_rad,
        overlap_m=recorded.overlap_m,
        moved_by=recorded.moved_by,
    )


def _fastest(s: Sampled, touch: Touch) -> float:
    """Return the robot's largest speed during a contact, from the sample before it on."""
    return round(float(s.series.speed[max(0, touch.first - 1) : touch.last + 1].max()), 3)


def _mover(s: Sampled, index: int, person: int) -> Literal["robot", "person", "both", "neither"]:
    """Return who moves towards whom at a sample: the shares of the closing speed decide."""
    dx, dy = (axis[index, person] for axis in s.offset)
    distance = max(float(np.hypot(dx, dy)), 1e-9)
    robot = sum(v[index] * d for v, d in zip(s.robot_velocity, (dx, dy), strict=True)) / distance
    other = -sum(v[index, person] * d for v, d in zip(s.human_velocity, (dx, dy), strict=True)) / distance
    closing = robot + other
    if closing <= 0.02:
        return "neither"
    if robot >= closing / 3 and other >= closing / 3:
        return "both"
    return "robot" if robot > other else "person"


def near_misses(s: Sampled, at: PlaceAt) -> Iterator[NearMiss]:
    """Yield one event for each passage with a gap below `NEAR_MISS_M` and without contact."""
    for person in range(s.people):
        gap = s.gap[:, person]
        for first, last in joined(stretches(gap < NEAR_MISS_M), s.series.t, APART_S):
            closest = first + int(gap[first : last + 1].argmin())
            moving = float(s.relative_speed[first : last + 1, person].max()) > 0.05
            if moving and not s.touching[first : last + 1, person].any():
                yield NearMiss(
                    **_start(s, closest, at),
                    person=s.run.human_names[person],
                    gap_m=round(float(gap[closest]), 3),
                    relative_speed_m_s=round(float(s.relative_speed[closest, person]), 3),
                    bearing_rad=_bearing(s, closest, person),
                )


def hard_brakes(s: Sampled, at: PlaceAt) -> Iterator[HardBrake]:
    """Yield one event for each stretch of braking harder than `HARD_BRAKE_M_S2` over half a second, en route.

    Speed that a contact takes from the robot is not braking: it counts only up to the moment at which they touch.
    """
    t, speed = s.series.t, s.series.speed
    later = np.searchsorted(t, t + BRAKE_WINDOW_S - 1e-9)
    usable = later < len(t)
    if s.run.completed:
        usable &= t <= t[-1] - ARRIVING_S
    window = np.minimum(later, len(t) - 1)
    touched = np.concatenate([[0], np.cumsum(_in_contact(s))])
    usable &= touched[window + 1] == touched[np.arange(len(t))]
    span = np.where(usable, t[window] - t, 1.0)
    drop = np.where(usable, (speed - speed[window]) / np.where(span > 0, span, 1.0), 0.0)
    for first, last in stretches(drop >= HARD_BRAKE_M_S2 - 1e-9):
        hardest = first + int(drop[first : last + 1].argmax())
        end = int(window[last])
        yield HardBrake(
            **_start(s, hardest, at),
            until_s=_time(s, end),
            deceleration_m_s2=round(float(drop[hardest]), 2),
            from_speed_m_s=round(float(speed[hardest]), 3),
            to_speed_m_s=round(float(speed[window[hardest]]), 3),
            person=_nearest(s, hardest, NEAR_M),
        )


def _in_contact(s: Sampled) -> Flags:
    """(N,) whether the robot touches a person, a wall or an object, or has just begun to when a sample is taken."""
    flags: Flags = np.zeros(len(s), np.bool_)
    if s.people:
        flags |= s.touching.any(axis=1)
    t = s.series.t
    for event in s.run.events:
        if isinstance(event, recorded.ObstacleContact | RobotContact):
            first, last = np.searchsorted(t, [event.time_s - 1e-9, event.until_s + 1e-9])
            flags[min(int(first), len(t) - 1) : int(last) + 1] = True
    return flags


def standstills(s: Sampled, at: PlaceAt) -> Iterator[StandStill]:
    """Yield one event for each standstill of at least a second between the first movement and the end."""
    if s.still.all():
        return
    begin = int((~s.still).argmax())
    on_the_way: Flags = s.still & (np.arange(len(s)) >= begin)
    for first, last in stretches(on_the_way):
        at_the_goal = s.run.completed and last == len(s) - 1
        if _time(s, last) - _time(s, first) < STANDSTILL_S - 1e-9 or at_the_goal:
            continue
        reason, person = _reason(s, first)
        yield StandStill(**_start(s, first, at), until_s=_time(s, last), reason=reason, person=person)


def _reason(s: Sampled, index: int) -> tuple[Reason, str]:
    """Return what stands next to the robot at a sample, and the name of the person if it is one."""
    if s.people:
        ahead = (s.bearing_of_human[index] < AHEAD_RAD) & (s.gap[index] < BESIDE_M)
        nearest = int(s.gap[index].argmin())
        if s.touching[index].any():
            return "contact", s.run.human_names[int(s.touching[index].argmax())]
        if ahead.any():
            return "person_ahead", s.run.human_names[int(np.where(ahead, s.gap[index], np.inf).argmin())]
        if s.gap[index, nearest] < BESIDE_M:
            return "person_close", s.run.human_names[nearest]
    t = float(s.series.t[index])
    if any(isinstance(e, recorded.Recovery) and e.time_s <= t + 1e-9 < e.until_s for e in s.run.events):
        return "recovery", ""
    if s.obstacle_distance is not None and s.obstacle_distance[index] < s.run.robot_radius_m + OBSTACLE_M:
        return "obstacle", ""
    return "unknown", ""


def blocked_goals(s: Sampled, at: PlaceAt) -> Iterator[BlockedGoal]:
    """Yield one event for each time a person occupies the goal while the robot is within 3 m of it."""
    goal_x, goal_y, _ = s.run.goal
    for person in range(s.people):
        reach = s.run.robot_radius_m + s.run.human_radius_m[person] - GOAL_TOLERANCE_M
        away = np.hypot(s.series.human_x[:, person] - goal_x, s.series.human_y[:, person] - goal_y)
        for first, last in stretches((away < reach) & (s.goal_distance < GOAL_NEAR_M)):
            if _time(s, last) - _time(s, first) >= BLOCKED_S - 1e-9:
                yield BlockedGoal(
                    time_s=_time(s, first),
                    place=at(goal_x, goal_y),
                    until_s=_time(s, last),
                    person=s.run.human_names[person],
                )


def ending(s: Sampled, at: PlaceAt) -> Event:
    """Return the event that ends the run."""
    end = _start(s, len(s) - 1, at)
    remaining = round(float(s.goal_distance[-1]), 3)
    match s.run.outcome:
        case Outcome.REACHED:
            return Arrival(**end)
        case Outcome.TIMED_OUT:
            return TimeOut(**end, remaining_m=remaining)
        case outcome:
            return Abort(**end, outcome=outcome, remaining_m=remaining)


def _start(s: Sampled, index: int, at: PlaceAt) -> dict[str, Any]:
    return {"time_s": _time(s, index), "place": at(s.series.x[index], s.series.y[index])}


def _time(s: Sampled, index: int) -> float:
    return round(float(s.series.t[index]), 3)


def _bearing(s: Sampled, index: int, person: int) -> float:
    dx, dy = (axis[index, person] for axis in s.offset)
    return round(float(wrap(np.arctan2(dy, dx) - s.series.yaw[index])), 3)


def _nearest(s: Sampled, index: int, within_m: float) -> str:
    """Return the name of the nearest person within a gap, else an empty text."""
    if not s.people:
        return ""
    person = int(s.gap[index].argmin())
    return s.run.human_names[person] if s.gap[index, person] < within_m else ""
