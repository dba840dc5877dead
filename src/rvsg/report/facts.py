"""Facts of each recorded run of a campaign, which the page states and links to."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rvsg.campaign.attempt import Attempt, Measurement
from rvsg.evaluation.detection import events_of, place_namer
from rvsg.evaluation.events import Contact, Event, ObstacleContact, Place, Recovery, StandStill
from rvsg.evaluation.naming import place_name
from rvsg.evaluation.sampled import sampled, stretches
from rvsg.evaluation.story import Sentence, story_of
from rvsg.report.payload import INVOLVED_M
from rvsg.report.quantity import Curve, Why, decisive, judged_curve
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.run import Run
from rvsg.world.world import World


@dataclass(frozen=True, kw_only=True, eq=False)
class RunFacts:
    """A run and what happened in it. `closest_m`, `closest_to`, `closest_s`: the smallest gap, to whom and when."""

    run: Run
    measurement: Measurement
    violated: bool
    events: tuple[Event, ...]
    story: tuple[Sentence, ...]
    curve: Curve
    decisive_s: float
    decisive_why: Why
    """What makes this moment decide the requirement."""
    decisive_with: str
    """The person nearest to the robot at the decisive moment; empty where nobody is within 2 m then."""
    decisive_at: Place
    world: World
    closest_m: float | None
    closest_to: str
    closest_s: float

    @property
    def id(self) -> str:
        """The id of the run."""
        return self.run.id

    @cached_property
    def decisive_near(self) -> str:
        """The name of the place where the robot is at the decisive moment, as failures and maps name it."""
        return place_name(self.world, self.decisive_at.x, self.decisive_at.y)

    @cached_property
    def closest_near(self) -> str:
        """The name of the place where the robot is at the smallest gap to a person."""
        at = _where(self.run, self.closest_s, self.world)
        return place_name(self.world, at.x, at.y)

    @property
    def arrived(self) -> bool:
        """Return whether the robot reached its goal in time."""
        return self.run.completed

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts of the robot with people."""
        return tuple(event for event in self.events if isinstance(event, Contact))

    @property
    def obstacle_contacts(self) -> tuple[ObstacleContact, ...]:
        """The contacts of the robot with walls and things."""
        return tuple(event for event in self.events if isinstance(event, ObstacleContact))

    @property
    def lanes(self) -> dict[str, list[tuple[float, float]]]:
        """The spells that the timeline of the replay shows, in seconds."""
        return {
            "contact": [(e.time_s, e.until_s) for e in self.contacts],
            "standing": [(e.time_s, e.until_s) for e in self.events if isinstance(e, StandStill)],
            "recovery": [(e.time_s, e.until_s) for e in self.events if isinstance(e, Recovery)],
            "violated": self.beyond,
        }

    @property
    def note(self) -> str:
        """What else is worth knowing of the run, in a few words."""
        return "contact" if self.contacts else ""

    beyond: list[tuple[float, float]]
    """When the judged quantity is beyond its limit, seconds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AttemptFacts:
    """The runs of one configuration."""

    attempt: Attempt
    runs: tuple[RunFacts, ...]

    @property
    def with_contact(self) -> tuple[RunFacts, ...]:
        """The runs in which the robot and a person touch."""
        return tuple(run for run in self.runs if run.contacts)

    @property
    def violating(self) -> tuple[RunFacts, ...]:
        """The runs that violate the requirement."""
        return tuple(run for run in self.runs if run.violated)

    @property
    def not_arrived(self) -> tuple[RunFacts, ...]:
        """The runs that end before the goal."""
        return tuple(run for run in self.runs if not run.arrived)

    def worst(self, requirement: Requirement) -> RunFacts | None:
        """Return the run with the worst objective; the first of equals."""
        valued = [run for run in self.runs if run.measurement.objective is not None]
        return max(valued, key=lambda run: requirement.badness(run.measurement.objective or 0.0), default=None)

    def nearest(self) -> RunFacts | None:
        """Return the run with the smallest gap to a person; the first of equals."""
        met = [run for run in self.runs if run.closest_m is not None]
        return min(met, key=lambda run: run.closest_m if run.closest_m is not None else 0.0, default=None)


def facts_of(
    attempts: Iterable[Attempt], requirement: Requirement, world: World, run_of: Callable[[str], Run]
) -> list[AttemptFacts]:
    """Return the facts of every attempt that was simulated, in the order of the attempts."""
    found = []
    known: dict[str, RunFacts] = {}  # a strategy may measure a configuration several times, each time in more runs
    for attempt in attempts:
        scenario = attempt.proposal.scenario
        if scenario is None or not attempt.measurements:
            continue
        for each in attempt.measurements:
            if each.run_id not in known:
                known[each.run_id] = run_facts(run_of(each.run_id), each, requirement, world, scenario)
        found.append(AttemptFacts(attempt=attempt, runs=tuple(known[m.run_id] for m in attempt.measurements)))
    return found


def run_facts(
    run: Run, measurement: Measurement, requirement: Requirement, world: World, scenario: Scenario | None = None
) -> RunFacts:
    """Return the facts of one run."""
    if scenario is not None:
        world = scenario.mission.place(world)
    curve = judged_curve(run, requirement, world)
    events = events_of(run, world=world, scenario=scenario)
    decides = decisive(run, requirement, curve)
    objective = measurement.objective
    closest, person, at = _closest(run)
    return RunFacts(
        run=run,
        measurement=measurement,
        violated=objective is not None and requirement.violated_by(objective),
        events=events,
        story=story_of(run, world=world, scenario=scenario, events=events),
        curve=curve,
        decisive_s=decides.time_s,
        decisive_why=decides.why,
        decisive_with=_nearest_at(run, decides.time_s),
        decisive_at=_where(run, decides.time_s, world),
        world=world,
        closest_m=closest,
        closest_to=person,
        closest_s=at,
        beyond=_beyond(curve, requirement),
    )


def _closest(run: Run) -> tuple[float | None, str, float]:
    if not run.human_names or not len(run.trajectory):
        return None, "", 0.0
    gap = sampled(run).gap
    row, person = np.unravel_index(int(gap.argmin()), gap.shape)
    return float(gap[row, person]), run.human_names[int(person)], float(run.trajectory.t[row])


def _row(run: Run, t_s: float) -> int:
    return min(int(np.searchsorted(run.trajectory.t, t_s - 1e-9)), len(run.trajectory) - 1)


def _nearest_at(run: Run, t_s: float) -> str:
    if not run.human_names or not len(run.trajectory):
        return ""
    gap = sampled(run).gap[_row(run, t_s)]
    return run.human_names[int(gap.argmin())] if gap.min() <= INVOLVED_M else ""


def _where(run: Run, t_s: float, world: World) -> Place:
    row = _row(run, t_s)
    return place_namer(world)(float(run.trajectory.x[row]), float(run.trajectory.y[row]))


def _beyond(curve: Curve, requirement: Requirement) -> list[tuple[float, float]]:
    if requirement.threshold is None or not len(curve.t):
        return []
    bad = np.array([np.isfinite(v) and requirement.violated_by(float(v)) for v in curve.value])
    return [(float(curve.t[a]), float(curve.t[b])) for a, b in stretches(bad)]
