"""The story of a run in a few plain sentences, generated from its events. Each sentence has its time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rvsg.core.records import Record
from rvsg.evaluation import run_events
from rvsg.evaluation.detection import events_of, place_namer
from rvsg.evaluation.run_events import Event, Place, PlaceAt, place_name
from rvsg.evaluation.sampled import joined, sampled, stretches
from rvsg.evaluation.verdict import metres, outcome_in_words
from rvsg.scenario.scenario import Scenario
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
    run: Run, *, world: World | None = None, scenario: Scenario | None = None, events: Sequence[Event] | None = None
) -> tuple[Sentence, ...]:
    """Return at most six sentences in order of time: the start, what mattered most, and the end.

    Args:
        world: Names the places.
        scenario: What people are asked to do.
        events: The events of the run, if they are known already.
    """
    if not len(run.trajectory):
        return ()
    at = _namer(world)
    found = list(events if events is not None else events_of(run, world=world, scenario=scenario))
    ends = (run_events.Arrival, run_events.TimeOut, run_events.Abort)
    middle = [event for event in found if not isinstance(event, ends)]
    chosen = sorted(middle, key=lambda event: WEIGHTS[type(event)](event), reverse=True)[: MOST - 2]
    told = [event.replace(place=at(event.place.x, event.place.y)) for event in chosen]
    sentences = [Sentence(text=in_words(event), time_s=event.time_s) for event in told]
    if len(sentences) < MOST - 2:
        sentences += _company(run, world, at)
    if len(sentences) < FEWEST - 2 and not any(
        isinstance(event, run_events.Contact | run_events.NearMiss) for event in chosen
    ):
        sentences += _closest(run, world, at)
    sentences.sort(key=lambda sentence: sentence.time_s)
    limit = f"the time limit of {run.time_limit_s:.0f} s passes"
    last = [
        Sentence(text=in_words(event).replace("the time limit passes", limit), time_s=event.time_s)
        for event in found
        if isinstance(event, ends)
    ]
    path = run.trajectory
    start, goal = at(float(path.x[0]), float(path.y[0])), at(run.goal[0], run.goal[1])
    away = f"{float(np.hypot(path.x[0] - run.goal[0], path.y[0] - run.goal[1])):.0f} m away"
    text = f"The robot sets out from {start} to {goal}, {away}, with a time limit of {run.time_limit_s:.0f} s."
    return (Sentence(text=text, time_s=float(path.t[0])), *sentences, *last)


def _namer(world: World | None) -> PlaceAt:
    """Return a function from x and y to a place with the names of its waypoint and its area, e.g. `F15 (Area 4)`.

    The area is that by which answers and failures speak of the position.
    """
    name = place_namer(world)
    if world is None:
        return name

    def at(x: float, y: float) -> Place:
        place, area = name(x, y), place_name(world, x, y)
        return place if area == place.waypoint else place.replace(waypoint=f"{place.waypoint} ({area})")

    return at


WEIGHTS: dict[type[Event], Callable[[Any], float]] = {
    run_events.Contact: lambda event: 100.0 + event.duration_s + 10.0 * event.closing_speed_m_s,
    run_events.ObstacleContact: lambda event: 90.0 + event.duration_s,
    run_events.StandStill: lambda event: 50.0 + event.duration_s,
    run_events.BlockedGoal: lambda event: 45.0 + event.duration_s,
    run_events.HardBrake: lambda event: 40.0 + event.deceleration_m_s2,
    run_events.Recovery: lambda _: 35.0,
    run_events.NearMiss: lambda event: 30.0 + 40.0 * (0.25 - event.gap_m),
    run_events.PersonStuck: lambda event: 28.0 if event.reason == "robot" else 5.0,
    run_events.PersonReacted: lambda _: 20.0,
    run_events.Replan: lambda _: 15.0,
    run_events.PersonPaused: lambda _: 4.0,
    run_events.PersonReached: lambda _: 3.0,
}
"""How much an event matters for a story; larger matters more."""


def in_words(event: Event) -> str:
    """Return one sentence that says when, who, where and what."""
    return f"At {event.time_s:.1f} s {_what(event)}."


def _what(event: Event) -> str:
    where = at_place(event.place)
    match event:
        case run_events.Contact():
            return _contact(event)
        case run_events.ObstacleContact():
            return f"the robot hits {what_is_hit(event)} {where} at {event.speed_m_s:.1f} m/s"
        case run_events.NearMiss():
            speed = f"a relative speed of {event.relative_speed_m_s:.1f} m/s"
            return f"the robot passes {event.person} {where} with a gap of {metres(event.gap_m)} and {speed}"
        case run_events.HardBrake():
            near = f"; {event.person} is near" if event.person else ""
            change = f"from {event.from_speed_m_s:.1f} to {event.to_speed_m_s:.1f} m/s"
            return f"the robot brakes hard {where}, {change}{near}"
        case run_events.StandStill():
            return f"the robot stops {where} and stands for {event.duration_s:.1f} s, {standing_because(event)}"
        case run_events.Replan():
            return f"the robot plans another path {where}, {event.deviation_m:.1f} m beside the one before"
        case run_events.Recovery():
            action = event.action.replace("_", " ")
            return f"navigation starts a recovery {where} ({action}, {event.duration_s:.1f} s)"
        case run_events.BlockedGoal():
            return f"{event.person} stands on the goal for {event.duration_s:.1f} s while the robot is near it"
        case run_events.PersonStuck():
            by = {"robot": " beside the robot", "person": " beside another person"}.get(event.reason, "")
            return f"{event.person} is stuck {where}{by} for {event.duration_s:.1f} s"
        case run_events.PersonReached():
            return f'{event.person} completes "{event.task}" {where}'
        case run_events.PersonPaused():
            return f"{event.person} pauses {where} for {event.duration_s:.1f} s"
        case run_events.PersonReacted():
            return f"{event.person} reacts to the robot ({event.behaviour}) {where} until {event.until_s:.1f} s"
        case run_events.TimeOut():
            return f"the time limit passes; the robot is {metres(event.remaining_m)} from its goal"
        case run_events.Abort():
            return f"{outcome_in_words(event.outcome)}; the robot is {metres(event.remaining_m)} from its goal"
        case run_events.Arrival():
            return "the robot reaches its goal"


def what_is_hit(event: run_events.ObstacleContact) -> str:
    """Return the door that the robot touches, by its name, or "an obstacle"."""
    return f"the door {event.door}" if event.door else "an obstacle"


def _contact(event: run_events.Contact) -> str:
    who, where = event.person, at_place(event.place)
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


def standing_because(event: run_events.StandStill) -> str:
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


def at_place(place: Place) -> str:
    """Return `at E15`, or `at (1.2, 3.4)` where the world is not known."""
    return f"at {place}"


def _company(run: Run, world: World | None, at: PlaceAt) -> list[Sentence]:
    """Tell who stays near the robot longest, where that lasts."""
    s = sampled(run, world)
    t = s.series.t
    found = [
        (float(t[last] - t[first]), -person, first, last)
        for person in range(s.people)
        for first, last in joined(stretches(s.gap[:, person] < COMPANY_M), t, 1.0)
    ]
    if not found or max(found)[0] < COMPANY_S:
        return []
    lasts, person, first, last = max(found)
    here, there = (at(float(s.series.x[k]), float(s.series.y[k])) for k in (first, last))
    way = at_place(here) if str(here) == str(there) else f"from {here} to {there}"
    text = f"{run.human_names[-person]} stays within {COMPANY_M:.0f} m of the robot for {lasts:.1f} s, {way}."
    time_s = round(float(t[first]), 3)
    return [Sentence(text=f"From {time_s:.1f} s on {text}", time_s=time_s)]


def _closest(run: Run, world: World | None, at: PlaceAt) -> list[Sentence]:
    s = sampled(run, world)
    if not s.people:
        return []
    index = int(s.closest_gap.argmin())
    who = run.human_names[int(s.gap[index].argmin())]
    where = at_place(at(float(s.series.x[index]), float(s.series.y[index])))
    time_s = round(float(s.series.t[index]), 3)
    gap = metres(float(s.closest_gap[index]))
    text = f"At {time_s:.1f} s {who} comes nearest to the robot {where}, with a gap of {gap}."
    return [Sentence(text=text, time_s=time_s)]
