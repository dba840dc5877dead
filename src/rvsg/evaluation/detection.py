"""Detection of events in the record of a run: contacts, near misses, stops, encounters, people who are stuck.

What the simulator records is taken from it. The rest is detected in the trajectory.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from enum import Enum
from typing import Any, Literal

import numpy as np
import shapely

from rvsg.evaluation.responsibility import responsible
from rvsg.evaluation.sampled import Flags, Floats, Sampled, joined, sampled, stretches, wrap
from rvsg.scenario.scenario import Behaviour, Human, HumanAgent, HumanConfiguration, Scenario, decode, task_ends
from rvsg.simulation.events import (
    Abort,
    BlockedGoal,
    Contact,
    DoorMoved,
    E,
    GoalReached,
    HardBrake,
    NearMiss,
    ObstacleContact,
    OfPerson,
    Outcome,
    PersonPaused,
    PersonReached,
    PersonStuck,
    Reason,
    Recovery,
    Replan,
    RunEvent,
    Spell,
    StandStill,
    TimedEvent,
    TimeOut,
    in_order,
)
from rvsg.simulation.run import Run
from rvsg.world.world import Door, World

REACHED_M = 0.45
"""A person this near a waypoint has reached it; simulated people turn to the next one at 0.3 to 0.4 m."""
LEFT_M = 0.6
LEAVING_S = 2.0
"""How long a person may take to leave after a pause."""
CHECKED_S = 0.25
"""Positions are compared at this period."""
STUCK_S = 5.0
STUCK_M = 0.3
"""A person who moves less than this in `STUCK_S` is stuck, unless the task, a reaction or the start explains it."""
BESIDE_PERSON_M = 0.6
REACTING_M = 1.0
"""A person whose behaviour stops it near the robot is not stuck within its distance of reaction plus this."""
STOPPING = (Behaviour.SURPRISED, Behaviour.CURIOUS, Behaviour.THREATENING)


def people_events(s: Sampled, scenario: Scenario | None) -> Iterator[OfPerson]:
    """Yield the events of people: as the simulator recorded them, else as the trajectory shows them.

    The names of tasks need the scenario and the world, and so does all that is read off the trajectory.
    """
    people = scenario.people if scenario is not None and s.world is not None else HumanConfiguration(humans=())
    if any(isinstance(event, OfPerson) for event in s.run.events):
        yield from _recorded(s, {human.name: task_ends(human) for human in people.humans})
    elif s.world is not None:
        for human, agent in zip(people.humans, decode(people, s.world.grid), strict=True):
            if human.name in s.run.human_names and len(agent.goals) > 1:
                yield from _of_one(s, s.run.human_names.index(human.name), human, agent)


def _recorded(s: Sampled, ends: dict[str, dict[int, str]]) -> Iterator[OfPerson]:
    """Yield the recorded events up to the end of the series; of waypoints reached only the ends of tasks."""
    t = s.series.t
    for event in s.run.events:
        if not isinstance(event, OfPerson) or event.time_s > t[-1] + 1e-9:
            continue
        if isinstance(event, PersonReached):
            task = ends.get(event.person, {}).get(event.goal)
            if task is not None:
                yield _named(event, s, task=task)
        elif isinstance(event, PersonStuck):
            index = min(int(np.searchsorted(t, event.time_s - 1e-9)), len(t) - 1)
            yield _named(event, s, reason=_beside(s, index, s.run.human_names.index(event.person)))
        else:
            yield _named(event, s)


def _named(event: E, s: Sampled, **changes: Any) -> E:
    """Return a recorded event with the name of its place; it ends with the series."""
    if isinstance(event, Spell):
        changes.setdefault("until_s", min(event.until_s, float(s.series.t[-1])))
    return event.model_copy(update={"waypoint": _at(s, event.x, event.y)["waypoint"], **changes})


def _of_one(s: Sampled, person: int, human: Human, agent: HumanAgent) -> Iterator[OfPerson]:
    x, y, t = s.series.human_x[:, person], s.series.human_y[:, person], s.series.t
    ends = task_ends(human)
    excused: Flags = t < agent.start_delay_s + 1.0
    for index, goal in _arrivals(x, y, agent):
        begin = round(float(t[index]), 3)
        arrival = {"time_s": begin, "person": human.name, "goal": goal, **_at(s, *agent.goals[goal])}
        if agent.pauses_s[goal] > 0.0:
            away = np.hypot(x[index:] - agent.goals[goal][0], y[index:] - agent.goals[goal][1]) > LEFT_M
            left = float(t[index + int(away.argmax()) if away.any() else -1])
            excused |= (t >= begin) & (t <= begin + agent.pauses_s[goal] + LEAVING_S)
            yield PersonPaused(**arrival, until_s=round(min(left, begin + agent.pauses_s[goal]), 3))
        if goal in ends:
            yield PersonReached(**arrival, task=ends.pop(goal))
    if agent.behaviour in STOPPING:
        excused |= s.distance[:, person] < agent.reaction.distance_m + REACTING_M
    yield from _stuck(s, person, excused)


def _arrivals(x: Floats, y: Floats, agent: HumanAgent) -> Iterator[tuple[int, int]]:
    """Yield the sample and the goal of each arrival, following the cycle of goals from the second on."""
    goal, start = 1, 0
    while start < len(x):
        near = np.hypot(x[start:] - agent.goals[goal][0], y[start:] - agent.goals[goal][1]) < REACHED_M
        if not near.any():
            return
        index = start + int(near.argmax())
        yield index, goal
        start, goal = index + 1, (goal + 1) % len(agent.goals)


def _stuck(s: Sampled, person: int, excused: Flags) -> Iterator[PersonStuck]:
    checked = np.append(np.arange(s.series.t[0], s.series.t[-1], CHECKED_S), s.series.t[-1])
    rows = np.unique(np.searchsorted(s.series.t, checked))
    x, y, t = s.series.human_x[rows, person], s.series.human_y[rows, person], s.series.t[rows]
    window = np.searchsorted(t, t + STUCK_S - 1e-9) - np.arange(len(t))
    last_row = np.arange(len(t)) + window
    stays: Flags = last_row < len(t)
    for ahead in range(1, int(window.max(initial=0)) + 1):
        later = np.minimum(np.minimum(np.arange(len(t)) + ahead, last_row), len(t) - 1)
        stays &= (np.hypot(x[later] - x, y[later] - y) < STUCK_M) & ~excused[rows[later]]
    stays &= ~excused[rows]
    for first, last in stretches(stays):
        yield PersonStuck(
            time_s=round(float(t[first]), 3),
            **_at(s, x[first], y[first]),
            until_s=round(float(t[last_row[last]]), 3),
            person=s.run.human_names[person],
            reason=_beside(s, int(rows[first]), person),
        )


def _beside(s: Sampled, index: int, person: int) -> Literal["robot", "person", "unknown"]:
    if s.gap[index, person] < BESIDE_PERSON_M:
        return "robot"
    x, y = s.series.human_x[index], s.series.human_y[index]
    away = np.hypot(x - x[person], y - y[person]) - np.asarray(s.run.human_radius_m) - s.run.human_radius_m[person]
    away[person] = np.inf
    return "person" if len(away) > 1 and away.min() < BESIDE_PERSON_M else "unknown"


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


def events_of(run: Run, *, world: World | None = None, scenario: Scenario | None = None) -> tuple[RunEvent, ...]:
    """Return the events of a run, in order of time.

    Args:
        world: Names the places, and is needed for events that concern obstacles.
        scenario: What people are asked to do; with `world` it is needed for people who arrive, pause or are stuck.
    """
    s = sampled(run, world)
    if not len(s):
        return ()
    events: list[RunEvent] = []
    if s.people:
        events += [*contacts(s), *near_misses(s), *blocked_goals(s)]
    events += [*obstacle_contacts(s), *navigation(s), *hard_brakes(s), *standstills(s), ending(s)]
    if s.people:
        events += people_events(s, scenario)
    return in_order(events)


def _at(s: Sampled, x: float, y: float) -> dict[str, Any]:
    """Return the place of an event, with the nearest waypoint where the world is known."""
    (waypoint,) = s.world.nearest_waypoints(np.array([x]), np.array([y])) if s.world is not None else ("",)
    return {"x": round(float(x), 3), "y": round(float(y), 3), "waypoint": waypoint}


def obstacle_contacts(s: Sampled) -> Iterator[ObstacleContact]:
    """Yield the recorded contacts of the robot's body with walls, objects and doors."""
    for touch in s.run.events:
        if not isinstance(touch, ObstacleContact):
            continue
        place, near = shapely.Point(touch.x, touch.y), []
        for door in s.world.staged_doors if s.world is not None else ():
            leaves = [shapely.Polygon(leaf).distance(place) for leaf in _leaves(door, s.run, touch.time_s)]
            if leaves and min(leaves) < ON_LEAF_M:
                near.append((min(leaves), door.name))
        yield _named(touch, s, until_s=touch.until_s, door=min(near)[1] if near else "")


