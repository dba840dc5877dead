"""Facts about a run: its judged quantity over time, its worst moment and its causes.

The values come from the requirement's own metric or formula, applied to the first part of the run. So the curve of a
mean is its running mean, the curve of a minimum is the minimum so far, the curve of a formula is its robustness so
far, and every curve ends at the objective that the verdict uses. Plug-in metrics need nothing extra.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.detection import events_of
from rvsg.evaluation.metrics import find_metric
from rvsg.evaluation.sampled import sampled, stretches
from rvsg.evaluation.story import Sentence, story_of
from rvsg.evaluation.verdict import objective
from rvsg.robots.robot import Robot
from rvsg.runs.attempt import Attempt, Measurement
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.events import Contact, Outcome, Recovery, RunEvent, StandStill
from rvsg.simulation.run import Run
from rvsg.world.world import World

Floats = NDArray[np.float64]

POINTS = 80
IMU_RATE_HZ = 100.0
INVOLVED_M = 2.0
"""A person who never comes nearer to the robot than this, surface to surface, is drawn grey."""
SETTLED_S = 1.5
"""A mean over fewer seconds than this says little, so its swings do not count as decisive."""


@dataclass(frozen=True, eq=False)
class Curve:
    """The judged quantity at increasing times (s); NaN where the first part of the run holds no judgement."""

    t: Floats
    value: Floats

    @property
    def is_known(self) -> bool:
        """Return whether the curve has at least two values."""
        return int(np.isfinite(self.value).sum()) >= 2


def prefix(run: Run, end: int) -> Run:
    """Return the run as if it had ended, at its goal, with sample `end` - 1 of its trajectory."""
    if end >= len(run.trajectory):
        return run
    t_s = float(run.trajectory.t[end - 1])
    trajectory = log = run.trajectory.at(slice(max(1, end)))
    if run.log is not run.trajectory:
        rows = int(np.searchsorted(run.log.t * run.clock_ratio, t_s, side="right"))
        log = run.log.at(slice(max(1, rows)))
    imu = run.imu[: round(t_s * IMU_RATE_HZ) + 1]
    return dataclasses.replace(run, trajectory=trajectory, log=log, imu=imu, outcome=Outcome.REACHED)


def judged_curve(run: Run, requirement: Requirement, world: World | None) -> Curve:
    """Return the judged quantity at about `POINTS` moments of the run, the last being its end."""
    samples = len(run.trajectory)
    if samples < 2:
        return Curve(np.empty(0), np.empty(0))
    ends = np.unique(np.linspace(2, samples, min(POINTS, samples - 1)).round().astype(int))
    metric = find_metric(requirement.metric)
    if metric is not None and metric.so_far is not None and metric.series == "trajectory":
        values = metric.so_far(sampled(run, world))[ends - 1]
        ends_at = objective(run, requirement, world=world)
        values[-1] = np.nan if ends_at is None else ends_at
    else:
        objectives = [objective(prefix(run, int(end)), requirement, world=world) for end in ends]
        values = np.array([np.nan if value is None else value for value in objectives])
    return Curve(run.trajectory.t[ends - 1], values)


def decisive(run: Run, requirement: Requirement, curve: Curve) -> float:
    """Return the moment (s) that decides the requirement in this run.

    A quantity that only gets worse (a minimum, a count) is decided where it passes its limit, else where it got its
    final value. A quantity that rises with the clock is decided where the robot loses most time. A mean is decided
    where the run adds most to it. Without a curve it is the closest approach.
    """
    finite = np.isfinite(curve.value)
    t, worse = curve.t[finite], np.array([requirement.badness(float(v)) for v in curve.value[finite]])
    closest = closest_approach(run)
    if len(t) < 3 or np.ptp(worse) == 0.0:
        return closest
    limit = requirement.badness(requirement.threshold) if requirement.threshold is not None else None
    if np.allclose(worse[:-1] - worse[0], t[:-1] - t[0], atol=0.15):
        lost = _least_way(run)
        return lost if lost is not None else closest
    if (np.diff(worse) >= -1e-9).all():
        if limit is not None and worse[-1] > limit:
            return float(t[int(np.argmax(worse > limit))])
        return float(t[int(np.argmax(worse >= worse[-1] - 1e-9))])
    contribution = np.diff(t * worse) / np.diff(t)  # of a running mean: the mean over each step
    contribution[t[1:] < SETTLED_S] = -np.inf
    if not np.isfinite(contribution).any():
        return closest
    return float(t[1:][int(contribution.argmax())])


def row_at(run: Run, t_s: float) -> int:
    """Return the first sample of a run that is not before a time, or the last one."""
    return min(int(np.searchsorted(run.trajectory.t, t_s - 1e-9)), len(run.trajectory) - 1)


def closest_approach(run: Run) -> float:
    """Return the time (s) at which robot and people are nearest; 0 without people."""
    closest = sampled(run).closest_approach
    return float(run.trajectory.t[closest[0]]) if closest is not None else 0.0


def _least_way(run: Run) -> float | None:
    """Return when the robot, once under way, makes least way in the next 3 s; None where it is never under way."""
    path = run.trajectory
    travelled = np.concatenate([[0.0], np.hypot(np.diff(path.x), np.diff(path.y)).cumsum()])
    later = np.searchsorted(path.t, path.t + 3.0)
    usable = np.flatnonzero((later < len(path)) & (travelled > 0.1))
    if not len(usable):
        return None
    return float(path.t[usable[int((travelled[later[usable]] - travelled[usable]).argmin())]])


@dataclass(frozen=True, kw_only=True, eq=False)
class RunFacts:
    """A run and what happened in it. `closest_m`, `closest_s`: the smallest gap to a person, and when."""

    run: Run
    measurement: Measurement
    violated: bool
    events: tuple[RunEvent, ...]
    story: tuple[Sentence, ...]
    curve: Curve
    decisive_s: float
    decisive_at: tuple[float, float]
    """Where the robot is then, metres."""
    closest_m: float | None
    closest_s: float

    @property
    def id(self) -> str:
        """The id of the run."""
        return self.run.id

    @property
    def arrived(self) -> bool:
        """Return whether the robot reached its goal in time."""
        return self.run.completed

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts of the robot with people."""
        return tuple(event for event in self.events if isinstance(event, Contact))

    @property
    def lanes(self) -> dict[str, list[tuple[float, float]]]:
        """The spells that the timeline of the replay shows, in seconds."""
        return {
            "contact": [(e.time_s, e.until_s) for e in self.contacts],
            "standing": [(e.time_s, e.until_s) for e in self.events if isinstance(e, StandStill)],
            "recovery": [(e.time_s, e.until_s) for e in self.events if isinstance(e, Recovery)],
            "violated": self.beyond,
        }

    beyond: list[tuple[float, float]]
    """When the judged quantity is beyond its limit, seconds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AttemptFacts:
    """The runs of one configuration."""

    attempt: Attempt
    runs: tuple[RunFacts, ...]


def facts_of(
    attempts: Iterable[Attempt], requirement: Requirement, world: World, run_of: Callable[[str], Run]
) -> list[AttemptFacts]:
    """Return the facts of every attempt that was simulated, in the order of the attempts."""
    facts = []
    by_run: dict[str, RunFacts] = {}  # a strategy may measure a configuration several times, each time in more runs
    for attempt in attempts:
        for measured in attempt.measurements:
            if measured.run_id not in by_run:
                run, scenario = run_of(measured.run_id), attempt.proposal.scenario
                by_run[measured.run_id] = run_facts(run, measured, requirement, world, scenario)
        if attempt.measurements:
            facts.append(AttemptFacts(attempt=attempt, runs=tuple(by_run[m.run_id] for m in attempt.measurements)))
    return facts


def run_facts(
    run: Run, measurement: Measurement, requirement: Requirement, world: World, scenario: Scenario | None = None
) -> RunFacts:
    """Return the facts of one run."""
    if scenario is not None:
        world = scenario.mission.place(world)
    curve = judged_curve(run, requirement, world)
    events = events_of(run, world=world, scenario=scenario)
    decisive_s = decisive(run, requirement, curve)
    objective = measurement.objective
    seen, row = sampled(run), row_at(run, decisive_s)
    closest = float(seen.gap[seen.closest_approach]) if seen.closest_approach is not None else None
    bad = np.array([np.isfinite(v) and requirement.violated_by(float(v)) for v in curve.value], np.bool_)
    return RunFacts(
        run=run,
        measurement=measurement,
        violated=objective is not None and requirement.violated_by(objective),
        events=events,
        story=story_of(run, world=world, scenario=scenario, events=events),
        curve=curve,
        decisive_s=decisive_s,
        decisive_at=(round(float(run.trajectory.x[row]), 3), round(float(run.trajectory.y[row]), 3)),
        closest_m=closest,
        closest_s=closest_approach(run),
        beyond=[(float(curve.t[a]), float(curve.t[b])) for a, b in stretches(bad)],
    )


EDGES = 24


def footprint_of(run: Run, robot: Robot | None) -> Sequence[tuple[float, float]]:
    """Return the robot's outline in its own frame: metres, x ahead, y to the left.

    A robot that is not given is drawn with the outline that the run keeps, and without that as the disc with which the
    run measures gaps.
    """
    if robot is not None:
        return robot.footprint
    if run.robot_outline:
        return run.robot_outline
    angles = [2 * math.pi * k / EDGES for k in range(EDGES)]
    return tuple((run.robot_radius_m * math.cos(a), run.robot_radius_m * math.sin(a)) for a in angles)
