"""Suites: states of a case, and what changed from one version to another."""

from __future__ import annotations

import numpy as np
import pytest

from rvsg.evaluation.verdict import Verdict, judge
from rvsg.scenario.requirement import Requirement
from rvsg.suites.suite import CaseResult, Change, State, SuiteResult, changes_of, counts, state_of

LIMIT = Requirement(name="X", title="x", text="x", metric="min_distance", worse="smaller", limit=0.5)


def verdict(violations: int, runs: int) -> Verdict:
    return judge(LIMIT, [0.0] * violations + [1.0] * (runs - violations))


def result(flags: list[bool | None], name: str = "door") -> CaseResult:
    known = [flag for flag in flags if flag is not None]
    made = verdict(sum(known), len(known))
    how = {"requirement": "X", "expected": "pass", "state": state_of("pass", made), "verdict": made}
    return CaseResult(case=name, title=name, seeds=tuple(range(len(flags))), violations=tuple(flags), **how)


def suite(*cases: CaseResult) -> SuiteResult:
    return SuiteResult(suite="s", version="v", simulator="embedded", cases=cases)


@pytest.mark.parametrize(
    ("expected", "violations", "runs", "state"),
    [
        ("pass", 0, 20, State.PASSED),
        ("pass", 18, 18, State.BROKEN),
        ("pass", 2, 2, State.BROKEN),
        ("pass", 1, 3, State.UNCLEAR),
        ("violation", 18, 18, State.KNOWN_FAILURE),
        ("violation", 0, 20, State.FIXED),
        ("violation", 0, 3, State.UNCLEAR),
    ],
)
def test_the_state_follows_from_expectation_and_verdict(
    expected: str, violations: int, runs: int, state: State
) -> None:
    assert state_of(expected, verdict(violations, runs)) is state  # type: ignore[arg-type]


def test_only_a_broken_case_fails_a_build() -> None:
    assert [state for state in State if state.fails] == [State.BROKEN]


def test_a_change_is_what_all_seeds_of_both_versions_show() -> None:
    clean, bad = result([False] * 20), result([True] * 20)
    (broken,) = changes_of(suite(clean), suite(bad))
    (fixed,) = changes_of(suite(bad), suite(clean))
    assert (broken.change, fixed.change) == (Change.BROKEN, Change.FIXED)
    assert broken.difference == 1.0 == broken.interval[1]
    assert broken.p == pytest.approx(2 * 0.5**20)
    (few,) = changes_of(suite(clean), suite(result([True] * 4 + [False] * 16)))
    assert (few.change, few.only_first, few.only_second) == (Change.UNCLEAR, 0, 4)
    (unjudged,) = changes_of(suite(result([None, False, False])), suite(result([True, False])))
    assert unjudged.seeds == 1
    changes = changes_of(suite(result([False], "a")), suite(result([False], "b")))
    assert [(each.case, each.change) for each in changes] == [("a", Change.MISSING), ("b", Change.MISSING)]


@pytest.mark.slow
def test_identical_versions_raise_no_alarm_in_100_comparisons_of_12_cases() -> None:
    """Each version draws its own runs from the same violation probabilities: the family-wise error stays below 5 %."""
    rng = np.random.default_rng(7)
    alarms = 0
    for _ in range(100):
        probabilities = rng.uniform(0.0, 1.0, 12)
        first, second = (
            suite(*(result((rng.random(20) < p).tolist(), f"c{k}") for k, p in enumerate(probabilities)))
            for _ in range(2)
        )
        found = counts(changes_of(first, second))
        alarms += bool(found[Change.BROKEN] or found[Change.FIXED])
    assert alarms <= 5
