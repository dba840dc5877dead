"""From objectives of repeated runs to a Verdict, by a sequential procedure with declared error rates.

Let q be the probability that a run violates the requirement. Two likelihood ratios are kept,

    low  = L(often) / L(rare)             often = 0.20, rare = 0.02 by default
    high = L(1 - rare) / L(1 - often)

and, with e = `error_rate`:

    PASS  when low  <= e        wrong with probability at most e if q >= often
    FAIL  when high >= 1 / e    wrong with probability at most e if q <= 1 - often
    FLAKY when low >= 1 / e and high <= e: violates more than rarely, and does not more than rarely;
                                wrong with probability at most e if q <= rare or q >= 1 - rare
    INCONCLUSIVE otherwise: more runs are needed, or the budget is spent.

FAIL and FLAKY both imply low >= 1 / e: the requirement is violated more than rarely. That alone is what `violated`
asks, so it is known, with the same error rate, before it is known which of the two it is: 8 violations in 8 runs are
INCONCLUSIVE between FAIL and FLAKY, and violated. With the defaults 2 violations in 2 runs are enough, one is not.

These are Wald's sequential probability ratio tests (1945), combined for three hypotheses as by Sobel and Wald (1949),
with the bounds e and 1/e instead of Wald's approximations: by Ville's inequality each ratio crosses its bound wrongly
with probability at most e *however long one looks*, so runs may be added in batches, stopped at any time and resumed.
The status depends on the two counts only, not on their order. With the defaults 15 clean runs pass, 15 violations in
a row fail, and a scenario that does both is flaky after 4 to 6 runs. One run never confirms anything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Self

from pydantic import Field, model_validator

from rvsg.core.errors import Unfit
from rvsg.core.records import Record
from rvsg.evaluation.metrics import METRICS, measure, metric
from rvsg.evaluation.signals import formula, robustness
from rvsg.evaluation.statistics import clopper_pearson, mean_interval
from rvsg.evaluation.verdict import Status, Verdict
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Run
from rvsg.world.world import World


class Procedure(Record):
    """How repeats are judged: the violation probabilities to tell apart, the error rate, the budget of runs."""

    rare: Annotated[float, Field(gt=0, lt=0.5)] = 0.02
    often: Annotated[float, Field(gt=0, lt=0.5)] = 0.20
    error_rate: Annotated[float, Field(gt=0, lt=0.5)] = 0.05
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95
    max_runs: Annotated[int, Field(ge=1, le=100_000)] = 30

    @model_validator(mode="after")
    def _apart(self) -> Self:
        if self.rare >= self.often:
            raise ValueError(f"rare ({self.rare}) must be smaller than often ({self.often})")
        return self

    def log_ratios(self, violations: int, runs: int) -> tuple[float, float]:
        """The natural logarithms of the two likelihood ratios `low` and `high`."""
        clean = runs - violations
        up = math.log(self.often / self.rare)
        down = math.log((1 - self.often) / (1 - self.rare))
        return violations * up + clean * down, -(clean * up + violations * down)

    def status(self, violations: int, runs: int) -> Status:
        """The status that these counts justify."""
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
        """Whether these counts show that more than rarely a run violates the requirement."""
        return self.log_ratios(violations, runs)[0] >= math.log(1 / self.error_rate)

    def fewest_for(self, violations: int, runs: int) -> dict[Status, int]:
        """For each status that the budget can still reach, the smallest number of further runs; the fewest first."""
        found: dict[Status, int] = {}
        for more in range(self.max_runs - runs + 1):
            for bad in range(more + 1):
                found.setdefault(self.status(violations + bad, runs + more), more)
        found.pop(Status.INCONCLUSIVE, None)
        return found

    def fewest_more(self, violations: int, runs: int) -> int:
        """The smallest number of further runs after which the status can be decided at all; 0 if it is."""
        for more in range(self.max_runs - runs + 1):
            for bad in range(more + 1):
                if self.status(violations + bad, runs + more) is not Status.INCONCLUSIVE:
                    return more
        return max(0, self.max_runs - runs)


DEFAULT = Procedure()
OPEN = "FAIL or FLAKY is still open"
"""What is told of a verdict that is `still_open`."""


def objective(run: Run, requirement: Requirement, *, world: World | None = None) -> float | None:
    """The value of the requirement's metric, or the robustness of its formula, for one run; None: no judgement.

    What concerns obstacles that stand still needs the `world` of the run.
    """
    if requirement.formula is not None:
        return robustness(run, requirement.formula, world=world)
    assert requirement.metric is not None
    return measure(run, [requirement.metric], world=world)[requirement.metric]


def check_requirement(requirement: Requirement) -> Requirement:
    """The requirement in the unit of its metric, which is filled in where it is left out.

    UnknownName or FormulaError where its metric or formula cannot be measured; Unfit where its unit, its direction or
    its share of the time limit is not one of its metric.
    """
    if requirement.formula is not None:
        formula(requirement.formula)
        return requirement
    assert requirement.metric is not None
    known = metric(requirement.metric)
    if requirement.unit and _plain(requirement.unit) != _plain(known.unit):
        raise Unfit(
            "unit",
            f"{known.id} is measured in {known.unit}, got {requirement.unit!r}. "
            f"Write the limit in {known.unit}, with `unit: {_quoted(known.unit)}`, or leave the unit out.",
        )
    if requirement.limit_share is not None and known.unit != "s":
        raise Unfit(
            "limit_share",
            f"is a share of the route's time limit, and {known.id} is measured in {known.unit}, not in s. "
            f"Give `limit` in {known.unit} instead.",
        )
    if known.worse not in ("neither", requirement.worse):
        raise Unfit(
            "worse",
            f"{known.id} is worse when {known.worse}, got {requirement.worse!r}. Write `worse: {known.worse}`; what "
            "must not be too good either can be asked with a formula, e.g. `always distance_to_person < 3`.",
        )
    return requirement.replace(unit=known.unit)


def _plain(unit: str) -> str:
    """A unit as an ordinary keyboard has it: m/s³, m/s^3 and m/s3 are one."""
    return unit.translate(str.maketrans("²³", "23", "^ "))


def _quoted(unit: str) -> str:
    """A unit as it has to stand in YAML."""
    return f'"{unit}"' if unit in ("1", "%") else unit


def judge(requirement: Requirement, objectives: Sequence[float | None], *, procedure: Procedure = DEFAULT) -> Verdict:
    """The verdict on a scenario from the objectives of its runs, None standing for a run without judgement."""
    known = tuple(float(value) for value in objectives if value is not None)
    violations = sum(requirement.violated_by(value) for value in known)
    judged = requirement.threshold is not None
    status = procedure.status(violations, len(known)) if judged else Status.UNJUDGED
    return Verdict(
        requirement=requirement.name,
        status=status,
        objectives=known,
        mean=math.fsum(known) / len(known) if known else None,
        interval=mean_interval(known, procedure.confidence, least=_least(requirement)),
        violations=violations,
        runs=len(known),
        undefined=len(objectives) - len(known),
        violation_probability=violations / len(known) if known and judged else None,
        violation_interval=clopper_pearson(violations, len(known), procedure.confidence) if known and judged else None,
        confidence=procedure.confidence,
        error_rate=procedure.error_rate if judged else None,
        reason=_reason(status, violations, len(known), len(objectives) - len(known), procedure),
    )


def violated(verdict: Verdict, *, procedure: Procedure = DEFAULT) -> bool:
    """Whether the runs say that the requirement is violated: FAIL, FLAKY, or one of the two and nothing else."""
    return verdict.status in (Status.FAIL, Status.FLAKY) or still_open(verdict, procedure=procedure)


def still_open(verdict: Verdict, *, procedure: Procedure = DEFAULT) -> bool:
    """Whether it is violated for sure, but not yet whether nearly always (FAIL) or sometimes (FLAKY)."""
    return verdict.status is Status.INCONCLUSIVE and procedure.violated(verdict.violations, verdict.runs)


def _least(requirement: Requirement) -> float | None:
    """The smallest objective there can be; None for robustness, a metric that can be negative, and one of a plug-in."""
    known = METRICS.get(requirement.metric) if requirement.metric is not None else None
    return known.least if known is not None else None


def next_repeats(
    requirement: Requirement, objectives: Sequence[float | None], *, procedure: Procedure = DEFAULT
) -> int:
    """How many more runs are worth their time now: the fewest that can decide the status; 0 when it is decided.

    Runs without judgement count against the budget, so the repeats of a scenario always end. Without a limit there
    is nothing to decide and the answer is 0.
    """
    if requirement.threshold is None or len(objectives) >= procedure.max_runs:
        return 0
    known = [value for value in objectives if value is not None]
    violations = sum(requirement.violated_by(value) for value in known)
    return min(procedure.fewest_more(violations, len(known)), procedure.max_runs - len(objectives))


def _reason(status: Status, violations: int, runs: int, undefined: int, procedure: Procedure) -> str:
    without = f"; {_runs(undefined)} {'holds' if undefined == 1 else 'hold'} no judgement" if undefined else ""
    if status is Status.UNJUDGED:
        return f"{_runs(runs)} {'is' if runs == 1 else 'are'} measured and none is judged{without}"
    verb = "violates" if violations == 1 else "violate"
    counted = f"{violations} of {_runs(runs)} {verb} the requirement{without}"
    sure = f"wrong in at most {procedure.error_rate:.0%} of such verdicts"
    unsure = (
        f"the budget of {_runs(procedure.max_runs)} is spent before the verdict is sure"
        if runs + undefined >= procedure.max_runs
        else "too few runs for a verdict"
    )
    if procedure.violated(violations, runs):
        unsure = f"it is violated in more than {procedure.rare:.0%} of runs ({sure}); {OPEN}, {unsure}"
    said = {
        Status.PASS: f"it is violated in fewer than {procedure.often:.0%} of runs ({sure})",
        Status.FAIL: f"it is violated in more than {1 - procedure.often:.0%} of runs ({sure})",
        Status.FLAKY: f"it is sometimes violated and sometimes not ({sure})",
        Status.INCONCLUSIVE: unsure,
    }[status]
    return f"{counted}: {said}"


def _runs(count: int) -> str:
    return "1 run" if count == 1 else f"{count} runs"
