"""Paired comparison of versions, stacks and campaigns on the same scenarios and seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rvsg.app.campaign import Campaign, campaigns_in
from rvsg.app.folder import store_of
from rvsg.app.matrix import folders_in
from rvsg.app.runs import simulate
from rvsg.app.suites import HEAD, Suite, driven_by, read_results, requirement_of
from rvsg.campaign.attempt import Attempt, Failure
from rvsg.campaign.ranking import candidates, search_attempts
from rvsg.campaign.runner import Measuring, Simulations
from rvsg.campaign.suite import (
    CaseChange,
    CaseResult,
    Change,
    ScoredRun,
    StackScore,
    StackScores,
    SuiteResult,
    compare_results,
    counts,
    score_stacks,
    state_of,
)
from rvsg.core.errors import InputError, SimulationError
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec, ignore
from rvsg.core.records import Record
from rvsg.evaluation.wording import counted
from rvsg.report.facts import run_facts
from rvsg.report.stacks import stacks_figure, stacks_markdown, stacks_page
from rvsg.report.suites import changes_markdown
from rvsg.report.versions import ORDER, ShownPair, change_rows, pair_replay, versions_page
from rvsg.scenario.builder import as_robot
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.simulators import check_robot, make_simulator
from rvsg.simulation.stacks.registry import StackChoice
from rvsg.world.world import World


@dataclass(frozen=True, kw_only=True)
class VersionComparison:
    """Two versions of the system under test on the same scenarios and seeds."""

    first: SuiteResult
    second: SuiteResult
    changes: tuple[CaseChange, ...]
    suite: Suite | None = None
    """The suite, where it was run for the comparison; a page then replays what changed."""

    def page(self, *, most: int = 6) -> str:
        """Return the comparison as an HTML page; with the suite at hand, two runs on one clock for `most` changes."""
        pairs = [] if self.suite is None else list(_pairs(self.suite, self.first, self.second, self.changes, most))
        return versions_page(self.first, self.second, self.changes, pairs)

    def replay(self, case: str, requirement: str) -> dict[str, Any]:
        """Return both versions' runs of the first seed that differs, as data of the replay component.

        Raises:
            InputError: no suite is at hand, or no seed of the case differs between the versions.
        """
        if self.suite is None or (case, requirement) not in self.replayable:
            raise InputError(f"{case}, {requirement}: no run of a suite at hand differs between the two versions.")
        change = next(each for each in self.changes if (each.case, each.requirement) == (case, requirement))
        return pair_replay(
            _pair(self.suite, self.first, self.second, change), (self.first.version, self.second.version)
        )

    @property
    def rows(self) -> list[dict[str, str]]:
        """The changes as a table of text, what broke first; `tone` is good, bad or empty."""
        return change_rows(self.changes)

    @property
    def replayable(self) -> frozenset[tuple[str, str]]:
        """Case and requirement of each change that a replay can show."""
        found = (each for each in self.changes if self.suite is not None and each.only_first + each.only_second)
        return frozenset((each.case, each.requirement) for each in found)

    @property
    def broken(self) -> tuple[CaseChange, ...]:
        """The cases that the second version breaks."""
        return tuple(each for each in self.changes if each.change is Change.BROKEN)

    @property
    def markdown(self) -> str:
        """The comparison as a table for a pull request."""
        return changes_markdown(self.first, self.second, self.changes)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data."""
        return {
            "first": self.first.version,
            "second": self.second.version,
            "counts": {change.value: number for change, number in counts(self.changes).items()},
            "changes": [each.model_dump(mode="json") for each in self.changes],
        }


