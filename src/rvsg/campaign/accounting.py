"""One account of what a campaign spends, whatever its strategy and generator, and limits of calls, tokens and money.

Runs of the search are limited by the plan, since they decide the records. The other limits do not: a campaign that
reached one resumes with a larger one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.ranking import confirmations, search_attempts
from rvsg.core.errors import BudgetSpent
from rvsg.core.records import Record
from rvsg.generation.generator import Call


class Accounting(Record):
    """What the campaign spent. `cost_usd` is None if the price of a call is unknown."""

    search_attempts: int
    search_runs: int
    confirmation_runs: int
    baseline_runs: int = 0
    """Runs with fewer people: without anybody, and without one person each."""
    shrinking_runs: int = 0
    """Runs that shrink the failures, those on the way included."""
    failed_runs: int
    invalid_proposals: int
    repaired_proposals: int
    calls: int
    input_tokens: int
    cached_tokens: int
    output_tokens: int
    cost_usd: float | None


class Limits(Record):
    """What the calls of a generator may cost in a campaign; None is no limit. Without calls it costs nothing."""

    calls: int | None = None
    tokens: int | None = None
    usd: float | None = None

    def check(self, calls: Sequence[Call]) -> None:
        """Refuse a further proposal where the calls so far reach a limit.

        Raises:
            BudgetSpent: Says which limit is reached. Where a call has no known price, no limit of money can be kept.
        """
        tokens = sum(call.input_tokens + call.output_tokens for call in calls)
        costs = [call.cost_usd for call in calls]
        spent = sum(cost for cost in costs if cost is not None)
        if self.calls is not None and len(calls) >= self.calls:
            raise _spent(f"{len(calls)} of {self.calls} calls", "--budget-calls")
        if self.tokens is not None and tokens >= self.tokens:
            raise _spent(f"{tokens} of {self.tokens} tokens", "--budget-tokens")
        if self.usd is not None and (spent >= self.usd or None in costs):
            unknown = f" ({costs.count(None)} calls of unknown price)" if None in costs else ""
            raise _spent(f"{spent:.4f} of {self.usd:.4f} USD{unknown}", "--budget-usd")


def account(attempts: Iterable[Attempt]) -> Accounting:
    """Return what the attempts spent; the calls of a proposal count once, with the attempt of the search."""
    attempts = list(attempts)
    searched = search_attempts(attempts)
    calls = calls_of(searched)
    costs = [call.cost_usd for call in calls]
    return Accounting(
        search_attempts=len(searched),
        search_runs=runs_of(searched),
        confirmation_runs=sum(len(a.measurements) for a in confirmations(attempts)),
        baseline_runs=sum(len(a.measurements) for a in attempts if a.purpose in ("baseline", "removal")),
        shrinking_runs=sum(a.trial_runs + len(a.measurements) for a in attempts if a.purpose == "shrinking"),
        failed_runs=sum(len(a.failures) for a in attempts),
        invalid_proposals=sum(a.proposal.scenario is None for a in searched),
        repaired_proposals=sum(bool(a.proposal.repairs) for a in searched),
        calls=len(calls),
        input_tokens=sum(call.input_tokens for call in calls),
        cached_tokens=sum(call.cached_tokens for call in calls),
        output_tokens=sum(call.output_tokens for call in calls),
        cost_usd=sum(cost for cost in costs if cost is not None) if None not in costs else None,
    )


def calls_of(attempts: Iterable[Attempt]) -> list[Call]:
    """Return the calls made for attempts; those of a proposal that is run again, under its brief, count once."""
    asked = {(a.brief.scenario_index, a.brief.configuration_index, a.brief.seed): a.proposal.calls for a in attempts}
    return [call for calls in asked.values() for call in calls]


def runs_of(attempts: Iterable[Attempt]) -> int:
    """Return how many runs attempts made; one that several attempts share counts once."""
    return len({m.run_id for attempt in attempts for m in attempt.measurements})


def _spent(spent: str, option: str) -> BudgetSpent:
    return BudgetSpent(
        f"The budget is spent: {spent}. Finished work is kept. To resume, run the same command with a larger {option}."
    )
