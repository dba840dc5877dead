"""What a campaign found, as plain data: for `--json`, the ranked table, JUnit and the page. One source for all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

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


class Accounting(Record):
    """What the campaign spent. `cost_usd` is None where the price of a call is unknown."""

    search_attempts: int
    search_runs: int
    confirmation_runs: int
    baseline_runs: int = 0
    """Runs with fewer people: without anybody, and without one person each."""
    failed_runs: int
    invalid_proposals: int
    repaired_proposals: int
    calls: int
    input_tokens: int
    cached_tokens: int
    output_tokens: int
    cost_usd: float | None


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
    return _runs_of(searched) >= plan.search_runs


def _runs_of(attempts: Sequence[Attempt]) -> int:
    """Return how many runs attempts made; one that several attempts share counts once."""
    return len({m.run_id for attempt in attempts for m in attempt.measurements})


def account(attempts: Iterable[Attempt]) -> Accounting:
    """What the attempts spent; the calls of a proposal count once, with the attempt of the search."""
    attempts = list(attempts)
    searched = search_attempts(attempts)
    calls = [call for attempt in searched for call in attempt.proposal.calls]
    costs = [call.cost_usd for call in calls]
    return Accounting(
        search_attempts=len(searched),
        search_runs=_runs_of(searched),
        confirmation_runs=sum(len(a.measurements) for a in attempts if a.purpose == "confirmation"),
        baseline_runs=sum(len(a.measurements) for a in attempts if a.purpose in ("baseline", "removal")),
        failed_runs=sum(len(a.failures) for a in attempts),
        invalid_proposals=sum(a.proposal.scenario is None for a in searched),
        repaired_proposals=sum(bool(a.proposal.repairs) for a in searched),
        calls=len(calls),
        input_tokens=sum(call.input_tokens for call in calls),
        cached_tokens=sum(call.cached_tokens for call in calls),
        output_tokens=sum(call.output_tokens for call in calls),
        cost_usd=sum(cost for cost in costs if cost is not None) if None not in costs else None,
    )


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
