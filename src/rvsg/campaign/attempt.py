"""Records of a campaign: the Plan that decides them, the Attempt, one turn of the loop, and its Measurements."""

from __future__ import annotations

import math
import sys
from array import array
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import AliasChoices, ConfigDict, Field, GetCoreSchemaHandler
from pydantic_core import core_schema

from rvsg.core.records import Record
from rvsg.evaluation.verdict import Verdict
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission

_PLACES: dict[tuple[str, ...], dict[str, int]] = {}
"""Where each metric stands, for every list of metrics; all runs of a campaign have the same."""


class Values(Mapping[str, float | None]):
    """Metrics by id; None where a metric has no value. It never changes, and takes 8 bytes a metric."""

    __slots__ = ("_numbers", "_places")

    def __init__(self, given: Mapping[str, float | None]) -> None:
        names = tuple(given)
        places = _PLACES.get(names)
        if places is None:
            places = _PLACES[names] = {name: place for place, name in enumerate(names)}
        self._places = places
        self._numbers = array("d", (math.nan if value is None else value for value in given.values()))

    def __getitem__(self, name: str) -> float | None:
        value = self._numbers[self._places[name]]
        return None if math.isnan(value) else value

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __repr__(self) -> str:
        return repr(dict(self))

    def __reduce__(self) -> tuple[type[Values], tuple[dict[str, float | None]]]:
        return Values, (dict(self),)


class _Kept:
    """Has a field of a record kept as `Values`, whatever mapping it is given."""

    @staticmethod
    def __get_pydantic_core_schema__(_: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        def made(given: Any, validated: core_schema.ValidatorFunctionWrapHandler) -> Values:
            return given if isinstance(given, Values) else Values(validated(given))

        return core_schema.no_info_wrap_validator_function(
            made,
            handler.generate_schema(dict[str, float | None]),
            serialization=core_schema.plain_serializer_function_ser_schema(dict),
        )


Metrics = Annotated[Mapping[str, float | None], _Kept]
"""Metrics of a run by id; None where a metric has no value for it."""


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
