"""Records of a campaign: the Plan that decides them, the Attempt, one turn of the loop, and its Measurements."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field

from rvsg.core.records import Record
from rvsg.core.setting import SEARCH, TEST, NotNegative, Positive, Setting
from rvsg.evaluation.realism import is_left_out
from rvsg.evaluation.verdict import Verdict
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario

Purpose = Literal["search", "confirmation", "baseline", "removal", "shrinking"]


class Measurement(Record):
    """The metrics of one run; None if a metric has no value for it."""

    run_id: str
    seed: int
    outcome: str
    values: dict[str, float | None]
    objective: float | None = None
    """The value of the requirement's metric, or the robustness of its formula."""

    @property
    def touches(self) -> bool:
        """Whether robot and people touch."""
        return (self.values.get("contacts") or 0.0) > 0.0


class Failure(Record):
    """A run that the simulator could not make, and why."""

    seed: int
    reason: str


BY_HAND = "by hand"
"""In the place of a campaign, a strategy and a generator where there is none."""


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
    purpose: Purpose = "search"
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

    @classmethod
    def by_hand(
        cls,
        mission: Mission,
        requirement: Requirement,
        scenario: Scenario | None,
        *,
        people: int,
        measurements: Iterable[Measurement],
        verdict: Verdict,
    ) -> Attempt:
        """Return runs that no campaign made as an attempt, for feedback, pages and replays, which read attempts."""
        return cls(
            campaign=BY_HAND,
            index=0,
            strategy=BY_HAND,
            brief=Brief(mission=mission, requirement=requirement, seed=0, humans=max(1, people)),
            proposal=Proposal(generator=BY_HAND, scenario=scenario),
            measurements=tuple(measurements),
            verdict=verdict,
        )

    def violating(self, requirement: Requirement) -> list[Measurement]:
        """Return the measurements that violate a requirement by their objective."""
        return [m for m in self.measurements if m.objective is not None and requirement.violated_by(m.objective)]

    def left_out(self, realism: float | None) -> set[str]:
        """Return the ids of runs that are not judged: somebody does what fewer recorded people (percent) do."""
        return {m.run_id for m in self.measurements if is_left_out(m.values, realism)}

    def worst(self, requirement: Requirement) -> Measurement:
        """Return the measurement whose objective is worst for the robot; the first of equals."""
        return max(
            self.measurements, key=lambda m: -math.inf if m.objective is None else requirement.badness(m.objective)
        )

    @property
    def mean(self) -> float | None:
        """The mean objective over the runs; None if there is none."""
        return self.verdict.mean if self.verdict else None

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of all runs: of those that were measured, then of those that could not be made."""
        return (*(m.seed for m in self.measurements), *(f.seed for f in self.failures))

    @property
    def runs(self) -> int:
        """How many runs were asked for, those that could not be made included."""
        return len(self.seeds)

    @property
    def measured_runs(self) -> int:
        """How many runs were measured."""
        return len(self.measurements)

    @property
    def violations(self) -> int:
        """How many runs violate the requirement."""
        return self.verdict.violations if self.verdict else 0

    @property
    def valued_runs(self) -> int:
        """How many runs have an objective."""
        return self.verdict.runs if self.verdict else 0

    @property
    def scenario_index(self) -> int:
        """The number of its scenario among those of the campaign, from 0."""
        return self.brief.scenario_index

    @property
    def number(self) -> str:
        """Scenario and configuration, from 1, e.g. `3.2`."""
        return f"{self.brief.scenario_index + 1}.{self.brief.configuration_index + 1}"

    @property
    def scenario_id(self) -> str | None:
        """The content id of the configuration; None where nothing valid was proposed."""
        return self.proposal.scenario.id if self.proposal.scenario else None

    @property
    def feedback_id(self) -> str | None:
        """The content id of the configuration whose feedback its brief holds."""
        return self.brief.feedback.scenario.id if self.brief.feedback else None

    @property
    def untold_id(self) -> str | None:
        """The content id of the configuration that its brief tells of before a new scenario begins."""
        return self.brief.untold.scenario.id if self.brief.untold else None

    @property
    def lesson(self) -> str:
        """What the generator learnt from the measurements before it."""
        return self.proposal.lesson


class SearchSettings(Record):
    """The settings of a search that its plan holds."""

    humans: Annotated[int, Field(ge=1, le=100), Setting("People in a scenario.", TEST, label="People")] = 2
    scenarios: Annotated[Positive, Setting("Scenarios to find.", SEARCH, label="Scenarios", common=True)] = 10
    refinements: Annotated[
        int, Field(ge=0, le=1000), Setting("Refinements of each scenario.", SEARCH, label="Refinements")
    ] = 4
    repeats: Annotated[Positive, Setting("Runs of each configuration.", SEARCH, label="Runs")] = 5
    confirmations: Annotated[
        int,
        Field(ge=0, le=100_000),
        Setting(
            "Confirmation runs in all, at most.",
            SEARCH,
            more="0 confirms nothing. See [What is confirmed](#what-is-confirmed).",
            label="Confirmation runs",
        ),
    ] = 250
    budget_runs: Annotated[
        int | None,
        Field(ge=1, le=10_000_000),
        Setting("Runs of the search.", SEARCH, default="scenarios x (1 + refinements) x repeats"),
    ] = None
    memory: Annotated[
        int, Field(ge=0, le=1000), Setting("Earlier scenarios that a new one must differ from.", SEARCH)
    ] = 10
    max_in_flight: Annotated[
        int,
        Field(ge=1, le=1000),
        Setting("Attempts in progress at a time; more keep more cores busy.", SEARCH, label="Attempts at a time"),
    ] = 1
    realism: Annotated[
        float | None,
        Field(ge=0, le=50),
        Setting(
            "Judge only runs whose people move as at least this percentage of recorded people.",
            SEARCH,
            more="For example 1. Speed, acceleration, distance, closing, following, standing and pacing count.",
        ),
    ] = None
    seed: Annotated[NotNegative, Setting("Seed of everything random.", SEARCH, label="Seed", common=True)] = 0


class Plan(SearchSettings):
    """What a campaign does.

    The search tries `scenarios` x (1 + `refinements`) configurations, each in `repeats` runs, or spends `budget_runs`
    runs. A strategy that races gives losing configurations fewer runs and tries more of them. Afterwards the scenarios
    that violated the requirement are confirmed, worst first, in at most `confirmations` runs together; see
    `rvsg.search.confirmation`.
    """

    name: Annotated[str, Field(min_length=1)]
    mission: Mission
    requirement: Requirement
    also: tuple[Requirement, ...] = ()
    """Further requirements that the strategy `multi` looks at; nothing is confirmed by them."""
    proposals: Positive | None = None
    """How often a strategy that plans in runs asks the generator; None: as often as it likes. Other strategies ask for
    every configuration."""

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
