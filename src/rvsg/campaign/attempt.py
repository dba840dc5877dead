"""The Attempt, one turn of the loop, and the Ledger that keeps it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, Protocol

from rvsg.evaluation.verdict import Verdict
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief
from rvsg.simulation.run import Run
from rvsg.world.records import Record


class Measurement(Record):
    """The metrics of one run; None where a metric has no value for it."""

    run_id: str
    seed: int
    outcome: str
    values: dict[str, float | None]
    objective: float | None = None


class Attempt(Record):
    """One proposal, its runs and its verdict. `purpose` tells search from confirmation: never mixed.

    `index` counts attempts of a campaign from 0 in the order they were asked.
    """

    campaign: str
    index: int
    purpose: Literal["search", "confirmation"] = "search"
    strategy: str
    brief: Brief
    proposal: Proposal
    measurements: tuple[Measurement, ...] = ()
    verdict: Verdict | None = None


class Ledger(Protocol):
    """Where attempts are kept, in order, for ever."""

    def append(self, attempt: Attempt, runs: Sequence[Run]) -> None:
        """Keep an attempt with its runs, all or nothing."""
        ...

    def attempts(self, campaign: str) -> Iterator[Attempt]:
        """The attempts of a campaign in the order of their index."""
        ...

    def run(self, run_id: str) -> Run:
        """The run of that id; raises StoreError where there is none."""
        ...
