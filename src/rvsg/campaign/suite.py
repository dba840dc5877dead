"""Suites: scenarios that stay, with the verdict you expect of each, and their results.

A case passes a suite where its verdict is the expected one. The sequential procedure of `rvsg.evaluation.verdict`
decides each verdict with its declared error rate, so a case changes its state only on statistical evidence; where the
runs do not decide, the state is unclear, and that is no failure.
"""

from __future__ import annotations

from enum import Enum
from typing import Annotated, Any, Literal

from pydantic import Field

from rvsg.core.errors import NothingJudged
from rvsg.core.plugins import Spec
from rvsg.core.records import Record
from rvsg.evaluation.statistics import wilson
from rvsg.evaluation.verdict import DEFAULT, Procedure, Status, Verdict, counted, violated
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
    """What makes the simulator again, with the stack under test; None if it was given as an object."""
    robot: Robot | str | None = None
    """The robot that drove every case instead of its own."""
    cases: tuple[CaseResult, ...]

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
