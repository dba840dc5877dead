"""Rank configurations by how badly the robot did, for two purposes.

What is ranked, confirmed and reported goes by the share of runs that violate the limit, then by the mean objective.
By the mean alone, a scenario that never violates could rank before one that does in two of three runs. Without a
limit the mean alone ranks, as in the published study.

What steers the search (climbing, memory) goes by the mean alone. With a handful of runs the share takes few values
and hides whether a refinement came closer to a violation.
"""

from __future__ import annotations

from collections.abc import Iterable

from rvsg.campaign.attempt import Attempt
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


def worst_by_mean(attempts: Iterable[Attempt], requirement: Requirement) -> Attempt | None:
    """Return the search attempt whose mean objective is worst for the robot; the earliest of equals; None without."""
    return max(in_full(attempts), key=lambda a: (standing(a, requirement)[1], -a.index), default=None)


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
    """Return the confirmations, in order; of one that was continued, the attempt that holds all of its runs."""
    latest: dict[int, Attempt] = {}
    for attempt in attempts:
        if attempt.purpose == "confirmation":
            latest[attempt.confirms if attempt.confirms is not None else -1 - attempt.index] = attempt
    return sorted(latest.values(), key=lambda a: a.index)


def candidates(attempts: Iterable[Attempt], requirement: Requirement) -> list[Attempt]:
    """Return the configurations worth confirming, in order.

    First the worst configuration of every scenario that violated the limit, the worst scenario first; then the other
    configurations that did. Where none did, or there is no limit, the configuration that ranks first.
    """
    attempts = list(attempts)
    first = ranking(attempts, requirement)
    rest = sorted(in_full(attempts), key=lambda a: standing(a, requirement), reverse=True)
    ordered = list({attempt.index: attempt for attempt in [*first, *rest]}.values())
    violating = [attempt for attempt in ordered if standing(attempt, requirement)[0] > 0.0]
    return violating or first[:1]


def remember(attempts: Iterable[Attempt], requirement: Requirement, *, last: int) -> tuple[Remembered, ...]:
    """Return the memory for a new scenario: the `last` scenarios, each by its best configuration."""
    attempts, found = list(attempts), []
    taught = _taught(attempts)
    for group in by_scenario(attempts)[-last:] if last else ():
        attempt = worst_by_mean(group, requirement)
        assert attempt is not None
        scenario, verdict = attempt.proposal.scenario, attempt.verdict
        assert scenario is not None and verdict is not None and verdict.mean is not None
        found.append(
            Remembered(
                description=scenario.description,
                tasks={human.name: tuple(task.name for task in human.tasks) for human in scenario.people.humans},
                mean=verdict.mean,
                interval=verdict.interval or (verdict.mean, verdict.mean),
                scenario=scenario,
                lesson=_lesson(group, taught),
                capped=verdict.censored,
                runs=verdict.runs,
            )
        )
    return tuple(found)


def lessons_of(attempts: Iterable[Attempt], *, last: int) -> tuple[str, ...]:
    """Return what was learnt from the `last` scenarios, without repetition."""
    attempts = list(attempts)
    taught = _taught(attempts)
    lessons = (_lesson(group, taught) for group in (by_scenario(attempts)[-last:] if last else ()))
    return tuple(dict.fromkeys(lesson for lesson in lessons if lesson))


def last_untold(attempts: Iterable[Attempt]) -> Attempt | None:
    """Return the measured attempt of the search that was made last, unless a later brief told of it."""
    attempts = list(attempts)
    last = max(measured(attempts), key=lambda a: a.index, default=None)
    if last is None:
        return None
    told = (a.brief.feedback for a in attempts if a.index > last.index)
    return None if any(f is not None and f.scenario.id == last.scenario_id for f in told) else last


def _taught(attempts: Iterable[Attempt]) -> list[Attempt]:
    """The attempts whose generator said, before a new scenario, what it learnt from the one before."""
    return [a for a in attempts if a.untold_id is not None and a.lesson]


def _lesson(group: list[Attempt], taught: list[Attempt]) -> str:
    """The lesson of a scenario: what was said when the next one began and all of it was known, else the last of it."""
    own = {a.scenario_id for a in group}
    after = [a for a in taught if a.untold_id in own]
    during = [a for a in group if a.untold_id is None]
    return next((a.lesson for a in (*reversed(after), *reversed(during)) if a.lesson), "")
