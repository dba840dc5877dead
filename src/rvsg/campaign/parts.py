"""What the loop works with, and the steps of one attempt: order runs, collect them, judge and store them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from rvsg.campaign.accounting import Limits
from rvsg.campaign.attempt import Attempt, Failure, Ledger, Measurement
from rvsg.campaign.events import Event, RunMade
from rvsg.campaign.measuring import FinishedRun
from rvsg.campaign.parallel import PendingRun, Simulations
from rvsg.core.errors import SimulationError
from rvsg.evaluation.verdict import DEFAULT, Procedure, Verdict
from rvsg.generation.generator import Generator
from rvsg.simulation.archive import PackedRun


class Judge(Protocol):
    """Makes the verdict on measurements; `budget` is how many runs there may be at most (None: as usual)."""

    def __call__(self, measurements: Sequence[Measurement], *, budget: int | None = None) -> Verdict:
        """Return the verdict."""
        ...


class Cancelled(Exception):
    """The campaign was cancelled; everything finished is stored."""


@dataclass(frozen=True, kw_only=True)
class Parts:
    """What the loop works with."""

    generator: Generator
    simulations: Simulations
    judge: Judge
    ledger: Ledger
    procedure: Procedure = DEFAULT
    """The error rates of a confirmation."""
    cancelled: Callable[[], bool] = lambda: False
    """Asked before every proposal and every run."""
    limits: Limits = field(default_factory=Limits)
    """What the calls of the generator may cost."""
    shrink_runs: int = 0
    """Runs in which the distinct failures are shrunk at the end, together; 0: they are not."""

    def check(self) -> None:
        """Raise Cancelled where the campaign was cancelled."""
        if self.cancelled():
            raise Cancelled


@dataclass
class Made:
    """The runs of an attempt as they come in, with their measurements, and those that could not be made.

    Of an attempt that continues another one, `runs` holds the new runs only.
    """

    runs: list[PackedRun] = field(default_factory=list)
    measurements: list[Measurement] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Return how many runs were asked for."""
        return len(self.measurements) + len(self.failures)


def submit(attempt: Attempt, seeds: Sequence[int], parts: Parts) -> list[PendingRun]:
    """Submit one run of an attempt's scenario for each seed; none if it has no scenario."""
    scenario = attempt.proposal.scenario
    return [parts.simulations.submit(scenario, seed) for seed in seeds] if scenario else []


def collect(attempt: Attempt, pending: Sequence[PendingRun], made: Made, parts: Parts) -> Iterator[Event]:
    """Wait for submitted runs, adding each to `made`; each is stored as soon as it is there."""
    for each in pending:
        parts.check()
        result = each.result()
        if isinstance(result, FinishedRun):
            parts.ledger.keep(result.packed)
            made.runs.append(result.packed)
            made.measurements.append(result.measurement)
        else:
            made.failures.append(result)
        yield RunMade(campaign=attempt.campaign, index=attempt.index, purpose=attempt.purpose, run=result)


def store(attempt: Attempt, made: Made, parts: Parts, *, budget: int | None = None) -> Attempt:
    """Judge an attempt and store it in one transaction.

    Raises:
        SimulationError: none of its runs could be made; the simulator would make none of the next either.
    """
    if made.failures and not made.measurements:
        raise SimulationError(
            f"The simulator made none of the {len(made.failures)} runs of attempt {attempt.index}: "
            f"{made.failures[0].reason}",
            code="no-run",
        )
    done = attempt.replace(
        measurements=tuple(made.measurements),
        failures=tuple(made.failures),
        verdict=parts.judge(made.measurements, budget=budget) if made.measurements else None,
    )
    parts.ledger.append(done, made.runs)
    return done
