"""Strategies with mutation: hybrid and multi.

`hybrid`: the generator proposes what people do and where; an optimiser tunes when and how fast. The search has three
parts. First the generator drafts scenarios, each of which gets one run. Then batches alternate: new configurations,
made by changing the numbers of good ones (`rvsg.generation.search_space`) or by asking the generator for a refinement,
get one run each; then the configurations that may still be the best get another run. At the end the few best are run
until their order is settled. All configurations share the seeds of the race (common random numbers), and one that has
lost gets no further run. The first run of a batch takes the next of these seeds: a search that always began with the
same seed would fit its configurations to that one.

Where the generator asks a model, a proposal costs far more than a run. Then the plan says how many there are, and
generator and optimiser take turns. The first proposals are new scenarios, the others refine what is best so far, and
the numbers of each are tuned before the next is asked for, so the model is told how its ideas do at their best. Once
the proposals are made or the budget of the calls is spent, tuning goes on as above.

Half of what is changed is not the best. It stands for a kind of failure (`Kinds`): place, what the person does, what
the robot does. Kinds take turns, and of the possible changes one is run whose closest approach the forecast sees at a
place or with a person that no failure has shown yet. Up to half of the races go to kinds that one run shows. As long as
nothing violates the requirement, the worst with their kind of encounter stand in.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from typing import Any, ClassVar

import numpy as np

from rvsg.core.seeds import seed_for
from rvsg.findings.feedback import FeedbackSource
from rvsg.findings.ranking import Tried, lessons_of, remember, tried_by, undominated
from rvsg.runs.attempt import Attempt, Plan
from rvsg.scenario.brief import Brief, Encounter, Feedback, Remembered, mechanism_of
from rvsg.search.candidates import Candidate, forms_of, in_order, last_written, tried, with_others, written
from rvsg.search.mutation import CandidateStrategy, Kinds, Met
from rvsg.search.race import estimate, in_the_race
from rvsg.search.strategies import Ask, Batches
from rvsg.world.world import World

KEEN = 0.35
"""The best configuration is changed with this probability, the next with as much of what is left, and so on."""

TURN = 4
"""Configurations that are tuned at a time between two proposals."""

LEAST_FORMS = 5
"""So many forms with other numbers are run of a proposal that may still be the best."""


class HybridStrategy(CandidateStrategy):
    """Proposals of the generator, tuned on the simulator.

    Args:
        drafts: Share of the runs that go to first runs of new scenarios.
        refine: Share of the changed configurations that the generator refines at first; the others are tuned. The
            share follows how often each of the two makes a configuration worse for the robot.
        turns: Share of the runs, less those of the finalists, that go to the turns of a generator with few proposals,
            unless `LEAST_FORMS` of each proposal take more.
        explore: Share of the changed configurations that are not the best but stand for their kind of failure.
        spread: Whether that share looks for kinds of failure that nothing shows yet, and races make kinds certain.
            Without it, that share is the worst with their kind of encounter.
        batch: Attempts that may be made side by side.
        finalists: Configurations that are run until their order is settled.
        final_runs: Runs of each finalist.
    """

    name = "hybrid"
    recorded: ClassVar[Mapping[str, Any]] = {"spread": True, "finalists": 3}

    def __init__(
        self,
        plan: Plan,
        feedback_of: FeedbackSource,
        world: World | None = None,
        *,
        drafts: float = 0.12,
        refine: float = 0.25,
        turns: float = 0.6,
        explore: float = 0.5,
        spread: bool = True,
        batch: int = 8,
        finalists: int = 3,
        final_runs: int = 10,
    ) -> None:
        super().__init__(plan, feedback_of, world, final_runs=final_runs)
        self.drafts, self.refine, self.explore, self.batch = drafts, refine, explore, batch
        self.turns, self.spent = turns, False
        self.finalists = finalists
        limit = plan.requirement.threshold
        self.kinds = Kinds(plan.requirement.badness(limit)) if spread and limit is not None else None
        self._batches = 0
        self._tried = {"refine": [0, 0], "tune": [0, 0]}

    def search(self) -> Batches:
        """Draft, then alternate between changing and racing, then settle the order of the best."""
        reserve = min(self.plan.search_runs // 3, self.finalists * self.final_runs)
        if self.plan.proposals is None:
            yield from self._first_drafts()
        else:
            yield from self._take_turns(self.plan.proposals, self.plan.search_runs - reserve)
        if not self.measured:
            return
        yield from self._race(self.batch)
        while self.left > reserve:
            before, known = self.left, len(self.candidates)
            yield from self._change(self.batch)
            yield from self._race(self.batch)
            if self.left == before or len(self.candidates) == known:
                break
        yield from self._settle()

    def _first_drafts(self) -> Batches:
        """Ask for new scenarios; as long as none is valid, for as many as the plan has attempts."""
        yield from self._draft(max(2, round(self.drafts * self.plan.search_runs)))
        while not self.measured and self.asked < self.plan.attempts and self.left > 0:
            yield from self._draft(min(self.batch, self.plan.attempts - self.asked))

    def _draft(self, count: int) -> Batches:
        """Ask the generator for a number of scenarios, each different from those before, and run each once."""
        begun = 1 + max(self._numbers, default=-1)
        end = begun + count
        while begun < end:
            memory = self._memory()
            size = min(self.batch, end - begun)
            briefs = [self._brief("new", begun + k, 0, memory=memory) for k in range(size)]
            begun += size
            results = yield [Ask(brief=brief, seeds=self._seeds(1)) for brief in briefs]
            for attempt in results:
                self._add(attempt, None, "new")
        estimate(self.candidates)

    def _memory(self, without: int | None = None) -> tuple[Remembered, ...]:
        """Return the memory, perhaps without one scenario: of each the configuration that all else calls its best."""
        best = self._best_of_each()
        met = {c.scenario.id: found for c in best if (found := self.feedback_of.encounter(c.last)) is not None}
        chosen = {c.scenario_index: c.last for c in best}
        others = (attempt for attempt in self.attempts if attempt.scenario_index != without)
        memory = remember(others, self.plan.requirement, last=self.plan.memory, best=chosen)
        seen = ((each, met.get(each.scenario.id)) for each in memory)
        return tuple(e if found is None else e.replace(mechanism=mechanism_of(found)) for e, found in seen)

    def _take_turns(self, proposals: int, most: int) -> Batches:
        """Let the generator propose, and tune what it proposes, in at most about so many runs together."""
        runs = min(most, max(self.turns * most, (1 + LEAST_FORMS) * proposals))
        drafts = -(-proposals // self.plan.configurations)
        for turn in range(proposals):
            if self.left <= 0:
                return
            if turn < drafts or not self.measured:
                scenario = turn
                memory = self._memory()
                last = next((c for c in self._best_of_each() if c.scenario_index == turn - 1), None)
                untold = self._feedback(last) if last is not None and memory else None
                brief = self._brief("new", turn, 0, memory=memory, untold=untold)
                yield from self._propose(Ask(brief=brief, seeds=self._seeds(1)), None)
            else:
                rng = np.random.default_rng(seed_for(self.plan.seed, "hybrid", self.asked))
                (parent,) = self._best(self._best_of_each(), rng, 1)
                scenario = parent.scenario_index
                yield from self._propose(self._refining(parent, self._seeds(1)), parent)
            if self.spent:
                return
            least = self.plan.search_runs - runs
            yield from self._tune(scenario, self.plan.search_runs - (turn + 1) * runs / proposals, least)

    def _tune(self, scenario: int, until: float, least: float) -> Batches:
        """Change the numbers of a scenario's configurations and race them until so many runs are left.

        What the generator wrote last gets `LEAST_FORMS` forms if it may still be the best, until `least` runs are left.
        """
        while self.left > 0:
            own, before = self._of(scenario), self.left
            last = last_written(own)
            owed = LEAST_FORMS - len(forms_of(last, own)) if last in in_the_race(self.candidates) else 0
            owed = min(owed, math.ceil(self.left - least))
            if not own or (self.left <= until and owed <= 0):
                return
            if last is not None and owed > 0:
                yield from self._change(owed, [last])
            else:
                yield from self._change(min(TURN, math.ceil(self.left - until)), own)
            if self.left > until:
                yield from self._race(min(TURN // 2, math.ceil(self.left - until)), among=self._of(scenario))
            if self.left == before:
                return

    def _of(self, scenario: int) -> list[Candidate]:
        return [candidate for candidate in self.measured if candidate.scenario_index == scenario]

    def _best_of_each(self) -> list[Candidate]:
        own = (self._of(scenario) for scenario in dict.fromkeys(c.scenario_index for c in self.measured))
        return [in_order(each)[0] for each in own]

    def _propose(self, ask: Ask, parent: Candidate | None) -> Batches:
        """Ask the generator; where its budget is spent, change the best configuration instead."""
        base = parent or next(iter(in_order(self.measured)), None)
        if base is not None:
            ask = ask.replace(instead=self._instead(base, ask.brief))
        results = yield [ask]
        for attempt in results:
            self.spent = attempt.brief.kind == "tune"
            scenario, number = attempt.brief.scenario_index, attempt.brief.configuration_index
            self._numbers[scenario] = max(number, self._numbers.get(scenario, 0))
            self._add(attempt, base if self.spent else parent, "tune" if self.spent else attempt.brief.kind)
        estimate(self.candidates)

    def _instead(self, base: Candidate, brief: Brief) -> Ask | None:
        """The ask for a changed configuration in the place of a proposal; it takes its number only if it is used."""
        numbers = dict(self._numbers)
        if brief.scenario_index == base.scenario_index:
            self._numbers[brief.scenario_index] = brief.configuration_index - 1
        rng = np.random.default_rng(seed_for(self.plan.seed, "instead", self.asked))
        ask = self._changed(base, rng, set(self._keys), self._seeds(1))
        self._numbers = numbers
        return ask

    def _feedback(self, candidate: Candidate) -> Feedback:
        """Return what a configuration measured, what of it was tuned, and the others of its scenario."""
        own, requirement = self._of(candidate.scenario_index), self.plan.requirement
        told = with_others(self.feedback_of(candidate.last, None), candidate, own, requirement)
        last = last_written(own) if self.plan.proposals is not None else None
        if last in (None, candidate, written(candidate)):
            return told
        weaker = self.feedback_of(last.last, None).replace(standing=tried(last, own, requirement))
        return told.replace(weaker=weaker)

    def _refining(self, parent: Candidate, seeds: tuple[int, ...]) -> Ask:
        scenario = parent.scenario_index
        memory = self._memory(scenario) if self.plan.proposals is not None else ()
        lessons = lessons_of(self.attempts, last=self.plan.memory, without=scenario)
        told = {"feedback": self._feedback(parent), "lessons": lessons}
        brief = self._brief("refine", scenario, self._next(parent), memory=memory, **told)
        return Ask(brief=brief, seeds=seeds)

    def _change(self, count: int, among: Sequence[Candidate] | None = None) -> Batches:
        """Make a number of changed configurations, and run each once, on the next seed of the race.

        Args:
            among: Change only the numbers of these configurations, the best most often.
        """
        self._batches += 1
        seeds = self._seeds(self.final_runs)[self._batches % self.final_runs :][:1]
        rng = np.random.default_rng(seed_for(self.plan.seed, "hybrid", self.asked))
        asks: list[Ask] = []
        origins: list[tuple[Candidate, str]] = []
        known = set(self._keys)
        # How often the generator refines: the share at first, weighed by how often each operator succeeded.
        rate = {name: (1 + good) / (2 + bad + good) for name, (bad, good) in self._tried.items()}
        refine, tune = self.refine * rate["refine"], (1.0 - self.refine) * rate["tune"]
        refine_share = refine / (refine + tune)
        for parent, avoid in self._choices(rng, count, among):
            if self.plan.proposals is None and rng.random() < refine_share:
                asks.append(self._refining(parent, seeds))
                origins.append((parent, "refine"))
            elif (ask := self._changed(parent, rng, known, seeds, avoid)) is not None:
                self.announce(ask)
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

    def _choices(
        self, rng: np.random.Generator, count: int, among: Sequence[Candidate] | None
    ) -> list[tuple[Candidate, Set[Met]]]:
        """The configurations to change, each with the ways of meeting the robot that a change should leave."""
        if among is not None:
            return [(parent, frozenset()) for parent in self._best(among, rng, count)]
        if self.kinds is None or not self.kinds.met():
            return [(parent, frozenset()) for parent in self._parents(rng, count)]
        known = self.measured
        changes = Counter(c.parent.index for c in self.candidates if c.parent is not None)
        chosen: list[tuple[Candidate, Set[Met]]] = []
        for _ in range(count):
            parent = self.kinds.least_changed(known, changes) if rng.random() < self.explore else None
            if parent is not None:
                changes[parent.index] += 1
            chosen.append((parent, self.kinds.met()) if parent else (self._best(known, rng, 1)[0], frozenset()))
        return chosen

    @staticmethod
    def _best(among: Sequence[Candidate], rng: np.random.Generator, count: int) -> list[Candidate]:
        """Draw from some configurations, the best most often."""
        ranked = in_order(among)
        return [ranked[min(len(ranked), int(rng.geometric(KEEN))) - 1] for _ in range(count)]

    def _parents(self, rng: np.random.Generator, count: int) -> list[Candidate]:
        """Return the configurations to change: the best most often, or the best with their kind of encounter."""
        limit = self.plan.requirement.threshold
        bound = -math.inf if limit is None else self.plan.requirement.badness(limit)
        open_ = [c for c in self.elites().values() if c.upper >= bound]
        chosen = []
        for _ in range(count):
            if open_ and rng.random() < self.explore:
                chosen.append(open_[int(rng.integers(len(open_)))])
            else:
                chosen += self._best(self.measured, rng, 1)
        return chosen

    def elites(self) -> dict[Encounter, Candidate]:
        """Return the candidate of every kind of encounter that is worst for the robot, by its estimate."""
        found: dict[Encounter, Candidate] = {}
        for candidate in self.candidates:
            cell = self._cells.get(candidate.index)
            if cell is not None and (cell not in found or candidate.estimate > found[cell].estimate):
                found[cell] = candidate
        return found

    def _measured(self, candidate: Candidate, attempt: Attempt) -> None:
        super()._measured(candidate, attempt)
        if self.kinds is not None and candidate.runs:
            self.kinds.place(candidate, self.feedback_of.failures(attempt))

    def _race(self, count: int, among: Sequence[Candidate] | None = None) -> Batches:
        """Give one more run to a number of the configurations, of all or of some, that may still be the best."""
        racing = in_the_race(self.candidates if among is None else among)
        hopeful = [c for c in racing if len(c.last.seeds) < self.final_runs]
        hopeful.sort(key=lambda c: (-(c.estimate + 0.5 * c.deviation), c.index))
        chosen = hopeful[:count]
        if self.kinds is not None and among is None:
            doubtful = self.kinds.doubtful(self.candidates)[: count // 2]
            chosen = [*doubtful, *[c for c in hopeful if c not in doubtful][: count - count // 2]]
        yield from self._run_again([self._again(c, 1) for c in chosen], chosen)

    def _settle(self) -> Batches:
        """Run the best configurations until each has its final number of runs, then more, until the budget is spent."""
        final = self.final_runs
        while self.left > 0:
            best = in_order(self.measured)
            open_ = [c for c in best[: self.finalists] if len(c.last.seeds) < final]
            if not open_:
                final += 1
                continue
            step = 2 if self.left > 1 else 1
            asks = [self._again(c, min(final - len(c.last.seeds), step)) for c in open_]
            if not (yield from self._run_again(asks, open_)):
                return


KEEN_ON_FRONT = 0.6
"""How often what is changed is on the first front; with as much of what is left on the next, and so on."""


class MultiStrategy(HybridStrategy):
    """Fills the Pareto front of the plan's requirement and those in `plan.also`.

    It drafts, changes what is on the fronts, then repeats the first front until the budget is spent.

    Args:
        drafts: Share of the runs that go to first runs of new scenarios.
        repeated: Share of the runs that repeat what is on the front.
        options: Those of `hybrid`.
    """

    name = "multi"
    needs_several = True
    recorded: ClassVar[Mapping[str, Any]] = {}

    def __init__(self, *args: Any, drafts: float = 0.2, repeated: float = 0.4, **options: Any) -> None:
        super().__init__(*args, drafts=drafts, spread=False, **options)
        self.repeated = repeated
        self._known: dict[int, tuple[Tried, ...] | None] = {}

    def search(self) -> Batches:
        """Draft; change what is on the fronts; then repeat the first one until the budget is spent."""
        yield from self._first_drafts()
        reserve = round(self.repeated * self.plan.search_runs)
        while self.left > reserve and self.candidates:
            before, known = self.left, len(self.candidates)
            yield from self._change(min(self.batch, self.left - reserve))
            if self.left == before or len(self.candidates) == known:
                break
        while self.left > 0:
            chosen = self._first_front()[: min(self.batch, self.left)]
            if not (yield from self._run_again([self._again(c, 1) for c in chosen], chosen)):
                return

    def fronts(self) -> list[list[Candidate]]:
        """Return the candidates front by front: those that none beats, those that none of the others beats, ..."""
        known = [(c, tried) for c in self.candidates if (tried := self._tried_by(c)) is not None]
        shares = np.array([[each.share for each in tried] for _, tried in known])
        left, found = list(range(len(known))), []
        while left:
            front = {left[k] for k in undominated(shares[left])}
            found.append([known[k][0] for k in sorted(front)])
            left = [k for k in left if k not in front]
        return found

    def _tried_by(self, candidate: Candidate) -> tuple[Tried, ...] | None:
        last = candidate.last.index
        if candidate.runs and last not in self._known:
            self._known[last] = tried_by(candidate.last.measurements, self.plan)
        return self._known.get(last)

    def _parents(self, rng: np.random.Generator, count: int) -> list[Candidate]:
        fronts = self.fronts()
        chosen = []
        for _ in range(count if fronts else 0):
            front = fronts[min(len(fronts), int(rng.geometric(KEEN_ON_FRONT))) - 1]
            chosen.append(front[int(rng.integers(len(front)))])
        return chosen

    def _first_front(self) -> list[Candidate]:
        fronts = self.fronts()
        return sorted(fronts[0] if fronts else [], key=lambda c: (len(c.last.seeds), c.index))
