"""Execution of an attempt: its runs, its verdict, progress events, and the account of a campaign's runs.

The plan limits the runs of the search, since they decide the records. The limits of calls, tokens and money do not: a
campaign that reached one resumes with a larger one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from rvsg.core.errors import BudgetSpent, SimulationError
from rvsg.core.records import Record
from rvsg.evaluation.verdict import DEFAULT, Procedure, Verdict
from rvsg.findings.ranking import confirmations, search_attempts
from rvsg.generation.generator import Call, Generator
from rvsg.generation.vlm.access import CallNews
from rvsg.runs.attempt import Attempt, Failure, Plan, Purpose
from rvsg.runs.ledger import CachedLedger
from rvsg.runs.runner import FinishedRun, PendingRun, Runner, RunRequest
from rvsg.scenario.brief import Brief


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened in the campaign of this name."""

    campaign: str


@dataclass(frozen=True, kw_only=True)
class CampaignStarted(Event):
    """The campaign begins, or resumes after `attempts` finished attempts with `runs` runs."""

    plan: Plan
    attempts: int
    runs: int


@dataclass(frozen=True, kw_only=True)
class Message(Event):
    """Something a person should know, e.g. that the simulator is being compiled."""

    text: str


@dataclass(frozen=True, kw_only=True)
class ProposalStarted(Event):
    """The generator is asked for attempt `index`."""

    index: int
    brief: Brief


@dataclass(frozen=True, kw_only=True)
class ModelCall(Event):
    """A call of a language model begins, waits or is answered."""

    news: CallNews


@dataclass(frozen=True, kw_only=True)
class RunFinished(Event):
    """A run of attempt `index` is finished, was already known, or could not be made."""

    index: int
    purpose: Purpose
    run: FinishedRun | Failure


@dataclass(frozen=True, kw_only=True)
class AttemptFinished(Event):
    """An attempt is complete and stored."""

    attempt: Attempt


@dataclass(frozen=True, kw_only=True)
class AloneStarted(Event):
    """The robot drives the mission without people, in so many `runs`, before the search."""

    runs: int


@dataclass(frozen=True, kw_only=True)
class ConfirmationStarted(Event):
    """The confirmation of a candidate begins: number `number` of `of`, in at most `runs` runs."""

    candidate: Attempt
    number: int
    of: int
    runs: int


@dataclass(frozen=True, kw_only=True)
class ExplanationStarted(Event):
    """Runs begin that show what people contribute: those without the people in `without`; `people` are left."""

    without: tuple[str, ...]
    people: int
    runs: int


@dataclass(frozen=True, kw_only=True)
class ReductionStarted(Event):
    """The scenario of a confirmation is shrunk, in at most `runs` runs: number `number` of `of`."""

    confirmation: Attempt
    number: int
    of: int
    runs: int


@dataclass(frozen=True, kw_only=True)
class CampaignFinished(Event):
    """The campaign ended; not `complete` where it was cancelled."""

    complete: bool
    attempts: int


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
        costs = [call.cost_usd for call in calls if call.cost_usd is not None]
        unknown = len(calls) - len(costs)
        reached = ""
        if self.calls is not None and len(calls) >= self.calls:
            reached, option = f"{len(calls)} of {self.calls} calls", "--budget-calls"
        elif self.tokens is not None and tokens >= self.tokens:
            reached, option = f"{tokens} of {self.tokens} tokens", "--budget-tokens"
        elif self.usd is not None and (sum(costs) >= self.usd or unknown):
            reached, option = f"{sum(costs):.4f} of {self.usd:.4f} USD", "--budget-usd"
            reached += f" ({unknown} calls of unknown price)" if unknown else ""
        if reached:
            raise BudgetSpent(
                f"The budget is spent: {reached}. To resume, run the same command with a larger {option}."
            )


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


class Cancelled(Exception):
    """The campaign was cancelled; everything finished is stored."""


@dataclass(frozen=True, kw_only=True)
class Parts:
    """What the loop works with."""

    generator: Generator
    runner: Runner
    judge: Callable[..., Verdict]
    """Makes the verdict on measurements; `budget` is how many runs there may be at most (None: as usual)."""
    ledger: CachedLedger
    procedure: Procedure = DEFAULT
    """The error rates of a confirmation."""
    cancelled: Callable[[], bool] = lambda: False
    """Asked before every proposal and every run."""
    limits: Limits = field(default_factory=Limits)
    """What the calls of the generator may cost."""
    alone: bool = False
    """Whether the robot first drives the mission without people."""
    search_anyway: bool = False
    """Whether there is a search even where it never arrives so."""
    shrink_runs: int = 0
    """Runs in which the distinct failures are shrunk at the end, together; 0: they are not."""

    def check(self) -> None:
        """Raise Cancelled where the campaign was cancelled."""
        if self.cancelled():
            raise Cancelled


Results = list[FinishedRun | Failure]
"""The runs of an attempt as they come in, and those that could not be made."""


def submit(attempt: Attempt, seeds: Sequence[int], parts: Parts) -> list[PendingRun]:
    """Submit one run of an attempt's scenario for each seed; none if it has no scenario."""
    scenario = attempt.proposal.scenario
    return [parts.runner.submit(RunRequest(scenario, seed)) for seed in seeds] if scenario else []


def collect(attempt: Attempt, pending: Iterable[PendingRun], results: Results, parts: Parts) -> Iterator[Event]:
    """Wait for submitted runs, adding each to `results`; each is stored as soon as it is there."""
    for each in pending:
        parts.check()
        result = each.result()
        if isinstance(result, FinishedRun):
            parts.ledger.keep(result.packed)
        results.append(result)
        yield RunFinished(campaign=attempt.campaign, index=attempt.index, purpose=attempt.purpose, run=result)


def make(attempt: Attempt, pending: Iterable[PendingRun], parts: Parts) -> Iterator[Event]:
    """Wait for the runs of an attempt, and store it."""
    results: Results = []
    yield from collect(attempt, pending, results, parts)
    yield AttemptFinished(campaign=attempt.campaign, attempt=store(attempt, results, parts))


def store(attempt: Attempt, results: Results, parts: Parts, *, budget: int | None = None) -> Attempt:
    """Add runs to an attempt, judge it, and store it in one transaction.

    Raises:
        SimulationError: None of its runs could be made; the simulator would make none of the next either.
    """
    runs = [result for result in results if isinstance(result, FinishedRun)]
    failures = (*attempt.failures, *(result for result in results if isinstance(result, Failure)))
    measurements = (*attempt.measurements, *(run.measurement for run in runs))
    if failures and not measurements:
        raise SimulationError(
            f"The simulator made none of the {len(failures)} runs of attempt {attempt.index}: {failures[0].reason}",
            code="no-run",
        )
    verdict = parts.judge(measurements, budget=budget) if measurements else None
    done = attempt.replace(measurements=measurements, failures=failures, verdict=verdict)
    parts.ledger.append(done, [run.packed for run in runs])
    return done
