"""Shrinking: the smallest scenario that still violates the requirement about as often.

What is left explains the violation: people, tasks, pauses and delays that do not matter are gone. Every simpler
scenario meets the same seeds as the original, so that both meet the same noise; it is kept where it violates the
requirement at least `keep` times as often. New seeds, which took no part in the choice, show at the end whether that
was luck. A campaign shrinks the worst confirmed scenario of every distinct failure on seeds of its own, and what is
left meets the seeds of the confirmation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import Record
from rvsg.core.seeds import fresh_seeds
from rvsg.evaluation.verdict import Verdict, load_requirement
from rvsg.findings.findings import badness, distinct_failures, findings
from rvsg.runs.attempt import Attempt, Measurement, Plan
from rvsg.runs.runner import Evaluator, Runner, RunRequest
from rvsg.scenario.builder import check_valid
from rvsg.scenario.repair import repair
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Attention, Behaviour, ForceFactors, Human, HumanConfiguration, Scenario, Task
from rvsg.scenario.validity import check
from rvsg.scenario.world_lookup import world_of
from rvsg.search.execution import AttemptFinished, Event, Parts, ReductionStarted, make, submit
from rvsg.simulation.simulators import Simulator, simulator_of
from rvsg.world.grid import Grid
from rvsg.world.world import World


class Simplification(Record):
    """One thing that was tried: what was taken away, how often the requirement was violated then, and if it stays so.

    `runs` may be fewer than asked for: it is given up as soon as it cannot be kept any more.
    """

    what: str
    kept: bool
    violations: int
    runs: int


class Shrunk(Record):
    """The smallest scenario found, what was tried, and how original and smallest do on the same fresh seeds."""

    original: Scenario
    smallest: Scenario
    steps: tuple[Simplification, ...]
    before: Verdict
    after: Verdict
    runs: int


@dataclass(kw_only=True)
class Shrinker:
    """The parts of a shrinking: what makes runs and what judges them, and how often a scenario is run.

    `keep` is the share of the original's violations that a simpler scenario has to show. `limit` is the number of runs
    at which it ends, with what was reached; None: none.
    """

    requirement: Requirement
    runner: Runner
    judge: Callable[[Sequence[Measurement]], Verdict]
    seed: int = 0
    repeats: int = 12
    confirmations: int = 20
    keep: float = 0.8
    limit: int | None = None
    watch: Callable[[Simplification], None] = lambda _: None
    runs: int = field(default=0, init=False)
    _violates: bool = field(default=False, init=False)

    def __call__(self, scenario: Scenario) -> Shrunk:
        """Shrink a scenario. InputError if the requirement has no limit or the scenario does not violate it."""
        if self.requirement.threshold is None:
            raise InputError(
                f'Requirement "{self.requirement.name}" has no limit, so nothing violates it. Give it one.',
                code="no-limit",
            )
        smallest, steps = self.smallest(scenario)
        if not self._violates:
            raise InputError(
                f"None of {self.repeats} runs violates {self.requirement.name}, so there is nothing to explain. "
                "Shrink a scenario that violates it, or raise the number of repeats.",
                code="no-violation",
            )
        fresh = fresh_seeds(self.seed, "shrink confirmation", self.confirmations, used=self._seeds)
        return Shrunk(
            original=scenario,
            smallest=smallest,
            steps=tuple(steps),
            before=self.judge(self._measured(scenario, fresh)),
            after=self.judge(self._measured(smallest, fresh)),
            runs=self.runs,
        )

    def smallest(self, scenario: Scenario) -> tuple[Scenario, list[Simplification]]:
        """Return the smallest scenario found and what was tried; the scenario itself where no run of it violates."""
        violated = self._violations(scenario, self._seeds, needed=0)[0]
        self._violates = violated > 0
        needed = max(1, math.ceil(self.keep * violated - 1e-9))
        if not violated:
            return scenario, []
        smallest, steps = self._smallest(scenario, self._seeds, needed)
        if kept := [step.what for step in steps if step.kept]:
            before, humans = len(scenario.people.humans), smallest.people.humans
            told = f"{scenario.description} (Shrunk: {'; '.join(kept)}.)".strip()
            if len(humans) < before:  # the old words name everybody, so what the others do is said instead
                people = "; ".join(f"{human.name}: {', '.join(task.name for task in human.tasks)}" for human in humans)
                told = f"{people}. (Shrunk: {len(humans)} of {before} people are left.)"
            smallest = smallest.replace(description=told)
        return smallest, steps

    @property
    def _seeds(self) -> tuple[int, ...]:
        return fresh_seeds(self.seed, "shrink", self.repeats, used=())

    def _smallest(self, scenario: Scenario, seeds: Sequence[int], needed: int) -> tuple[Scenario, list[Simplification]]:
        """Take away what can be taken away, the largest things first, until nothing more can."""
        steps: list[Simplification] = []
        tried, world, again = {scenario.id}, self.runner.world, True
        while again:
            again = False
            for what, people in simpler(scenario.people, world.grid):
                mended, _ = repair(people, scenario.mission, world)  # its loops closed again
                if size(mended) >= size(scenario.people) or check(mended, scenario.mission, world):
                    continue
                candidate = scenario.replace(people=mended)
                if candidate.id in tried:
                    continue
                if self.limit is not None and self.runs + len(seeds) > self.limit:
                    return scenario, steps
                tried.add(candidate.id)
                violations, runs = self._violations(candidate, seeds, needed)
                step = Simplification(what=what, kept=violations >= needed, violations=violations, runs=runs)
                steps.append(step)
                self.watch(step)
                if step.kept:
                    scenario, again = candidate, True
                    break
        return scenario, steps

    def _violations(self, scenario: Scenario, seeds: Sequence[int], needed: int) -> tuple[int, int]:
        """Return how many runs violate the requirement, and how many were made before it was clear that too few do."""
        violations = 0
        for count, seed in enumerate(seeds, start=1):
            spare = violations + len(seeds) - count + 1 - needed
            for certain in seeds[count - 1 : count + spare]:  # made whatever they show, so workers begin them at once
                self.runner.submit(RunRequest(scenario, certain, trial=True))
            (measured,) = self._measured(scenario, [seed]) or (None,)
            objective = measured.objective if measured else None
            violations += objective is not None and self.requirement.violated_by(objective)
            if violations + len(seeds) - count < needed:
                return violations, count
        return violations, len(seeds)

    def _measured(self, scenario: Scenario, seeds: Sequence[int]) -> list[Measurement]:
        self.runs += len(seeds)
        return self.runner.measured(scenario, seeds)


def size(people: HumanConfiguration) -> tuple[int, int, int, int, int]:
    """How large a configuration is: people, tasks, waypoints, pauses, and everything else that is not as usual."""
    tasks = [task for human in people.humans for task in human.tasks]
    specials = [
        (h.start_delay_s > 0.0)
        + (h.group is not None)
        + (h.behaviour is not Behaviour.REGULAR)
        + (h.attention is not Attention.ATTENTIVE)
        + (h.factors != ForceFactors())
        for h in people.humans
    ]
    return (
        len(people.humans),
        len(tasks),
        sum(len(task.path) for task in tasks),
        sum(len(task.pauses) for task in tasks),
        sum(specials),
    )


def simpler(people: HumanConfiguration, grid: Grid) -> Iterator[tuple[str, HumanConfiguration]]:
    """Everything one thing simpler, with words for what was taken away: people first, then tasks, then details."""
    humans = people.humans
    if len(humans) > 1:
        for i, human in enumerate(humans):
            yield f"without {human.name}", HumanConfiguration(humans=humans[:i] + humans[i + 1 :])
    for i, human in enumerate(humans):
        for what, changed in _simpler_human(human, grid):
            yield f"{human.name} {what}", HumanConfiguration(humans=(*humans[:i], changed, *humans[i + 1 :]))


def _simpler_human(human: Human, grid: Grid) -> Iterator[tuple[str, Human]]:
    tasks = human.tasks
    for i in reversed(range(1, len(tasks))):  # from behind: what comes late in a run seldom matters
        if (fewer := _without_stop(tasks, i, grid)) is not None:
            yield f"without going to {tasks[i].path[0]}", human.replace(tasks=fewer)
    for i, task in enumerate(tasks):
        for pause in task.pauses:
            rest = task.replace(pauses=tuple(p for p in task.pauses if p is not pause))
            yield f"without the pause at {pause.at}", human.replace(tasks=(*tasks[:i], rest, *tasks[i + 1 :]))
    if human.start_delay_s > 0.0:
        yield "without its delay", human.replace(start_delay_s=0.0)
    if human.group is not None:
        yield "without its group", human.replace(group=None)
    if human.behaviour is not Behaviour.REGULAR:
        yield "as a regular person", human.replace(behaviour=Behaviour.REGULAR)
    if human.attention is not Attention.ATTENTIVE:
        yield "paying attention", human.replace(attention=Attention.ATTENTIVE)
    if human.factors != ForceFactors():
        yield "with the usual forces", human.replace(factors=ForceFactors())


def _without_stop(tasks: tuple[Task, ...], i: int, grid: Grid) -> tuple[Task, ...] | None:
    """The tasks without the stop at which task `i` starts: one task leads straight past it, or, where that would lead
    nowhere, neither of the two is done. None if fewer than two tasks would be left or there is no way."""
    before, after = tasks[i - 1], tasks[i]
    start, end = before.path[0], after.path[-1]
    if start == end:
        rest = (*tasks[: i - 1], *tasks[i + 1 :])
    elif (path := grid.shortest_path(start, end)) is not None:
        straight = Task.between(before.start_area or start, after.end_area or end, path)
        rest = (*tasks[: i - 1], straight, *tasks[i + 1 :])
    else:
        return None
    return rest if len(rest) > 1 else None


REPEATS = 6
"""Runs of every simpler scenario: at most as many as tell that a failure that nearly always happens is gone."""
CHECKED = 10
"""Runs of what is left, on the seeds of the confirmation, at most."""


def shrink_all(plan: Plan, attempts: Sequence[Attempt], parts: Parts) -> Iterator[Event]:
    """Shrink the worst confirmed scenario of every distinct failure; none gets more than its part of the runs left.

    What is stored already is not repeated.
    """
    if not parts.shrink_runs or plan.requirement.threshold is None:
        return
    done = [attempt for attempt in attempts if attempt.purpose != "search"]
    index = max((attempt.index for attempt in attempts), default=-1)
    world = parts.runner.world
    modes = partial(parts.ledger.failure_mode, world=world)
    found = findings(plan, done, run_of=parts.ledger.run, world=world, mode_of_run=modes)
    # What is shrunk first goes by the verdicts alone, as in every stored campaign.
    found = tuple(sorted(found, key=lambda f: (badness(f.verdict), -f.confirmation), reverse=True))
    confirmations = {finding.attempt: finding.confirmation for finding in found}
    worst = [confirmations[failure.attempts[0]] for failure in distinct_failures(found)]
    for place, confirmed in enumerate(worst):
        shrunk = [attempt for attempt in done if attempt.purpose == "shrinking"]
        share = (parts.shrink_runs - sum(a.trial_runs + a.runs for a in shrunk)) // (len(worst) - place)
        if share < REPEATS + CHECKED or any(attempt.confirms == confirmed for attempt in shrunk):
            continue
        index += 1
        confirmation = next(a for a in done if a.index == confirmed)
        yield ReductionStarted(
            campaign=plan.name, confirmation=confirmation, number=place + 1, of=len(worst), runs=share
        )
        for event in _shrunk(plan, confirmation, index, parts, share):
            if isinstance(event, AttemptFinished):
                done.append(event.attempt)
            yield event


def _shrunk(plan: Plan, confirmation: Attempt, index: int, parts: Parts, runs: int) -> Iterator[Event]:
    """Shrink one confirmed scenario in at most `runs` runs, the check at the end included."""
    scenario = confirmation.proposal.scenario
    assert scenario is not None
    seeds = [m.seed for m in confirmation.measurements][:CHECKED]
    shrinking = Shrinker(
        requirement=plan.requirement,
        runner=parts.runner,
        judge=parts.judge,
        seed=plan.seed,
        repeats=REPEATS,
        limit=runs - len(seeds),
        watch=lambda _: parts.check(),
    )
    smallest, steps = shrinking.smallest(scenario)
    attempt = Attempt(
        campaign=plan.name,
        index=index,
        purpose="shrinking",
        strategy=confirmation.strategy,
        brief=confirmation.brief,
        proposal=confirmation.proposal.replace(scenario=smallest, calls=()),
        confirms=confirmation.index,
        taken_away=tuple(step.what for step in steps if step.kept),
        trial_runs=shrinking.runs,
    )
    yield from make(attempt, submit(attempt, seeds, parts), parts)


def shrink(
    scenario: Scenario,
    requirement: str | Path | Requirement = "R1",
    *,
    repeats: int = 12,
    confirmations: int = 20,
    keep: float = 0.8,
    seed: int = 0,
    jobs: int = 1,
    simulator: str | Spec | Simulator = "embedded",
    world: World | str | Path | None = None,
    on_step: Callable[[Simplification], None] = ignore,
    on_message: Callable[[str], None] = ignore,
) -> Shrunk:
    """Find the smallest scenario that violates a requirement about as often.

    People, tasks, pauses and delays are removed one by one as long as the violations stay.

    Args:
        repeats: runs of every simpler scenario.
        confirmations: runs with new seeds of the original and of the smallest.
        keep: the share of the original's violations that has to stay.
        simulator: a name, a Spec, or an instance, which stays open.

    Raises:
        InvalidScenario: the scenario breaks a rule.
        InputError: the requirement has no limit, or the scenario does not violate it.
    """
    place = world_of(scenario.mission, world)
    check_valid(scenario, place)
    asked = load_requirement(requirement, scenario.mission.route)
    measuring = Evaluator(asked, place)
    with (
        simulator_of(simulator, scenario=scenario, on_message=on_message) as made,
        Runner(made, place, measuring=measuring, jobs=jobs, notify=on_message) as runner,
    ):
        return Shrinker(
            requirement=asked,
            runner=runner,
            judge=measuring.judge,
            seed=seed,
            repeats=repeats,
            confirmations=confirmations,
            keep=keep,
            watch=on_step,
        )(scenario)
