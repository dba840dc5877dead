"""Feedback: what an attempt measured, for the generator that refines it.

Distances between robot and human are gaps: centre distance less both radii, so 0 is contact. What feedback takes of
each run is extracted where the run is made: a worker has all of it at hand, the campaign would have to unpack it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rvsg.campaign.attempt import Attempt, Measurement, Plan
from rvsg.campaign.ledger import CachedLedger
from rvsg.campaign.observation import (
    FailureMode,
    RunObservation,
    Walk,
    arrivals,
    encounter_of,
    observe,
    passings_of,
    side_of,
    stops_of,
    walks_of,
)
from rvsg.campaign.ranking import measured, standing
from rvsg.core.errors import SimulationError
from rvsg.core.records import Record
from rvsg.core.seeds import seed_for
from rvsg.evaluation.run_events import WaypointNames
from rvsg.evaluation.sampled import sampled
from rvsg.evaluation.signals import series_name, series_of
from rvsg.evaluation.statistics import welch
from rvsg.evaluation.verdict import Verdict
from rvsg.generation.generator import MET_M, Rehearsal, Rehearse, Walked
from rvsg.scenario.brief import Encounter, Feedback, HumanInfluence, Moment, Part, PersonAt, Row, Sample, Tried
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Scenario
from rvsg.scenario.variation import differences
from rvsg.simulation.run import Run, Trajectory
from rvsg.simulation.simulators import Simulator
from rvsg.world.grid import Grid
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
    found = []
    for h, person in enumerate(observations[0].people):
        seen = [each.people[h] for each in observations]
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


APART_S = 3.0
"""Decisive moments of one kind that are closer together than this are one moment."""
SERIES_PERIOD_S = 1.0
ROW_PERIOD_S = 2.0


def feedback_of(
    attempt: Attempt,
    runs: Sequence[Run],
    *,
    requirement: Requirement,
    grid: Grid,
    previous: Attempt | None = None,
    moments: int = 4,
    world: World | None = None,
) -> Feedback:
    """Return what an attempt measured.

    Decisive moments and the series are of the run that is worst for the robot; influences are over all runs.
    Where there are too few runs for an interval, it is the mean alone.

    Args:
        runs: The runs of the attempt.
        previous: The attempt before it of the same scenario.
        world: Needed where the requirement concerns obstacles, and for stops and passings.

    Raises:
        ValueError: The attempt has no objective or no run.
    """
    by_id = {run.id: run for run in runs}
    return feedback_from(
        attempt,
        [observe(run, grid, world) for run in runs],
        by_id.__getitem__,
        requirement=requirement,
        grid=grid,
        previous=previous,
        moments=moments,
        world=world,
    )


def feedback_from(
    attempt: Attempt,
    observations: Sequence[RunObservation],
    run_of: Callable[[str], Run],
    *,
    requirement: Requirement,
    grid: Grid,
    previous: Attempt | None = None,
    moments: int = 4,
    world: World | None = None,
) -> Feedback:
    """Return what an attempt measured, as `feedback_of` does, from what was observed of each run.

    Args:
        run_of: Finds a run by its id; asked for the worst run and the mildest one.
    """
    scenario, verdict = attempt.proposal.scenario, attempt.verdict
    if scenario is None or verdict is None or verdict.mean is None or not observations:
        raise ValueError("an attempt without an objective has no feedback")
    worst = run_of(worst_measurement(attempt, requirement).run_id)
    before = previous.verdict if previous else None
    times = [each.ended_s for each in observations if each.completed]
    walks = walks_of(worst, scenario.people, grid)
    mild = mildest_measurement(attempt, requirement)
    touched = {each.run_id: each.touches for each in observations if each.touches}
    return Feedback(
        scenario=scenario,
        analysis="" if attempt.brief.kind == "tune" else attempt.proposal.reasoning,
        planned=attempt.proposal.plan,
        tuned=attempt.brief.kind == "tune",
        objectives=verdict.objectives,
        mean=verdict.mean,
        interval=verdict.interval or (verdict.mean, verdict.mean),
        violation_share=verdict.violations / verdict.runs
        if verdict.runs and requirement.threshold is not None
        else None,
        previous_mean=before.mean if before else None,
        separable=separable(before, verdict) if before and before.mean is not None else None,
        moments=decisive_moments(worst, grid, world, at_most=moments),
        influences=influences(scenario.people.humans, observations),
        series=series(worst, grid, requirement, world),
        series_of=series_name(requirement),
        rows=rows_of(worst, walks, grid, series_of(worst, requirement, world=world)),
        parts=parts_of(worst, requirement, world),
        stops=stops_of(worst, world) if world is not None else (),
        passings=passings_of(worst, world) if world is not None else (),
        mildest=mild.objective if mild is not None else None,
        mildest_parts=parts_of(run_of(mild.run_id), requirement, world) if mild is not None else (),
        arrivals={
            human.name: arrivals(walk, human, grid) for walk, human in zip(walks, scenario.people.humans, strict=True)
        },
        arrival_s=float(np.mean(times)) if times else None,
        arrived=len(times),
        capped=verdict.censored,
        touched=len(touched),
        touches=touched.get(worst.id, ()),
        touches_elsewhere=tuple(touches[0] for run, touches in touched.items() if run != worst.id),
    )


class FeedbackSource(Protocol):
    """What a strategy may ask of attempts that were made. A function of the two arguments of `__call__` is none.

    Derive a source from this class: everything but `__call__` and `attempt` has a default.
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


