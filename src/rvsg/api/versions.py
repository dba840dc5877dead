"""Compare two versions of the system under test on the same scenarios and seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rvsg.api.scenarios import as_robot
from rvsg.api.simulating import ignore, make_simulator, simulate
from rvsg.api.suites import Suite, driven_by, read_results, requirement_of
from rvsg.campaign.measuring import Measuring
from rvsg.campaign.suite import CaseChange, Change, SuiteResult, compare_results, counts
from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec
from rvsg.evaluation.wording import counted
from rvsg.report.facts import run_facts
from rvsg.report.suites import changes_markdown
from rvsg.report.versions import ORDER, ShownPair, change_rows, pair_replay, versions_page


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
            as_robot(robot, made)


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
