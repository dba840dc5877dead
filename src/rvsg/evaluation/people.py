"""Detection of the events of people: ends of tasks, pauses, and people who are stuck."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.events import Event, PersonPaused, PersonReached, PersonReacted, PersonStuck, PlaceAt
from rvsg.evaluation.sampled import Flags, Sampled, stretches
from rvsg.scenario.scenario import Behaviour, Human, HumanAgent, Scenario, decode, task_ends
from rvsg.simulation import run as recorded
from rvsg.world.world import World

Floats = NDArray[np.float64]

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
BESIDE_M = 0.6
REACTING_M = 1.0
"""A person whose behaviour stops it near the robot is not stuck within its distance of reaction plus this."""
OfPeople = recorded.PersonStuck | recorded.PersonPaused | recorded.PersonReacted | recorded.PersonReached
STOPPING = (Behaviour.SURPRISED, Behaviour.CURIOUS, Behaviour.THREATENING)


def people_events(s: Sampled, scenario: Scenario | None, world: World | None, at: PlaceAt) -> Iterator[Event]:
    """Yield the events of people: as the simulator recorded them, else as the trajectory shows them.

    The names of tasks need `scenario` and `world`, and so does all that is read off the trajectory.
    """
    known = scenario is not None and world is not None
    humans = {human.name: human for human in scenario.people.humans} if known and scenario is not None else {}
    if any(isinstance(event, OfPeople) for event in s.run.events):
        ends = {name: task_ends(human) for name, human in humans.items()}
        yield from _recorded(s, ends, at)
    elif scenario is not None and world is not None:
        for human, agent in zip(scenario.people.humans, decode(scenario.people, world.grid), strict=True):
            if human.name in s.run.human_names and len(agent.goals) > 1:
                yield from _of_one(s, s.run.human_names.index(human.name), human, agent, at)


def _recorded(s: Sampled, ends: dict[str, dict[int, str]], at: PlaceAt) -> Iterator[Event]:
    """Yield the recorded events up to the end of the series; of waypoints reached only the ends of tasks."""
    t = s.series.t
    for event in s.run.events:
        if not isinstance(event, OfPeople) or event.time_s > t[-1] + 1e-9:
            continue
        start: dict[str, Any] = {"time_s": event.time_s, "place": at(event.x, event.y), "person": event.person}
        if isinstance(event, recorded.PersonReached):
            task = ends.get(event.person, {}).get(event.goal)
            if task is not None:
                yield PersonReached(**start, task=task)
            continue
        until = min(event.until_s, float(t[-1]))
        if isinstance(event, recorded.PersonPaused):
            yield PersonPaused(**start, until_s=until)
        elif isinstance(event, recorded.PersonReacted):
            yield PersonReacted(**start, until_s=until, behaviour=event.behaviour.value)
        else:
            index = min(int(np.searchsorted(t, event.time_s - 1e-9)), len(t) - 1)
            reason = _beside(s, index, s.run.human_names.index(event.person))
            yield PersonStuck(**start, until_s=until, reason=reason)


def _of_one(s: Sampled, person: int, human: Human, agent: HumanAgent, at: PlaceAt) -> Iterator[Event]:
    x, y, t = s.series.human_x[:, person], s.series.human_y[:, person], s.series.t
    ends = task_ends(human)
    excused: Flags = t < agent.start_delay_s + 1.0
    for index, goal in _arrivals(x, y, agent):
        where = at(*agent.goals[goal])
        begin = round(float(t[index]), 3)
        if agent.pauses_s[goal] > 0.0:
            left = float(t[_leaves(x, y, index, agent.goals[goal])])
            until = min(left, begin + agent.pauses_s[goal])
            excused |= (t >= begin) & (t <= begin + agent.pauses_s[goal] + LEAVING_S)
            yield PersonPaused(time_s=begin, place=where, until_s=round(until, 3), person=human.name)
        if goal in ends:
            yield PersonReached(time_s=begin, place=where, person=human.name, task=ends.pop(goal))
    if agent.behaviour in STOPPING:
        excused |= s.distance[:, person] < agent.reaction.distance_m + REACTING_M
    yield from _stuck(s, person, excused, at)


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


def _leaves(x: Floats, y: Floats, index: int, goal: tuple[float, float]) -> int:
    """Return the sample at which a person who stands at a goal since `index` leaves it, or the last one."""
    away = np.hypot(x[index:] - goal[0], y[index:] - goal[1]) > LEFT_M
    return index + int(away.argmax()) if away.any() else len(x) - 1


def _stuck(s: Sampled, person: int, excused: Flags, at: PlaceAt) -> Iterator[PersonStuck]:
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
            place=at(x[first], y[first]),
            until_s=round(float(t[last_row[last]]), 3),
            person=s.run.human_names[person],
            reason=_beside(s, int(rows[first]), person),
        )


def _beside(s: Sampled, index: int, person: int) -> Literal["robot", "person", "unknown"]:
    """Return who stands next to a person at a sample."""
    if s.gap[index, person] < BESIDE_M:
        return "robot"
    x, y = s.series.human_x[index], s.series.human_y[index]
    away = np.hypot(x - x[person], y - y[person]) - np.asarray(s.run.human_radius_m) - s.run.human_radius_m[person]
    away[person] = np.inf
    return "person" if len(away) > 1 and away.min() < BESIDE_M else "unknown"
