"""Paired comparison of versions, navigation stacks and campaigns on the same scenarios and seeds."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rvsg.app.campaign import Campaign, campaigns_in
from rvsg.app.folder import store_of
from rvsg.app.matrix import folders_in
from rvsg.app.suites import Suite
from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.core.plugins import Spec, ignore
from rvsg.evaluation.verdict import counted
from rvsg.findings.ranking import candidates, search_attempts
from rvsg.report.comparison_page import (
    TONES,
    ReplayedChange,
    change_replay,
    comparison_page,
    ranking_markdown,
    shares_figure,
)
from rvsg.report.run_facts import run_facts
from rvsg.runs.attempt import Measurement
from rvsg.runs.runner import Evaluator
from rvsg.scenario.builder import as_robot
from rvsg.scenario.requirement import Requirement
from rvsg.search.run_set import simulate
from rvsg.simulation.run import Run
from rvsg.simulation.simulators import make_simulator
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.suites.suite import (
    Case,
    CaseChange,
    CaseResult,
    Change,
    Comparison,
    Expectation,
    SuiteResult,
    compare,
    compare_attempts,
)
from rvsg.suites.suite_folder import HEAD, SuiteCase, read_results, run_cases


@dataclass(frozen=True, kw_only=True)
class VersionComparison:
    """Two versions of the system under test on the same scenarios and seeds."""

    found: Comparison
    suite: Suite | None = None
    """The suite, where it was run for the comparison; a page then replays what changed."""

    @property
    def replayable(self) -> frozenset[tuple[str, str]]:
        """Case and requirement of each change that a replay can show."""
        changes = (
            change for change in self.found.changes if self.suite is not None and change.only_first + change.only_second
        )
        return frozenset((change.case, change.requirement) for change in changes)

    def page(self) -> str:
        """Return the comparison as an HTML page; with the suite at hand, two runs on one clock for six changes."""
        changed = [change for change in self.found.changes if change.change not in (Change.MISSING, Change.UNCHANGED)]
        shown = sorted(changed, key=lambda change: [*TONES].index(change.change))[:6] if self.suite is not None else []
        return comparison_page(self.found, replayed=[self._replayed(change) for change in shown])

    def replay(self, case: str, requirement: str) -> dict[str, Any]:
        """Return both versions' runs of the first seed that differs, as data of the replay component.

        Raises:
            InputError: no suite is at hand, or no seed of the case differs between the versions.
        """
        if (case, requirement) not in self.replayable:
            raise InputError(f"{case}, {requirement}: no run of a suite at hand differs between the two versions.")
        change = next(each for each in self.found.changes if (each.case, each.requirement) == (case, requirement))
        return change_replay(self._replayed(change), [variant.version for variant in self.found.variants])

    def _replayed(self, change: CaseChange) -> ReplayedChange:
        """Return the first seed that differs of a changed case, run again with both versions."""
        assert self.suite is not None
        tested = self.suite.tested(change.case)
        names = [expectation.requirement for expectation in tested.case.expectations]
        route = tested.case.scenario.mission.route
        requirement = tested.requirements[names.index(change.requirement)].for_time_limit(route.time_limit_s)
        measuring = Evaluator(requirement, tested.world)
        mine, theirs = (
            {case.key: case.flags for case in variant.cases}[change.case, change.requirement]
            for variant in self.found.variants
        )
        seed = next(seed for seed, flag in mine.items() if seed in theirs and flag != theirs[seed])
        shown = []
        for variant in self.found.variants:
            simulator = next(case.simulator for case in variant.cases if case.key == (change.case, change.requirement))
            if (simulator := simulator or variant.asked) is None:
                raise InputError(f"{variant.version}: the results do not say how to make this version again.")
            driven = tested if variant.robot is None else tested.driven_by(variant.robot)
            (run,) = simulate(driven.case.scenario, [seed], simulator=simulator, world=tested.world)
            shown.append(run_facts(run, measuring.measure(run), requirement, tested.world, driven.case.scenario))
        return ReplayedChange(
            change=change,
            seed=seed,
            scenario=tested.case.scenario,
            requirement=requirement,
            world=tested.world,
            runs=(shown[0], shown[1]),
        )


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
        results = [source if isinstance(source, SuiteResult) else read_results(source) for source in (first, second)]
    else:
        asked = [(str(source), *_version(str(source))) for source in (first, second)]
        for _, simulator, robot in asked:  # one that cannot be made is refused before the other runs
            with closing(make_simulator(simulator)) as ready:
                if robot is not None:
                    as_robot(robot, ready.robots)
        results = []
        for name, simulator, robot in asked:
            on_message(f"Running {counted(len(opened.cases), 'case')} with {name}.")
            results.append(
                opened.run(simulator=simulator, version=name, robot=robot, jobs=jobs, runs=runs, on_message=on_message)
            )
    comparison = compare(results, error_rate=error_rate)
    if all(change.change is Change.MISSING for change in comparison.changes):
        raise InputError("The two results have no case in common. Run the same suite with both versions.")
    return VersionComparison(found=comparison, suite=opened)


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


def compare_stacks(
    source: str | Path | None,
    stacks: Sequence[str | Spec],
    *,
    robots: Sequence[str] = (),
    runs: int = 10,
    scenarios: int = 10,
    jobs: int = 1,
    on_result: Callable[[SuiteResult], None] = ignore,
    on_message: Callable[[str], None] = ignore,
) -> Comparison:
    """Compare navigation stacks on the same scenarios and seeds, the one with the least violating runs first.

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
    versions = {str(stack): StackChoice.of(stack).record.version for stack in stacks}
    variants = []
    for stack, robot in ((stack, robot) for stack in stacks for robot in robots or ("",)):
        with closing(make_simulator("embedded", stack)) as simulator:
            simulator.prepare(on_message)
            driver = as_robot(robot, simulator.robots) if robot else None
            driven = [case if driver is None else case.with_robot(driver) for case in cases]
            results = run_cases(driven, simulator, runs=runs, jobs=jobs, finish=_placed, on_message=on_message)
            variants.append(
                SuiteResult(
                    suite=str(source),
                    version=f"{stack} on {robot}" if robot else str(stack),
                    stack_version=versions[str(stack)],
                    simulator=simulator.name,
                    options=dict(simulator.options),
                    robot=driver,
                    cases=tuple(results),
                )
            )
        on_result(variants[-1])
    return compare(variants, source=str(source), ranked=True)