class StoredFeedback(FeedbackSource):
    """Feedback that is computed from the stored runs of a campaign."""

    def __init__(self, ledger: CachedLedger, plan: Plan, world: World) -> None:
        self._ledger, self._plan, self._world = ledger, plan, world

    def __call__(self, attempt: Attempt, previous: Attempt | None) -> Feedback:
        """Return the feedback."""
        requirement, world = self._plan.requirement, self._world
        found = feedback_from(
            attempt,
            [self._ledger.observation(measurement.run_id, world) for measurement in attempt.measurements],
            self._ledger.run,
            requirement=requirement,
            grid=world.grid,
            previous=previous,
            world=world,
        )
        return found.replace(encounter=self.encounter(attempt))

    def encounter(self, attempt: Attempt) -> Encounter | None:
        """Return the encounter of the run that is worst for the robot."""
        worst = worst_measurement(attempt, self._plan.requirement)
        return self._ledger.observation(worst.run_id, self._world).encounter

    def failures(self, attempt: Attempt) -> tuple[FailureMode, ...]:
        """Return how each run that violates the requirement fails."""
        requirement = self._plan.requirement
        violating = (
            m for m in attempt.measurements if m.objective is not None and requirement.violated_by(m.objective)
        )
        modes = (self._ledger.failure_mode(m.run_id, self._world) for m in violating)
        return tuple(mode for mode in modes if mode is not None)


def with_history(
    feedback: Feedback, attempts: Sequence[Attempt], requirement: Requirement, *, most: int = 8
) -> Feedback:
    """Return the feedback with the best configuration of the scenario so far, and the last ones that were tried.

    The best is of all that were tried, those that a racing strategy ran once among them: the runs stand beside each.

    Args:
        attempts: The attempts of the scenario, in order.
        most: How many tried configurations to keep.
    """
    known = [(a, a.mean) for a in measured(attempts) if a.mean is not None]
    judged = requirement.threshold is not None
    tried = [
        Tried(
            mean=mean,
            change=_change(known[place - 1][0], attempt) if place else "first configuration",
            runs=attempt.valued_runs,
            violations=attempt.violations if judged else None,
        )
        for place, (attempt, mean) in enumerate(known)
        if len(known) > 1 and place >= len(known) - most
    ]
    best, best_mean = max(known, key=lambda each: requirement.badness(each[1]), default=(None, None))
    worse = best_mean is not None and requirement.badness(best_mean) > requirement.badness(feedback.mean)
    return feedback.replace(
        best=best.proposal.scenario if best is not None and worse else None,
        best_mean=best_mean,
        best_runs=best.valued_runs if best is not None else 0,
        tried=tuple(tried),
    )


