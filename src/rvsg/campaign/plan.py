"""The Plan of a campaign: everything that decides its records, and nothing that does not (no jobs, no folder)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rvsg.core.records import Record
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission

Count = Annotated[int, Field(ge=1, le=100_000)]


class Plan(Record):
    """What a campaign is to do.

    `scenarios` x (1 + `refinements`) configurations are tried, each in `repeats` runs; the worst for the robot is
    confirmed in at most `confirmations` fresh runs (0: not at all), fewer where the verdict is sure earlier. `memory`
    is how many earlier scenarios a new one is told of. `abreast` is how many attempts may be under way at a time: the
    more, the more processes have work, and the later a strategy learns what an attempt measured. It is part of the
    plan because it decides what is tried; how many processes there are does not. Every strategy spends the same runs.
    """

    name: Annotated[str, Field(min_length=1)]
    mission: Mission
    requirement: Requirement
    humans: Annotated[int, Field(ge=1, le=100)] = 2
    scenarios: Count = 10
    refinements: Annotated[int, Field(ge=0, le=1000)] = 4
    repeats: Count = 5
    confirmations: Annotated[int, Field(ge=0, le=100_000)] = 30
    memory: Annotated[int, Field(ge=0, le=1000)] = 10
    abreast: Annotated[int, Field(ge=1, le=1000)] = 1
    seed: Annotated[int, Field(ge=0)] = 0

    @property
    def configurations(self) -> int:
        """Configurations of one scenario: the first and its refinements."""
        return 1 + self.refinements

    @property
    def attempts(self) -> int:
        """Attempts of the search."""
        return self.scenarios * self.configurations

    @property
    def runs(self) -> int:
        """Runs of search and confirmation together, at most."""
        return self.attempts * self.repeats + self.confirmations