def compare_versions(
    first: str | Path | SuiteResult,
    second: str | Path | SuiteResult,
    *,
    suite: str | Path | None = None,
    runs: int = 20,
    jobs: int = 1,
    error_rate: float = 0.05,
    on_message: Callable[[str], None] = ignore,
) -> VersionComparison:
    """Compare two versions of the system under test.

    Args:
        first, second: results, or files of `rvsg suite run --json`; with `suite`, versions to run it with, as
            `SIMULATOR` or `SIMULATOR:OPTION=VALUE,OPTION=VALUE`. The option `robot` gives every case another robot:
            `embedded:robot=slower.yaml`.
        runs: runs of every case, where the suite is run now.
        error_rate: probability of one false alarm in the whole comparison.

    Raises:
        InputError: a version cannot be run, or the results have no case in common.
    """
    opened = None if suite is None else Suite.open(suite)
    if opened is None:
        results = [given if isinstance(given, SuiteResult) else read_results(given) for given in (first, second)]
    else:
        results, asked = [], (str(first), str(second))
        for given in asked:
            _check_version(given)
        for given in asked:
            on_message(f"Running {counted(len(opened.cases), 'case')} with {given}.")
            simulator, robot = _version(given)
            made = opened.run(
                simulator=simulator, version=given, robot=robot, jobs=jobs, runs=runs, on_message=on_message
            )
            results.append(made)
    changes = compare_results(results[0], results[1], error_rate=error_rate)
    if all(each.change is Change.MISSING for each in changes):
        raise InputError("The two results have no case in common. Run the same suite with both versions.")
    return VersionComparison(first=results[0], second=results[1], changes=changes, suite=opened)


def _pairs(
    suite: Suite, first: SuiteResult, second: SuiteResult, changes: Sequence[CaseChange], most: int
) -> Iterator[ShownPair]:
    """Yield the first seed that differs of each changed case, run again with both versions."""
    changed = [each for each in changes if each.change in (Change.BROKEN, Change.FIXED, Change.UNCLEAR)]
    for change in sorted(changed, key=lambda each: ORDER.index(each.change))[:most]:
        yield _pair(suite, first, second, change)


def _pair(suite: Suite, first: SuiteResult, second: SuiteResult, change: CaseChange) -> ShownPair:
    """Return the first seed that differs of a changed case, run again with both versions."""
    case = next(each for each in suite.cases if each.name == change.case)
    expectation = next(each for each in case.expectations if each.requirement == change.requirement)
    world, route = suite.worlds[case.name], case.scenario.mission.route
    requirement = requirement_of(expectation, suite.folder, route)
    seed = _differing(first, second, change)
    measuring = Measuring(requirement, world)
    shown = []
    for result in (first, second):
        if result.asked is None:
            raise InputError(f"{result.version}: the results do not say how to make this version again.")
        driven = case if result.robot is None else driven_by(case, result.robot, world)
        (run,) = simulate(driven.scenario, [seed], simulator=result.asked, world=world)
        shown.append(run_facts(run, measuring.measure(run), requirement, world, driven.scenario))
    return ShownPair(
        change=change,
        seed=seed,
        scenario=case.scenario,
        requirement=requirement,
        world=world,
        runs=(shown[0], shown[1]),
    )


def _differing(first: SuiteResult, second: SuiteResult, change: CaseChange) -> int:
    """Return the first common seed of a case that violates in one version alone."""
    flags = [
        dict(zip(each.seeds, each.violations, strict=True))
        for result in (first, second)
        for each in result.cases
        if (each.case, each.requirement) == (change.case, change.requirement)
    ]
    return next(seed for seed, flag in flags[0].items() if seed in flags[1] and flag != flags[1][seed])


def _check_version(text: str) -> None:
    """Refuse a version that cannot be made, before the other one runs."""
    simulator, robot = _version(text)
    with closing(make_simulator(simulator)) as made:
        if robot is not None:
            as_robot(robot, made.robots)


def _version(text: str) -> tuple[Spec, str | None]:
    """Return the simulator of a version, and its robot where it has one of its own."""
    name, _, options = text.partition(":")
    values: dict[str, Any] = {}
    for pair in filter(None, options.split(",")):
        key, equals, value = pair.partition("=")
        if not (key and equals):
            raise InputError(f"{text}: expected SIMULATOR:OPTION=VALUE,OPTION=VALUE.")
        try:
            values[key] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise InputError(f"{text}: the value of {key} cannot be read: {error}") from None
    robot = values.pop("robot", None)
    return Spec(name, values), None if robot is None else str(robot)


@dataclass(frozen=True)
class Tested:
    """A scenario with the requirement that judges it."""

    name: str
    scenario: Scenario
    requirement: Requirement
    world: World