def _change(before: Attempt, after: Attempt) -> str:
    """What an attempt changed against another one, in one line."""
    first, second = before.proposal.scenario, after.proposal.scenario
    assert first is not None and second is not None
    return differences(first.people, second.people)


def rows_of(run: Run, walks: Sequence[Walk], grid: Grid, values: Floats | None = None) -> tuple[Row, ...]:
    """Return the run every two seconds: the robot, what everybody does, and the judged value (None: unknown).

    Args:
        walks: Of the run's people, in their order.
    """
    path = run.trajectory
    if len(path) == 0:
        return ()
    wanted = np.arange(0.0, float(path.t[-1]) + 1e-9, ROW_PERIOD_S)
    samples = np.clip(np.searchsorted(path.t, wanted - 1e-9), 0, len(path) - 1)
    names = WaypointNames(grid)
    found = []
    for k in map(int, samples):
        at = names.nearest(path.human_x[k], path.human_y[k])
        away = np.hypot(path.human_x[k] - path.x[k], path.human_y[k] - path.y[k])
        everybody = {
            name: PersonAt(
                at=at[h], doing=walks[h].doing[k], side=side_of(run, k, h), distance_m=round(float(away[h]), 2)
            )
            for h, name in enumerate(run.human_names)
        }
        value = round(float(values[k]), 2) if values is not None and np.isfinite(values[k]) else None
        robot = names.nearest(path.x[k : k + 1], path.y[k : k + 1])[0]
        found.append(Row(time_s=round(float(path.t[k]), 1), robot_at=robot, people=everybody, value=value))
    return tuple(found)


def parts_of(run: Run, requirement: Requirement, world: World | None = None) -> tuple[Part, ...]:
    """Return the mean of the judged value in every quarter of the drive."""
    t, values = run.trajectory.t, series_of(run, requirement, world=world)
    if not len(t):
        return ()
    edges = np.linspace(float(t[0]), float(t[-1]), 5)
    found = []
    for start, end in pairwise(edges):
        inside = values[(t >= start) & (t <= end)]
        inside = inside[np.isfinite(inside)]
        if len(inside):
            found.append(
                Part(start_s=round(float(start), 1), end_s=round(float(end), 1), mean=round(float(inside.mean()), 3))
            )
    return tuple(found)


def worst_run(attempt: Attempt, runs: Sequence[Run], requirement: Requirement) -> Run:
    """Return the run of the attempt whose objective is worst for the robot; the first of equals."""
    worst = worst_measurement(attempt, requirement).run_id
    return next(run for run in runs if run.id == worst)


def worst_measurement(attempt: Attempt, requirement: Requirement) -> Measurement:
    """Return the measurement of the attempt whose objective is worst for the robot; the first of equals."""
    return max(attempt.measurements, key=lambda m: -np.inf if m.objective is None else requirement.badness(m.objective))


def mildest_measurement(attempt: Attempt, requirement: Requirement) -> Measurement | None:
    """Return the measurement whose objective is least bad for the robot; None where there is only one to choose."""
    known = [(m, m.objective) for m in attempt.measurements if m.objective is not None]
    if len({m.run_id for m, _ in known}) < 2:
        return None
    return min(known, key=lambda each: requirement.badness(each[1]))[0]


def separable(before: Verdict, after: Verdict) -> bool:
    """Return whether the two means differ beyond noise: Welch's t test at 0.05, two-sided; never with a single run.

    Two samples without any spread are separable where they differ at all.
    """
    p = welch(before.objectives, after.objectives)
    return p is not None and p < 0.05


def gaps(run: Run, world: World | None = None) -> Floats:
    """Return (N, H) the gap in metres between robot and each human at every sample of the trajectory."""
    return sampled(run, world).gap


