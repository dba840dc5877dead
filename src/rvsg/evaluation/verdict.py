"""The verdict on a scenario from repeated runs."""

from __future__ import annotations

import math
from enum import Enum
from functools import lru_cache
from typing import Annotated

from pydantic import Field, model_validator

from rvsg.core.records import Record


class Status(str, Enum):
    """What repeated runs say about a requirement."""

    PASS = "PASS"  # noqa: S105
    FAIL = "FAIL"
    FLAKY = "FLAKY"
    INCONCLUSIVE = "INCONCLUSIVE"
    UNJUDGED = "no limit is set"


_SHOWN = (Status.PASS, Status.FAIL, Status.FLAKY, Status.INCONCLUSIVE)
"""What the counts of runs can show."""


class Procedure(Record):
    """How runs are judged: the violation probabilities to tell apart, the error rate, the budget of runs.

    `rvsg.evaluation.judge` explains how they decide.
    """

    rare: Annotated[float, Field(gt=0, lt=0.5)] = 0.02
    """A requirement that is violated with this probability, or less, is violated rarely."""
    often: Annotated[float, Field(gt=0, lt=0.5)] = 0.20
    """A requirement that is violated with this probability, or more, is violated often."""
    error_rate: Annotated[float, Field(gt=0, lt=0.5)] = 0.05
    """How often a status may be wrong at most."""
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95
    """Confidence of the intervals that are reported."""
    max_runs: Annotated[int, Field(ge=1, le=100_000)] = 30
    """The budget: the most runs a verdict may take."""

    @model_validator(mode="after")
    def _apart(self) -> Procedure:
        if self.rare >= self.often:
            raise ValueError(f"rare ({self.rare}) must be smaller than often ({self.often})")
        return self

    def log_ratios(self, violations: int, runs: int) -> tuple[float, float]:
        """Return the natural logarithms of the two likelihood ratios `low` and `high`."""
        clean = runs - violations
        up = math.log(self.often / self.rare)
        down = math.log((1 - self.often) / (1 - self.rare))
        return violations * up + clean * down, -(clean * up + violations * down)

    def status(self, violations: int, runs: int) -> Status:
        """Return the status that these counts justify."""
        bound = math.log(1 / self.error_rate)
        low, high = self.log_ratios(violations, runs)
        if low <= -bound:
            return Status.PASS
        if high >= bound:
            return Status.FAIL
        if low >= bound and high <= -bound:
            return Status.FLAKY
        return Status.INCONCLUSIVE

    def violated(self, violations: int, runs: int) -> bool:
        """Return whether these counts show that runs violate the requirement more than rarely."""
        return self.log_ratios(violations, runs)[0] >= math.log(1 / self.error_rate)

    def fewest_for(self, violations: int, runs: int) -> dict[Status, int]:
        """Return for each status within the budget the smallest number of further runs; the fewest first."""
        return dict(_fewest_for(self, violations, runs))

    def fewest_more(self, violations: int, runs: int) -> int:
        """Return the smallest number of further runs that can decide the status; 0 if it is decided."""
        for more in range(self.max_runs - runs + 1):
            for bad in range(more + 1):
                if self.status(violations + bad, runs + more) is not Status.INCONCLUSIVE:
                    return more
        return max(0, self.max_runs - runs)


@lru_cache(maxsize=1024)
def _fewest_for(procedure: Procedure, violations: int, runs: int) -> dict[Status, int]:
    found: dict[Status, int] = {}
    for more in range(procedure.max_runs - runs + 1):
        for bad in range(more + 1):
            found.setdefault(procedure.status(violations + bad, runs + more), more)
        if len(found) == len(_SHOWN):
            break
    return {status: more for status, more in found.items() if status is not Status.INCONCLUSIVE}


DEFAULT = Procedure()


class Verdict(Record):
    """What repeated runs say about a requirement."""

    requirement: str
    status: Status
    objectives: tuple[float, ...]
    """The value of each run that has one."""
    mean: float | None
    """Mean of `objectives`. Where some are `censored` it is the mean restricted to the time limit."""
    interval: tuple[float, float] | None
    """Interval of `mean` at `confidence`, within what is possible; None if there are too few runs."""
    violations: int
    runs: int
    """Runs with a value."""
    undefined: int = 0
    """Runs without a value."""
    violation_probability: float | None = None
    """Share of violating runs; None without a limit."""
    violation_interval: tuple[float, float] | None = None
    """Two-sided Clopper-Pearson interval of the share at `confidence`; the status comes from one-sided tests."""
    confidence: float = 0.95
    error_rate: float | None = None
    """How often such a status is wrong at most; None without a limit."""
    reason: str = ""
    """How sure the verdict is, in words: `rvsg.evaluation.wording.how_sure`."""
    censored: int = 0
    """Runs that did not arrive and whose value is therefore only a lower bound."""
    median: float | None = None
    """Median of the values; None if it lies beyond the time limit, or without values."""
    procedure: Procedure | None = None
    """The procedure that judged; None in verdicts of RVSG 0.1, which used the default one."""

    @property
    def judged_by(self) -> Procedure:
        """The procedure that judged."""
        return self.procedure or DEFAULT