def navigation(s: Sampled) -> Iterator[Replan | Recovery]:
    """Yield the recorded recoveries, and the paths that differ clearly from those before."""
    for event in s.run.events:
        if isinstance(event, Replan | Recovery):
            yield _named(event, s)


def _leaves(door: Door, run: Run, t: float) -> list[tuple[tuple[float, float], ...]]:
    """Return where the leaf of a door may be at a time, as corners; nowhere for one that has slid into the wall.

    The movements of an automatic door are recorded, but not who is in the way of its leaf and holds it up. A swing leaf
    may therefore be anywhere on its way since it began to move, but for the first part, where its end is at the frame.
    """
    if door.state != "automatic":
        return [door.still] if door.still is not None else []
    begin = share = 0.0
    for move in run.events:
        if isinstance(move, DoorMoved) and move.door == door.name and move.time_s <= t:
            way = (min(t, move.until_s) - move.time_s) / door.opening_s
            begin, share = move.share, min(1.0, max(0.0, move.share + (way if move.opens else -way)))
    if door.kind == "sliding":
        return [door.leaf(share)] if share < 1.0 else []
    shares = np.linspace(begin, share, LEAF_STEPS)
    return [door.leaf(share), *(door.leaf(float(held)) for held in shares[shares > AT_FRAME])]


