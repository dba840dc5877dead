"""The loop of a campaign: ask, propose, simulate, judge, tell; then confirm, explain and shrink what was found.

Before the first of it, the robot drives alone.

A strategy returns Asks. An Ask without a proposal goes to the generator; one with a proposal is simulated as it is.
An Ask may name the seeds of its runs; runs that the ledger holds already are not simulated again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from functools import partial
from itertools import islice

from rvsg.core.errors import BudgetSpent, GenerationError, NotRecorded
from rvsg.core.seeds import seed_for
from rvsg.findings.ranking import search_attempts
from rvsg.generation.generator import Call
from rvsg.runs.attempt import Attempt, Plan
from rvsg.runs.runner import PendingRun, RunRequest
from rvsg.search.confirmation import confirm_all
from rvsg.search.drive_alone import drive_alone
from rvsg.search.execution import (
    AttemptFinished,
    CampaignFinished,
    CampaignStarted,
    Cancelled,
    Event,
    Message,
    Parts,
    ProposalStarted,
    make,
    submit,
)
from rvsg.search.smallest_scenario import shrink_all
from rvsg.search.strategies import Ask, Strategy

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
    known = _Known()
    for attempt in parts.ledger.attempts(plan.name):
        known.add(attempt)
        if attempt.purpose == "search":
            strategy.tell(attempt)
    attempts = known.attempts
    yield CampaignStarted(campaign=plan.name, plan=plan, attempts=len(attempts), runs=sum(a.runs for a in attempts))
    complete = True
    try:
        if len(search_attempts(attempts)) == len(attempts):
            if parts.alone:
                yield from drive_alone(plan, parts)
            yield from _search(plan, strategy, known, parts)
        for rest in (confirm_all, shrink_all):
            for event in rest(plan, tuple(attempts), parts):
                if isinstance(event, AttemptFinished):
                    known.add(event.attempt)
                yield event
    except Cancelled:
        complete = False
    yield CampaignFinished(campaign=plan.name, complete=complete, attempts=len(attempts))


class _Known:
    """The attempts of a campaign so far, and what every further one is compared with."""

    def __init__(self) -> None:
        self._first: dict[str, tuple[Attempt, tuple[int, ...]]] = {}
        self._calls: dict[tuple[int, int, int], tuple[Call, ...]] = {}
        self.attempts: list[Attempt] = []

    @property
    def calls(self) -> list[Call]:
        """The calls of the generator."""
        return [call for calls in self._calls.values() for call in calls]

    def begin(self, attempt: Attempt) -> None:
        """Count the calls made for an attempt; one that is run again, under its brief, has the same."""
        brief = attempt.brief
        self._calls[brief.scenario_index, brief.configuration_index, brief.seed] = attempt.proposal.calls

    def add(self, attempt: Attempt) -> None:
        """Add a stored attempt."""
        self.attempts.append(attempt)
        if attempt.purpose == "search":
            self.begin(attempt)
        if attempt.proposal.scenario is not None:
            self._first.setdefault(attempt.proposal.scenario.situation, (attempt, attempt.seeds))

    def first(self, attempt: Attempt, seeds: tuple[int, ...]) -> tuple[Attempt, tuple[int, ...]]:
        """Return the first attempt with the same people and objects, perhaps this one, and the seeds of its runs."""
        scenario = attempt.proposal.scenario
        return (attempt, seeds) if scenario is None else self._first.setdefault(scenario.situation, (attempt, seeds))


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
                yield ProposalStarted(campaign=plan.name, index=index, brief=ask.brief)
            try:
                in_progress.append(_begin(plan, strategy.name, index, ask, parts, known))
            except GenerationError as error:
                stopped = error
            else:
                known.begin(in_progress[-1][0])
                if in_progress[-1][0].brief != ask.brief:
                    yield Message(campaign=plan.name, text=WITHOUT_MODEL)
            index += 1
        if not in_progress:
            break
        for event in make(*in_progress.popleft(), parts):
            if isinstance(event, AttemptFinished):
                known.add(event.attempt)
                strategy.tell(event.attempt)
            yield event
    if stopped:
        raise stopped


def _begin_early(ask: Ask, parts: Parts) -> None:
    """Begin the runs of an ask that needs no generator, while the attempts before it are proposed and collected."""
    if ask.proposal is not None and ask.proposal.scenario is not None:
        for seed in ask.seeds or ():
            parts.runner.submit(RunRequest(ask.proposal.scenario, seed))


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