def decisive_moments(run: Run, grid: Grid, world: World | None = None, *, at_most: int = 4) -> tuple[Moment, ...]:
    """Return the closest approaches, the hardest braking and the longest stop, in order of time."""
    path = run.trajectory
    if len(path) == 0 or path.human_x.shape[1] == 0:
        return ()
    gap = gaps(run, world)
    nearest = gap.min(axis=1)
    found = [
        (index, "contact" if nearest[index] <= 0.0 else "closest approach")
        for index in _approaches(path.t, nearest)[: max(1, at_most - 2)]
    ]
    braking = _hardest_braking(path)
    if braking is not None:
        found.append((braking[0], f"hardest braking, {braking[1]:.1f} m/s2"))
    stop = _longest_stop(path)
    if stop is not None:
        found.append((stop[0], f"stands still for {stop[1]:.1f} s from here"))
    names = WaypointNames(grid)
    chosen: dict[int, str] = {}
    for index, note in found[:at_most]:
        chosen[index] = f"{chosen[index]}; {note}" if index in chosen else note
    return tuple(_moment(run, gap, index, note, names) for index, note in sorted(chosen.items()))


def series(run: Run, grid: Grid, requirement: Requirement, world: World | None = None) -> tuple[Sample, ...]:
    """Return the run once a second: where everybody was, and the series that shows where the requirement is lost."""
    path = run.trajectory
    if len(path) == 0:
        return ()
    wanted = np.arange(0.0, float(path.t[-1]) + 1e-9, SERIES_PERIOD_S)
    rows = np.clip(np.searchsorted(path.t, wanted - 1e-9), 0, len(path) - 1)
    values = series_of(run, requirement, world=world)[rows]
    names = WaypointNames(grid)
    robot = names.nearest(path.x[rows], path.y[rows])
    humans = [names.nearest(path.human_x[rows, h], path.human_y[rows, h]) for h in range(path.human_x.shape[1])]
    return tuple(
        Sample(
            time_s=round(float(path.t[row]), 2),
            robot_at=robot[k],
            humans_at={name: humans[h][k] for h, name in enumerate(run.human_names)},
            value=round(float(values[k]), 3) if np.isfinite(values[k]) else None,
        )
        for k, row in enumerate(rows)
    )


def _approaches(t: Floats, nearest: Floats) -> list[int]:
    """Samples at which somebody is nearer than during the seconds before and after, the nearest first."""
    found: list[int] = []
    firsts, ends = np.searchsorted(t, t - APART_S), np.searchsorted(t, t + APART_S)
    for index in np.argsort(nearest, kind="stable")[: int((nearest <= 2 * MEETING_M).sum())].tolist():
        alone = all(abs(t[index] - t[other]) >= APART_S for other in found)
        if alone and nearest[index] <= nearest[firsts[index] : ends[index]].min():
            found.append(index)
    return found