def contacts(s: Sampled) -> Iterator[Contact]:
    """Yield one event for each contact of the robot with a person, as the metric `contacts` counts them."""
    for touch in s.contacts:
        first, last, person = touch.first, touch.last, touch.person
        rows = slice(max(0, first - 1), last + 1)
        whole = {
            "responsible": responsible(s, max(0, first - 1), person),
            "robot_speed_m_s": round(float(s.series.speed[rows].max()), 3),
            "person_speed_m_s": round(float(s.series.human_speed[rows, person].max()), 3),
        }
        if touch.recorded is not None:
            yield _named(touch.recorded, s, **whole)
            continue
        at = max((max(0, first - 1), first), key=lambda row: s.closing_speed[row, person])
        distance = max(float(s.distance[at, person]), 1e-9)
        towards = [axis[at, person] / distance for axis in s.offset]
        robot = float(sum(v[at] * d for v, d in zip(s.robot_velocity, towards, strict=True)))
        other = float(-sum(v[at, person] * d for v, d in zip(s.human_velocity, towards, strict=True)))
        yield Contact(
            **_span(s, first, last),
            person=s.run.human_names[person],
            closing_speed_m_s=round(max(0.0, float(s.closing_speed[at, person])), 3),
            robot_part_m_s=round(robot, 3),
            person_part_m_s=round(other, 3),
            **whole,
            bearing_rad=_bearing(s, first, person),
            overlap_m=round(float(-s.gap[first : last + 1, person].min()), 3),
        )


def near_misses(s: Sampled) -> Iterator[NearMiss]:
    """Yield one event for each passage with a gap below `NEAR_MISS_M` and without contact."""
    for person in range(s.people):
        gap = s.gap[:, person]
        for first, last in joined(stretches(gap < NEAR_MISS_M), s.series.t, APART_S):
            closest = first + int(gap[first : last + 1].argmin())
            moving = float(s.relative_speed[first : last + 1, person].max()) > 0.05
            if moving and not s.touching[first : last + 1, person].any():
                yield NearMiss(
                    **_start(s, closest),
                    person=s.run.human_names[person],
                    gap_m=round(float(gap[closest]), 3),
                    relative_speed_m_s=round(float(s.relative_speed[closest, person]), 3),
                    bearing_rad=_bearing(s, closest, person),
                    responsible=responsible(s, closest, person),
                )


