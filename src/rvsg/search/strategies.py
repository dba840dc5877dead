"""The ask-and-tell protocol of strategies, the strategies of the published study, and checks for plug-ins.

A strategy never simulates. It returns Asks and receives the Attempts that came of them. Its state is a function of the
attempts it received, so a campaign resumes by telling a new strategy the attempts of the ledger. All strategies may
spend the same number of runs, `plan.search_runs`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping
from typing import Any, ClassVar, Protocol

from rvsg.core.errors import StoreError
from rvsg.core.records import Record
from rvsg.core.seeds import seed_for
from rvsg.evaluation.signals import aim_of, moved_by
from rvsg.evaluation.verdict import judge
from rvsg.findings.feedback import FeedbackSource
from rvsg.findings.ranking import last_untold, lessons_of, remember
from rvsg.generation.generator import Proposal
from rvsg.runs.attempt import Attempt, Measurement, Plan
from rvsg.runs.ledger import Ledger
from rvsg.scenario.brief import Brief, Feedback
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.search.candidates import with_history
from rvsg.simulation.archive import PackedRun, arrays_of
from rvsg.simulation.run import Run
from rvsg.world.world import World


class Ask(Record):
    """One attempt that a strategy asks for.

    Without a `proposal` the generator answers the brief. With one, that configuration is simulated as it is and the
    generator is not called; `brief` then says which scenario and configuration of the campaign it is.

    `seeds` are the seeds of the runs; None stands for `plan.repeats` seeds that no other attempt has. Configurations
    that share seeds meet the same noise (common random numbers). To add runs to a configuration, ask for its proposal
    again with more seeds: runs that the ledger holds are not simulated again and cost nothing.
    """

    brief: Brief
    proposal: Proposal | None = None
    seeds: tuple[int, ...] | None = None
    instead: Ask | None = None
    """The attempt to make where the budget of the generator is spent; None: the search stops there."""


class Strategy(Protocol):
    """Anything that chooses what to attempt. Made as `Strategy(plan, feedback_of, world, **options)`.

    Derive a strategy from this class: everything but `name`, `ask` and `tell` has a default.
    """

    spends_runs: ClassVar[bool] = False
    """Whether it plans in runs (`plan.search_runs`), not in configurations of `plan.repeats` runs each."""
    needs_several: ClassVar[bool] = False
    """Whether it needs further requirements, those in `plan.also`."""
    recorded: ClassVar[Mapping[str, Any]] = {}
    """Options that the record of a campaign keeps, so that it resumes in the form it began with."""

    @property
    def name(self) -> str:
        """The name it is chosen by."""
        ...

    def ask(self) -> tuple[Ask, ...]:
        """Return the asks that can be attempted now, independently of one another; none when the search ends.

        They continue after the attempts answered so far: ask k becomes attempt `answered + k`.
        """
        ...

    def tell(self, attempt: Attempt) -> None:
        """Receive an attempt of the search. Attempts arrive in the order of their index."""
        ...

    def allow_early_runs(self, begin: Callable[[Ask], None]) -> None:
        """Take a function that begins the runs of an ask which is certain before it is asked for."""
        return


Batches = Generator[list[Ask], list[Attempt], None]
"""A search as a coroutine: it yields a batch of asks and receives the attempts of that batch, in order."""


class BatchStrategy(Strategy):
    """A strategy written as a coroutine over batches of asks.

    A batch is chosen from complete batches alone, so the asks are the same for any number of workers, and after a
    resume. Subclasses implement `search`. The asks of a batch are cut where they would exceed `plan.search_runs`.
    """

    name = "batch"
    spends_runs = True

    def __init__(self, plan: Plan, feedback_of: FeedbackSource, world: World | None = None) -> None:
        self.plan = plan
        self.feedback_of = feedback_of
        self.world = world
        self.attempts: list[Attempt] = []
        self.used: set[tuple[str | None, int]] = set()
        self.announce: Callable[[Ask], None] = lambda _: None
        self._search: Batches | None = None
        self._batch: list[Ask] = []
        self._results: list[Attempt] = []

    def allow_early_runs(self, begin: Callable[[Ask], None]) -> None:
        """Have `announce` begin the runs of an ask of the next batch."""
        self.announce = begin

    def search(self) -> Batches:
        """Yield batches of asks; receive their attempts."""
        raise NotImplementedError

    def ask(self) -> tuple[Ask, ...]:
        """Return the rest of the current batch."""
        if self._search is None:
            self._search = self.search()
            self._take(next(self._search, []))
        while len(self._results) == len(self._batch):  # a batch for which nothing was found ends no search
            results, self._results = self._results, []
            try:
                self._take(self._search.send(results))
            except StopIteration:
                self._batch = []
                break
        return tuple(self._batch[len(self._results) :])

    def tell(self, attempt: Attempt) -> None:
        """Receive an attempt of the current batch."""
        self.ask()
        self.attempts.append(attempt)
        self._results.append(attempt)
        self.used.update((attempt.scenario_id, seed) for seed in attempt.seeds)

    @property
    def left(self) -> int:
        """Return how many runs the search may still spend."""
        return self.plan.search_runs - len(self.used)

    def _take(self, batch: Iterable[Ask]) -> None:
        """Keep the asks of a batch that the remaining runs pay for."""
        left, self._batch = self.left, []
        for ask in batch:
            scenario = ask.proposal.scenario.id if ask.proposal and ask.proposal.scenario else None
            seeds = ask.seeds if ask.seeds is not None else range(self.plan.repeats)
            cost = sum((scenario, seed) not in self.used for seed in seeds) if scenario else len(seeds)
            if cost > left:
                break
            left -= cost
            self._batch.append(ask)


def brief_of(plan: Plan, kind: str, number: int, place: tuple[int, int], **more: object) -> Brief:
    """Return the brief with that number of a campaign.

    Args:
        place: Its scenario and configuration.
    """
    return Brief(
        mission=plan.mission,
        requirement=plan.requirement,
        aim=aim_of(plan.requirement),
        moved_by=moved_by(plan.requirement),
        kind=kind,
        humans=plan.humans,
        seed=seed_for(plan.seed, "brief", number),
        scenario_index=place[0],
        configuration_index=place[1],
        **more,
    )


class StudyStrategy(Strategy):
    """The study's method: refine a scenario from what it measured, then ask for one that differs from all before.

    A refinement reads the feedback on the last valid configuration of the scenario; as long as a scenario has none,
    it is asked for again. With `plan.max_in_flight` k > 1 the scenarios are worked on in groups of k, in turn: every
    refinement still reads the configuration before it, but no scenario reads the others of its group.
    """

    name = "study"

    def __init__(self, plan: Plan, feedback_of: FeedbackSource, world: World | None = None) -> None:
        self.plan = plan
        self.feedback_of = feedback_of
        self.attempts: list[Attempt] = []
        self._open: deque[Brief] = deque()
        """The briefs of the attempts that are under way."""
        self._scenarios: list[int] = []
        """The scenarios of all attempts, those under way included."""

    def ask(self) -> tuple[Ask, ...]:
        """What can be tried now. What is tried as number n follows from the attempts before n + 1 - k, k of the plan.

        So up to k attempts are under way at a time, and which they are does not depend on who is done first.
        """
        answered = len(self.attempts)
        while (index := len(self._scenarios)) < self.plan.attempts and (known := self._known(index)) <= answered:
            brief = self._next(index, self.attempts[:known])
            self._open.append(brief)
            self._scenarios.append(brief.scenario_index)
        return tuple(Ask(brief=brief) for brief in self._open)

    def tell(self, attempt: Attempt) -> None:
        """Learn of an attempt."""
        if self._open:
            self._open.popleft()
        else:
            self._scenarios.append(attempt.scenario_index)
        self.attempts.append(attempt)

    def _known(self, index: int) -> int:
        """Return how many attempts have to be known before attempt `index` is chosen; no more are looked at."""
        return max(0, index + 1 - self._place(index)[2])

    def _next(self, index: int, known: list[Attempt]) -> Brief:
        plan = self.plan
        scenario, configuration, _ = self._place(index)
        own = [attempt for attempt in known if attempt.scenario_index == scenario]
        measured = [attempt for attempt in own if attempt.mean is not None]
        if measured:  # a refinement: with what was tried in its scenario, and the lessons of the others
            previous = measured[-2] if len(measured) > 1 else None
            feedback = with_history(self.feedback_of(measured[-1], previous), own, plan.requirement)
            lessons = lessons_of(known, last=plan.memory, without=scenario)
            return brief_of(plan, "refine", index, (scenario, configuration), feedback=feedback, lessons=lessons)
        memory = remember(known, plan.requirement, last=plan.memory)
        last = last_untold(known) if memory else None
        untold = self.feedback_of(last, None) if last is not None else None
        return brief_of(plan, "new", index, (scenario, configuration), memory=memory, untold=untold)

    def _place(self, index: int) -> tuple[int, int, int]:
        """Scenario and configuration of attempt `index`, and how many scenarios are worked on beside each other."""
        group, rest = divmod(index, self.plan.max_in_flight * self.plan.configurations)
        first = group * self.plan.max_in_flight
        width = min(self.plan.max_in_flight, self.plan.scenarios - first)
        configuration, lane = divmod(rest, width)
        return first + lane, configuration, width


class UnguidedStrategy(Strategy):
    """The study's baseline: every attempt a new scenario, without a requirement, feedback or memory."""

    name = "unguided"

    def __init__(self, plan: Plan, feedback_of: FeedbackSource | None = None, world: World | None = None) -> None:
        self.plan = plan
        self.answered = 0

    def ask(self) -> tuple[Ask, ...]:
        """Return all asks that are left: no attempt depends on another."""
        return tuple(
            Ask(
                brief=Brief(
                    mission=self.plan.mission,
                    requirement=None,
                    humans=self.plan.humans,
                    seed=seed_for(self.plan.seed, "brief", index),
                    scenario_index=index,
                )
            )
            for index in range(self.answered, self.plan.attempts)
        )

    def tell(self, attempt: Attempt) -> None:
        """Count an attempt."""
        self.answered += 1


