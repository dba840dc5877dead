"""The Plan of a campaign: everything that decides its records, and nothing that does not (no jobs, no folder)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rvsg.core.records import Record
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission

Count = Annotated[int, Field(ge=1, le=100_000)]


class Plan(Record):
    """What a campaign does.

    `scenarios` x (1 + `refinements`) configurations are tried, each in `repeats` runs, or as many runs as
    `budget_runs` says; a strategy that races gives losing configurations fewer runs and tries more of them. The worst
    for the robot is confirmed in at most `confirmations` fresh runs (0: not at all), fewer where the verdict is
    certain earlier. `memory` is how many earlier scenarios the generator is shown for a new one. `abreast` is how many
    attempts `study`, `climb` and `elite` may have under way at a time: with more of them, more workers are busy, and
    the strategy learns later what an attempt measured. It is part of the plan because it decides what is tried; the
    number of workers does not.
    """

    name: Annotated[str, Field(min_length=1)]
    mission: Mission
    requirement: Requirement
    humans: Annotated[int, Field(ge=1, le=100)] = 2
    scenarios: Count = 10
    refinements: Annotated[int, Field(ge=0, le=1000)] = 4
    repeats: Count = 5
    confirmations: Annotated[int, Field(ge=0, le=100_000)] = 30
    budget_runs: Annotated[int | None, Field(ge=1, le=10_000_000)] = None
    memory: Annotated[int, Field(ge=0, le=1000)] = 10
    abreast: Annotated[int, Field(ge=1, le=1000)] = 1
    seed: Annotated[int, Field(ge=0)] = 0

    @property
    def configurations(self) -> int:
        """Configurations of one scenario: the first and its refinements."""
        return 1 + self.refinements

    @property
    def attempts(self) -> int:
        """Attempts of the search, for a strategy that runs each of them `repeats` times."""
        planned = self.scenarios * self.configurations
        return planned if self.budget_runs is None else min(planned, self.budget_runs // self.repeats)

    @property
    def search_runs(self) -> int:
        """Runs that the search may spend."""
        planned = self.scenarios * self.configurations * self.repeats
        return planned if self.budget_runs is None else self.budget_runs

    @property
    def runs(self) -> int:
        """Runs of search and confirmation together, at most."""
        return self.search_runs + self.confirmations
