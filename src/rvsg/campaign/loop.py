"""The loop of a campaign: ask, propose, simulate, judge, tell; then confirm, explain and shrink what was found.

A strategy returns Asks. An Ask without a proposal goes to the generator; one with a proposal is simulated as it is.
An Ask may name the seeds of its runs; runs that the ledger holds already are not simulated again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import islice

from rvsg.campaign.attempt import Attempt, Plan
from rvsg.campaign.confirmation import confirm_all
from rvsg.campaign.execution import (
    Attempted,
    Cancelled,
    Event,
    Finished,
    Made,
    Message,
    Parts,
    Proposing,
    Started,
    calls_of,
    collect,
    store,
    submit,
)
from rvsg.campaign.ledger import CachedLedger, Filing
from rvsg.campaign.ranking import search_attempts
from rvsg.campaign.runner import PendingRun
from rvsg.campaign.smallest_scenario import shrink_all
from rvsg.campaign.strategies import Ask, Strategy
from rvsg.core.errors import BudgetSpent, GenerationError, NotRecorded
from rvsg.core.records import text_id
from rvsg.core.seeds import seed_for
from rvsg.generation.generator import Call

WITHOUT_MODEL = "The budget of the model is spent, or its record ends. The search continues without it."

MOST_EARLY = 64
"""Asks whose runs are begun, at most, before their turn."""


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
    known = _Known(plan, parts.ledger)
    attempts = known.attempts
    yield Started(campaign=plan.name, plan=plan, attempts=len(attempts), runs=sum(a.runs for a in attempts))
    for attempt in search_attempts(attempts):
        strategy.tell(attempt)
    complete = True
    try:
        if len(search_attempts(attempts)) == len(attempts):
            yield from _search(plan, strategy, known, parts)
        yield from _noted(confirm_all(plan, tuple(attempts), parts), known)
        yield from _noted(shrink_all(plan, tuple(attempts), parts), known)
    except Cancelled:
        complete = False
    yield Finished(campaign=plan.name, complete=complete, attempts=len(attempts))


class _Known:
    """The attempts of a campaign so far, filed, and what every further one is compared with.

    Attributes:
        calls: Those of the generator.
    """

    def __init__(self, plan: Plan, ledger: CachedLedger) -> None:
        self._filing = Filing(ledger, plan.name)
        self._first: dict[str, tuple[Attempt, tuple[int, ...]]] = {}
        self.attempts: list[Attempt] = []
        self.calls: list[Call] = calls_of(self._read(ledger.attempts(plan.name)))

    def add(self, attempt: Attempt) -> Attempt:
        """Add a stored attempt and return what stands for it."""
        filed = self._filing(attempt)
        self.attempts.append(filed)
        key = _people_id(attempt)
        if key is not None:
            first, seeds = self._first.get(key, (attempt, attempt.seeds))
            self._first[key] = (filed if first.index == attempt.index else first, seeds)
        return filed

    def first(self, attempt: Attempt, seeds: tuple[int, ...]) -> tuple[Attempt, tuple[int, ...]]:
        """Return the first attempt with the same people, which may be this one, and the seeds of its runs."""
        key = _people_id(attempt)
        return (attempt, seeds) if key is None else self._first.setdefault(key, (attempt, seeds))

    def _read(self, attempts: Iterable[Attempt]) -> Iterator[Attempt]:
        for attempt in attempts:
            self.add(attempt)
            yield attempt


def _people_id(attempt: Attempt) -> str | None:
    """Return what tells the people of attempts apart; None without a scenario."""
    scenario = attempt.proposal.scenario
    return None if scenario is None else text_id("people", scenario.people.model_dump_json())


def _noted(events: Iterator[Event], known: _Known) -> Iterator[Event]:
    """Pass events on, adding every finished attempt to those known."""
    for event in events:
        if isinstance(event, Attempted):
            known.add(event.attempt)
        yield event


def _search(plan: Plan, strategy: Strategy, known: _Known, parts: Parts) -> Iterator[Event]:
    """Make the attempts a strategy asks for, adding them to those known; several may be in progress.

    The strategy receives them in their order, whichever finishes first. As soon as it has one, it is asked
    what can begin beside those still in progress.
    """
    in_progress: deque[tuple[Attempt, list[PendingRun]]] = deque()
    upcoming: deque[Ask] = deque()
    stopped: GenerationError | None = None
    index = len(known.attempts)
    strategy.allow_early_runs(partial(_begin_early, parts=parts))
    while True:
        if not upcoming and not stopped:
            upcoming.extend(strategy.ask()[len(in_progress) :])
            for ask in islice(upcoming, MOST_EARLY):
                _begin_early(ask, parts)
        while upcoming and not stopped and len(in_progress) <= parts.runner.lookahead:
            ask = upcoming.popleft()
            parts.check()
            if ask.proposal is None:
                yield Proposing(campaign=plan.name, index=index, brief=ask.brief)
            try:
                in_progress.append(_begin(plan, strategy.name, index, ask, parts, known))
            except GenerationError as error:
                stopped = error
            else:
                known.calls += in_progress[-1][0].proposal.calls if ask.proposal is None else ()
                if in_progress[-1][0].brief != ask.brief:
                    yield Message(campaign=plan.name, text=WITHOUT_MODEL)
            index += 1
        if not in_progress:
            break
        attempt, ordered = in_progress.popleft()
        made = Made()
        yield from collect(attempt, ordered, made, parts)
        done = store(attempt, made, parts)
        strategy.tell(known.add(done))
        yield Attempted(campaign=plan.name, attempt=done)
    if stopped:
        raise stopped


def _begin_early(ask: Ask, parts: Parts) -> None:
    """Begin the runs of an ask that needs no generator, while the attempts before it are proposed and collected."""
    if ask.proposal is not None and ask.proposal.scenario is not None:
        for seed in ask.seeds or ():
            parts.runner.submit(ask.proposal.scenario, seed)


def _begin(
    plan: Plan, strategy: str, index: int, ask: Ask, parts: Parts, known: _Known
) -> tuple[Attempt, list[PendingRun]]:
    """Get the proposal of an ask, from the generator where it holds none, and order its runs.

    A configuration that the generator proposes again is not run with other seeds: the runs it has stand. Where the
    budget of the generator is spent, or its record ends, what the ask names instead is done.
    """
    proposal = ask.proposal
    if proposal is None:
        try:
            parts.limits.check(known.calls)
            proposal = parts.generator.propose(ask.brief, parts.runner.world)
        except (BudgetSpent, NotRecorded):
            if ask.instead is None:
                raise
            return _begin(plan, strategy, index, ask.instead, parts, known)
    attempt = Attempt(campaign=plan.name, index=index, strategy=strategy, brief=ask.brief, proposal=proposal)
    seeds = ask.seeds
    if seeds is None:
        seeds = tuple(seed_for(plan.seed, "search", index, repeat) for repeat in range(plan.repeats))
    first, its_seeds = known.first(attempt, seeds)
    if ask.proposal is None and first.index != index:
        same = proposal.replace(scenario=first.proposal.scenario)
        attempt, seeds = attempt.replace(proposal=same, same_as=first.index), its_seeds
    return attempt, submit(attempt, seeds, parts)
