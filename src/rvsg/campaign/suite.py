"""Suites: scenarios that stay, with the verdict you expect of each, and what changed since.

A case passes a suite where its verdict is the expected one. The sequential procedure of `rvsg.evaluation.judge`
decides each verdict with its declared error rate, so a case changes its state only on statistical evidence; where the
runs do not decide, the state is unclear, and that is no failure.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Annotated, Any, Literal

from pydantic import Field

from rvsg.core.errors import NothingJudged
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.evaluation.judge import violated
from rvsg.evaluation.statistics import ShareDifference, holm, share_difference, wilson
from rvsg.evaluation.verdict import DEFAULT, Procedure, Status, Verdict
from rvsg.evaluation.wording import counted
from rvsg.robots.robot import Robot
from rvsg.scenario.scenario import Scenario

Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[a-z0-9][a-z0-9._-]*$")]


class Expectation(Record):
    """What a case expects of one requirement."""

    requirement: str
    """Name of a shipped requirement, or FILE.yaml#NAME beside the suite."""
    expected: Literal["pass", "violation"] = "pass"
    """`violation` marks a known failure; give the reason."""
    reason: str = ""


class Case(Record):
    """A scenario of a suite, with a stable name and a title that people read."""

    name: Name
    """Stable: results of versions are compared by it."""
    title: Annotated[str, Field(min_length=1, max_length=200)]
    expectations: Annotated[tuple[Expectation, ...], Field(min_length=1)]
    scenario: Scenario
    max_runs: Annotated[int, Field(ge=1, le=10_000)] = DEFAULT.max_runs
    """Runs at most; the sequential procedure stops as soon as the verdict is decided."""


class State(str, Enum):
    """What a run of a suite says of a case, in the words a person reads."""

    PASSED = "passed"
    KNOWN_FAILURE = "known failure"
    FIXED = "fixed"
    BROKEN = "broken"
    UNCLEAR = "unclear"

    @property
    def fails(self) -> bool:
        """Return whether a build that holds this state should fail."""
        return self is State.BROKEN


class CaseResult(Record):
    """One case judged by one requirement."""

    case: str
    title: str
    requirement: str
    expected: Literal["pass", "violation"]
    reason: str = ""
    state: State
    verdict: Verdict
    seeds: tuple[int, ...]
    violations: tuple[bool | None, ...]
    """For each seed whether the run violates the requirement; None if it holds no judgement."""
    contacts: int = 0
    """Runs in which the robot touches a person, whatever the requirement measures."""
    arrived: int = 0
    """Runs that reach the goal in time."""
    seconds: float = 0.0
    """Simulated seconds of all runs together."""
    story: tuple[str, ...] = ()
    """What happens in the worst run, in sentences."""
    worst_seed: int | None = None
    """The seed of that run."""
    picture: str | None = None
    """The file with pictures of that run, as it was written; None if none was asked for."""


class SuiteResult(Record):
    """A whole suite, run with one version of the system under test."""

    suite: str
    version: str
    """A label of what was run: simulator, stack, robot, or a commit."""
    simulator: str
    options: dict[str, Any] = Field(default_factory=dict)
    asked: Spec | None = None
    """What makes the simulator again, with the stack under test; None if it was given as an object."""
    robot: Robot | str | None = None
    """The robot that drove every case instead of its own."""
    cases: tuple[CaseResult, ...]

    @property
    def broken(self) -> tuple[CaseResult, ...]:
        """The cases that should pass and do not."""
        return tuple(case for case in self.cases if case.state.fails)

    def check_judged(self) -> None:
        """Check that something is known of the system under test, before "nothing is broken" is taken for an answer.

        Raises:
            NothingJudged: the requirement has no value in any run of any case, as where the stack failed in all.
        """
        runs = [violated for case in self.cases for violated in case.violations]
        if runs and all(violated is None for violated in runs):
            raise NothingJudged(
                f"{self.suite}: nothing was judged: no requirement has a value in any of {counted(len(runs), 'run')} "
                f"of {counted(len(self.cases), 'case')}. Mend the stack under test; see `rvsg simulate`."
            )