def _moment(run: Run, gap: Floats, index: int, note: str, names: WaypointNames) -> Moment:
    path = run.trajectory
    closest = int(gap[index].argmin())
    return Moment(
        time_s=round(float(path.t[index]), 2),
        robot_at=names.nearest(path.x[index : index + 1], path.y[index : index + 1])[0],
        humans_at=dict(zip(run.human_names, names.nearest(path.human_x[index], path.human_y[index]), strict=True)),
        closest_human=run.human_names[closest],
        gap_m=round(float(gap[index, closest]), 3),
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


def _longest_stop(path: Trajectory) -> tuple[int, float] | None:
    """The first sample and the duration (s) of the longest standstill of at least 1 s after the robot first moved."""
    moving = (path.speed >= 0.01) | (np.abs(path.omega) >= 0.02)
    if not moving.any():
        return None
    best: tuple[int, float] | None = None
    begin: int | None = None
    for index in range(int(moving.argmax()), len(path)):
        if moving[index]:
            begin = None
            continue
        begin = index if begin is None else begin
        lasted = float(path.t[index] - path.t[begin])
        if lasted >= 1.0 and (best is None or lasted > best[1]):
            best = (begin, lasted)
    return best


PERIOD_S = 2.0
WAY_S = 0.5
"""Seconds between the points of the robot's way."""


def rehearsing(simulator: Simulator, world: World, *, seed: int) -> Rehearse:
    """Return the function that simulates a configuration once, with a seed that no run of the campaign has.

    A rehearsal that the simulator cannot make is one in which nothing happens: the runs will tell why.
    """
    own = seed_for(seed, "rehearsal")

    def rehearse(mission: Mission, people: HumanConfiguration) -> Rehearsal:
        try:
            scenario = Scenario(mission=mission, people=people)
            run = simulator.run(scenario, mission.place(world), seed=own)
        except SimulationError:
            return Rehearsal(robot=(), arrival_s=None)
        return in_short(run, people, world)

    return rehearse


def in_short(run: Run, people: HumanConfiguration, world: World) -> Rehearsal:
    """Return a run in short."""
    path = run.trajectory
    if not len(path):
        return Rehearsal(robot=(), arrival_s=None)
    wanted = np.arange(0.0, float(path.t[-1]) + 1e-9, PERIOD_S)
    samples = np.clip(np.searchsorted(path.t, wanted - 1e-9), 0, len(path) - 1)
    at = WaypointNames(world.grid).nearest(path.x[samples], path.y[samples])
    walks = walks_of(run, people, world.grid)
    along = np.unique(np.clip(np.searchsorted(path.t, np.arange(0.0, path.t[-1] + WAY_S, WAY_S)), 0, len(path) - 1))
    return Rehearsal(
        way=tuple((round(float(path.t[k]), 1), round(float(path.x[k]), 2), round(float(path.y[k]), 2)) for k in along),
        robot=tuple((round(float(path.t[k]), 1), name) for k, name in zip(samples, at, strict=True)),
        arrival_s=round(float(path.t[-1]), 1) if run.completed else None,
        people={
            human.name: _walked(run, h, human, walk, world)
            for h, (human, walk) in enumerate(zip(people.humans, walks, strict=True))
        },
        rows=rows_of(run, walks, world.grid) if people.humans else (),
    )


def _walked(run: Run, h: int, human: Human, walk: Walk, world: World) -> Walked:
    path = run.trajectory
    away = np.hypot(path.human_x[:, h] - path.x, path.human_y[:, h] - path.y)
    nearest = int(away.argmin())
    met = np.flatnonzero(away <= MET_M)
    stuck_s, stuck_at = walk.stuck_at or (None, None)
    return Walked(
        begins_at=walk.goals[0],
        left_s=round(walk.left_s, 1) if walk.left_s is not None else None,
        arrivals=arrivals(walk, human, world.grid),
        stuck_at=stuck_at,
        stuck_s=round(stuck_s, 1) if stuck_s is not None else None,
        stood=tuple((round(start, 1), round(end, 1), at) for start, end, at in walk.stood),
        nearest_m=round(float(away[nearest]), 2),
        nearest_s=round(float(path.t[nearest]), 1),
        met_s=round(float(path.t[met[0]]), 1) if met.size else None,
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
        worst = worst_run(attempt, [run_of(m.run_id) for m in attempt.measurements], requirement)
        encounter = encounter_of(worst, world)
        if encounter is not None:
            cells.setdefault(encounter, []).append(attempt)
    ranked = [(max(found, key=lambda a: _rank(a, requirement)), encounter) for encounter, found in cells.items()]
    ranked.sort(key=lambda pair: _rank(pair[0], requirement), reverse=True)
    return tuple(_cell(attempt, encounter, len(cells[encounter])) for attempt, encounter in ranked)


def filled(cells: Iterable[MapCell]) -> tuple[int, int]:
    """Return how many cells there are, and how many of them hold a violation."""
    listed = list(cells)
    return len(listed), sum(cell.violations > 0 for cell in listed)


def _rank(attempt: Attempt, requirement: Requirement) -> tuple[float, float, int]:
    share, badness = standing(attempt, requirement)
    return (share, badness, -attempt.index)


def _cell(attempt: Attempt, encounter: Encounter, configurations: int) -> MapCell:
    scenario, verdict = attempt.proposal.scenario, attempt.verdict
    assert scenario is not None
    assert verdict is not None
    assert verdict.mean is not None
    return MapCell(
        encounter=encounter,
        attempt=attempt.index,
        scenario_id=scenario.id,
        mean=verdict.mean,
        violations=verdict.violations,
        runs=verdict.runs,
        configurations=configurations,
    )
