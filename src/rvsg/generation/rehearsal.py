"""Rehearsals: short simulations that a generator may ask for before it answers.

Generation does not know the simulator. The code that assembles a campaign gives the generator a `Rehearse` function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pydantic import Field

from rvsg.core.records import Record
from rvsg.scenario.brief import Arrival
from rvsg.scenario.scenario import HumanConfiguration, Mission

LATE_S = 2.0
"""A planned time that is off by less is good enough."""
NEAR_M = 4.0
"""Somebody who never comes nearer to the robot than this (centre to centre) takes no part in the test."""


class Walked(Record):
    """What one person does in a rehearsal: first arrivals, where they get stuck, how near they come to the robot."""

    arrivals: tuple[Arrival, ...] = ()
    stuck_at: str | None = None
    stuck_s: float | None = None
    nearest_m: float
    nearest_s: float


class Rehearsal(Record):
    """One simulated run in short: where the robot is every two seconds, when it arrives, and what the people do."""

    robot: tuple[tuple[float, str], ...]
    arrival_s: float | None
    way: tuple[tuple[float, float, float], ...] = ()
    """Where the robot is every half second: seconds, metres, metres."""
    people: dict[str, Walked] = Field(default_factory=dict)


Rehearse = Callable[[Mission, HumanConfiguration], Rehearsal]
"""Simulate a configuration once and return it in short. Without humans it is the undisturbed drive."""

Plan = Mapping[str, Mapping[str, float]]
"""When each person is planned to be at which waypoint, in seconds: name, waypoint, time."""


def surprises(rehearsal: Rehearsal, plan: Plan) -> tuple[str, ...]:
    """Return what does not happen as planned: who is stuck, who never comes near, who arrives at another time."""
    found = []
    for name, walked in rehearsal.people.items():
        if walked.stuck_at is not None:
            found.append(
                f"{name} gets stuck at {walked.stuck_at} from {walked.stuck_s:g} s on and does not walk further."
            )
        if walked.nearest_m > NEAR_M:
            found.append(
                f"{name} never comes near the robot: the smallest distance is {walked.nearest_m:.1f} m, at "
                f"{walked.nearest_s:.0f} s."
            )
        reached = {arrival.at: arrival.time_s for arrival in reversed(walked.arrivals)}
        for at, planned in plan.get(name, {}).items():
            actual = reached.get(at)
            if actual is None and rehearsal.people:
                found.append(f"{name} does not reach {at} during the run; you planned {planned:g} s.")
            elif actual is not None and abs(actual - planned) >= LATE_S:
                found.append(f"{name} reaches {at} at {actual:.1f} s; you planned {planned:g} s.")
    return tuple(found)
