"""Feedback: what an attempt measured, for the generator that refines it.

Distances between robot and human are gaps: centre distance less both radii, so 0 is contact. What feedback takes of
each run is extracted where the run is made: a worker has all of it at hand, the campaign would have to unpack it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import SimulationError
from rvsg.core.records import Record
from rvsg.core.seeds import seed_for
from rvsg.evaluation.realism import rarest
from rvsg.evaluation.sampled import Sampled, sampled
from rvsg.evaluation.signals import least_room, series_name, series_of
from rvsg.evaluation.statistics import welch
from rvsg.evaluation.verdict import Verdict, judge, objective
from rvsg.findings.ranking import measured, standing
from rvsg.generation.generator import MET_M, Abilities, Rehearsal, Rehearse, Walked
from rvsg.runs.attempt import Attempt, Measurement, Plan
from rvsg.runs.ledger import CachedLedger
from rvsg.runs.observation import (
    FailureMode,
    RunObservation,
    Walk,
    encounter_of,
    observe,
    passings_of,
    side_of,
    stops_of,
    walks_of,
)
from rvsg.scenario.brief import Encounter, Feedback, HumanInfluence, Moment, Part, PersonAt, Reacted, Row, Sample
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Scenario
from rvsg.simulation.events import PersonReacted, in_order
from rvsg.simulation.run import Run, Trajectory
from rvsg.simulation.simulators import Simulator
from rvsg.world.world import World

Floats = NDArray[np.float64]

MEETING_M = 3.0
"""A waypoint at which a human never came nearer than this to the robot played no part in the encounter."""


def influences(people: Sequence[Human], observations: Sequence[RunObservation]) -> tuple[HumanInfluence, ...]:
    """Return what each human contributed over all runs: closest gap, share of time near, waypoints without effect.

    Args:
        people: Of the scenario.
    """
    planned = {human.name: human for human in people}
    contributions = []
    for h, person in enumerate(observations[0].people):
        seen = [part.people[h] for part in observations]
        human = planned.get(person.name)
        path = dict.fromkeys(w for task in human.tasks for w in task.path) if human is not None else {}
        idle = tuple(w for w in path if min(part.met.get(w, np.inf) for part in seen) > MEETING_M)
        contributions.append(
            HumanInfluence(
                name=person.name,
                closest_gap_m=min(part.closest_gap_m for part in seen),
                share_within_2_m=min(float(np.mean([part.share_near for part in seen])), 1.0),
                idle_waypoints=idle,
            )
        )
    return tuple(contributions)


APART_S = 3.0
"""Decisive moments of one kind that are closer together than this are one moment."""
SERIES_PERIOD_S = 1.0
ROW_PERIOD_S = 2.0


def feedback_of(
    attempt: Attempt, runs: Sequence[Run], *, requirement: Requirement, world: World, previous: Attempt | None = None
) -> Feedback:
    """Return what an attempt measured.

    Decisive moments and the series are of the run that is worst for the robot; influences are over all runs.
    Where there are too few runs for an interval, it is the mean alone.

    Args:
        runs: The runs of the attempt.
        previous: The attempt before it of the same scenario.

    Raises:
        ValueError: The attempt has no objective or no run.
    """
    by_id = {run.id: run for run in runs}
    observations = [observe(run, world) for run in runs]
    return _feedback(attempt, observations, by_id.__getitem__, requirement, world, previous)


def _feedback(
    attempt: Attempt,
    observations: Sequence[RunObservation],
    run_of: Callable[[str], Run],
    requirement: Requirement,
    world: World,
    previous: Attempt | None,
) -> Feedback:
    """Return what an attempt measured; `run_of` finds the worst run and the mildest one by their ids."""
    scenario, verdict = attempt.proposal.scenario, attempt.verdict
    if scenario is None or verdict is None or verdict.mean is None or not observations:
        raise ValueError("an attempt without an objective has no feedback")
    worst = run_of(attempt.worst(requirement).run_id)
    before = previous.verdict if previous else None
    times = [seen.ended_s for seen in observations if seen.completed]
    walks = walks_of(worst, scenario.people, world.grid)
    valued = [(m, m.objective) for m in attempt.measurements if m.objective is not None]
    several = len({m.run_id for m, _ in valued}) > 1
    mild = min(valued, key=lambda pair: requirement.badness(pair[1]))[0] if several else None
    mildest = run_of(mild.run_id) if mild is not None else None
    touched = {seen.run_id: seen.touches for seen in observations if seen.touches}
    rare = [seen.rarest for seen in observations if seen.rarest is not None and seen.rarest.is_rare]
    unusual = rarest(rare)
    judged = verdict.runs > 0 and requirement.threshold is not None
    values = series_of(worst, requirement, world=world)
    return Feedback(
        scenario=scenario,
        analysis="" if attempt.brief.kind == "tune" else attempt.proposal.reasoning,
        planned=attempt.proposal.plan,
        limits=attempt.proposal.limits,
        tuned=attempt.brief.kind == "tune",
        objectives=verdict.objectives,
        mean=verdict.mean,
        interval=verdict.interval or (verdict.mean, verdict.mean),
        violation_share=verdict.violations / verdict.runs if judged else None,
        previous_mean=before.mean if before else None,
        separable=separable(before, verdict) if before and before.mean is not None else None,
        moments=decisive_moments(worst, world),
        influences=influences(scenario.people.humans, observations),
        series=_series(worst, world, values),
        series_of=series_name(requirement),
        rows=_rows(worst, walks, world, values),
        parts=_parts(worst, values),
        least_room=least_room(worst, requirement, world=world),
        stops=stops_of(worst, world),
        reactions=_reactions(worst),
        passings=passings_of(worst, world),
        mildest=mild.objective if mild is not None else None,
        mildest_rows=_mild_rows(mildest, mild, verdict, scenario, requirement, world),
        mildest_parts=_parts(mildest, series_of(mildest, requirement, world=world)) if mildest else (),
        arrivals={human.name: walk.arrivals for walk, human in zip(walks, scenario.people.humans, strict=True)},
        arrival_s=float(np.mean(times)) if times else None,
        arrived=len(times),
        ends=tuple((round(seen.ended_s, 1), seen.completed) for seen in observations),
        capped=verdict.censored,
        touched=len(touched),
        touches=touched.get(worst.id, ()),
        touches_elsewhere=tuple(touches[0] for run_id, touches in touched.items() if run_id != worst.id),
        unusual="" if unusual is None else unusual.sentence,
        unusual_runs=len(rare),
    )


def _mild_rows(
    run: Run | None,
    measured: Measurement | None,
    verdict: Verdict,
    scenario: Scenario,
    requirement: Requirement,
    world: World,
) -> tuple[Row, ...]:
    """Return the mildest run every two seconds where it holds and others do not: why it does is what to change."""
    if run is None or measured is None or measured.objective is None or not verdict.violations:
        return ()
    if requirement.violated_by(measured.objective):
        return ()
    walks = walks_of(run, scenario.people, world.grid)
    return _rows(run, walks, world, series_of(run, requirement, world=world))


class FeedbackSource(Protocol):
    """What a strategy may ask of attempts that were made. A function of the two arguments of `__call__` is none.

    Derive a source from this class: everything but `__call__` has a default.
    """

    def __call__(self, attempt: Attempt, previous: Attempt | None) -> Feedback:
        """Return the feedback on an attempt, compared with the attempt before it (None: the first of its scenario)."""
        ...

    def encounter(self, attempt: Attempt) -> Encounter | None:
        """Return the encounter that an attempt shows, which is a small part of the work; None without people."""
        return self(attempt, None).encounter

    def failures(self, attempt: Attempt) -> tuple[FailureMode, ...]:
        """Return how the violating runs of an attempt fail; by default of the worst, as far as its encounter tells."""
        met = self.encounter(attempt) if attempt.violations else None
        return (FailureMode(place=met.place, person=met.kind, robot=""),) if met is not None else ()

    def reached(self, attempt: Attempt, *, before_closest: bool = False) -> dict[str, int]:
        """Return the last goal that each person reached in any run, as far as all runs record it; by default none.

        Args:
            before_closest: Before the closest approach of each run, not before its end.
        """
        return {}


class StoredFeedback(FeedbackSource):
    """Feedback that is computed from the stored runs of a campaign."""

    def __init__(self, ledger: CachedLedger, plan: Plan, world: World) -> None:
        self._ledger, self._plan, self._world = ledger, plan, world

    def __call__(self, attempt: Attempt, previous: Attempt | None) -> Feedback:
        """Return the feedback."""
        observations = [self._ledger.observation(m.run_id, self._world) for m in attempt.measurements]
        requirement, world = self._plan.requirement, self._world
        feedback = _feedback(attempt, observations, self._ledger.run, requirement, world, previous)
        return feedback.replace(encounter=self.encounter(attempt))

    def encounter(self, attempt: Attempt) -> Encounter | None:
        """Return the encounter of the run that is worst for the robot."""
        worst = attempt.worst(self._plan.requirement)
        return self._ledger.observation(worst.run_id, self._world).encounter

    def reached(self, attempt: Attempt, *, before_closest: bool = False) -> dict[str, int]:
        """Return the last goal that each person reached in any run, as far as all runs record it."""
        goals: dict[str, list[int | None]] = {}
        for measurement in attempt.measurements:
            for person in self._ledger.observation(measurement.run_id, self._world).people:
                goals.setdefault(person.name, []).append(person.reached_before if before_closest else person.reached)
        return {name: max(g for g in own if g is not None) for name, own in goals.items() if None not in own}

    def failures(self, attempt: Attempt) -> tuple[FailureMode, ...]:
        """Return how each run that violates the requirement fails."""
        violating = attempt.violating(self._plan.requirement)
        modes = (self._ledger.failure_mode(m.run_id, self._world) for m in violating)
        return tuple(mode for mode in modes if mode is not None)


def _every(path: Trajectory, period_s: float) -> NDArray[np.int64]:
    """Return the samples of a trajectory at every multiple of a period."""
    wanted = np.arange(0.0, float(path.t[-1]) + 1e-9, period_s) if len(path) else np.zeros(0)
    return np.clip(np.searchsorted(path.t, wanted - 1e-9), 0, len(path) - 1)


def _rows(run: Run, walks: Sequence[Walk], world: World, values: Floats | None = None) -> tuple[Row, ...]:
    """Return the run every two seconds: the robot, what everybody does, and the judged value (None: unknown).

    Args:
        walks: Of the run's people, in their order.
    """
    path, rows = run.trajectory, []
    for k in map(int, _every(path, ROW_PERIOD_S)):
        at = world.nearest_waypoints(path.human_x[k], path.human_y[k])
        away = np.hypot(path.human_x[k] - path.x[k], path.human_y[k] - path.y[k])
        everybody = {
            name: PersonAt(
                at=at[h],
                doing=walks[h].doing[k],
                side=side_of(run, k, h),
                distance_m=round(float(away[h]), 2),
                x=round(float(path.human_x[k, h]), 2),
                y=round(float(path.human_y[k, h]), 2),
            )
            for h, name in enumerate(run.human_names)
        }
        value = round(float(values[k]), 2) if values is not None and np.isfinite(values[k]) else None
        robot = world.nearest_waypoints(path.x[k : k + 1], path.y[k : k + 1])[0]
        x, y = round(float(path.x[k]), 2), round(float(path.y[k]), 2)
        rows.append(Row(time_s=round(float(path.t[k]), 1), robot_at=robot, people=everybody, value=value, x=x, y=y))
    return tuple(rows)


def _reactions(run: Run) -> tuple[Reacted, ...]:
    """Return when and where people begin to react to the robot, in order."""
    path, reactions = run.trajectory, []
    for event in in_order(event for event in run.events if isinstance(event, PersonReacted)):
        k = min(int(path.t.searchsorted(event.time_s)), len(path) - 1)
        reactions.append(
            Reacted(
                who=event.person,
                behaviour=event.behaviour.value,
                time_s=round(event.time_s, 1),
                until_s=round(event.until_s, 1),
                x=round(event.x, 2),
                y=round(event.y, 2),
                distance_m=round(math.hypot(event.x - path.x[k], event.y - path.y[k]), 2),
            )
        )
    return tuple(reactions)


def _parts(run: Run, values: Floats) -> tuple[Part, ...]:
    """Return the mean of the judged value in every quarter of the drive."""
    t = run.trajectory.t
    if not len(t):
        return ()
    parts = []
    for start, end in pairwise(np.linspace(float(t[0]), float(t[-1]), 5)):
        inside = values[(t >= start) & (t <= end)]
        inside = inside[np.isfinite(inside)]
        if len(inside):
            parts.append(
                Part(start_s=round(float(start), 1), end_s=round(float(end), 1), mean=round(float(inside.mean()), 3))
            )
    return tuple(parts)


def separable(before: Verdict, after: Verdict) -> bool:
    """Return whether the two means differ beyond noise: Welch's t test at 0.05, two-sided; never with a single run.

    Two samples without any spread are separable where they differ at all.
    """
    p = welch(before.objectives, after.objectives)
    return p is not None and p < 0.05


def decisive_moments(run: Run, world: World) -> tuple[Moment, ...]:
    """Return the two closest approaches, the hardest braking and the longest stop, in order of time."""
    path = run.trajectory
    if len(path) == 0 or path.human_x.shape[1] == 0:
        return ()
    s = sampled(run, world)
    notes = [
        (row, "contact" if s.closest_gap[row] <= 0.0 else "closest approach")
        for row in _approaches(path.t, s.closest_gap)[:2]
    ]
    if (braking := _hardest_braking(path)) is not None:
        notes.append((braking[0], f"hardest braking, {braking[1]:.1f} m/s2"))
    stops = [(float(path.t[last] - path.t[first]), first) for first, last in s.stops]
    lasts, first = max(stops, key=lambda stop: stop[0], default=(0.0, 0))
    if lasts >= 1.0:
        notes.append((first, f"stands still for {lasts:.1f} s from here"))
    chosen: dict[int, str] = {}
    for row, note in notes:
        chosen[row] = f"{chosen[row]}; {note}" if row in chosen else note
    return tuple(_moment(s, world, row, note) for row, note in sorted(chosen.items()))


def _series(run: Run, world: World, values: Floats) -> tuple[Sample, ...]:
    """Return the run once a second: where everybody was, and the series that shows where the requirement is lost."""
    path = run.trajectory
    rows = _every(path, SERIES_PERIOD_S)
    robot = world.nearest_waypoints(path.x[rows], path.y[rows])
    humans = [
        world.nearest_waypoints(path.human_x[rows, h], path.human_y[rows, h]) for h in range(path.human_x.shape[1])
    ]
    return tuple(
        Sample(
            time_s=round(float(path.t[row]), 2),
            robot_at=robot[k],
            humans_at={name: humans[h][k] for h, name in enumerate(run.human_names)},
            value=round(float(values[row]), 3) if np.isfinite(values[row]) else None,
        )
        for k, row in enumerate(rows)
    )


def _approaches(t: Floats, nearest: Floats) -> list[int]:
    """Samples at which somebody is nearer than during the seconds before and after, the nearest first."""
    approaches: list[int] = []
    firsts, ends = np.searchsorted(t, t - APART_S), np.searchsorted(t, t + APART_S)
    for index in np.argsort(nearest, kind="stable")[: int((nearest <= 2 * MEETING_M).sum())].tolist():
        alone = all(abs(t[index] - t[other]) >= APART_S for other in approaches)
        if alone and nearest[index] <= nearest[firsts[index] : ends[index]].min():
            approaches.append(index)
    return approaches


def _moment(s: Sampled, world: World, index: int, note: str) -> Moment:
    path, names = s.series, s.run.human_names
    closest = int(s.gap[index].argmin())
    near = world.nearest_waypoints(path.human_x[index], path.human_y[index])
    return Moment(
        time_s=round(float(path.t[index]), 2),
        robot_at=world.nearest_waypoints(path.x[index : index + 1], path.y[index : index + 1])[0],
        humans_at=dict(zip(names, near, strict=True)),
        closest_human=names[closest],
        gap_m=round(float(s.gap[index, closest]), 3),
        robot_speed_m_s=round(float(path.signed_speed[index]), 3),
        note=note,
    )


def _hardest_braking(path: Trajectory) -> tuple[int, float] | None:
    """Return the sample of the strongest deceleration over half a second before the robot arrives, from 0.3 m/s2 on."""
    end = float(path.t[-1]) - 1.5
    later = np.searchsorted(path.t, path.t + 0.5)
    usable = (later < len(path)) & (path.t <= end)
    if not usable.any():
        return None
    index = np.flatnonzero(usable)
    drop = (path.signed_speed[index] - path.signed_speed[later[index]]) / (path.t[later[index]] - path.t[index])
    hardest = int(drop.argmax())
    return (int(index[hardest]), float(drop[hardest])) if drop[hardest] >= 0.3 else None


WAY_S = 0.5
"""Seconds between the points of the robot's way."""