class RandomStrategy(UnguidedStrategy):
    """Random search: as unguided; the door chooses the random generator where none is named."""

    name = "random"


Made = Callable[[Plan, FeedbackSource, World], Strategy]


def check_strategy(made: Made, plan: Plan, scenario: Scenario, world: World) -> None:
    """Check the promises of a strategy; AssertionError names the first broken one.

    A strategy spends at most `plan.search_runs` runs and then stops, also where every proposal is invalid. Asking
    twice without telling gives the same asks. A new one that is told the same attempts continues the same way, so
    that a campaign resumes. Every ask has the mission and the number of people of the plan. `scenario` stands for
    what a generator answers.
    """
    for answered in (True, False):
        told = _play(made, plan, scenario if answered else None, world)
        assert not answered or told, "it asks for nothing at all"
        for cut in (0, 1, len(told) // 2, len(told)):
            strategy = made(plan, _MadeUpFeedback(), world)
            for attempt in told[:cut]:
                strategy.tell(attempt)
            asks = strategy.ask()
            assert strategy.ask() == asks, "asking twice without telling gives different asks"
            expected = tuple(attempt.brief for attempt in told[cut : cut + len(asks)])
            continued = tuple(ask.brief for ask in asks)
            assert continued == expected, f"told again, it does not continue the same way after {cut} attempts"
            assert bool(asks) == (cut < len(told)), f"after {cut} attempts it asks for {len(asks)} attempts"
        for attempt in told:
            assert attempt.brief.mission == plan.mission, "a brief is of another mission than the plan's"
            assert attempt.brief.humans == plan.humans, "a brief is of another number of humans than the plan's"
        answers = [a for a in told if a.proposal.generator == "conformance"]
        briefs = {a.brief.id: a.brief for a in answers}  # a configuration that is run again keeps its brief
        assert len({b.seed for b in briefs.values()}) == len(briefs), "briefs for the generator share a seed"


def check_ledger(opened: Callable[[], Ledger], attempt: Attempt, run: Run) -> None:
    """Raises AssertionError naming the first promise that is broken. `opened` opens the same, empty ledger each time.

    What was kept is there when it is opened again, equal to the last bit, in the order of the index; an index that
    is taken is refused and leaves nothing; settings are kept once; what is absent is None or a StoreError.
    """
    ledger, name, packed = opened(), attempt.campaign, PackedRun.of(run)
    assert ledger.settings(name) is None and list(ledger.attempts(name)) == []
    assert ledger.find(run.id) is None
    _refuses(lambda: ledger.run(run.id), "a run that is not there")
    ledger.begin(name, {"seed": 1})
    ledger.begin(name, {"seed": 1})
    _refuses(lambda: ledger.begin(name, {"seed": 2}), "other settings under the same name")
    second, first = attempt.replace(index=1), attempt.replace(index=0)
    ledger.append(second, [])
    ledger.keep(packed)
    ledger.append(first, [packed])
    _refuses(lambda: ledger.append(second, [packed]), "an index that is taken")
    again = opened()
    assert list(again.attempts(name)) == [first, second], "the attempts are not there again, or not in order"
    assert again.settings(name) == {"seed": 1} and again.campaigns() == (name,)
    kept, given = arrays_of(again.run(run.id)), arrays_of(run)
    assert all((kept[key] == given[key]).all() for key in given), "the run is not what was kept"


def _play(made: Made, plan: Plan, scenario: Scenario | None, world: World) -> list[Attempt]:
    """Everything a strategy asks for, where the generator always answers `scenario` (None: with nothing valid)."""
    strategy = made(plan, _MadeUpFeedback(), world)
    told: list[Attempt] = []
    spent: set[tuple[str, int]] = set()
    while asks := strategy.ask():
        for ask in asks:
            told.append(_answered(plan, strategy.name, len(told), ask, scenario))
            strategy.tell(told[-1])
            spent.update((told[-1].proposal.model_dump_json(), m.seed) for m in told[-1].measurements)
        assert len(spent) <= plan.search_runs, f"it spends {len(spent)} runs, the plan has {plan.search_runs}"
        assert len(told) <= plan.search_runs + plan.attempts, f"it does not stop after {len(told)} attempts"
    return told


def _answered(plan: Plan, strategy: str, index: int, ask: Ask, scenario: Scenario | None) -> Attempt:
    """Return the attempt of an ask with made-up measurements that differ from attempt to attempt."""
    proposal = ask.proposal or Proposal(generator="conformance", scenario=scenario)
    seeds = ask.seeds or [seed_for(plan.seed, "search", index, repeat) for repeat in range(plan.repeats)]
    value = 1.0 + 0.1 * (index % 3)
    measurements = tuple(
        Measurement(run_id=f"run-{index}-{seed}", seed=seed, outcome="reached", values={}, objective=value)
        for seed in (seeds if proposal.scenario else ())
    )
    return Attempt(
        campaign=plan.name,
        index=index,
        strategy=strategy,
        brief=ask.brief,
        proposal=proposal,
        measurements=measurements,
        verdict=judge(plan.requirement, [value] * len(measurements)) if measurements else None,
    )


class _MadeUpFeedback(FeedbackSource):
    def __call__(self, attempt: Attempt, previous: Attempt | None) -> Feedback:
        scenario, verdict = attempt.proposal.scenario, attempt.verdict
        assert scenario is not None and verdict is not None and verdict.mean is not None
        before = previous.verdict.mean if previous and previous.verdict else None
        return Feedback(
            scenario=scenario,
            objectives=verdict.objectives,
            mean=verdict.mean,
            interval=(verdict.mean, verdict.mean),
            previous_mean=before,
        )


def _refuses(action: Callable[[], object], what: str) -> None:
    try:
        action()
    except StoreError:
        return
    raise AssertionError(f"the ledger accepts {what}; a StoreError is due")


def single_brief(
    mission: Mission, requirement: Requirement | None, *, humans: int, seed: int, feedback: Feedback | None
) -> Brief:
    """Return the brief for one scenario outside a campaign."""
    return Brief(
        mission=mission,
        requirement=requirement,
        aim=aim_of(requirement),
        moved_by=moved_by(requirement) if requirement else "",
        kind="refine" if feedback else "new",
        humans=humans,
        seed=seed,
        configuration_index=1 if feedback else 0,
        feedback=feedback,
    )
