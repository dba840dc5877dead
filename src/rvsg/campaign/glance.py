"""What the feedback on an attempt takes of each of its runs, so that only the worst and the mildest are read again.

It is made where the run is made: a worker has all of the run at hand, the campaign would have to unpack it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rvsg.campaign.failures import FailureMode
from rvsg.evaluation.detection import contacts
from rvsg.evaluation.events import Place
from rvsg.evaluation.naming import WaypointNames
from rvsg.evaluation.sampled import sampled
from rvsg.scenario.brief import Encounter, HumanInfluence, Touched
from rvsg.scenario.scenario import Human
from rvsg.simulation.run import Run
from rvsg.world.grid import Grid
from rvsg.world.world import World

NEAR_M = 2.0
"""A human nearer than this may influence how the robot drives (the inflation and the social zone end before it)."""
MEETING_M = 3.0
"""A waypoint at which a human never came nearer than this to the robot played no part in the encounter."""


@dataclass(frozen=True)
class PersonGlance:
    """One person in a run."""

    name: str
    closest_gap_m: float
    share_near: float
    """Share of the time within `NEAR_M`."""
    met: dict[str, float]
    """The smallest gap at each waypoint that the person was nearest to, m."""


@dataclass(frozen=True)
class Glance:
    """One run."""

    run_id: str
    completed: bool
    ended_s: float
    people: tuple[PersonGlance, ...]
    touches: tuple[Touched, ...]


@dataclass(frozen=True)
class Look:
    """What the process that made a run tells of it, so that the campaign seldom unpacks it."""

    run_id: str
    mode: FailureMode | None
    """How it fails if it does."""
    encounter: Encounter | None
    glance: Glance | None = None
    """None where hardly any run gets feedback."""


def glance_at(run: Run, world: World) -> Glance:
    """Return what feedback takes of a run."""
    return glance_of(run, world.grid, world)


def glance_of(run: Run, grid: Grid, world: World | None) -> Glance:
    """Return what feedback takes of a run, in a world that is possibly not known but for its grid."""
    path, gap, names = run.trajectory, sampled(run, world).gap, WaypointNames(grid)
    step = max(1, len(path) // 400)
    people = []
    for h, name in enumerate(run.human_names):
        met: dict[str, float] = {}
        at = names.nearest(path.human_x[::step, h], path.human_y[::step, h])
        for place, distance in zip(at, gap[::step, h].tolist(), strict=True):
            met[place] = min(met.get(place, np.inf), distance)
        closest, near = (float(gap[:, h].min()), float((gap[:, h] < NEAR_M).mean())) if len(path) else (np.inf, 0.0)
        people.append(PersonGlance(name, closest, near, met))
    ended = float(path.t[-1]) if len(path) else 0.0
    return Glance(run.id, run.completed, ended, tuple(people), touches_of(run, grid, world))


def influences(people: Sequence[Human], glances: Sequence[Glance]) -> tuple[HumanInfluence, ...]:
    """Return what each human contributed over all runs: closest gap, share of time near, waypoints without effect.

    Args:
        people: Of the scenario.
    """
    planned = {human.name: human for human in people}
    found = []
    for h, person in enumerate(glances[0].people):
        seen = [glance.people[h] for glance in glances]
        human = planned.get(person.name)
        path = dict.fromkeys(w for task in human.tasks for w in task.path) if human is not None else {}
        idle = tuple(w for w in path if min(each.met.get(w, np.inf) for each in seen) > MEETING_M)
        found.append(
            HumanInfluence(
                name=person.name,
                closest_gap_m=min(each.closest_gap_m for each in seen),
                share_within_2_m=min(float(np.mean([each.share_near for each in seen])), 1.0),
                idle_waypoints=idle,
            )
        )
    return tuple(found)


def touches_of(run: Run, grid: Grid, world: World | None = None) -> tuple[Touched, ...]:
    """Return the touches of the robot and a person in a run, as events tell them, in order."""
    s, names = sampled(run, world), WaypointNames(grid)

    def at(x: float, y: float) -> Place:
        return Place(x=x, y=y, waypoint=names.nearest(np.array([x]), np.array([y]))[0])

    return tuple(
        Touched(
            who=contact.person,
            at=contact.place.waypoint,
            time_s=round(contact.time_s, 1),
            until_s=round(contact.until_s, 1),
            moved_by=contact.moved_by,
        )
        for contact in sorted(contacts(s, at), key=lambda contact: contact.time_s)
    )