def state_of(expected: Literal["pass", "violation"], verdict: Verdict, *, procedure: Procedure = DEFAULT) -> State:
    """Return the state of a case from what was expected and the verdict."""
    if violated(verdict, procedure=procedure):
        return State.KNOWN_FAILURE if expected == "violation" else State.BROKEN
    if verdict.status is Status.PASS:
        return State.FIXED if expected == "violation" else State.PASSED
    return State.UNCLEAR


class Change(str, Enum):
    """What became of a case from one version to another."""

    FIXED = "fixed"
    BROKEN = "broken"
    UNCHANGED = "unchanged"
    UNCLEAR = "unclear"
    MISSING = "only in one version"


class CaseChange(Record):
    """A case of two versions, compared on the seeds that both were run with."""

    case: str
    title: str
    requirement: str
    change: Change
    seeds: int
    violations: tuple[int, int]
    """Violating runs of the first and of the second version, on these seeds."""
    only_first: int
    """Seeds that violate in the first version alone."""
    only_second: int
    """Seeds that violate in the second version alone."""
    difference: float | None
    """Share of violating runs, second minus first."""
    interval: tuple[float, float] | None
    """95 % interval of the difference, paired."""
    p: float | None
    """Exact McNemar test."""
    p_corrected: float | None
    """By Holm over all cases of the comparison."""


Pairs = Sequence[tuple[bool, bool]]
"""For each common seed whether the first and the second version violate."""


def compare_results(first: SuiteResult, second: SuiteResult, *, error_rate: float = 0.05) -> tuple[CaseChange, ...]:
    """Compare two versions case by case, on the same seeds.

    A case is fixed or broken where the exact McNemar test, corrected by Holm over all cases, is below `error_rate`;
    so the chance of one false alarm in the whole comparison is at most that. It is unchanged where the verdicts agree,
    and unclear where they do not and the test is not sure.
    """
    theirs = {(case.case, case.requirement): case for case in second.cases}
    matched = [(case, theirs.get((case.case, case.requirement))) for case in first.cases]
    pairs = {_key(case): _pairs(case, other) for case, other in matched if other}
    p_values = {key: _mcnemar(*_discordant(found)) for key, found in pairs.items()}
    corrected = holm(p_values)
    known = {(case.case, case.requirement) for case in first.cases}
    changes = [
        _change(case, other, pairs[_key(case)], p_values[_key(case)], corrected[_key(case)], error_rate)
        if other
        else _missing(case)
        for case, other in matched
    ]
    changes += [_missing(case) for case in second.cases if (case.case, case.requirement) not in known]
    return tuple(changes)


def _key(case: CaseResult) -> str:
    return f"{case.case}/{case.requirement}"


def _change(
    case: CaseResult, other: CaseResult, pairs: Pairs, p: float, p_corrected: float, error_rate: float
) -> CaseChange:
    only_first, only_second = _discordant(pairs)
    if p_corrected < error_rate:
        change = Change.BROKEN if only_second > only_first else Change.FIXED
    elif only_first == only_second == 0 or _settled(case.verdict) == _settled(other.verdict) is not None:
        change = Change.UNCHANGED
    else:
        change = Change.UNCLEAR
    before, after = [a for a, _ in pairs], [b for _, b in pairs]
    difference = share_difference(after, before, paired=True)
    return CaseChange(
        case=case.case,
        title=case.title,
        requirement=case.requirement,
        change=change,
        seeds=len(pairs),
        violations=(sum(before), sum(after)),
        only_first=only_first,
        only_second=only_second,
        difference=difference.difference if difference else None,
        interval=difference.interval if difference else None,
        p=p,
        p_corrected=p_corrected,
    )


def _missing(case: CaseResult) -> CaseChange:
    return CaseChange(
        case=case.case,
        title=case.title,
        requirement=case.requirement,
        change=Change.MISSING,
        seeds=0,
        violations=(0, 0),
        only_first=0,
        only_second=0,
        difference=None,
        interval=None,
        p=None,
        p_corrected=None,
    )


def _pairs(first: CaseResult, second: CaseResult) -> Pairs:
    """Return whether each common seed violates in the first and in the second version."""
    theirs = dict(zip(second.seeds, second.violations, strict=True))
    return tuple(
        (mine, other)
        for seed, mine in zip(first.seeds, first.violations, strict=True)
        if mine is not None and (other := theirs.get(seed)) is not None
    )