def hard_brakes(s: Sampled) -> Iterator[HardBrake]:
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
        nearest = int(s.gap[hardest].argmin()) if s.people else -1
        near = s.people and s.gap[hardest, nearest] < NEAR_M
        yield HardBrake(
            **_span(s, hardest, int(window[last])),
            deceleration_m_s2=round(float(drop[hardest]), 2),
            from_speed_m_s=round(float(speed[hardest]), 3),
            to_speed_m_s=round(float(speed[window[hardest]]), 3),
            person=s.run.human_names[nearest] if near else "",
        )


def _in_contact(s: Sampled) -> Flags:
    """(N,) whether the robot touches a person, a wall or an object, or has just begun to when a sample is taken."""
    flags: Flags = np.zeros(len(s), np.bool_)
    if s.people:
        flags |= s.touching.any(axis=1)
    t = s.series.t
    for event in s.run.events:
        if isinstance(event, ObstacleContact | Contact):
            first, last = np.searchsorted(t, [event.time_s - 1e-9, event.until_s + 1e-9])
            flags[min(int(first), len(t) - 1) : int(last) + 1] = True
    return flags


def standstills(s: Sampled) -> Iterator[StandStill]:
    """Yield one event for each standstill of at least a second between the first movement and the end."""
    goals = list(blocked_goals(s))
    for first, last in s.stops:
        at_the_goal = s.run.completed and last == len(s) - 1
        if _time(s, last) - _time(s, first) < STANDSTILL_S - 1e-9 or at_the_goal:
            continue
        reason, person = _main_reason(s, first, last)
        for taken in goals:
            if taken.time_s < _time(s, last) and _time(s, first) < taken.until_s:
                reason, person = "goal_taken", taken.person
        side = responsible(s, first - 1, s.run.human_names.index(person)) if person else "robot"
        side = "person" if reason == "goal_taken" else side  # there is no way round
        yield StandStill(**_span(s, first, last), reason=reason, person=person, responsible=side)


def _main_reason(s: Sampled, first: int, last: int) -> tuple[Reason, str]:
    """Return what stands next to the robot for most of a standstill; what is known of a part where most is unknown."""
    reasons = Counter(_reason(s, index) for index in range(first, last + 1))
    del reasons["unknown", ""]
    return reasons.most_common(1)[0][0] if reasons else ("unknown", "")


def _reason(s: Sampled, index: int) -> tuple[Reason, str]:
    """Return what stands next to the robot at a sample, and the name of the person if it is one."""
    t = float(s.series.t[index])
    at_wall = any(isinstance(e, ObstacleContact) and e.time_s <= t + 1e-9 < e.until_s for e in s.run.events)
    if at_wall and not (s.people and s.touching[index].any()):
        return "obstacle_contact", ""
    if s.people:
        ahead = (s.bearing_of_human[index] < AHEAD_RAD) & (s.gap[index] < BESIDE_M)
        nearest = int(s.gap[index].argmin())
        if s.touching[index].any():
            return "contact", s.run.human_names[int(s.touching[index].argmax())]
        if ahead.any():
            return "person_ahead", s.run.human_names[int(np.where(ahead, s.gap[index], np.inf).argmin())]
        if s.gap[index, nearest] < BESIDE_M:
            return "person_close", s.run.human_names[nearest]
    if any(isinstance(e, Recovery) and e.time_s <= t + 1e-9 < e.until_s for e in s.run.events):
        return "recovery", ""
    if s.obstacle_distance is not None and s.obstacle_distance[index] < s.run.robot_radius_m + OBSTACLE_M:
        return "obstacle", ""
    return "unknown", ""


def blocked_goals(s: Sampled) -> Iterator[BlockedGoal]:
    """Yield one event for each time a person occupies the goal while the robot is within 3 m of it."""
    goal_x, goal_y, _ = s.run.goal
    for person in range(s.people):
        reach = s.run.robot_radius_m + s.run.human_radius_m[person] - GOAL_TOLERANCE_M
        away = np.hypot(s.series.human_x[:, person] - goal_x, s.series.human_y[:, person] - goal_y)
        for first, last in stretches((away < reach) & (s.goal_distance < GOAL_NEAR_M)):
            if _time(s, last) - _time(s, first) >= BLOCKED_S - 1e-9:
                yield BlockedGoal(
                    time_s=_time(s, first),
                    **_at(s, goal_x, goal_y),
                    until_s=_time(s, last),
                    person=s.run.human_names[person],
                )


