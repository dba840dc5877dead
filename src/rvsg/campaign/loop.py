"""The loop of a campaign: ask, propose, simulate, judge, tell; then confirm, explain and shrink what was found.

A strategy returns Asks. An Ask without a proposal goes to the generator; one with a proposal is simulated as it is.
An Ask may name the seeds of its runs; runs that the ledger holds already are not simulated again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence

from rvsg.campaign.accounting import calls_of
from rvsg.campaign.attempt import Attempt, Ledger
from rvsg.campaign.confirmation import confirm_all
from rvsg.campaign.encounter import encounter_of
from rvsg.campaign.events import Attempted, Event, Finished, Message, Proposing, Started
from rvsg.campaign.failures import FailureMode, mode_of
from rvsg.campaign.feedback import feedback_of, worst_measurement, worst_run
from rvsg.campaign.parallel import PendingRun
from rvsg.campaign.parts import Cancelled, Made, Parts, collect, store, submit
from rvsg.campaign.plan import Plan
from rvsg.campaign.ranking import search_attempts
from rvsg.campaign.sharing import Sharing
from rvsg.campaign.smallest import shrink_all
from rvsg.campaign.strategies import Ask, FeedbackOf, Strategy
from rvsg.core.errors import BudgetSpent, GenerationError, NotRecorded
from rvsg.core.records import text_id
from rvsg.core.seeds import seed_for
from rvsg.generation.generator import Call
from rvsg.scenario.brief import Encounter, Feedback
from rvsg.scenario.scenario import Scenario
from rvsg.world.world import World

WITHOUT_MODEL = "The budget of the model is spent, or its record ends. The search continues without it."


def run_campaign(plan: Plan, strategy: Strategy, parts: Parts) -> list[Attempt]:
    """Do what is left of the plan and return all attempts, earlier ones included."""
    for _ in stream_campaign(plan, strategy, parts):
        pass
    return list(parts.ledger.attempts(plan.name))


def stream_campaign(plan: Plan, strategy: Strategy, parts: Parts) -> Iterator[Event]:
    """Do what is left of the plan, yielding an event for everything that happens.

    Every attempt is stored as soon as it is complete. After an interruption at any point, the same call continues and
    ends with the same records. An error of the generator is raised after everything proposed before it is simulated
    and stored.
    """
    shared = Sharing(folds=True)
    attempts = [shared(attempt) for attempt in parts.ledger.attempts(plan.name)]
    yield Started(campaign=plan.name, plan=plan, attempts=len(attempts), runs=sum(a.runs for a in attempts))
    for known in search_attempts(attempts):
        strategy.tell(known)
    complete = True
    try:
        if len(search_attempts(attempts)) == len(attempts):
            yield from _noted(_search(plan, strategy, attempts, parts), attempts, shared)
        yield from _noted(confirm_all(plan, tuple(attempts), parts), attempts, shared)
        yield from _noted(shrink_all(plan, tuple(attempts), parts), attempts, shared)
    except Cancelled:
        complete = False
    yield Finished(campaign=plan.name, complete=complete, attempts=len(attempts))


class FeedbackFrom:
    """Computes the feedback on an attempt, or only its encounter, from the stored runs."""

    def __init__(self, ledger: Ledger, plan: Plan, world: World) -> None:
        self._ledger, self._plan, self._world = ledger, plan, world
        self._modes: dict[str, FailureMode | None] = {}
        self._kinds: dict[FailureMode | None, FailureMode | None] = {}

    def __call__(self, attempt: Attempt, previous: Attempt | None) -> Feedback:
        """Return the feedback."""
        plan, world = self._plan, self._world
        runs = [self._ledger.run(measurement.run_id) for measurement in attempt.measurements]
        told = feedback_of(attempt, runs, requirement=plan.requirement, grid=world.grid, previous=previous, world=world)
        return told.replace(encounter=encounter_of(worst_run(attempt, runs, plan.requirement), world))

    def encounter(self, attempt: Attempt) -> Encounter | None:
        """Return the encounter alone, which is a small part of the work."""
        worst = worst_measurement(attempt, self._plan.requirement)
        return encounter_of(self._ledger.run(worst.run_id), self._world)

    def failures(self, attempt: Attempt) -> tuple[FailureMode, ...]:
        """Return how each run that violates the requirement fails."""
        found = []
        for measurement in attempt.measurements:
            if measurement.objective is None or not self._plan.requirement.violated_by(measurement.objective):
                continue
            if measurement.run_id not in self._modes:
                mode = mode_of(self._ledger.run(measurement.run_id), self._world)
                self._modes[measurement.run_id] = self._kinds.setdefault(mode, mode)
            found.append(self._modes[measurement.run_id])
        return tuple(mode for mode in found if mode is not None)


def feedback_from(ledger: Ledger, plan: Plan, world: World) -> FeedbackOf:
    """Return the function that computes the feedback on an attempt from the stored runs."""
    return FeedbackFrom(ledger, plan, world)


def _noted(events: Iterator[Event], attempts: list[Attempt], shared: Sharing) -> Iterator[Event]:
    """Pass events on, adding every finished attempt to `attempts`."""
    for event in events:
        if isinstance(event, Attempted):
            attempts.append(shared(event.attempt))
        yield event


def _search(plan: Plan, strategy: Strategy, known: Sequence[Attempt], parts: Parts) -> Iterator[Event]:
    """Make the attempts a strategy asks for, after those known; several may be in progress.

    The strategy receives them in their order, whichever finishes first. As soon as it has one, it is asked
    what can begin beside those still in progress.
    """
    in_progress: deque[tuple[Attempt, list[PendingRun]]] = deque()
    upcoming: deque[Ask] = deque()
    stopped: GenerationError | None = None
    index, calls, tried = len(known), calls_of(known), _Tried(known)
    while True:
        if not upcoming and not stopped:
            upcoming.extend(strategy.ask()[len(in_progress) :])
        while upcoming and not stopped and len(in_progress) <= parts.simulations.lookahead:
            ask = upcoming.popleft()
            parts.check()
            if ask.proposal is None:
                yield Proposing(campaign=plan.name, index=index, brief=ask.brief)
            try:
                in_progress.append(_begin(plan, strategy.name, index, ask, parts, tried, calls))
            except GenerationError as error:
                stopped = error
            else:
                calls += in_progress[-1][0].proposal.calls if ask.proposal is None else ()
                if in_progress[-1][0].brief != ask.brief:
                    yield Message(campaign=plan.name, text=WITHOUT_MODEL)
            index += 1
        if not in_progress:
            break
        attempt, ordered = in_progress.popleft()
        made = Made()
        yield from collect(attempt, ordered, made, parts)
        done = store(attempt, made, parts)
        strategy.tell(done)
        yield Attempted(campaign=plan.name, attempt=done)
    if stopped:
        raise stopped


class _Tried:
    """The configurations of the search, each with its first attempt and the seeds of the runs of that."""

    def __init__(self, attempts: Sequence[Attempt]) -> None:
        self._first: dict[str, tuple[int, Scenario | None, tuple[int, ...]]] = {}
        for attempt in attempts:
            self.first(attempt, (*(m.seed for m in attempt.measurements), *(f.seed for f in attempt.failures)))

    def first(self, attempt: Attempt, seeds: tuple[int, ...]) -> tuple[int, Scenario | None, tuple[int, ...]]:
        """Return the first attempt with the same people, which may be this one: index, scenario and seeds."""
        scenario = attempt.proposal.scenario
        found = (attempt.index, scenario, seeds)
        if scenario is None:
            return found
        return self._first.setdefault(text_id("people", scenario.people.model_dump_json()), found)


def _begin(
    plan: Plan, strategy: str, index: int, ask: Ask, parts: Parts, tried: _Tried, calls: Sequence[Call]
) -> tuple[Attempt, list[PendingRun]]:
    """Get the proposal of an ask, from the generator where it holds none, and order its runs.

    A configuration that the generator proposes again is not run with other seeds: the runs it has stand. Where the
    budget of the generator is spent, or its record ends, what the ask names instead is done.

    Args:
        calls: The calls of the campaign so far.
    """
    proposal = ask.proposal
    if proposal is None:
        try:
            parts.limits.check(calls)
            proposal = parts.generator.propose(ask.brief, parts.simulations.world)
        except (BudgetSpent, NotRecorded):
            if ask.instead is None:
                raise
            return _begin(plan, strategy, index, ask.instead, parts, tried, calls)
    attempt = Attempt(campaign=plan.name, index=index, strategy=strategy, brief=ask.brief, proposal=proposal)
    seeds = ask.seeds
    if seeds is None:
        seeds = tuple(seed_for(plan.seed, "search", index, repeat) for repeat in range(plan.repeats))
    first, scenario, known = tried.first(attempt, seeds)
    if ask.proposal is None and first != attempt.index:
        attempt, seeds = attempt.replace(proposal=proposal.replace(scenario=scenario), same_as=first), known
    return attempt, submit(attempt, seeds, parts)
