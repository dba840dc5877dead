"""Compare two versions of the system under test on the same scenarios and seeds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rvsg.api.simulating import ignore
from rvsg.api.suites import Suite, read_results
from rvsg.campaign.suite import CaseChange, Change, SuiteResult, compare_results, counts
from rvsg.core.errors import InputError
from rvsg.core.plugins import Spec
from rvsg.report.suites import changes_markdown


@dataclass(frozen=True, kw_only=True)
class VersionComparison:
    """Two versions of the system under test on the same scenarios and seeds."""

    first: SuiteResult
    second: SuiteResult
    changes: tuple[CaseChange, ...]

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
    if suite is None:
        results = [given if isinstance(given, SuiteResult) else read_results(given) for given in (first, second)]
    else:
        opened = Suite.open(suite)
        results = []
        for given in (str(first), str(second)):
            on_message(f"Running {len(opened.cases)} cases with {given}.")
            simulator, robot = _version(given)
            made = opened.run(
                simulator=simulator, version=given, robot=robot, jobs=jobs, runs=runs, on_message=on_message
            )
            results.append(made)
    changes = compare_results(results[0], results[1], error_rate=error_rate)
    if all(each.change is Change.MISSING for each in changes):
        raise InputError("The two results have no case in common. Run the same suite with both versions.")
    return VersionComparison(first=results[0], second=results[1], changes=changes)


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