def compare_stacks(
    source: str | Path | None,
    stacks: Sequence[str | Spec],
    *,
    robots: Sequence[str] = (),
    runs: int = 10,
    scenarios: int = 10,
    jobs: int = 1,
    on_score: Callable[[StackScore], None] = ignore,
    on_message: Callable[[str], None] = ignore,
) -> StackScores:
    """Compare navigation stacks on the same scenarios and seeds.

    Args:
        source: a suite, a campaign's folder, or a folder of several campaigns.
        stacks: names, files, classes or commands, as for `--stack`.
        robots: robots to drive instead of those of the scenarios; every stack drives every one of them.
        runs: seeds of each scenario.
        scenarios: how many scenarios of the campaigns, the worst of each first; a suite is run as a whole.
        jobs: worker processes; the results are the same.

    Raises:
        InputError: there is nothing to compare, or a stack cannot be used.
        SimulationError: a run could not be made.
    """
    if len({str(stack) for stack in stacks}) < len(stacks):
        raise InputError("Two of the stacks are the same. Name each of them once.")
    if not stacks:
        raise InputError("Name the stacks to compare: --stack nav2-dwb --stack nav2-rpp.", code="no-stack")
    if source is None:
        message = "Name the suite or the campaign whose scenarios are driven: rvsg stacks DIR --stack ..."
        raise InputError(message, code="no-source")
    cases = tested_in(Path(source), scenarios)
    chosen = [(str(stack), stack, StackChoice.of(stack)) for stack in stacks]
    scores = []
    for label, stack, choice in chosen:
        for robot in robots or ("",):
            simulator = make_simulator("embedded", stack)
            name = f"{label} on {robot}" if robot else label
            with closing(simulator):
                simulator.prepare(on_message)
                score = _score(name, choice, simulator, cases, robot, runs, jobs, on_message)
            scores.append(score)
            on_score(score)
    return score_stacks(str(source), [case.name for case in cases], runs, scores)


def write_comparison(found: StackScores, source: str | Path, folder: str | Path) -> list[Path]:
    """Write a comparison as `index.html`, `stacks.svg`, `stacks.md` and `stacks.json`; return their paths."""
    worlds = {case.name: case.world for case in tested_in(Path(source), len(found.cases))}
    contents = {
        "index.html": stacks_page(found, worlds),
        "stacks.svg": stacks_figure(found),
        "stacks.md": stacks_markdown(found),
        "stacks.json": found.to_json(),
    }
    for name, text in contents.items():
        write_whole(Path(folder) / name, text)
    return [Path(folder) / name for name in contents]


def tested_in(source: Path, scenarios: int) -> list[Tested]:
    """Return the cases of a suite, or the worst scenarios of one or more campaigns, taken in turn."""
    if (source / HEAD).is_file():
        suite = Suite.open(source)
        return [
            Tested(
                f"{case.name}, {each.requirement}", case.scenario,
                requirement_of(each, source, case.scenario.mission.route), suite.worlds[case.name],
            )
            for case in suite.cases
            for each in case.expectations
        ]  # fmt: skip
    if not source.is_dir():
        raise InputError(f"{source}: there is no such folder. Give a suite, or the folder of one or more campaigns.")
    folders = [source] if store_of(source) else folders_in(source)
    campaigns = [campaign for folder in folders for campaign in campaigns_in(folder, optional=True)]
    found = [_worst(campaign) for campaign in campaigns]
    turns = [case for k in range(max(map(len, found), default=0)) for each in found for case in each[k : k + 1]]
    if not turns:
        raise InputError(f"{source}: there is neither a suite nor a campaign with scenarios. Make one: rvsg run")
    return turns[:scenarios]


def _worst(campaign: Campaign) -> list[Tested]:
    plan = campaign.plan
    attempts = candidates(search_attempts(campaign.attempts()), plan.requirement)
    return [
        Tested(f"{campaign.name} #{attempt.index}", attempt.proposal.scenario, plan.requirement, campaign.world)
        for attempt in attempts
        if attempt.proposal.scenario is not None
    ]


def _score(
    label: str, choice: StackChoice, simulator: Simulator, cases: Sequence[Tested], robot: str, runs: int, jobs: int,
    tell: Callable[[str], None],
) -> StackScore:  # fmt: skip
    scored: list[ScoredRun] = []
    worlds = {case.world.id: case.world for case in cases}
    for key, world in worlds.items():
        with Simulations(simulator, world, jobs=jobs, notify=tell) as simulations:
            pending = [
                (case, simulations.submit(_driven_by(case, robot, simulator), seed))
                for case in cases
                if case.world.id == key
                for seed in range(runs)
            ]
            for case, each in pending:
                result = each.result()
                if isinstance(result, Failure):
                    raise SimulationError(f"{label}, {case.name}, seed {result.seed}: {result.reason}")
                scored.append(_scored(case, result.unpack()))
    failed = sum(run.outcome == Outcome.STACK_FAILED.name for run in scored)
    record = choice.record
    return StackScore(label=label, name=record.name, version=record.version, runs=tuple(scored), failed=failed)


