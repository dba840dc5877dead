"""Rehearsals: short simulations that a generator may ask for before it answers.

Generation does not know the simulator. The code that assembles a campaign gives the generator a `Rehearse` function.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from pydantic import Field

from rvsg.core.records import Record
from rvsg.scenario.brief import Arrival, Row
from rvsg.scenario.scenario import HumanConfiguration, Mission

LATE_S = 2.0
"""A planned time that is off by less is good enough."""
NEAR_M = 4.0
"""Somebody who never comes nearer to the robot than this (centre to centre) takes no part in the test."""
MET_M = 2.0
"""From the first moment at which somebody is this near (centre to centre), what happens is the encounter's effect."""


class Walked(Record):
    """What one person does in a rehearsal: first arrivals, where they get stuck, how near they come to the robot."""

    begins_at: str = ""
    """The first waypoint."""
    left_s: float | None = None
    """When the person leaves it, in seconds; None: never."""
    arrivals: tuple[Arrival, ...] = ()
    stuck_at: str | None = None
    stuck_s: float | None = None
    """Since when the person stands still until the run ends, in seconds; None for who walks on."""
    stood: tuple[tuple[float, float, str], ...] = ()
    """From when to when, in seconds, and where somebody who should walk stands still, and then walks on."""
    nearest_m: float
    nearest_s: float
    met_s: float | None = None
    """When the person is first within `MET_M` of the robot, in seconds; None: never."""


class Rehearsal(Record):
    """One simulated run in short: where the robot is every two seconds, when it arrives, and what the people do."""

    robot: tuple[tuple[float, str], ...]
    arrival_s: float | None
    way: tuple[tuple[float, float, float], ...] = ()
    """Where the robot is every half second: seconds, metres, metres."""
    people: dict[str, Walked] = Field(default_factory=dict)
    rows: tuple[Row, ...] = ()
    """What everybody does every two seconds; empty without people."""


Rehearse = Callable[[Mission, HumanConfiguration], Rehearsal]
"""Simulate a configuration once and return it in short. Without humans it is the undisturbed drive."""

Plan = Mapping[str, Mapping[str, float]]
"""When each person is planned to be at which waypoint, in seconds: name, waypoint, time."""


def surprises(rehearsal: Rehearsal, plan: Plan) -> tuple[str, ...]:
    """Return what does not happen as planned: who is held up, who never comes near, who arrives at another time.

    Only what goes wrong before the first person meets the robot is a mistake of the plan. Afterwards robot and people
    hold each other up, which is what the test is for: its runs measure it. For the same reason a person who is still
    waiting for a robot that somebody else holds up until the end is no surprise.
    """
    met = min((walked.met_s for walked in rehearsal.people.values() if walked.met_s is not None), default=math.inf)
    held_up = math.isfinite(met) and rehearsal.arrival_s is None
    found = []
    for name, walked in rehearsal.people.items():
        if walked.stuck_s is not None and walked.stuck_s < met:
            found.append(
                f"{name} gets stuck at {walked.stuck_at} from {walked.stuck_s:g} s on and does not walk further."
            )
        found += [
            f"{name} stands still at {at} from {start:g} to {end:g} s, held up by what is in the way."
            for start, end, at in walked.stood
            if start < met
        ]
        if walked.nearest_m > NEAR_M and not held_up:
            found.append(
                f"{name} never comes near the robot: the smallest distance is {walked.nearest_m:.1f} m, at "
                f"{walked.nearest_s:.0f} s."
            )
        reached = {arrival.at: arrival.time_s for arrival in reversed(walked.arrivals)}
        for at, planned in plan.get(name, {}).items():
            left = math.inf if walked.left_s is None else walked.left_s
            if at == walked.begins_at and planned < left + LATE_S:
                continue  # there from the start on
            actual = reached.get(at)
            if min(planned, math.inf if actual is None else actual) >= met:
                continue
            if actual is None and at == walked.begins_at:
                found.append(f"{name} leaves {at} at {left:.1f} s and does not come back; you planned {planned:g} s.")
            elif actual is None:
                found.append(f"{name} does not reach {at} during the run; you planned {planned:g} s.")
            elif abs(actual - planned) >= LATE_S:
                found.append(f"{name} reaches {at} at {actual:.1f} s; you planned {planned:g} s.")
    return tuple(found)
