"""The Attempt, one turn of the loop, and the Ledger that keeps it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, Protocol

from rvsg.core.records import Record
from rvsg.evaluation.verdict import Verdict
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief
from rvsg.simulation.run import Run


class Measurement(Record):
    """The metrics of one run; None where a metric has no value for it."""

    run_id: str
    seed: int
    outcome: str
    values: dict[str, float | None]
    objective: float | None = None


class Failure(Record):
    """A run that the simulator could not make, and why."""

    seed: int
    reason: str


class Attempt(Record):
    """One proposal, its runs and its verdict. `purpose` tells search from confirmation: never mixed.

    `index` counts attempts of a campaign from 0 in the order they were asked. A confirmation repeats the brief and
    the proposal of the attempt it confirms: `confirms` is that one's index.
    """

    campaign: str
    index: int
    purpose: Literal["search", "confirmation"] = "search"
    strategy: str
    brief: Brief
    proposal: Proposal
    measurements: tuple[Measurement, ...] = ()
    failures: tuple[Failure, ...] = ()
    verdict: Verdict | None = None
    confirms: int | None = None

    @property
    def mean(self) -> float | None:
        """The mean objective over the runs; None where there is none."""
        return self.verdict.mean if self.verdict else None


class Ledger(Protocol):
    """Where attempts are kept, in order, for ever.

    As a plug-in it is made with the path that is its own in the campaign's folder, and its options. A run is kept by
    its content id and may be kept before the attempt it belongs to, so that an interruption loses at most the runs
    in progress.
    """

    def begin(self, campaign: str, settings: Mapping[str, Any]) -> None:
        """Keep the effective settings of a new campaign; StoreError where others are kept under that name."""
        ...

    def settings(self, campaign: str) -> dict[str, Any] | None:
        """The settings of a campaign; None where it was never begun."""
        ...

    def campaigns(self) -> tuple[str, ...]:
        """The names of all campaigns, in the order they were begun."""
        ...

    def close(self) -> None:
        """Give everything free; nothing is asked of it afterwards."""
        ...

    def keep(self, run: Run) -> None:
        """Keep a run; one of the same id that is known already stays as it is."""
        ...

    def append(self, attempt: Attempt, runs: Sequence[Run]) -> None:
        """Keep an attempt with its runs, all or nothing; StoreError where its index is taken."""
        ...

    def attempts(self, campaign: str) -> Iterator[Attempt]:
        """The attempts of a campaign in the order of their index."""
        ...

    def run(self, run_id: str) -> Run:
        """The run of that id; raises StoreError where there is none."""
        ...

    def find(self, run_id: str) -> Run | None:
        """The run of that id, or None."""
        ...