def ending(s: Sampled) -> GoalReached | TimeOut | Abort:
    """Return the event that ends the run."""
    end = _start(s, len(s) - 1)
    remaining = round(float(s.goal_distance[-1]), 3)
    match s.run.outcome:
        case Outcome.REACHED:
            return GoalReached(**end)
        case Outcome.TIMED_OUT:
            return TimeOut(**end, remaining_m=remaining)
        case outcome:
            return Abort(**end, outcome=outcome, remaining_m=remaining)


def _start(s: Sampled, index: int) -> dict[str, Any]:
    return {"time_s": _time(s, index), **_at(s, s.series.x[index], s.series.y[index])}


def _span(s: Sampled, first: int, last: int) -> dict[str, Any]:
    return _start(s, first) | {"until_s": _time(s, last)}


def _time(s: Sampled, index: int) -> float:
    return round(float(s.series.t[index]), 3)


def _bearing(s: Sampled, index: int, person: int) -> float:
    dx, dy = (axis[index, person] for axis in s.offset)
    return round(float(wrap(np.arctan2(dy, dx) - s.series.yaw[index])), 3)


ENCOUNTER_M = 1.5
"""An encounter begins where the gap between the bodies falls below this."""
ENCOUNTER_APART_S = 2.0
"""Approaches of one person with less time between them are one encounter."""
STANDING_M_S = 0.15
BESIDE_RAD = np.deg2rad(45.0)
"""Directions of travel within 45 degrees count as the same, or as opposite."""


class EncounterKind(str, Enum):
    """How a person comes near the robot, by the directions of both when the encounter begins."""

    HEAD_ON = "head-on"
    FROM_LEFT = "crossing from the left"
    FROM_RIGHT = "crossing from the right"
    ROBOT_OVERTAKES = "robot behind a person"
    PERSON_OVERTAKES = "person behind the robot"
    STANDING = "person stands"


class Approach(TimedEvent):
    """One person near the robot, from the moment the gap falls below `ENCOUNTER_M`; when and where it is smallest."""

    kind: EncounterKind
    person: str
    gap_m: float
    """The smallest gap between the bodies; negative where they overlap."""


def encounters_of(run: Run, *, world: World | None = None) -> tuple[Approach, ...]:
    """Return every encounter of a run in order of time. A `world` names the places."""
    if not len(run.trajectory) or not run.human_names:
        return ()
    s, encounters = sampled(run, world), []
    for person, name in enumerate(run.human_names):
        gap = s.gap[:, person]
        for first, last in joined(stretches(gap < ENCOUNTER_M), s.series.t, ENCOUNTER_APART_S):
            closest = first + int(gap[first : last + 1].argmin())
            kind, gap_m = _kind(s, first, closest, person), round(float(gap[closest]), 3)
            encounters.append(Approach(**_start(s, closest), kind=kind, person=name, gap_m=gap_m))
    return tuple(sorted(encounters, key=lambda encounter: (encounter.time_s, encounter.person)))


def _kind(s: Sampled, first: int, closest: int, person: int) -> EncounterKind:
    speed = s.series.human_speed[first : closest + 1, person]
    if float(np.median(speed)) < STANDING_M_S:
        return EncounterKind.STANDING
    # Of the stretch up to the smallest gap the moment in which the person walks: at its start one may still turn.
    walking = first + int(np.argmax(speed >= STANDING_M_S))
    turned = float(wrap(s.series.human_yaw[walking, person] - s.series.yaw[walking]))
    if abs(turned) > np.pi - BESIDE_RAD:
        return EncounterKind.HEAD_ON
    if abs(turned) < BESIDE_RAD:
        ahead = abs(float(s.bearing_of_human[walking, person])) < np.pi / 2
        return EncounterKind.ROBOT_OVERTAKES if ahead else EncounterKind.PERSON_OVERTAKES
    return EncounterKind.FROM_LEFT if turned < 0 else EncounterKind.FROM_RIGHT
