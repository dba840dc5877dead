"""Ranking of configurations by how badly the robot did: by one requirement, and by several at once.

What is ranked, confirmed and reported goes by the share of runs that violate the limit, then by the mean objective.
By the mean alone, a scenario that never violates could rank before one that does in two of three runs. Without a
limit the mean alone ranks, as in the published study. What steers the search (such as the memory) goes by the mean
alone. With a handful of runs the share takes few values and hides whether a refinement came closer to a violation.

With several requirements, a value is given as a share of what violates: 1 is the limit, more is beyond it. 0 is twice
the limit where small values are bad, and 0 where large ones are. The hypervolume is the volume that the Pareto front
dominates above 0, so 1 is what one configuration exactly at all limits has. Neither depends on what else was found, so
campaigns can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Record
from rvsg.runs.attempt import Attempt, Measurement, Plan
from rvsg.scenario.brief import Remembered
from rvsg.scenario.requirement import Requirement


def search_attempts(attempts: Iterable[Attempt]) -> list[Attempt]:
    """Return the attempts of the search; a confirmation never takes part in a selection."""
    return [attempt for attempt in attempts if attempt.purpose == "search"]


def rule(requirement: Requirement) -> str:
    """Return the ranking rule as a sentence."""
    if requirement.threshold is None:
        return "Ranked by the mean objective."
    return "Ranked by the share of runs that violate the limit, then by the mean objective."


def standing(attempt: Attempt, requirement: Requirement) -> tuple[float, float]:
    """Return the share of runs that violate the limit (0 without one) and the badness of the mean; larger is worse.

    ValueError if nothing of the attempt was measured.
    """
    if attempt.mean is None:
        raise ValueError("an attempt without an objective has no standing")
    judged = requirement.threshold is not None and attempt.valued_runs > 0
    return (attempt.violations / attempt.valued_runs if judged else 0.0, requirement.badness(attempt.mean))


def measured(attempts: Iterable[Attempt]) -> list[Attempt]:
    """Return the attempts of the search that have an objective, without those that a later one contains.

    An attempt contains an earlier one of the same scenario where it repeats all of its seeds and adds others.
    """
    kept: list[Attempt] = []
    last: dict[str, int] = {}
    for attempt in search_attempts(attempts):
        if attempt.mean is None or attempt.scenario_id is None:
            continue
        before = last.get(attempt.scenario_id)
        if before is not None and seeds_of(kept[before]) < seeds_of(attempt):
            kept[before] = attempt
            continue
        last[attempt.scenario_id] = len(kept)
        kept.append(attempt)
    return kept


def seeds_of(attempt: Attempt) -> frozenset[int]:
    """Return the seeds of all runs of an attempt, those that failed included."""
    return frozenset(attempt.seeds)


def in_full(attempts: Iterable[Attempt]) -> list[Attempt]:
    """Return the measured attempts that were not given up early: those with at least half the runs of the most run.

    A strategy that races stops measuring what falls behind. One or two lucky runs do not make a best configuration.
    """
    known = measured(attempts)
    most = max((len(seeds_of(attempt)) for attempt in known), default=0)
    return [attempt for attempt in known if 2 * len(seeds_of(attempt)) >= most]


def best_attempt(attempts: Iterable[Attempt], requirement: Requirement) -> Attempt | None:
    """Return the search attempt that ranks first among those measured in full; the earliest of equals; None without."""
    return max(in_full(attempts), key=lambda a: (standing(a, requirement), -a.index), default=None)


def confirmed_candidate(confirmation: Attempt, attempts: Iterable[Attempt]) -> Attempt | None:
    """Return the attempt of the search whose scenario a confirmation runs again; None if it is not stored.

    They belong together by the scenario. A racing strategy may have measured it in several attempts: the one with most
    runs stands for them.
    """
    scenario = confirmation.proposal.scenario
    tried = [a for a in measured(attempts) if scenario is not None and a.scenario_id == scenario.id]
    return max(tried, key=lambda a: (len(seeds_of(a)), a.index), default=None)


def by_scenario(attempts: Iterable[Attempt]) -> list[list[Attempt]]:
    """Return the attempts of the search that have an objective, scenario by scenario."""
    groups: dict[int, list[Attempt]] = {}
    for attempt in measured(attempts):
        groups.setdefault(attempt.scenario_index, []).append(attempt)
    return [group for _, group in sorted(groups.items())]


def ranking(attempts: Iterable[Attempt], requirement: Requirement) -> list[Attempt]:
    """The best attempt of every scenario, the one that is worst for the robot first; the earlier of equals first."""
    best = (best_attempt(group, requirement) for group in by_scenario(attempts))
    chosen = sorted((attempt for attempt in best if attempt is not None), key=lambda a: a.index)
    return sorted(chosen, key=lambda a: standing(a, requirement), reverse=True)


def confirmations(attempts: Iterable[Attempt]) -> list[Attempt]:
    """Return the confirmations, in order; of a scenario that was confirmed again or longer, the last one."""
    latest: dict[str | int | None, Attempt] = {}
    for attempt in attempts:
        if attempt.purpose == "confirmation":
            latest[attempt.index if attempt.confirms is None else attempt.scenario_id] = attempt
    return sorted(latest.values(), key=lambda a: a.index)


def candidates(attempts: Iterable[Attempt], requirement: Requirement) -> list[Attempt]:
    """Return the configurations worth confirming, in order.

    First the worst configuration of every scenario that violated the limit, the worst scenario first; then the other
    configurations that did. Where none did, or there is no limit, the configuration that ranks first.
    """
    known = list(attempts)
    ordered = ranking(known, requirement)
    first = ordered[:1]
    ordered += sorted(in_full(known), key=lambda a: standing(a, requirement), reverse=True)
    distinct = {attempt.index: attempt for attempt in ordered}
    return [attempt for attempt in distinct.values() if standing(attempt, requirement)[0] > 0.0] or first


REHEARSAL = -1
"""In the place of the seed of a rehearsal, which is the same for all."""


def badness_of(attempt: Attempt, requirement: Requirement) -> dict[int, float]:
    """Return the badness of the runs of an attempt by their seeds, and of the rehearsal of its configuration."""
    scenario, proposal = attempt.proposal.scenario, attempt.proposal
    situation = scenario.situation if scenario is not None else ""
    rehearsed = [(REHEARSAL, value) for each, value in proposal.rehearsals if each.situation == situation]
    values = dict([*rehearsed, *((m.seed, m.objective) for m in attempt.measurements if m.objective is not None)])
    return {seed: requirement.badness(value) for seed, value in values.items()}


def remember(
    attempts: Iterable[Attempt],
    requirement: Requirement,
    *,
    last: int,
    best: Mapping[int, Attempt] | None = None,
) -> tuple[Remembered, ...]:
    """Return the memory for a new scenario: the `last` scenarios, each by its best configuration.

    Args:
        best: The best configuration of scenarios, by their numbers; of others it is the one with the worst mean.
    """
    attempts, found, best = list(attempts), [], best or {}
    taught = _taught(attempts)
    for group in by_scenario(attempts)[-last:] if last else ():
        attempt = best.get(group[0].scenario_index)
        attempt = attempt or max(in_full(group), key=lambda a: (standing(a, requirement)[1], -a.index))
        scenario, verdict = attempt.proposal.scenario, attempt.verdict
        assert scenario is not None and verdict is not None and verdict.mean is not None
        values = badness_of(attempt, requirement).values()
        found.append(
            Remembered(
                description=scenario.description,
                tasks={human.name: tuple(task.name for task in human.tasks) for human in scenario.people.humans},
                mean=requirement.badness(math.fsum(values) / len(values)),  # the sign turned back
                interval=verdict.interval or (verdict.mean, verdict.mean),
                scenario=scenario,
                lesson=_lesson(group, taught),
                capped=verdict.censored,
                runs=len(values),
            )
        )
    return tuple(found)


def lessons_of(attempts: Iterable[Attempt], *, last: int, without: int) -> tuple[str, ...]:
    """Return what was learnt from the `last` scenarios `without` one, without repetition.

    The first answer of that one may hold the lesson of the scenario before it.
    """
    attempts = list(attempts)
    taught = _taught(attempts)
    groups = by_scenario(a for a in attempts if a.scenario_index != without)
    lessons = (_lesson(group, taught) for group in (groups[-last:] if last else ()))
    return tuple(dict.fromkeys(lesson for lesson in lessons if lesson))


def last_untold(attempts: Iterable[Attempt]) -> Attempt | None:
    """Return the measured attempt of the search that was made last, unless a later brief told of it."""
    attempts = list(attempts)
    last = max(measured(attempts), key=lambda a: a.index, default=None)
    if last is None:
        return None
    told = any(a.index > last.index and a.feedback_id == last.scenario_id for a in attempts)
    return None if told else last


def _taught(attempts: Iterable[Attempt]) -> list[Attempt]:
    """The attempts whose generator said, before a new scenario, what it learnt from the one before."""
    return [a for a in attempts if a.untold_id is not None and a.lesson]


def _lesson(group: list[Attempt], taught: list[Attempt]) -> str:
    """The lesson of a scenario: what was said when the next one began and all of it was known, else the last of it."""
    own = {a.scenario_id for a in group}
    after = [a for a in taught if a.untold_id in own]
    during = [a for a in group if a.untold_id is None]
    return next((a.lesson for a in (*reversed(after), *reversed(during)) if a.lesson), "")


Floats = NDArray[np.float64]


class Tried(Record):
    """How a configuration does by one requirement."""

    requirement: str
    mean: float
    share: float
    """The mean as a share of what violates; more than 1 is a violation."""
    violations: int
    runs: int


class FrontPoint(Record):
    """A configuration that no other one beats in every requirement."""

    attempt: int
    scenario_id: str
    tried: tuple[Tried, ...]
    """By requirement, in the order of the plan."""
    confirmed: tuple[Tried, ...] = ()
    """The same in the confirmation runs; empty if it was not confirmed."""


class Front(Record):
    """The configurations that no other beats in every requirement, the worst by the first requirement first."""

    points: tuple[FrontPoint, ...]
    hypervolume: float


def share_of(requirement: Requirement, value: float) -> float:
    """Return a value as a share of what violates, at least 0.

    ValueError for a requirement whose limit gives no scale: none, or 0.
    """
    limit = requirement.threshold
    if not limit:
        raise ValueError(f"{requirement.name} has no limit other than 0, which gives no scale")
    share = (2.0 * limit - value) / limit if requirement.worse == "smaller" else value / limit
    return max(0.0, share)


def value_of(measurement: Measurement, requirement: Requirement, plan: Plan) -> float | None:
    """Return what a run's objective is by one of the plan's requirements; None if it has no value."""
    if requirement == plan.requirement:
        return measurement.objective
    return measurement.values.get(requirement.metric) if requirement.metric is not None else None


def tried_by(measurements: Sequence[Measurement], plan: Plan) -> tuple[Tried, ...] | None:
    """Return how runs do by every requirement of the plan; None if one has no value at all."""
    found = []
    for requirement in (plan.requirement, *plan.also):
        values = [v for m in measurements if (v := value_of(m, requirement, plan)) is not None]
        if not values:
            return None
        mean = math.fsum(values) / len(values)
        found.append(
            Tried(
                requirement=requirement.name,
                mean=mean,
                share=share_of(requirement, mean),
                violations=sum(requirement.violated_by(value) for value in values),
                runs=len(values),
            )
        )
    return tuple(found)


def front_of(plan: Plan, attempts: Sequence[Attempt]) -> Front:
    """Return the front of the configurations that were not given up early."""
    candidates = [(a, tried) for a in in_full(attempts) if (tried := tried_by(a.measurements, plan)) is not None]
    shares = np.array([[each.share for each in tried] for _, tried in candidates])
    chosen = [candidates[k] for k in undominated(shares)]
    chosen.sort(key=lambda pair: (-pair[1][0].share, pair[0].index))
    points = []
    for attempt, tried in chosen:
        assert attempt.proposal.scenario is not None
        name = attempt.proposal.scenario.id
        again = next((a for a in confirmations(attempts) if a.scenario_id == name), None)
        confirmed = tried_by(again.measurements, plan) if again is not None else None
        points.append(FrontPoint(attempt=attempt.index, scenario_id=name, tried=tried, confirmed=confirmed or ()))
    return Front(points=tuple(points), hypervolume=hypervolume([[each.share for each in tried] for _, tried in chosen]))


def undominated(shares: Floats) -> list[int]:
    """Return the rows that no other row equals or exceeds everywhere and exceeds somewhere; the first of equal rows."""
    kept: list[int] = []
    for k, row in enumerate(shares):
        beaten = ((shares >= row).all(axis=1) & (shares > row).any(axis=1)).any()
        if not beaten and not any((shares[other] == row).all() for other in kept):
            kept.append(k)
    return kept


def hypervolume(points: Sequence[Sequence[float]]) -> float:
    """Return the volume that points dominate, from 0 on every axis."""
    left = [tuple(point) for point in points if min(point) > 0.0]
    if not left:
        return 0.0
    if len(left[0]) == 1:
        return max(point[0] for point in left)
    volume, above = 0.0, 0.0
    for height in sorted({point[-1] for point in left}):
        volume += (height - above) * hypervolume([point[:-1] for point in left if point[-1] >= height])
        above = height
    return volume
