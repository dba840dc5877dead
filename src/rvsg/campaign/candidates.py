"""The bookkeeping of a strategy that races: configurations with their runs on shared seeds, and the asks for more."""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.kinds import Met
from rvsg.campaign.operators import Operators, key
from rvsg.campaign.plan import Plan
from rvsg.campaign.racing import Candidate
from rvsg.campaign.strategies import Ask, BatchStrategy, FeedbackOf
from rvsg.core.seeds import seed_for
from rvsg.evaluation.aims import aim_of, moved_by
from rvsg.generation.descriptions import answer
from rvsg.generation.people_sampler import added
from rvsg.scenario.brief import Brief, Encounter
from rvsg.world.world import World


class CandidateStrategy(BatchStrategy):
    """A batch strategy whose configurations are candidates of one race; subclasses implement `search`.

    Args:
        final_runs: Runs of a configuration that is measured in full.
    """

    def __init__(
        self, plan: Plan, feedback_of: FeedbackOf, world: World | None = None, *, final_runs: int = 10
    ) -> None:
        super().__init__(plan, feedback_of, world)
        if world is None:
            raise ValueError(f"the {self.name} strategy needs the world")
        self.here = world
        self.final_runs = final_runs
        self.candidates: list[Candidate] = []
        self.asked = 0
        self._numbers: dict[int, int] = {}
        self._cells: dict[int, Encounter] = {}
        self._by_id: dict[str, Candidate] = {}
        self._keys: set[str] = set()
        self._operators = Operators(plan.mission, world, aim_of(plan.requirement))

    # -- asks ------------------------------------------------------------------------------------------------------

    def _brief(self, kind: str, scenario: int, configuration: int, **more: object) -> Brief:
        self.asked += 1
        self._numbers[scenario] = max(configuration, self._numbers.get(scenario, 0))
        return Brief(
            mission=self.plan.mission,
            requirement=self.plan.requirement,
            aim=aim_of(self.plan.requirement),
            moved_by=moved_by(self.plan.requirement),
            kind=kind,
            humans=self.plan.humans,
            tunes=self.plan.proposals is not None,
            seed=seed_for(self.plan.seed, "brief", self.asked - 1),
            scenario_index=scenario,
            configuration_index=configuration,
            **more,
        )

    def _changed(
        self,
        parent: Candidate,
        rng: np.random.Generator,
        known: set[str],
        seeds: tuple[int, ...],
        avoid: Set[Met] = frozenset(),
    ) -> Ask | None:
        """The ask for a changed configuration that was not tried yet; None where none is found."""
        change = self._operators.change(parent, [c for c in self.candidates if c.runs], rng, known, avoid)
        if change is None:
            return None
        known.add(key(change.people))
        brief = self._brief("tune", parent.scenario_index, self._next(parent))
        proposal = answer(
            change.people,
            brief,
            self.here,
            generator=self.name,
            described=change.described,
            reasoning=f"Attempt {parent.index} {change.words}.",
            moved=added(self.plan.mission, parent.scenario.mission),
        )
        return Ask(brief=brief, proposal=proposal, seeds=seeds) if proposal.scenario else None

    def _again(self, candidate: Candidate, runs: int) -> Ask:
        """The ask for more runs of a candidate, on the first seeds of the race that it did not meet."""
        attempt, seen = candidate.attempt, self._seen(candidate)
        more = [seed for seed in self._seeds(len(seen) + runs + self.final_runs) if seed not in seen]
        return Ask(brief=attempt.brief, proposal=attempt.proposal, seeds=(*seen, *more[:runs]))

    def _seeds(self, count: int) -> tuple[int, ...]:
        """The first seeds of the race."""
        return tuple(seed_for(self.plan.seed, "race", k) for k in range(count))

    def _next(self, parent: Candidate) -> int:
        """The number of the next configuration of a scenario."""
        return 1 + self._numbers[parent.scenario_index]

    # -- results ---------------------------------------------------------------------------------------------------

    def _add(self, attempt: Attempt, parent: Candidate | None, operator: str) -> None:
        """Keep a new candidate, unless the same configuration is in the race already."""
        scenario = attempt.proposal.scenario
        if scenario is None:
            return
        if scenario.id in self._by_id:
            self._by_id[scenario.id].last = attempt
            return
        candidate = self._by_id[scenario.id] = Candidate(attempt, parent, operator)
        self.candidates.append(candidate)
        self._keys.add(key(scenario.people))
        self._measured(candidate, attempt)
        self._place(candidate, attempt)

    def _place(self, candidate: Candidate, attempt: Attempt) -> None:
        """Note the kind of encounter that a candidate shows."""
        encounter = self.encounter_of(attempt) if candidate.runs else None
        if encounter is not None:
            self._cells[candidate.index] = encounter.replace(stretch="", who="")

    def _measured(self, candidate: Candidate, attempt: Attempt) -> None:
        for measurement in attempt.measurements:
            if measurement.objective is not None:
                candidate.badness[measurement.seed] = self.plan.requirement.badness(measurement.objective)

    def tell(self, attempt: Attempt) -> None:
        """Receive an attempt of the current batch."""
        super().tell(attempt)
        if (candidate := self._by_id.get(attempt.scenario_id or "")) is not None:
            candidate.last = attempt

    @staticmethod
    def _seen(candidate: Candidate) -> Sequence[int]:
        return candidate.last.seeds
