"""The loop: ask, propose, simulate, evaluate, tell; then confirm what was found."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from rvsg.campaign.attempt import Attempt, Failure, Ledger, Measurement
from rvsg.campaign.feedback import feedback_of
from rvsg.campaign.parallel import Ordered, Simulations
from rvsg.campaign.plan import Plan
from rvsg.campaign.ranking import best_attempt, search_attempts
from rvsg.campaign.seeds import fresh_seeds, seed_for
from rvsg.campaign.strategies import FeedbackOf, Strategy
from rvsg.errors import GenerationError, SimulationError
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


@dataclass(frozen=True, kw_only=True)
class Parts:
    """What the loop works with. `measure` makes the Measurement of a run, `judge` the Verdict on measurements."""

    generator: Generator
    simulations: Simulations
    measure: Callable[[Run], Measurement]
    judge: Callable[[Sequence[Measurement]], Verdict]
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
    while briefs := strategy.ask():
        for attempt in _attempts(plan, strategy.name, briefs, len(attempts), parts):
            attempts.append(attempt)
            strategy.tell(attempt)
    if all(attempt.purpose == "search" for attempt in attempts):
        attempts += confirm(plan, attempts, parts)
    return attempts


def confirm(plan: Plan, attempts: Sequence[Attempt], parts: Parts) -> list[Attempt]:
    """The best attempt again, in fresh runs whose seeds took no part in its selection."""
    best = best_attempt(attempts, plan.requirement)
    if best is None or plan.confirmations == 0:
        return []
    used = {measurement.seed for attempt in attempts for measurement in attempt.measurements}
    seeds = fresh_seeds(plan.seed, "confirmation", plan.confirmations, used=used)
    index = max(attempt.index for attempt in attempts) + 1
    again = best.replace(index=index, purpose="confirmation", confirms=best.index)
    return [_finish(again, _order(again, seeds, parts), parts)]


def feedback_from(ledger: Ledger, plan: Plan, world: World) -> FeedbackOf:
    """What a strategy learns of an attempt, computed from the runs that the ledger keeps."""

    def feedback(attempt: Attempt, previous: Attempt | None) -> Feedback:
        runs = [ledger.run(measurement.run_id) for measurement in attempt.measurements]
        return feedback_of(attempt, runs, requirement=plan.requirement, grid=world.grid, previous=previous)

    return feedback


def attempt(plan: Plan, strategy: str, index: int, brief: Brief, parts: Parts) -> Attempt:
    """One turn: propose, simulate, evaluate, keep."""
    return next(_attempts(plan, strategy, (brief,), index, parts))


def _attempts(plan: Plan, strategy: str, briefs: Sequence[Brief], first: int, parts: Parts) -> Iterator[Attempt]:
    """Attempts of briefs that do not depend on one another, in their order; some are simulated ahead."""
    under_way: deque[tuple[Attempt, list[Ordered]]] = deque()
    stopped: GenerationError | None = None
    for index, brief in enumerate(briefs, first):
        parts.watch.proposing(brief)
        try:
            proposal = parts.generator.propose(brief, parts.simulations.world)
        except GenerationError as error:
            stopped = error
            break
        turn = Attempt(campaign=plan.name, index=index, strategy=strategy, brief=brief, proposal=proposal)
        seeds = [seed_for(plan.seed, "search", index, repeat) for repeat in range(plan.repeats)]
        under_way.append((turn, _order(turn, seeds, parts)))
        if len(under_way) > parts.simulations.ahead:
            yield _finish(*under_way.popleft(), parts)
    while under_way:
        yield _finish(*under_way.popleft(), parts)
    if stopped:
        raise stopped


def _order(turn: Attempt, seeds: Sequence[int], parts: Parts) -> list[Ordered]:
    scenario = turn.proposal.scenario
    return [parts.simulations.order(scenario, seed) for seed in seeds] if scenario else []


def _finish(turn: Attempt, ordered: Sequence[Ordered], parts: Parts) -> Attempt:
    """Collect the runs of an attempt, measure and judge them, and keep it all in one transaction.

    A simulator that makes none of the runs of a valid scenario stops the campaign: it would make none of the next.
    """
    runs: list[Run] = []
    failures: list[Failure] = []
    for order in ordered:
        found = order.result()
        parts.watch.ran(found)
        if isinstance(found, Run):
            parts.ledger.keep(found)
            runs.append(found)
        else:
            failures.append(found)
    if failures and not runs:
        raise SimulationError(
            f"None of the {len(failures)} runs of attempt {turn.index} was made: {failures[0].reason}"
        )
    measurements = tuple(parts.measure(run) for run in runs)
    done = turn.replace(
        measurements=measurements,
        failures=tuple(failures),
        verdict=parts.judge(measurements) if measurements else None,
    )
    parts.ledger.append(done, runs)
    parts.watch.attempted(done)
    return done
