"""What a campaign found, as plain data: for `--json`, the ranked table, JUnit and the page. One source for all."""

from __future__ import annotations

from collections.abc import Sequence

from rvsg.campaign.accounting import Accounting, account, runs_of
from rvsg.campaign.attempt import Attempt
from rvsg.campaign.finding import worst_confirmation
from rvsg.campaign.plan import Plan
from rvsg.campaign.ranking import ranking, search_attempts
from rvsg.core.records import Record
from rvsg.evaluation.judge import violated
from rvsg.evaluation.verdict import Verdict
from rvsg.evaluation.wording import counted, number, status_in_words, value_in_words
from rvsg.scenario.scenario import Scenario

__all__ = [
    "Accounting",
    "Ranked",
    "Summary",
    "account",
    "counted",
    "in_short",
    "interval",
    "number",
    "status_in_words",
    "summarise",
]


class Ranked(Record):
    """A scenario in its place: its best configuration and how that did. Indices count from 0."""

    rank: int
    scenario: int
    configuration: int
    configurations: int
    attempt: int
    scenario_id: str
    description: str
    verdict: Verdict


class Summary(Record):
    """A campaign so far."""

    campaign: str
    complete: bool
    """Whether everything planned is done."""
    ranking: tuple[Ranked, ...]
    confirmed: Attempt | None
    """The confirmation that says most against the robot."""
    violated: bool
    """Whether a confirmation says so (FAIL, FLAKY, or one of the two), or without one any verdict of the search."""
    accounting: Accounting


def summarise(plan: Plan, attempts: Sequence[Attempt]) -> Summary:
    """Sum up the attempts of a campaign."""
    confirmed = worst_confirmation(attempts)
    searched = search_attempts(attempts)
    ranked = tuple(
        _ranked(place, attempt, searched) for place, attempt in enumerate(ranking(attempts, plan.requirement))
    )
    decided = [confirmed.verdict] if confirmed and confirmed.verdict else [entry.verdict for entry in ranked]
    return Summary(
        campaign=plan.name,
        complete=_complete(plan, attempts, ranked),
        ranking=ranked,
        confirmed=confirmed,
        violated=any(violated(verdict) for verdict in decided),
        accounting=account(attempts),
    )


def _complete(plan: Plan, attempts: Sequence[Attempt], ranked: Sequence[Ranked]) -> bool:
    """Return whether everything planned is done: the search, and its confirmation with the mission without people."""
    if plan.confirmations and ranked:
        return any(a.purpose == "baseline" for a in attempts)
    searched = search_attempts(attempts)
    if all(a.runs in (0, plan.repeats) for a in searched):
        return len(searched) >= plan.attempts
    return runs_of(searched) >= plan.search_runs


def in_short(scenario: Scenario) -> str:
    """What everybody does first, for a scenario that nobody described."""
    return "; ".join(f"{human.name}: {human.tasks[0].name}" for human in scenario.people.humans)


interval = value_in_words
"""The name by which the tables know it."""


def _ranked(place: int, attempt: Attempt, searched: Sequence[Attempt]) -> Ranked:
    scenario = attempt.proposal.scenario
    assert scenario is not None and attempt.verdict is not None
    tried = sum(other.brief.scenario_index == attempt.brief.scenario_index for other in searched)
    return Ranked(
        rank=place + 1,
        scenario=attempt.brief.scenario_index,
        configuration=attempt.brief.configuration_index,
        configurations=tried,
        attempt=attempt.index,
        scenario_id=scenario.id,
        description=scenario.description or in_short(scenario),
        verdict=attempt.verdict,
    )