def rehearsing(
    simulator: Simulator,
    world: World,
    *,
    seed: int,
    requirement: Requirement | None = None,
    measure: Callable[[Mission], Abilities | None] = lambda mission: None,
) -> Rehearse:
    """Return the function that simulates a configuration once, with a seed that no run of the campaign has.

    With a requirement, it is measured. The drive without people also tells what `measure` says the robot can do.

    A rehearsal that the simulator cannot make is one in which nothing happens: the runs will tell why.
    """
    own = seed_for(seed, "rehearsal")

    def rehearse(mission: Mission, people: HumanConfiguration) -> Rehearsal:
        try:
            scenario = Scenario(mission=mission, people=people)
            run = simulator.run(scenario, mission.place(world), seed=own)
        except SimulationError:
            return Rehearsal(robot=(), arrival_s=None)
        rehearsal = _rehearsed(run, people, world)
        if not people.humans:
            return rehearsal.replace(abilities=measure(mission))
        if requirement is None:
            return rehearsal
        value = objective(run, requirement, world=mission.place(world))
        capped = judge(requirement, [value], arrived=[run.completed]).censored > 0
        return rehearsal.replace(value=value, capped=capped)

    return rehearse


def _rehearsed(run: Run, people: HumanConfiguration, world: World) -> Rehearsal:
    path = run.trajectory
    if not len(path):
        return Rehearsal(robot=(), arrival_s=None)
    samples = _every(path, ROW_PERIOD_S)
    at = world.nearest_waypoints(path.x[samples], path.y[samples])
    walks = walks_of(run, people, world.grid)
    along = np.unique(np.clip(np.searchsorted(path.t, np.arange(0.0, path.t[-1] + WAY_S, WAY_S)), 0, len(path) - 1))
    return Rehearsal(
        way=tuple((round(float(path.t[k]), 1), round(float(path.x[k]), 2), round(float(path.y[k]), 2)) for k in along),
        robot=tuple((round(float(path.t[k]), 1), name) for k, name in zip(samples, at, strict=True)),
        arrival_s=round(float(path.t[-1]), 1) if run.completed else None,
        people={
            human.name: _walked(run, h, walk) for h, (human, walk) in enumerate(zip(people.humans, walks, strict=True))
        },
        rows=_rows(run, walks, world) if people.humans else (),
        stops=stops_of(run, world) if people.humans else (),
    )


