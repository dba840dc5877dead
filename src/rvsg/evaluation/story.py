"""The story of a run in a few plain sentences, generated from its events. Each sentence has its time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rvsg.core.records import Record
from rvsg.evaluation.detection import events_of
from rvsg.evaluation.sampled import joined, sampled, stretches
from rvsg.evaluation.verdict import metres, outcome_in_words
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.events import (
    Abort,
    BlockedGoal,
    Contact,
    DoorMoved,
    GoalReached,
    HardBrake,
    NearMiss,
    ObstacleContact,
    PersonPaused,
    PersonReached,
    PersonReacted,
    PersonStuck,
    Recovery,
    Replan,
    RunEvent,
    StandStill,
    TimeOut,
    responsible_in_words,
)
from rvsg.simulation.run import Run
from rvsg.world.world import World

MOST = 6
FEWEST = 4
COMPANY_M, COMPANY_S = 1.0, 4.0
"""Who has a smaller gap to the robot for longer is told, where there is room."""


class Sentence(Record):
    """One sentence of a story."""

    text: str
    time_s: float
    """The time that the replay seeks for it, seconds since the start of the run."""


def story_of(
    run: Run, *, world: World | None = None, scenario: Scenario | None = None, events: Sequence[RunEvent] | None = None
) -> tuple[Sentence, ...]:
    """Return at most six sentences in order of time: the start, what mattered most, and the end.

    Args:
        world: Names the places.
        scenario: What people are asked to do.
        events: The events of the run, if they are known already.
    """
    if not len(run.trajectory):
        return ()
    events = events_of(run, world=world, scenario=scenario) if events is None else events
    ends = (GoalReached, TimeOut, Abort)
    middle = [event for event in events if not isinstance(event, ends)]
    chosen = sorted(middle, key=lambda event: WEIGHTS[type(event)](event), reverse=True)[: MOST - 2]
    located = [event.model_copy(update={"waypoint": _place(world, event.x, event.y)}) for event in chosen]
    sentences = [Sentence(text=in_words(event), time_s=event.time_s) for event in located]
    if len(sentences) < MOST - 2:
        sentences += _company(run, world)
    if len(sentences) < FEWEST - 2 and not any(isinstance(event, Contact | NearMiss) for event in chosen):
        sentences += _closest(run, world)
    sentences.sort(key=lambda sentence: sentence.time_s)
    limit = f"the time limit of {run.time_limit_s:.0f} s passes"
    last = [
        Sentence(text=in_words(event).replace("the time limit passes", limit), time_s=event.time_s)
        for event in events
        if isinstance(event, ends)
    ]
    path = run.trajectory
    start, goal = _place(world, float(path.x[0]), float(path.y[0])), _place(world, run.goal[0], run.goal[1])
    away = f"{float(np.hypot(path.x[0] - run.goal[0], path.y[0] - run.goal[1])):.0f} m away"
    text = f"The robot sets out from {start} to {goal}, {away}, with a time limit of {run.time_limit_s:.0f} s."
    return (Sentence(text=text, time_s=float(path.t[0])), *sentences, *last)


def _place(world: World | None, x: float, y: float) -> str:
    """Return the waypoint and the area of a position, e.g. `F15 (Area 4)`, or the position where no world is given.

    The area is that by which answers and failures speak of the position.
    """
    if world is None:
        return f"({round(x, 3):.1f}, {round(y, 3):.1f})"
    waypoint, area = world.grid.nearest(x, y), world.place_name(x, y)
    return waypoint if area == waypoint else f"{waypoint} ({area})"


WEIGHTS: dict[type, Callable[[Any], float]] = {
    Contact: lambda event: 100.0 + event.duration_s + 10.0 * event.closing_speed_m_s,
    ObstacleContact: lambda event: 90.0 + event.duration_s,
    StandStill: lambda event: 50.0 + event.duration_s,
    BlockedGoal: lambda event: 45.0 + event.duration_s,
    HardBrake: lambda event: 40.0 + event.deceleration_m_s2,
    Recovery: lambda _: 35.0,
    NearMiss: lambda event: 30.0 + 40.0 * (0.25 - event.gap_m),
    PersonStuck: lambda event: 28.0 if event.reason == "robot" else 5.0,
    PersonReacted: lambda _: 20.0,
    Replan: lambda _: 15.0,
    PersonPaused: lambda _: 4.0,
    PersonReached: lambda _: 3.0,
}
"""How much an event matters for a story; larger matters more."""


def in_words(event: RunEvent) -> str:
    """Return one sentence that says when, who, where and what."""
    whose = ""
    if isinstance(event, Contact | NearMiss) and event.responsible is not None:
        whose = f"; {responsible_in_words(event.responsible, event.person)}"
    return f"At {event.time_s:.1f} s {_what(event)}{whose}."


def _what(event: RunEvent) -> str:
    where = f"at {event.at}"
    match event:
        case Contact():
            return _contact(event)
        case ObstacleContact():
            return f"the robot hits {what_is_hit(event)} {where} at {event.speed_m_s:.1f} m/s"
        case NearMiss():
            speed = f"a relative speed of {event.relative_speed_m_s:.1f} m/s"
            return f"the robot passes {event.person} {where} with a gap of {metres(event.gap_m)} and {speed}"
        case HardBrake():
            near = f"; {event.person} is near" if event.person else ""
            change = f"from {event.from_speed_m_s:.1f} to {event.to_speed_m_s:.1f} m/s"
            return f"the robot brakes hard {where}, {change}{near}"
        case StandStill():
            return f"the robot stops {where} and stands for {event.duration_s:.1f} s, {standing_because(event)}"
        case Replan():
            return f"the robot plans another path {where}, {event.deviation_m:.1f} m beside the one before"
        case Recovery():
            action = event.action.replace("_", " ")
            return f"navigation starts a recovery {where} ({action}, {event.duration_s:.1f} s)"
        case BlockedGoal():
            return f"{event.person} stands on the goal for {event.duration_s:.1f} s while the robot is near it"
        case PersonStuck():
            by = {"robot": " beside the robot", "person": " beside another person"}.get(event.reason or "", "")
            return f"{event.person} is stuck {where}{by} for {event.duration_s:.1f} s"
        case PersonReached():
            return f'{event.person} completes "{event.task}" {where}'
        case PersonPaused():
            return f"{event.person} pauses {where} for {event.duration_s:.1f} s"
        case PersonReacted():
            return f"{event.person} reacts to the robot ({event.behaviour.value}) {where} until {event.until_s:.1f} s"
        case DoorMoved():
            return f"the door {event.door} begins to {'open' if event.opens else 'close'}"
        case TimeOut():
            return f"the time limit passes; the robot is {metres(event.remaining_m)} from its goal"
        case Abort():
            return f"{outcome_in_words(event.outcome)}; the robot is {metres(event.remaining_m)} from its goal"
        case GoalReached():
            return "the robot reaches its goal"


def what_is_hit(event: ObstacleContact) -> str:
    """Return the door that the robot touches, by its name, or "an obstacle"."""
    return f"the door {event.door}" if event.door else "an obstacle"


def _contact(event: Contact) -> str:
    who, where = event.person, f"at {event.at}"
    short = event.duration_s < 0.05  # a tenth of a second is the finest that is told
    lasts = "they touch briefly" if short else f"they touch for {event.duration_s:.1f} s"
    speed = f"at {event.closing_speed_m_s:.1f} m/s"
    match event.moved_by:
        case "robot":
            return f"the robot moves into {who} {where} {speed}; {lasts}"
        case "person":
            return f"{who} moves into the robot {where} {speed}; {lasts}"
        case "both":
            return f"the robot and {who} move into each other {where} {speed}; {lasts}"
        case "neither":
            return f"the robot and {who} touch {where} for {event.duration_s:.1f} s"


def standing_because(event: StandStill) -> str:
    """Return why the robot stands, in the words of stories, reports and prompts."""
    return {
        "contact": f"in contact with {event.person}",
        "person_ahead": f"{event.person} in front of it",
        "person_close": f"{event.person} close to it",
        "goal_taken": f"{event.person} on its goal",
        "obstacle_contact": "in contact with an obstacle",
        "obstacle": "an obstacle close to it",
        "recovery": "in a recovery of its navigation",
        "unknown": "without a visible cause",
    }[event.reason]


def _company(run: Run, world: World | None) -> list[Sentence]:
    """Tell who stays near the robot longest, where that lasts."""
    s = sampled(run, world)
    t = s.series.t
    spans = [
        (float(t[last] - t[first]), -person, first, last)
        for person in range(s.people)
        for first, last in joined(stretches(s.gap[:, person] < COMPANY_M), t, 1.0)
    ]
    if not spans or max(spans)[0] < COMPANY_S:
        return []
    lasts, person, first, last = max(spans)
    here, there = (_place(world, float(s.series.x[k]), float(s.series.y[k])) for k in (first, last))
    way = f"at {here}" if here == there else f"from {here} to {there}"
    text = f"{run.human_names[-person]} stays within {COMPANY_M:.0f} m of the robot for {lasts:.1f} s, {way}."
    time_s = round(float(t[first]), 3)
    return [Sentence(text=f"From {time_s:.1f} s on {text}", time_s=time_s)]


def _closest(run: Run, world: World | None) -> list[Sentence]:
    s = sampled(run, world)
    if s.closest_approach is None:
        return []
    row, person = s.closest_approach
    where = _place(world, float(s.series.x[row]), float(s.series.y[row]))
    time_s, gap = round(float(s.series.t[row]), 3), metres(float(s.gap[row, person]))
    text = f"At {time_s:.1f} s {run.human_names[person]} comes nearest to the robot at {where}, with a gap of {gap}."
    return [Sentence(text=text, time_s=time_s)]
