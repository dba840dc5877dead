"""The Attempt, one turn of the loop, and the Ledger that stores it."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, Protocol

from rvsg.campaign.values import Metrics
from rvsg.core.records import Record
from rvsg.evaluation.verdict import Verdict
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief
from rvsg.simulation.archive import PackedRun
from rvsg.simulation.run import Run


class Measurement(Record):
    """The metrics of one run; None if a metric has no value for it."""

    run_id: str
    seed: int
    outcome: str
    values: Metrics
    objective: float | None = None
    """The value of the requirement's metric, or the robustness of its formula."""

    def __setstate__(self, state: dict[Any, Any]) -> None:
        """Receive one from a worker: the words that say how a run ended are those of all other runs."""
        super().__setstate__(state)
        self.__dict__["outcome"] = sys.intern(self.outcome)


class Failure(Record):
    """A run that the simulator could not make, and why."""

    seed: int
    reason: str


class Attempt(Record):
    """One configuration with its runs and its verdict.

    Attempts of the search choose; the others never take part in a selection. A "confirmation" repeats a candidate in
    runs with new seeds. A "baseline" is the mission without people, a "removal" a confirmed scenario without one
    person, both on the seeds of the confirmation. A "shrinking" is the smallest form of a confirmed scenario, on the
    same seeds.
    """

    campaign: str
    index: int
    """Position among the attempts of the campaign, from 0, in the order they were asked for."""
    purpose: Literal["search", "confirmation", "baseline", "removal", "shrinking"] = "search"
    strategy: str
    brief: Brief
    proposal: Proposal
    measurements: tuple[Measurement, ...] = ()
    failures: tuple[Failure, ...] = ()
    verdict: Verdict | None = None
    confirms: int | None = None
    """The index of the attempt that this one confirms or explains; None for the search and the baseline."""
    without: tuple[str, ...] = ()
    """The people of that attempt who are left out."""
    taken_away: tuple[str, ...] = ()
    """What shrinking took away from the scenario of that attempt, in words."""
    same_as: int | None = None
    """The index of the attempt whose configuration the generator proposed again; the runs of that attempt stand."""
    trial_runs: int = 0
    """Runs of simpler scenarios on the way to this one, which are not stored."""

    @property
    def mean(self) -> float | None:
        """The mean objective over the runs; None if there is none."""
        return self.verdict.mean if self.verdict else None

    @property
    def runs(self) -> int:
        """Return how many runs were asked for, those that could not be made included."""
        return len(self.measurements) + len(self.failures)

    @property
    def measured_runs(self) -> int:
        """Return how many runs were measured."""
        return len(self.measurements)

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of all runs: of those that were measured, then of those that could not be made."""
        return (*(m.seed for m in self.measurements), *(f.seed for f in self.failures))

    @property
    def violations(self) -> int:
        """Return how many runs violate the requirement."""
        return self.verdict.violations if self.verdict else 0

    @property
    def valued_runs(self) -> int:
        """Return how many runs have an objective."""
        return self.verdict.runs if self.verdict else 0

    @property
    def scenario_index(self) -> int:
        """The number of its scenario among those of the campaign, from 0."""
        return self.brief.scenario_index

    @property
    def scenario_id(self) -> str | None:
        """The content id of the configuration; None where nothing valid was proposed."""
        return self.proposal.scenario.id if self.proposal.scenario else None

    @property
    def untold_id(self) -> str | None:
        """The content id of the configuration that its brief tells of before a new scenario begins."""
        return self.brief.untold.scenario.id if self.brief.untold else None

    @property
    def lesson(self) -> str:
        """What the generator learnt from the measurements before it."""
        return self.proposal.lesson


class Ledger(Protocol):
    """Where attempts and runs are stored, in order, for good.

    A plug-in of the kind `store` is made with the path that is its own in the campaign's folder, and its options. A
    run is stored by its content id, possibly before the attempt it belongs to, so that an interruption loses at most
    the runs in progress.

    A ledger that has a method `attempt` as well, with the name of a campaign and the index of one attempt, which it
    returns, is read again during a long campaign, so that this one need not keep its attempts in memory.
    """

    def begin(self, campaign: str, settings: Mapping[str, Any]) -> None:
        """Store the settings of a new campaign; StoreError if others are stored under that name."""
        ...

    def settings(self, campaign: str) -> dict[str, Any] | None:
        """Return the settings of a campaign; None if it was never begun."""
        ...

    def campaigns(self) -> tuple[str, ...]:
        """Return the names of all campaigns, in the order they were begun."""
        ...

    def forget_empty(self, campaign: str) -> bool:
        """Delete a campaign that has no attempt and return True; return False, changing nothing, where it has one."""
        return False

    def close(self) -> None:
        """Release every resource; no other method is called afterwards."""
        ...

    def keep(self, run: PackedRun) -> None:
        """Store a run; where its id is known, nothing changes."""
        ...

    def append(self, attempt: Attempt, runs: Sequence[PackedRun]) -> None:
        """Store an attempt with its runs, all or nothing; StoreError if its index is taken."""
        ...

    def attempts(self, campaign: str) -> Iterator[Attempt]:
        """Return the attempts of a campaign in the order of their index."""
        ...

    def run(self, run_id: str) -> Run:
        """Return the run of that id; StoreError if there is none."""
        ...

    def find(self, run_id: str) -> Run | None:
        """Return the run of that id, or None."""
        ...
