"""The plan of a campaign: everything that decides its records, and nothing else (no jobs, no folder)."""

from __future__ import annotations

from typing import Annotated

from pydantic import AliasChoices, ConfigDict, Field

from rvsg.core.records import Record
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission

Count = Annotated[int, Field(ge=1, le=100_000)]
InFlight = Annotated[int, Field(ge=1, le=1000, validation_alias=AliasChoices("max_in_flight", "abreast"))]
"""`abreast` is how RVSG 0.1 wrote it."""


class Plan(Record):
    """What a campaign does.

    The search tries `scenarios` x (1 + `refinements`) configurations, each in `repeats` runs, or spends `budget_runs`
    runs. A strategy that races gives losing configurations fewer runs and tries more of them. Afterwards the scenarios
    that violated the requirement are confirmed, worst first, in at most `confirmations` runs together; see
    `rvsg.campaign.confirmation`.
    """

    model_config = ConfigDict(populate_by_name=True)

    name: Annotated[str, Field(min_length=1)]
    mission: Mission
    requirement: Requirement
    also: tuple[Requirement, ...] = ()
    """Further requirements that the strategy `multi` looks at; nothing is confirmed by them."""
    humans: Annotated[int, Field(ge=1, le=100)] = 2
    """People in a scenario."""
    scenarios: Count = 10
    refinements: Annotated[int, Field(ge=0, le=1000)] = 4
    """Refinements of each scenario."""
    repeats: Count = 5
    """Runs of each configuration of the search."""
    confirmations: Annotated[int, Field(ge=0, le=100_000)] = 250
    """Confirmation runs of all candidates together; 0: no confirmation."""
    budget_runs: Annotated[int | None, Field(ge=1, le=10_000_000)] = None
    """Runs of the search; None: `scenarios` x (1 + `refinements`) x `repeats`."""
    proposals: Count | None = None
    """How often a strategy that plans in runs asks the generator; None: as often as it likes. Other strategies ask for
    every configuration."""
    memory: Annotated[int, Field(ge=0, le=1000)] = 10
    """Earlier scenarios that a new one must differ from."""
    max_in_flight: InFlight = 1
    """Attempts that may be in progress at a time. More of them keep more workers busy, and the strategy learns the
    result of each later. That changes what it tries, so it belongs to the plan; the number of workers does not."""
    seed: Annotated[int, Field(ge=0)] = 0

    @property
    def configurations(self) -> int:
        """Configurations of one scenario: the first draft and its refinements."""
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
