"""Suites: scenarios that stay, with the verdict you expect of each, and their results.

A case passes a suite where its verdict is the expected one. The sequential procedure of `rvsg.evaluation.verdict`
decides each verdict with its declared error rate, so a case changes its state only on statistical evidence; where the
runs do not decide, the state is unclear, and that is no failure.

Paired comparison of variants of the system under test on the same scenarios and seeds.

A variant is what ran a set of cases: a version of the robot, a navigation stack, or the simulator of a campaign.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from itertools import combinations
from typing import Annotated, Any, Literal

from pydantic import Field

from rvsg.core.errors import NothingJudged
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.evaluation.statistics import ShareDifference, holm, share_difference, wilson
from rvsg.evaluation.verdict import DEFAULT, Status, Verdict, counted, violated
from rvsg.robots.robot import Robot
from rvsg.runs.attempt import Attempt, Measurement, Plan
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.run import Outcome

Name = Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[a-z0-9][a-z0-9._-]*$")]


class Expectation(Record):
    """What a case expects of one requirement."""

    requirement: str
    """Name of a shipped requirement, or FILE.yaml#NAME beside the suite."""
    expected: Literal["pass", "violation"] = "pass"
    """`violation` marks a known failure; give the reason."""
    reason: str = ""
    definition: Requirement | None = None
    """The requirement by content, so that the case stays the same where the file or the shipped one changes."""


class Case(Record):
    """A scenario of a suite, with a stable name and a title that people read."""

    name: Name
    """Stable: results of versions are compared by it."""
    title: Annotated[str, Field(min_length=1, max_length=200)]
    expectations: Annotated[tuple[Expectation, ...], Field(min_length=1)]
    scenario: Scenario
    simulator: Spec | None = None
    """What it was found with: the simulator, and its stack by content and version. A run uses it by default."""
    stack_file: str | None = None
    """The parameter file that stack was read from, relative to the suite. A run tests it where it is given."""
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
    failed: int = 0
    """Runs in which the stack under test itself failed."""
    seconds: float = 0.0
    """Simulated seconds of all runs together."""
    story: tuple[str, ...] = ()
    """What happens in the worst run, in sentences."""
    worst_seed: int | None = None
    """The seed of that run."""
    picture: str | None = None
    """The file with pictures of that run, as it was written; None if none was asked for."""
    places: tuple[tuple[float, float], ...] = ()
    """Where the robot is at the decisive moment of each violating run, m, where that was asked for."""
    attempt: int | None = None
    """The attempt of a campaign that it is; None for a case of a suite."""
    simulator: Spec | None = None
    """What ran it, with the stack by content; None if it was given as an object."""
    stack: str = ""
    """The stack under test, with its version."""
    robot: str = ""
    """The robot, with its content id where it is not one that only its simulator knows."""

    @property
    def key(self) -> tuple[str, str]:
        """What results of variants are compared by: case and requirement."""
        return self.case, self.requirement

    @property
    def flags(self) -> dict[int, bool]:
        """Whether each judged run violates the requirement, by seed."""
        return {seed: flag for seed, flag in zip(self.seeds, self.violations, strict=True) if flag is not None}


class SuiteResult(Record):
    """A whole suite, run with one version of the system under test."""

    suite: str
    version: str
    """A label of what was run: simulator, stack, robot, or a commit."""
    stack_version: str = ""
    """The version of the navigation stack, where stacks are compared."""
    simulator: str
    options: dict[str, Any] = Field(default_factory=dict)
    asked: Spec | None = None
    """In results of RVSG 0.2: what makes the simulator of all cases again."""
    robot: Robot | str | None = None
    """The robot that drove every case instead of its own."""
    cases: tuple[CaseResult, ...]

    @property
    def tested(self) -> str:
        """Every stack and robot that was tested, with versions."""
        return "; ".join(dict.fromkeys(f"{case.stack} on {case.robot}" for case in self.cases if case.stack))

    @property
    def flags(self) -> dict[tuple[str, str, int], bool]:
        """Whether each judged run violates its requirement, by case, requirement and seed."""
        return {(*case.key, seed): flag for case in self.cases for seed, flag in case.flags.items()}

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
    def runs(self) -> int:
        """Runs of all cases and requirements."""
        return sum(len(case.seeds) for case in self.cases)

    @property
    def contacts(self) -> int:
        """Runs in which the robot touches a person."""
        return sum(case.contacts for case in self.cases)

    @property
    def arrived(self) -> int:
        """Runs that reach the goal in time."""
        return sum(case.arrived for case in self.cases)

    @property
    def failed(self) -> int:
        """Runs in which the stack itself failed."""
        return sum(case.failed for case in self.cases)

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
                f"{self.suite}, {self.version}: nothing was judged: no requirement has a value in any of "
                f"{counted(len(runs), 'run')} of {counted(len(self.cases), 'case')}. "
                "Mend the stack under test; see `rvsg simulate`."
            )


