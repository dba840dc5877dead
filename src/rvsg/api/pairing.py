"""Compare two campaigns scenario by scenario, on the same seeds where they share any."""

from __future__ import annotations

from collections.abc import Iterable

from rvsg.api.campaign import Campaign
from rvsg.campaign.attempt import Attempt
from rvsg.campaign.suite import CaseResult, Change, SuiteResult, compare_results, state_of
from rvsg.core.records import Record

__all__ = ["Change", "Pair", "pairs_of"]


class Pair(Record):
    """A configuration that two campaigns both ran."""

    scenario_id: str
    description: str
    first: int
    """The attempt of the first campaign."""
    second: int
    """The attempt of the second campaign."""
    first_mean: float | None
    second_mean: float | None
    first_violations: tuple[int, int]
    """Runs that violate the requirement, of how many."""
    second_violations: tuple[int, int]
    change: Change
    """By the exact McNemar test on the seeds both ran, corrected by Holm over all pairs; see `compare_results`."""


def pairs_of(first: Campaign, second: Campaign) -> tuple[Pair, ...]:
    """Return the configurations that both campaigns ran, in the order of the first."""
    mine, theirs = _measured(first), _measured(second)
    common = [key for key in mine if key in theirs]
    changes = compare_results(
        _as_results(first, (mine[key] for key in common)), _as_results(second, (theirs[key] for key in common))
    )
    by_case = {change.case: change.change for change in changes}
    return tuple(_pair(mine[key], theirs[key], by_case[_name(key)]) for key in common)


def _measured(campaign: Campaign) -> dict[str, Attempt]:
    """Return the attempts with runs by what their people do; a confirmation before the search it confirms."""
    found: dict[str, Attempt] = {}
    for attempt in campaign.attempts():
        scenario = attempt.proposal.scenario
        if scenario is None or attempt.verdict is None or attempt.purpose not in ("search", "confirmation"):
            continue
        key = scenario.people.id
        if key not in found or attempt.purpose == "confirmation":
            found[key] = attempt
    return found


def _name(key: str) -> str:
    return f"case-{key}"


def _as_results(campaign: Campaign, attempts: Iterable[Attempt]) -> SuiteResult:
    return SuiteResult(
        suite=campaign.name,
        version=campaign.name,
        simulator=campaign.record.simulator.name,
        cases=tuple(_result(campaign, attempt) for attempt in attempts),
    )


def _result(campaign: Campaign, attempt: Attempt) -> CaseResult:
    scenario, verdict, requirement = attempt.proposal.scenario, attempt.verdict, campaign.requirement
    assert scenario is not None and verdict is not None
    flags = [None if m.objective is None else requirement.violated_by(m.objective) for m in attempt.measurements]
    return CaseResult(
        case=_name(scenario.people.id),
        title=scenario.description[:200] or "Without a description",
        requirement=requirement.name,
        expected="pass",
        state=state_of("pass", verdict),
        verdict=verdict,
        seeds=tuple(m.seed for m in attempt.measurements),
        violations=tuple(flags),
    )


def _pair(first: Attempt, second: Attempt, change: Change) -> Pair:
    scenario, one, two = first.proposal.scenario, first.verdict, second.verdict
    assert scenario is not None and one is not None and two is not None
    return Pair(
        scenario_id=scenario.id,
        description=scenario.description,
        first=first.index,
        second=second.index,
        first_mean=one.mean,
        second_mean=two.mean,
        first_violations=(one.violations, one.runs),
        second_violations=(two.violations, two.runs),
        change=change,
    )