def _walked(run: Run, h: int, walk: Walk) -> Walked:
    path, name = run.trajectory, run.human_names[h]
    reactions = [e.time_s for e in run.events if isinstance(e, PersonReacted) and e.person == name]
    away = np.hypot(path.human_x[:, h] - path.x, path.human_y[:, h] - path.y)
    nearest = int(away.argmin())
    met = np.flatnonzero(away <= MET_M)
    stuck_s, stuck_at = walk.stuck_at or (None, None)
    return Walked(
        begins_at=walk.begins_at,
        left_s=round(walk.left_s, 1) if walk.left_s is not None else None,
        arrivals=walk.arrivals,
        stuck_at=stuck_at,
        stuck_s=round(stuck_s, 1) if stuck_s is not None else None,
        stood=tuple((round(start, 1), round(end, 1), at) for start, end, at in walk.stood),
        nearest_m=round(float(away[nearest]), 2),
        nearest_s=round(float(path.t[nearest]), 1),
        met_s=round(float(path.t[met[0]]), 1) if met.size else None,
        reacted_s=round(min(reactions), 1) if reactions else None,
    )


class MapCell(Record):
    """The worst configuration with one kind of encounter."""

    encounter: Encounter
    attempt: int
    """The attempt of the search."""
    scenario_id: str
    mean: float
    violations: int
    runs: int
    configurations: int
    """How many configurations show this encounter."""


def failure_map(
    attempts: Sequence[Attempt], requirement: Requirement, *, run_of: Callable[[str], Run], world: World
) -> tuple[MapCell, ...]:
    """Return the worst configuration of every kind of encounter among the attempts of a search, the worst first."""
    cells: dict[Encounter, list[Attempt]] = {}
    for attempt in measured(attempts):
        encounter = encounter_of(run_of(attempt.worst(requirement).run_id), world)
        if encounter is not None:
            cells.setdefault(encounter, []).append(attempt)

    def rank(attempt: Attempt) -> tuple[tuple[float, float], int]:
        return standing(attempt, requirement), -attempt.index

    rows = []
    ranked = sorted(((max(own, key=rank), met) for met, own in cells.items()), key=lambda p: rank(p[0]), reverse=True)
    for worst, encounter in ranked:
        scenario_id, mean = worst.scenario_id, worst.mean
        assert scenario_id is not None and mean is not None
        rows.append(
            MapCell(
                encounter=encounter,
                attempt=worst.index,
                scenario_id=scenario_id,
                mean=mean,
                violations=worst.violations,
                runs=worst.valued_runs,
                configurations=len(cells[encounter]),
            )
        )
    return tuple(rows)