def state_of(expected: Literal["pass", "violation"], verdict: Verdict) -> State:
    """Return the state of a case from what was expected and the verdict."""
    if violated(verdict):
        return State.KNOWN_FAILURE if expected == "violation" else State.BROKEN
    if verdict.status is Status.PASS:
        return State.FIXED if expected == "violation" else State.PASSED
    return State.UNCLEAR


class Change(str, Enum):
    """What became of a case from one variant to another."""

    FIXED = "fixed"
    BROKEN = "broken"
    UNCHANGED = "unchanged"
    UNCLEAR = "unclear"
    MISSING = "only in one version"


class CaseChange(Record):
    """A case of two variants, compared on the seeds that both were run with."""

    case: str
    title: str
    requirement: str
    change: Change
    seeds: int = 0
    violations: tuple[int, int] = (0, 0)
    """Violating runs of the first and of the second variant, on these seeds."""
    only_first: int = 0
    """Seeds that violate in the first variant alone."""
    only_second: int = 0
    """Seeds that violate in the second variant alone."""
    difference: float | None = None
    """Share of violating runs, second minus first."""
    interval: tuple[float, float] | None = None
    """95 % interval of the difference, paired."""
    p: float | None = None
    """Exact McNemar test."""
    p_corrected: float | None = None
    """By Holm over all cases of the two variants."""


class VariantPair(Record):
    """Two variants on the same scenarios and seeds."""

    first: str
    second: str
    difference: ShareDifference | None
    """Share of violating runs of the first less that of the second over all cases; None without a common run."""
    changes: tuple[CaseChange, ...]


class Comparison(Record):
    """Variants, and every pair of them."""

    source: str
    """The suite or the campaigns whose scenarios were run."""
    variants: tuple[SuiteResult, ...]
    pairs: tuple[VariantPair, ...]

    @property
    def cases(self) -> tuple[tuple[str, str], ...]:
        """Name and requirement of every case, in order."""
        return tuple(dict.fromkeys(case.key for variant in self.variants for case in variant.cases))

    @property
    def changes(self) -> tuple[CaseChange, ...]:
        """What changed from the first variant to the second."""
        return self.pairs[0].changes if self.pairs else ()

    @property
    def broken(self) -> tuple[CaseChange, ...]:
        """The cases that the second variant breaks."""
        return tuple(each for each in self.changes if each.change is Change.BROKEN)


def compare(
    variants: Sequence[SuiteResult], *, source: str = "", error_rate: float = 0.05, ranked: bool = False
) -> Comparison:
    """Compare every pair of variants, over all their common runs and case by case.

    Args:
        error_rate: probability of one false alarm among the cases of a pair.
        ranked: order the variants from the least share of violating runs to the largest; those that never arrive
            or are never judged come last.
    """
    if ranked:
        variants = sorted(
            variants, key=lambda each: (not each.judged, not each.arrived, each.share, each.failed, each.version)
        )
    pairs = tuple(_pair(first, second, error_rate) for first, second in combinations(variants, 2))
    return Comparison(source=source or variants[0].suite, variants=tuple(variants), pairs=pairs)


def _pair(first: SuiteResult, second: SuiteResult, error_rate: float) -> VariantPair:
    mine, theirs = first.flags, second.flags
    common = [key for key in mine if key in theirs]
    difference = share_difference([mine[key] for key in common], [theirs[key] for key in common], paired=True)
    changes = changes_of(first, second, error_rate=error_rate)
    return VariantPair(first=first.version, second=second.version, difference=difference, changes=changes)


def changes_of(first: SuiteResult, second: SuiteResult, *, error_rate: float = 0.05) -> tuple[CaseChange, ...]:
    """Compare two variants case by case, on the same seeds.

    A case is fixed or broken where the exact McNemar test, corrected by Holm over all cases, is below `error_rate`;
    so the chance of one false alarm in the whole comparison is at most that. It is unchanged where the verdicts agree,
    and unclear where they do not and the test is not sure.
    """
    mine, theirs = ({case.key: case for case in result.cases} for result in (first, second))
    found = [_change(case, theirs.get(key)) for key, case in mine.items()]
    found += [_change(case, None) for key, case in theirs.items() if key not in mine]
    corrected = holm({str(k): each.p for k, each in enumerate(found) if each.p is not None})
    for key, p in corrected.items():
        each, change = found[int(key)], found[int(key)].change
        if p < error_rate:
            change = Change.BROKEN if each.only_second > each.only_first else Change.FIXED
        found[int(key)] = each.replace(p_corrected=p, change=change)
    return tuple(found)


