"""The loop: ask, propose, simulate, evaluate, tell; then confirm what was found.

A strategy returns Asks. An Ask without a proposal goes to the generator; one with a proposal is simulated as it is.
An Ask may name the seeds of its runs; runs that the ledger holds already are not simulated again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from rvsg.campaign.attempt import Attempt, Failure, Ledger, Measurement
from rvsg.campaign.feedback import feedback_of
from rvsg.campaign.parallel import Ordered, Simulations
from rvsg.campaign.plan import Plan
from rvsg.campaign.ranking import best_attempt, search_attempts
from rvsg.campaign.strategies import Ask, FeedbackOf, Strategy
from rvsg.core.errors import GenerationError, SimulationError
from rvsg.core.seeds import fresh_seeds, seed_for
from rvsg.evaluation.judge import DEFAULT, next_repeats
from rvsg.evaluation.verdict import Verdict
from rvsg.generation.generator import Generator
from rvsg.scenario.brief import Brief, Feedback
from rvsg.simulation.run import Run
from rvsg.world.world import World


class Watcher(Protocol):
    """Whoever looks on: told of every run and every attempt, in order. Nothing it does reaches a record."""

    def proposing(self, brief: Brief) -> None:
        """A generator is asked."""
        ...

    def ran(self, run: Run | Failure) -> None:
        """A run was made, found, or could not be made."""
        ...

    def attempted(self, attempt: Attempt) -> None:
        """An attempt is complete and kept."""
        ...


class Judge(Protocol):
    """Makes the Verdict on measurements; `budget` is how many runs there may be at most (None: as usual)."""

    def __call__(self, measurements: Sequence[Measurement], *, budget: int | None = None) -> Verdict:
        """The verdict."""
        ...


@dataclass(frozen=True, kw_only=True)
class Parts:
    """What the loop works with. `measure` makes the Measurement of a run, `judge` the Verdict on measurements."""

    generator: Generator
    simulations: Simulations
    measure: Callable[[Run], Measurement]
    judge: Judge
    ledger: Ledger
    watch: Watcher


def run_campaign(plan: Plan, strategy: Strategy, parts: Parts) -> list[Attempt]:
    """Do what of the plan is not done yet, and return all attempts, those from before included.

    Every attempt is kept as soon as it is complete; interrupted at any point, the same call continues and ends with
    the same records. Errors of the generator pass through after what was proposed is simulated and kept.
    """
    attempts = list(parts.ledger.attempts(plan.name))
    for known in search_attempts(attempts):
        strategy.tell(known)
    attempts += _search(plan, strategy, len(attempts), parts)
    if all(attempt.purpose == "search" for attempt in attempts):
        attempts += confirm(plan, attempts, parts)
    return attempts


def confirm(plan: Plan, attempts: Sequence[Attempt], parts: Parts) -> list[Attempt]:
    """The best attempt again, in fresh runs whose seeds took no part in its selection.

    Where the requirement has a limit, runs are added in batches until the sequential procedure decides or the
    budget `plan.confirmations` is spent; a batch is the fewest runs that can decide, so none is made in vain and how
    many are made does not depend on the number of processes. Without a limit all of the budget is spent.
    """
    best = best_attempt(attempts, plan.requirement)
    if best is None or plan.confirmations == 0:
        return []
    used = {measurement.seed for attempt in attempts for measurement in attempt.measurements}
    seeds = fresh_seeds(plan.seed, "confirmation", plan.confirmations, used=used)
    index = max(attempt.index for attempt in attempts) + 1
    again = best.replace(index=index, purpose="confirmation", confirms=best.index)
    procedure = DEFAULT.replace(max_runs=plan.confirmations)
    judged = plan.requirement.threshold is not None
    made = _Made()
    count = next_repeats(plan.requirement, [], procedure=procedure) if judged else plan.confirmations
    while count:
        made.collect(_order(again, seeds[made.count : made.count + count], parts), parts)
        objectives = [m.objective for m in made.measurements] + [None] * len(made.failures)
        count = next_repeats(plan.requirement, objectives, procedure=procedure)
    return [_keep(again, made, parts, budget=plan.confirmations)]


def feedback_from(ledger: Ledger, plan: Plan, world: World) -> FeedbackOf:
    """What a strategy learns of an attempt, computed from the runs that the ledger keeps."""

    def feedback(attempt: Attempt, previous: Attempt | None) -> Feedback:
        runs = [ledger.run(measurement.run_id) for measurement in attempt.measurements]
        return feedback_of(attempt, runs, requirement=plan.requirement, grid=world.grid, previous=previous)

    return feedback


def _search(plan: Plan, strategy: Strategy, index: int, parts: Parts) -> Iterator[Attempt]:
    """The attempts a strategy asks for from number `index` on, in their order; some are under way side by side.

    They are told in their order too, so a strategy learns the same whichever is done first, and as soon as one is
    told the strategy is asked what can be begun beside those that are still under way.
    """
    under_way: deque[tuple[Attempt, list[Ordered]]] = deque()
    upcoming: deque[Ask] = deque()
    stopped: GenerationError | None = None
    while True:
        if not upcoming and not stopped:
            upcoming.extend(strategy.ask()[len(under_way) :])
        while upcoming and not stopped and len(under_way) <= parts.simulations.ahead:
            try:
                under_way.append(_begin(plan, strategy.name, index, upcoming.popleft(), parts))
            except GenerationError as error:
                stopped = error
            index += 1
        if not under_way:
            break
        done = _finish(*under_way.popleft(), parts)
        strategy.tell(done)
        yield done
    if stopped:
        raise stopped


def attempt(plan: Plan, strategy: str, index: int, brief: Brief, parts: Parts) -> Attempt:
    """One turn: propose, simulate, evaluate, keep."""
    return _finish(*_begin(plan, strategy, index, Ask(brief=brief), parts), parts)


def _begin(plan: Plan, strategy: str, index: int, ask: Ask, parts: Parts) -> tuple[Attempt, list[Ordered]]:
    """Get the proposal of an ask, from the generator where it holds none, and order its runs."""
    proposal = ask.proposal
    if proposal is None:
        parts.watch.proposing(ask.brief)
        proposal = parts.generator.propose(ask.brief, parts.simulations.world)
    turn = Attempt(campaign=plan.name, index=index, strategy=strategy, brief=ask.brief, proposal=proposal)
    seeds = ask.seeds
    if seeds is None:
        seeds = tuple(seed_for(plan.seed, "search", index, repeat) for repeat in range(plan.repeats))
    return turn, _order(turn, seeds, parts)


def _order(turn: Attempt, seeds: Sequence[int], parts: Parts) -> list[Ordered]:
    scenario = turn.proposal.scenario
    return [parts.simulations.order(scenario, seed) for seed in seeds] if scenario else []


@dataclass
class _Made:
    """The runs of an attempt as they come in, with their measurements, and those that could not be made."""

    runs: list[Run] = field(default_factory=list)
    measurements: list[Measurement] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)

    @property
    def count(self) -> int:
        return len(self.runs) + len(self.failures)

    def collect(self, ordered: Sequence[Ordered], parts: Parts) -> None:
        """Wait for ordered runs; each is kept and measured as soon as it is there."""
        for order in ordered:
            found = order.result()
            parts.watch.ran(found)
            if isinstance(found, Run):
                parts.ledger.keep(found)
                self.runs.append(found)
                self.measurements.append(parts.measure(found))
            else:
                self.failures.append(found)


def _finish(turn: Attempt, ordered: Sequence[Ordered], parts: Parts) -> Attempt:
    """Collect the runs of an attempt of the search, and keep it."""
    made = _Made()
    made.collect(ordered, parts)
    return _keep(turn, made, parts)


def _keep(turn: Attempt, made: _Made, parts: Parts, *, budget: int | None = None) -> Attempt:
    """Judge what was measured and keep it all in one transaction.

    A simulator that makes none of the runs of a valid scenario stops the campaign: it would make none of the next.
    """
    if made.failures and not made.runs:
        raise SimulationError(
            f"None of the {len(made.failures)} runs of attempt {turn.index} was made: {made.failures[0].reason}"
        )
    done = turn.replace(
        measurements=tuple(made.measurements),
        failures=tuple(made.failures),
        verdict=parts.judge(made.measurements, budget=budget) if made.measurements else None,
    )
    parts.ledger.append(done, made.runs)
    parts.watch.attempted(done)
    return done