def _driven_by(case: Tested, robot: str, simulator: Simulator) -> Scenario:
    """Return the scenario of a case with another robot, where there is one."""
    scenario = case.scenario
    if robot:
        scenario = scenario.replace(mission=scenario.mission.replace(robot=as_robot(robot, simulator.robots)))
    check_robot(scenario, simulator)
    return scenario


def _scored(case: Tested, run: Run) -> ScoredRun:
    measured = Measuring(case.requirement, case.world).measure(run)
    violated = None if measured.objective is None else case.requirement.violated_by(measured.objective)
    at = None
    if violated:
        decisive = run_facts(run, measured, case.requirement, case.world, case.scenario).decisive_at
        at = (float(decisive.x), float(decisive.y))
    contact = (measured.values.get("contacts") or 0.0) > 0.0
    return ScoredRun(case=case.name, seed=run.seed, violated=violated, outcome=run.outcome.name, contact=contact, at=at)


class Pair(Record):
    """A configuration that two campaigns both ran."""

    scenario_id: str
    description: str
    first: int
    """The attempt of the first campaign."""
    second: int
    """The attempt of the second campaign."""
    first_mean: float | None
    second_mean: float | None
    first_violations: tuple[int, int]
    """Runs that violate the requirement, of how many."""
    second_violations: tuple[int, int]
    change: Change
    """By the exact McNemar test on the seeds both ran, corrected by Holm over all pairs; see `compare_results`."""


def pairs_of(first: Campaign, second: Campaign) -> tuple[Pair, ...]:
    """Return the configurations that both campaigns ran, in the order of the first."""
    mine, theirs = _measured(first), _measured(second)
    common = [key for key in mine if key in theirs]
    changes = compare_results(
        _as_results(first, (mine[key] for key in common)), _as_results(second, (theirs[key] for key in common))
    )
    by_case = {change.case: change.change for change in changes}
    return tuple(_common(mine[key], theirs[key], by_case[_name(key)]) for key in common)


def _measured(campaign: Campaign) -> dict[str, Attempt]:
    """Return the attempts with runs by what their people do; a confirmation before the search it confirms."""
    found: dict[str, Attempt] = {}
    for attempt in campaign.attempts():
        scenario = attempt.proposal.scenario
        if scenario is None or attempt.verdict is None or attempt.purpose not in ("search", "confirmation"):
            continue
        key = scenario.people.id
        if key not in found or attempt.purpose == "confirmation":
            found[key] = attempt
    return found


def _name(key: str) -> str:
    return f"case-{key}"


def _as_results(campaign: Campaign, attempts: Iterable[Attempt]) -> SuiteResult:
    return SuiteResult(
        suite=campaign.name,
        version=campaign.name,
        simulator=campaign.record.simulator.name,
        cases=tuple(_result(campaign, attempt) for attempt in attempts),
    )


def _result(campaign: Campaign, attempt: Attempt) -> CaseResult:
    scenario, verdict, requirement = attempt.proposal.scenario, attempt.verdict, campaign.requirement
    assert scenario is not None and verdict is not None
    flags = [None if m.objective is None else requirement.violated_by(m.objective) for m in attempt.measurements]
    return CaseResult(
        case=_name(scenario.people.id),
        title=scenario.description[:200] or "Without a description",
        requirement=requirement.name,
        expected="pass",
        state=state_of("pass", verdict),
        verdict=verdict,
        seeds=tuple(m.seed for m in attempt.measurements),
        violations=tuple(flags),
    )


def _common(first: Attempt, second: Attempt, change: Change) -> Pair:
    scenario, one, two = first.proposal.scenario, first.verdict, second.verdict
    assert scenario is not None and one is not None and two is not None
    return Pair(
        scenario_id=scenario.id,
        description=scenario.description,
        first=first.index,
        second=second.index,
        first_mean=one.mean,
        second_mean=two.mean,
        first_violations=(one.violations, one.runs),
        second_violations=(two.violations, two.runs),
        change=change,
    )