def _change(case: CaseResult, other: CaseResult | None) -> CaseChange:
    """Return a case as the verdicts alone say it, with the test's p."""
    from scipy import stats

    named = {"case": case.case, "title": case.title, "requirement": case.requirement}
    if other is None:
        return CaseChange(**named, change=Change.MISSING)
    theirs = other.flags
    pairs = [(flag, theirs[seed]) for seed, flag in case.flags.items() if seed in theirs]
    before, after = [a for a, _ in pairs], [b for _, b in pairs]
    only_first, only_second = sum(a and not b for a, b in pairs), sum(b and not a for a, b in pairs)
    agree = only_first == only_second == 0 or _settled(case.verdict) == _settled(other.verdict) is not None
    difference, discordant = share_difference(after, before, paired=True), only_first + only_second
    return CaseChange(
        **named,
        change=Change.UNCHANGED if agree else Change.UNCLEAR,
        seeds=len(pairs),
        violations=(sum(before), sum(after)),
        only_first=only_first,
        only_second=only_second,
        difference=difference.difference if difference else None,
        interval=difference.interval if difference else None,
        # The exact two-sided McNemar test (McNemar 1947): the discordant pairs are a fair coin if nothing changed.
        p=float(stats.binomtest(only_second, discordant, 0.5).pvalue) if discordant else 1.0,
    )


def _settled(verdict: Verdict) -> bool | None:
    """Return whether a verdict says violated (True), passed (False) or neither (None)."""
    if verdict.status is Status.PASS:
        return False
    return True if violated(verdict) else None


def counts(changes: Sequence[CaseChange]) -> dict[Change, int]:
    """Return how many cases changed how; every kind is there."""
    return {change: sum(each.change is change for each in changes) for change in Change}


def compare_attempts(campaigns: Sequence[tuple[Plan, str, Sequence[Attempt]]]) -> Comparison:
    """Compare the configurations that campaigns have in common, in the order of the first; a case is an attempt.

    Args:
        campaigns: the plan, the simulator's name and the attempts of each.
    """
    measured = [_measured(attempts) for _, _, attempts in campaigns]
    common = [key for key in measured[0] if all(key in others for others in measured[1:])]
    return compare(
        [
            SuiteResult(
                suite=plan.name,
                version=plan.name,
                simulator=simulator,
                cases=tuple(result_of_attempt(attempts[key], plan.requirement) for key in common),
            )
            for (plan, simulator, _), attempts in zip(campaigns, measured, strict=True)
        ]
    )


def _measured(attempts: Sequence[Attempt]) -> dict[str, Attempt]:
    """Return the attempts with runs by their situation; a confirmation before the search it confirms."""
    found: dict[str, Attempt] = {}
    for attempt in attempts:
        scenario = attempt.proposal.scenario
        if scenario is None or attempt.verdict is None or attempt.purpose not in ("search", "confirmation"):
            continue
        if scenario.situation not in found or attempt.purpose == "confirmation":
            found[scenario.situation] = attempt
    return found


def result_of_attempt(attempt: Attempt, requirement: Requirement) -> CaseResult:
    """Return an attempt with runs as the result of a case."""
    scenario, verdict = attempt.proposal.scenario, attempt.verdict
    assert scenario is not None and verdict is not None
    return case_result(
        Expectation(requirement=requirement.name),
        requirement,
        verdict,
        attempt.measurements,
        case=f"case-{scenario.situation}",
        title=scenario.description[:200] or "Without a description",
        seconds=sum(m.values.get("trg") or 0.0 for m in attempt.measurements),
        attempt=attempt.index,
    )


def case_result(
    expectation: Expectation,
    requirement: Requirement,
    verdict: Verdict,
    measurements: Sequence[Measurement],
    **about: Any,
) -> CaseResult:
    """Return what runs say of an expectation.

    Args:
        about: the fields of the result that these do not tell, such as the name of the case.
    """
    outcomes = [m.outcome for m in measurements]
    return CaseResult(
        requirement=expectation.requirement,
        expected=expectation.expected,
        reason=expectation.reason,
        state=state_of(expectation.expected, verdict),
        verdict=verdict,
        seeds=tuple(m.seed for m in measurements),
        violations=tuple(None if m.objective is None else requirement.violated_by(m.objective) for m in measurements),
        contacts=sum(m.touches for m in measurements),
        arrived=outcomes.count(Outcome.REACHED.value),
        failed=outcomes.count(Outcome.STACK_FAILED.value),
        **about,
    )
