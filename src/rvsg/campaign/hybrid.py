"""The hybrid strategy: the generator proposes what people do and where; an optimiser tunes when and how fast.

The search has three parts. First the generator drafts scenarios, each of which gets one run. Then batches alternate:
new configurations, made by changing the numbers of good ones (`rvsg.generation.tuning`) or by asking the generator for
a refinement, get one run each; then the configurations that may still be the best get another run. At the end the few
best are run until their order is settled. All configurations share the seeds of the race (common random numbers), and
one that has lost gets no further run. The first run of a batch takes the next of these seeds: a search that always
began with the same seed would fit its configurations to that one.

Some of what is changed is not the best but the worst for the robot among those with its kind of encounter, as in
`rvsg.campaign.map_elites`, so that the search finds more than one way to fail.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence

import numpy as np

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.feedback import with_history
from rvsg.campaign.operators import Operators, key
from rvsg.campaign.plan import Plan
from rvsg.campaign.racing import Candidate, estimate, in_the_race
from rvsg.campaign.ranking import remember
from rvsg.campaign.strategies import Ask, Batches, BatchStrategy, FeedbackOf
from rvsg.core.seeds import seed_for
from rvsg.evaluation.aims import aim_of, moved_by
from rvsg.generation.answer import answer
from rvsg.scenario.brief import Brief, Encounter
from rvsg.world.world import World

KEEN = 0.35
"""The best configuration is changed with this probability, the next with as much of what is left, and so on."""

Batch = Generator[list[Ask], list[Attempt], None]


class HybridStrategy(BatchStrategy):
    """Proposals of the generator, tuned on the simulator.

    Args:
        drafts: Share of the runs that go to first runs of new scenarios.
        refine: Share of the changed configurations that the generator refines at first; the others are tuned. The
            share follows how often each of the two makes a configuration worse for the robot.
        explore: Share of the changed configurations that are the worst with their kind of encounter, whichever it is.
        batch: Attempts that may be made side by side.
        finalists: Configurations that are run until their order is settled.
        final_runs: Runs of each finalist.
    """

    name = "hybrid"

    def __init__(
        self,
        plan: Plan,
        feedback_of: FeedbackOf,
        world: World | None = None,
        *,
        drafts: float = 0.12,
        refine: float = 0.25,
        explore: float = 0.5,
        batch: int = 8,
        finalists: int = 4,
        final_runs: int = 10,
    ) -> None:
        super().__init__(plan, feedback_of, world)
        if world is None:
            raise ValueError("the hybrid strategy needs the world")
        self.here = world
        self.drafts, self.refine, self.explore, self.batch = drafts, refine, explore, batch
        self.finalists, self.final_runs = finalists, final_runs
        self.candidates: list[Candidate] = []
        self.asked = 0
        self._batches = 0
        self._tried = {"refine": [0, 0], "tune": [0, 0]}
        self._numbers: dict[int, int] = {}
        self._cells: dict[int, Encounter] = {}
        self._operators = Operators(plan.mission, world, aim_of(plan.requirement))

    def search(self) -> Batches:
        """Draft, then alternate between changing and racing, then settle the order of the best."""
        yield from self._first_drafts()
        if not any(c.runs for c in self.candidates):
            return
        yield from self._race(self.batch)
        reserve = min(self.plan.search_runs // 3, self.finalists * self.final_runs)
        while self.left > reserve:
            before, known = self.left, len(self.candidates)
            yield from self._change(self.batch)
            yield from self._race(self.batch)
            if self.left == before or len(self.candidates) == known:
                break
        yield from self._settle()

    # -- the parts -------------------------------------------------------------------------------------------------

    def _first_drafts(self) -> Batch:
        """Ask for new scenarios; as long as none is valid, for as many as the plan has attempts."""
        yield from self._draft(max(2, round(self.drafts * self.plan.search_runs)))
        while not any(c.runs for c in self.candidates) and self.asked < self.plan.attempts and self.left > 0:
            yield from self._draft(min(self.batch, self.plan.attempts - self.asked))

    def _draft(self, count: int) -> Batch:
        """Ask the generator for a number of scenarios, each different from those before, and run each once."""
        begun = 1 + max(self._numbers, default=-1)
        end = begun + count
        while begun < end:
            memory = remember(self.attempts, self.plan.requirement, last=self.plan.memory)
            size = min(self.batch, end - begun)
            briefs = [self._brief("new", begun + k, 0, memory=memory) for k in range(size)]
            begun += size
            results = yield [Ask(brief=brief, seeds=self._seeds(1)) for brief in briefs]
            for attempt in results:
                self._add(attempt, None, "new")
        estimate(self.candidates)

    def _change(self, count: int) -> Batch:
        """Make a number of changed configurations, and run each once, on the next seed of the race."""
        self._batches += 1
        seeds = self._seeds(self.final_runs)[self._batches % self.final_runs :][:1]
        rng = np.random.default_rng(seed_for(self.plan.seed, "hybrid", self.asked))
        asks: list[Ask] = []
        origins: list[tuple[Candidate, str]] = []
        known = {key(c.scenario.people) for c in self.candidates}
        for parent in self._parents(rng, count):
            if rng.random() < self._refine_share():
                last = self._attempt_of(parent)
                scenario = parent.brief.scenario_index
                siblings = [a for a in self.attempts if a.brief.scenario_index == scenario]
                feedback = with_history(self.feedback_of(last, None), siblings, self.plan.requirement)
                brief = self._brief("refine", parent.brief.scenario_index, self._next(parent), feedback=feedback)
                asks.append(Ask(brief=brief, seeds=seeds))
                origins.append((parent, "refine"))
            elif (ask := self._changed(parent, rng, known, seeds)) is not None:
                asks.append(ask)
                origins.append((parent, "tune"))
        results = yield asks
        for attempt, (parent, operator) in zip(results, origins, strict=False):
            before = len(self.candidates)
            self._add(attempt, parent, operator)
            self._tried[operator][0] += 3 * (len(self.candidates) == before)
        estimate(self.candidates)
        for candidate in self.candidates[-len(results) :]:
            if candidate.parent is not None and candidate.runs:
                self._tried[candidate.operator][candidate.estimate > candidate.parent.estimate] += 1

    def _refine_share(self) -> float:
        """How often the generator refines: the share at first, weighed by how often each operator succeeded."""
        rate = {name: (1 + good) / (2 + bad + good) for name, (bad, good) in self._tried.items()}
        refine, tune = self.refine * rate["refine"], (1.0 - self.refine) * rate["tune"]
        return refine / (refine + tune)

    def _parents(self, rng: np.random.Generator, count: int) -> list[Candidate]:
        """The configurations to change: the best most often, or the best with their kind of encounter."""
        ranked = sorted((c for c in self.candidates if c.runs), key=lambda c: (-c.estimate, c.index))
        open_ = [c for c in self.elites().values() if self._may_violate(c)]
        chosen = []
        for _ in range(count):
            if open_ and rng.random() < self.explore:
                chosen.append(open_[int(rng.integers(len(open_)))])
            else:
                chosen.append(ranked[min(len(ranked), int(rng.geometric(KEEN))) - 1])
        return chosen

    def elites(self) -> dict[Encounter, Candidate]:
        """Return the candidate of every kind of encounter that is worst for the robot, by its estimate."""
        found: dict[Encounter, Candidate] = {}
        for candidate in self.candidates:
            cell = self._cells.get(candidate.index)
            if cell is not None and (cell not in found or candidate.estimate > found[cell].estimate):
                found[cell] = candidate
        return found

    def _may_violate(self, candidate: Candidate) -> bool:
        limit = self.plan.requirement.threshold
        return limit is None or candidate.upper >= self.plan.requirement.badness(limit)

    def _race(self, count: int, most: int | None = None) -> Batch:
        """Give one more run to a number of the configurations that may still be the best."""
        most = self.final_runs if most is None else most
        hopeful = [c for c in in_the_race(self.candidates) if len(self._seen(c)) < most]
        hopeful.sort(key=lambda c: (-(c.estimate + 0.5 * c.deviation), c.index))
        chosen = hopeful[:count]
        results = yield [self._again(c, 1) for c in chosen]
        for attempt, candidate in zip(results, chosen, strict=False):
            self._measured(candidate, attempt)
        estimate(self.candidates)

    def _settle(self) -> Batch:
        """Run the best configurations until each has its final number of runs, then more, until the budget is spent."""
        final = self.final_runs
        while self.left > 0:
            best = sorted((c for c in self.candidates if c.runs), key=lambda c: (-c.estimate, c.index))
            open_ = [c for c in best[: self.finalists] if len(self._seen(c)) < final]
            if not open_:
                final += 1
                continue
            step = 2 if self.left > 1 else 1
            results = yield [self._again(c, min(final - len(self._seen(c)), step)) for c in open_]
            if not results:
                return
            for attempt, candidate in zip(results, open_, strict=False):
                self._measured(candidate, attempt)
            estimate(self.candidates)

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
            seed=seed_for(self.plan.seed, "brief", self.asked - 1),
            scenario_index=scenario,
            configuration_index=configuration,
            **more,
        )

    def _changed(
        self, parent: Candidate, rng: np.random.Generator, known: set[str], seeds: tuple[int, ...]
    ) -> Ask | None:
        """The ask for a changed configuration that was not tried yet; None where none is found."""
        change = self._operators.change(parent, [c for c in self.candidates if c.runs], rng, known)
        if change is None:
            return None
        known.add(key(change.people))
        brief = self._brief("tune", parent.brief.scenario_index, self._next(parent))
        proposal = answer(
            change.people,
            brief,
            self.here,
            generator=self.name,
            described=change.described,
            reasoning=f"Attempt {parent.index} {change.words}.",
        )
        return Ask(brief=brief, proposal=proposal, seeds=seeds) if proposal.scenario else None

    def _again(self, candidate: Candidate, runs: int) -> Ask:
        """The ask for more runs of a candidate, on the first seeds of the race that it did not meet."""
        seen = self._seen(candidate)
        more = [seed for seed in self._seeds(len(seen) + runs + self.final_runs) if seed not in seen]
        return Ask(brief=candidate.brief, proposal=candidate.proposal, seeds=(*seen, *more[:runs]))

    def _seeds(self, count: int) -> tuple[int, ...]:
        """The first seeds of the race."""
        return tuple(seed_for(self.plan.seed, "race", k) for k in range(count))

    def _next(self, parent: Candidate) -> int:
        """The number of the next configuration of a scenario."""
        return 1 + self._numbers[parent.brief.scenario_index]

    # -- results ---------------------------------------------------------------------------------------------------

    def _add(self, attempt: Attempt, parent: Candidate | None, operator: str) -> None:
        """Keep a new candidate, unless the same configuration is in the race already."""
        scenario = attempt.proposal.scenario
        if scenario is None or any(
            c.proposal.scenario is not None and c.proposal.scenario.id == scenario.id for c in self.candidates
        ):
            return
        candidate = Candidate(attempt.brief, attempt.proposal, attempt.index, parent, operator)
        self.candidates.append(candidate)
        self._measured(candidate, attempt)
        self._place(candidate, attempt)

    def _place(self, candidate: Candidate, attempt: Attempt) -> None:
        """Note the kind of encounter that a candidate shows."""
        encounter = self.feedback_of(attempt, None).encounter if candidate.runs else None
        if encounter is not None:
            self._cells[candidate.index] = encounter.replace(stretch="", who="")

    def _measured(self, candidate: Candidate, attempt: Attempt) -> None:
        for measurement in attempt.measurements:
            if measurement.objective is not None:
                candidate.badness[measurement.seed] = self.plan.requirement.badness(measurement.objective)

    def _attempt_of(self, candidate: Candidate) -> Attempt:
        """The last attempt of a candidate: the one with the most runs."""
        name = candidate.scenario.id
        return next(
            a for a in reversed(self.attempts) if a.proposal.scenario is not None and a.proposal.scenario.id == name
        )

    def _seen(self, candidate: Candidate) -> Sequence[int]:
        last = self._attempt_of(candidate)
        return [*(m.seed for m in last.measurements), *(f.seed for f in last.failures)]