def _placed(
    result: CaseResult, tested: SuiteCase, requirement: Requirement, _: Run, runs: Sequence[tuple[Run, Measurement]]
) -> CaseResult:
    """Add where the robot is at the decisive moment of each violating run."""
    decisive = [
        run_facts(run, measured, requirement, tested.world, tested.scenario).decisive_at
        for (run, measured), violated in zip(runs, result.violations, strict=True)
        if violated
    ]
    return result.replace(places=tuple(decisive))


def write_comparison(found: Comparison, source: str | Path, folder: str | Path) -> list[Path]:
    """Write a comparison as `index.html`, `stacks.svg`, `stacks.md` and `stacks.json`; return their paths."""
    worlds = {tested.case.name: tested.world for tested in tested_in(Path(source), len(found.cases))}
    contents = {
        "index.html": comparison_page(found, worlds=worlds),
        "stacks.svg": shares_figure(found),
        "stacks.md": ranking_markdown(found),
        "stacks.json": found.to_json(),
    }
    for name, text in contents.items():
        write_whole(Path(folder) / name, text)
    return [Path(folder) / name for name in contents]


def tested_in(source: Path, scenarios: int) -> list[SuiteCase]:
    """Return the cases of a suite, or the worst scenarios of one or more campaigns, taken in turn."""
    if (source / HEAD).is_file():
        suite = Suite.open(source)
        return [suite.tested(case.name) for case in suite.cases]
    if not source.is_dir():
        raise InputError(f"{source}: there is no such folder. Give a suite, or the folder of one or more campaigns.")
    folders = [source] if store_of(source) else folders_in(source)
    campaigns = [campaign for folder in folders for campaign in campaigns_in(folder, optional=True)]
    worst = [list(_worst(campaign)) for campaign in campaigns]
    turns = [case for k in range(max(map(len, worst), default=0)) for cases in worst for case in cases[k : k + 1]]
    if not turns:
        raise InputError(f"{source}: there is neither a suite nor a campaign with scenarios. Make one: rvsg run")
    return turns[:scenarios]


def _worst(campaign: Campaign) -> Iterator[SuiteCase]:
    """Yield the scenarios of a campaign's search as cases, the worst first."""
    world, requirement = campaign.world, campaign.requirement
    for attempt in candidates(search_attempts(campaign.attempts()), requirement):
        if attempt.proposal.scenario is not None:
            name = re.sub(r"[^a-z0-9.]+", "-", f"{campaign.name}-{attempt.index}".lower())[-80:].strip("-.")
            case = Case(
                name=name,
                title=f"{campaign.name} #{attempt.index}",
                expectations=(Expectation(requirement=requirement.name),),
                scenario=attempt.proposal.scenario,
            )
            yield SuiteCase(case=case, world=world, requirements=(requirement,), judging=campaign.record.judging)


def compare_campaigns(first: Campaign, second: Campaign) -> Comparison:
    """Compare the configurations that two campaigns both ran, in the order of the first; a case is an attempt."""
    return compare_attempts(
        [(campaign.plan, campaign.record.simulator.name, campaign.attempts()) for campaign in (first, second)]
    )