def _discordant(pairs: Pairs) -> tuple[int, int]:
    """Return how many seeds violate in the first version alone, and in the second alone."""
    return sum(a and not b for a, b in pairs), sum(b and not a for a, b in pairs)


def _mcnemar(only_first: int, only_second: int) -> float:
    """The exact two-sided McNemar test (McNemar 1947): the discordant pairs are a fair coin if nothing changed."""
    from scipy import stats

    discordant = only_first + only_second
    if discordant == 0:
        return 1.0
    return float(stats.binomtest(only_second, discordant, 0.5).pvalue)


def _settled(verdict: Verdict) -> bool | None:
    """Return whether a verdict says violated (True), passed (False) or neither (None)."""
    if verdict.status is Status.PASS:
        return False
    return True if violated(verdict) else None


def counts(changes: Sequence[CaseChange]) -> dict[Change, int]:
    """Return how many cases changed how; every kind is there."""
    return {change: sum(each.change is change for each in changes) for change in Change}


class ScoredRun(Record):
    """One run of a stack, judged by one requirement."""

    case: str
    """Scenario and requirement."""
    seed: int
    violated: bool | None
    """None if the run holds no judgement."""
    outcome: str
    contact: bool
    """Whether the robot touches a person."""
    at: tuple[float, float] | None = None
    """Where the robot is at the decisive moment of a violation, m."""


class StackScore(Record):
    """A stack over all cases."""

    label: str
    """The stack as the user named it, and the robot where there are several."""
    name: str
    version: str
    runs: tuple[ScoredRun, ...]
    failed: int = 0
    """Runs in which the stack itself failed."""

    @property
    def flags(self) -> dict[tuple[str, int], bool]:
        """Whether each judged run violates its requirement, by case and seed."""
        return {(run.case, run.seed): run.violated for run in self.runs if run.violated is not None}

    @property
    def violated(self) -> int:
        """Violating runs."""
        return sum(self.flags.values())

    @property
    def judged(self) -> int:
        """Runs with a judgement."""
        return len(self.flags)

    @property
    def share(self) -> float:
        """The share of judged runs that violate; 0 of none."""
        return self.violated / self.judged if self.judged else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's interval of the share."""
        return wilson(self.violated, self.judged) if self.judged else (0.0, 1.0)

    @property
    def contacts(self) -> int:
        """Runs in which the robot touches a person."""
        return sum(run.contact for run in self.runs)

    @property
    def arrived(self) -> int:
        """Runs that reach the goal in time."""
        return sum(run.outcome == "REACHED" for run in self.runs)

    def of_case(self, case: str) -> tuple[int, int]:
        """Return violating and judged runs of a case."""
        flags = [violated for (name, _), violated in self.flags.items() if name == case]
        return sum(flags), len(flags)


class StackPair(Record):
    """Two stacks on the same scenarios and seeds."""

    first: str
    second: str
    difference: ShareDifference | None
    """Share of the first less that of the second; None without a common run."""


class StackScores(Record):
    """The comparison: stacks from the least share of violating runs to the largest, and every pair of them."""

    source: str
    cases: tuple[str, ...]
    seeds: int
    scores: tuple[StackScore, ...]
    pairs: tuple[StackPair, ...]


def score_stacks(source: str, cases: Sequence[str], seeds: int, scores: Sequence[StackScore]) -> StackScores:
    """Rank stacks and compare every pair of them on their common runs."""
    ranked = sorted(scores, key=lambda score: (score.share, score.failed, score.label))
    pairs = []
    for k, first in enumerate(ranked):
        for second in ranked[k + 1 :]:
            common = sorted(first.flags.keys() & second.flags.keys())
            flags = [[score.flags[key] for key in common] for score in (first, second)]
            difference = share_difference(*flags, paired=True) if common else None
            pairs.append(StackPair(first=first.label, second=second.label, difference=difference))
    return StackScores(source=source, cases=tuple(cases), seeds=seeds, scores=tuple(ranked), pairs=tuple(pairs))
