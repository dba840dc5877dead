"""The Verdict on a scenario from repeated runs."""

from __future__ import annotations

from enum import Enum

from rvsg.core.records import Record


class Status(str, Enum):
    """What repeats say of a requirement."""

    PASS = "PASS"  # noqa: S105
    FAIL = "FAIL"
    FLAKY = "FLAKY"
    INCONCLUSIVE = "INCONCLUSIVE"
    UNJUDGED = "no limit is set"


class Verdict(Record):
    """What repeated runs say: the objective's mean with its interval, how often it was violated and how sure that is.

    `violation_interval` is Clopper-Pearson at `confidence`; `interval` a bootstrap interval of the mean.
    `undefined` counts runs whose objective has no value. `error_rate` bounds how often such a status is wrong
    (see `rvsg.evaluation.judge`); None where nothing was decided.
    """

    requirement: str
    status: Status
    objectives: tuple[float, ...]
    mean: float | None
    interval: tuple[float, float] | None
    violations: int
    runs: int
    undefined: int = 0
    violation_probability: float | None = None
    violation_interval: tuple[float, float] | None = None
    confidence: float = 0.95
    error_rate: float | None = None
    reason: str = ""
