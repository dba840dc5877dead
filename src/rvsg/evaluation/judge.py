"""Judgement of the objectives of repeated runs by a sequential procedure with declared error rates.

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
from pathlib import Path

from rvsg.core.errors import InputError, Unfit
from rvsg.evaluation.metrics import metric
from rvsg.evaluation.metrics.registry import find_metric, measure
from rvsg.evaluation.signals import formula, robustness
from rvsg.evaluation.statistics import censored_median, clopper_pearson, mean_interval
from rvsg.evaluation.verdict import DEFAULT, Procedure, Status, Verdict
from rvsg.evaluation.wording import OPEN, how_sure
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.requirement import load_requirement as read_requirement
from rvsg.simulation.run import Outcome, Run
from rvsg.world.world import Route, World

__all__ = [
    "DEFAULT",
    "OPEN",
    "Procedure",
    "check_requirement",
    "judge",
    "next_repeats",
    "objective",
    "still_open",
    "violated",
]


def objective(run: Run, requirement: Requirement, *, world: World | None = None) -> float | None:
    """Return the value of the requirement's metric, or the robustness of its formula; None: no judgement.

    What concerns obstacles needs the `world` of the run. A run in which the stack under test crashed or hung is not
    judged: it says nothing about how the robot drives.
    """
    if run.outcome is Outcome.STACK_FAILED:
        return None
    if requirement.formula is not None:
        return robustness(run, requirement.formula, world=world)
    assert requirement.metric is not None
    return measure(run, [requirement.metric], world=world)[requirement.metric]


def check_requirement(requirement: Requirement) -> Requirement:
    """Return the requirement with the unit of its metric, which may be left out.

    Raises:
        UnknownName: There is no such metric.
        FormulaError: The formula cannot be read.
        Unfit: The unit, the direction or the share of the time limit does not fit the metric.
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
    """Return a unit as a keyboard has it: m/s³, m/s^3 and m/s3 are one."""
    return unit.translate(str.maketrans("²³", "23", "^ "))


def _quoted(unit: str) -> str:
    """Return a unit as YAML needs it."""
    return f'"{unit}"' if unit in ("1", "%") else unit


def judge(
    requirement: Requirement,
    objectives: Sequence[float | None],
    *,
    procedure: Procedure = DEFAULT,
    arrived: Sequence[bool] | None = None,
    time_limit_s: float | None = None,
) -> Verdict:
    """Return the verdict on a scenario from the objectives of its runs.

    Args:
        objectives: One value for each run; None for a run without judgement.
        procedure: Error rates, confidence and budget.
        arrived: Whether the robot arrived, for each run. A metric that is `censored` needs it: the value of a run that
            did not arrive is only a lower bound.
        time_limit_s: The route's time limit, which bounds times.

    Raises:
        InputError: The limit is a share of a time limit and not worked out, so nothing could be judged.
    """
    if requirement.limit_share is not None:
        raise InputError(
            f"The limit of {requirement.name} is a share of the route's time limit. Work it out first: "
            "requirement.for_time_limit(route.time_limit_s), or load_requirement(name, route).",
            code="limit-open",
        )
    rows = [k for k, value in enumerate(objectives) if value is not None]
    known = tuple(float(value) for value in objectives if value is not None)
    metric_of = find_metric(requirement.metric)
    late = [metric_of is not None and metric_of.censored and arrived is not None and not arrived[k] for k in rows]
    least, most = metric_of.bounds(time_limit_s) if metric_of is not None else (None, None)
    two_valued = metric_of is not None and metric_of.two_valued
    if any(late):  # a run may end a tick after its limit
        most = max(value for value, is_late in zip(known, late, strict=True) if is_late)
    violations = sum(requirement.violated_by(value) for value in known)
    judged = requirement.threshold is not None
    undefined = len(objectives) - len(known)
    status = procedure.status(violations, len(known)) if judged else Status.UNJUDGED
    verdict = Verdict(
        requirement=requirement.name,
        status=status,
        objectives=known,
        mean=math.fsum(known) / len(known) if known else None,
        interval=None
        if all(late)
        else mean_interval(known, procedure.confidence, least=least, most=most, two_valued=two_valued),
        violations=violations,
        runs=len(known),
        undefined=undefined,
        violation_probability=violations / len(known) if known and judged else None,
        violation_interval=clopper_pearson(violations, len(known), procedure.confidence) if known and judged else None,
        confidence=procedure.confidence,
        error_rate=procedure.error_rate if judged else None,
        censored=sum(late),
        median=censored_median(known, late),
        procedure=procedure,
    )
    return verdict.replace(reason=how_sure(verdict))


def violated(verdict: Verdict, *, procedure: Procedure | None = None) -> bool:
    """Return whether the runs violate the requirement: FAIL, FLAKY, or surely one of the two."""
    return verdict.status in (Status.FAIL, Status.FLAKY) or still_open(verdict, procedure=procedure)


def still_open(verdict: Verdict, *, procedure: Procedure | None = None) -> bool:
    """Return whether it is surely violated, but not yet whether nearly always (FAIL) or sometimes (FLAKY).

    The procedure is that of the verdict where none is given.
    """
    used = procedure or verdict.judged_by
    return verdict.status is Status.INCONCLUSIVE and used.violated(verdict.violations, verdict.runs)


def next_repeats(
    requirement: Requirement, objectives: Sequence[float | None], *, procedure: Procedure = DEFAULT
) -> int:
    """Return how many more runs are worth their time now: the fewest that can decide the status; 0 if it is decided.

    Runs without judgement count against the budget, so the repeats of a scenario always end. Without a limit there
    is nothing to decide and the answer is 0.
    """
    if requirement.threshold is None or len(objectives) >= procedure.max_runs:
        return 0
    known = [value for value in objectives if value is not None]
    violations = sum(requirement.violated_by(value) for value in known)
    return min(procedure.fewest_more(violations, len(known)), procedure.max_runs - len(objectives))


def load_requirement(
    name_or_path: str | Path | Requirement, route: Route | None = None, *, time_limit_s: float | None = None
) -> Requirement:
    """Load a shipped requirement by its name, or one of a file as `file.yaml` or `file.yaml#name`.

    Some limits are a share of the route's time limit. They are worked out where `route` or `time_limit_s` is given;
    otherwise `judge` does it for the runs it judges.

    Raises:
        UnknownName: there is no such requirement.
        FileError: the file cannot be used; names every mistake with its line.
    """
    if isinstance(name_or_path, Requirement):
        requirement = check_requirement(name_or_path)
    else:
        requirement = read_requirement(name_or_path, check=check_requirement)
    limit = route.time_limit_s if route is not None else time_limit_s
    return requirement if limit is None else requirement.for_time_limit(limit)
