"""Judgement of runs by a requirement, and the verdict on a scenario from repeated runs.

The verdict comes from a sequential procedure with declared error rates.

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
from collections.abc import Mapping, Sequence
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from rvsg.core.errors import InputError, Unfit
from rvsg.core.records import Record
from rvsg.core.setting import SEARCH, Setting
from rvsg.evaluation.metrics import find_metric, measure, metric
from rvsg.evaluation.signals import formula, robustness
from rvsg.evaluation.statistics import censored_median, clopper_pearson, mean_interval
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.requirement import load_requirement as read_requirement
from rvsg.simulation.run import Outcome, Run
from rvsg.world.world import Route, World


class Status(str, Enum):
    """What repeated runs say about a requirement."""

    PASS = "PASS"  # noqa: S105
    FAIL = "FAIL"
    FLAKY = "FLAKY"
    INCONCLUSIVE = "INCONCLUSIVE"
    UNJUDGED = "no limit is set"


class Rates(Record):
    """The probabilities that a verdict tells apart, and how sure it is."""

    error_rate: Annotated[
        float, Field(gt=0, lt=0.5), Setting("Probability that a verdict is wrong, at most.", SEARCH)
    ] = 0.05
    rare: Annotated[
        float, Field(gt=0, lt=0.5), Setting("Violation rate up to which violations count as rare.", SEARCH)
    ] = 0.02
    often: Annotated[
        float,
        Field(gt=0, lt=0.5),
        Setting("Violation rate that a PASS excludes.", SEARCH, more="A FAIL excludes those up to 1 minus this."),
    ] = 0.20
    confidence: Annotated[float, Field(gt=0.5, lt=1), Setting("Confidence level of intervals.", SEARCH)] = 0.95

    @model_validator(mode="after")
    def _apart(self) -> Rates:
        if self.rare >= self.often:
            raise ValueError(f"rare ({self.rare:g}) must be smaller than often ({self.often:g})")
        return self


class Procedure(Rates):
    """How runs are judged: the violation probabilities to tell apart, the error rate, the budget of runs.

    `rvsg.evaluation.verdict` explains how they decide.
    """

    max_runs: Annotated[int, Field(ge=1, le=100_000)] = 30
    """The budget: the most runs a verdict may take."""

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
        return _fewest_for(self, violations, runs)


@lru_cache(maxsize=1024)
def _fewest_for(procedure: Procedure, violations: int, runs: int) -> dict[Status, int]:
    fewest: dict[Status, int] = {}
    for more in range(procedure.max_runs - runs + 1):
        for bad in range(more + 1):
            fewest.setdefault(procedure.status(violations + bad, runs + more), more)
        if len(fewest) == len(Status) - 1:  # all but UNJUDGED
            break
    return {status: more for status, more in fewest.items() if status is not Status.INCONCLUSIVE}


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
    """How sure the verdict is, in words: `rvsg.evaluation.verdict.how_sure`."""
    censored: int = 0
    """Runs that did not arrive and whose value is therefore only a lower bound."""
    median: float | None = None
    """Median of the values; None if it lies beyond the time limit, or without values."""
    missed: Annotated[int, Field(exclude_if=lambda count: count == 0)] = 0
    """Runs with a value that did not arrive, where that leaves the value as it is; else they are `censored`."""
    procedure: Procedure | None = None
    """The procedure that judged; None in verdicts of RVSG 0.1, which used the default one."""

    @property
    def judged_by(self) -> Procedure:
        """The procedure that judged."""
        return self.procedure or DEFAULT


OPEN, OPEN_STATUS = "FAIL or FLAKY is still open", "VIOLATED"
"""What is said of a verdict that is violated for sure, but not yet FAIL or FLAKY; and its code instead of a status."""


def metres(gap: float) -> str:
    """Return a gap in words: whole centimetres below 1 m, never rounded down to a contact."""
    if gap <= 0.0:
        return "0 cm"
    return f"{max(1, round(gap * 100))} cm" if gap < 1.0 else f"{gap:.1f} m"


def number(value: float | None, unit: str = "") -> str:
    """Return a value as people read it: three significant digits and its unit; a dash for None."""
    if value is None:
        return "–"
    text = f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{text} {_SPOKEN.get((text, unit), _SPOKEN.get(('', unit), unit))}".strip()


_SPOKEN = {("1", "events"): "event", ("", "1 or 0"): ""}
"""How some units are said after a number, or after any."""


def counted(count: int, one: str, more: str = "") -> str:
    """Return a number with its noun: `1 run`, `2 runs`; `more` is the plural where an s is not enough."""
    return f"{count} {one if count == 1 else more or one + 's'}"


def outcome_in_words(outcome: Outcome) -> str:
    """Return how a run ended; what is stored of an aborted one is older than the word for it."""
    return "navigation aborted before the goal was reached" if outcome is Outcome.ABORTED else outcome.value


def percent(share: float) -> str:
    """Return a share as a percentage without decimals."""
    return f"{100.0 * share:.0f} %"


def value_in_words(verdict: Verdict, unit: str = "") -> str:
    """Return the mean with its interval; where runs did not arrive in time, how many, and the median.

    A mean over values that the time limit cuts off is named as such and never stands alone.
    """
    if verdict.censored:
        total = counted(verdict.runs, "run")
        late = f"{verdict.censored} of {total} did not arrive in time"
        if verdict.censored == verdict.runs:
            return late
        middle = f"median {number(verdict.median, unit)}" if verdict.median is not None else "median beyond the limit"
        return f"{late}; {middle}; mean up to the time limit {_with_interval(verdict, unit)}"
    return _with_interval(verdict, unit)


def _with_interval(verdict: Verdict, unit: str) -> str:
    if verdict.interval is None:
        return number(verdict.mean, unit)
    low, high = verdict.interval
    return f"{number(verdict.mean)} [{number(low)}, {number(high)}] {unit}".strip()


def status_in_words(verdict: Verdict) -> str:
    """Return the status; VIOLATED where it surely is and FAIL or FLAKY is open."""
    return f"{OPEN_STATUS} ({OPEN})" if still_open(verdict) else verdict.status.value


def share_in_words(verdict: Verdict) -> str:
    """Return the share of violating runs with its interval, e.g. `93 %, two-sided 95 % interval 68 to 100 %`."""
    if verdict.violation_probability is None or verdict.violation_interval is None:
        return ""
    low, high = verdict.violation_interval
    between = f"{100 * low:.0f} to {percent(high)}"
    return f"{percent(verdict.violation_probability)}, two-sided {percent(verdict.confidence)} interval {between}"


def difference_in_words(difference: float, interval: tuple[float, float], confidence: float) -> str:
    """Return how much larger one share is than another, e.g. `difference 24 points, two-sided 95 % interval 3 to 41`.

    Args:
        difference: Of two shares, from -1 to 1.
    """
    low, high = (round(100 * bound) for bound in interval)
    points = counted(round(100 * difference), "point")
    return f"difference {points}, two-sided {percent(confidence)} interval {low} to {high}"


def arrivals_in_words(arrived: int, runs: int) -> str:
    """Return how many runs arrive, to be said before how many violate; nothing where all arrive."""
    return "" if arrived == runs else f"{arrived} of {counted(runs, 'run')} arrive{'s' * (1 in (arrived, runs))}; "


def how_sure(verdict: Verdict) -> str:
    """Return how sure a verdict is: the share of violating runs with its interval, and what the tests rule out.

    The interval has two sides. The status comes from sequential tests that have one each. So their bounds differ, and
    each is named.
    """
    without = ""
    if verdict.undefined:
        without = f"; {counted(verdict.undefined, 'run')} {'has' if verdict.undefined == 1 else 'have'} no value"
    came = arrivals_in_words(verdict.runs - verdict.missed, verdict.runs)
    if verdict.status is Status.UNJUDGED:
        runs = counted(verdict.runs, "run")
        return f"{came}{runs} measured; the requirement has no limit, so none is judged{without}"
    verb = "violates" if 1 in (verdict.violations, verdict.runs) else "violate"
    share = f" ({said})" if (said := share_in_words(verdict)) else ""
    count = f"{came}{verdict.violations} of {counted(verdict.runs, 'run')} {verb} the requirement{share}{without}"
    return f"{count}. {_decision(verdict)}"


def _decision(verdict: Verdict) -> str:
    """Return what the tests behind a status rule out, or why none has decided."""
    procedure = verdict.judged_by
    sure = f"wrong in at most {percent(procedure.error_rate)} of cases"
    often, rare = procedure.often, procedure.rare
    match verdict.status:
        case Status.PASS:
            return f"PASS: a one-sided test rules out that {percent(often)} of runs or more violate it ({sure})"
        case Status.FAIL:
            return f"FAIL: a one-sided test rules out that {percent(1 - often)} of runs or fewer violate it ({sure})"
        case Status.FLAKY:
            return (
                f"FLAKY: one-sided tests rule out that {percent(rare)} of runs or fewer violate it, and that "
                f"{percent(1 - rare)} or more do ({sure})"
            )
    spent = verdict.runs + verdict.undefined >= procedure.max_runs
    open_ = f"the budget of {counted(procedure.max_runs, 'run')} is spent" if spent else "too few runs for a verdict"
    if still_open(verdict):
        ruled = f"a one-sided test rules out that {percent(rare)} of runs or fewer violate it ({sure})"
        return f"{OPEN_STATUS}: {ruled}; {OPEN}, {open_}"
    return f"INCONCLUSIVE: no test has decided; {open_}"


def why_ended(verdict: Verdict) -> str:
    """Return why a confirmation made no more runs, where its verdict is decided; `how_sure` says it of the others."""
    if verdict.status in (Status.INCONCLUSIVE, Status.UNJUDGED):
        return ""
    runs, most = verdict.runs + verdict.undefined, verdict.judged_by.max_runs
    return f"The runs ended after {runs} of at most {most} because the verdict was decided."


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
    measured = metric(requirement.metric)
    unit = f'"{measured.unit}"' if measured.unit in ("1", "%") else measured.unit  # as YAML needs it
    if requirement.unit and _plain(requirement.unit) != _plain(measured.unit):
        raise Unfit(
            "unit",
            f"{measured.id} is measured in {measured.unit}, got {requirement.unit!r}. "
            f"Write the limit in {measured.unit}, with `unit: {unit}`, or leave the unit out.",
        )
    if requirement.limit_share is not None and measured.unit != "s":
        raise Unfit(
            "limit_share",
            f"is a share of the route's time limit, and {measured.id} is measured in {measured.unit}, not in s. "
            f"Give `limit` in {measured.unit} instead.",
        )
    if measured.worse not in ("neither", requirement.worse):
        raise Unfit(
            "worse",
            f"{measured.id} is worse when {measured.worse}, got {requirement.worse!r}. Write `worse: {measured.worse}`"
            "; what must not be too good either can be asked with a formula, e.g. `always distance_to_person < 3`.",
        )
    return requirement.replace(unit=measured.unit)


def _plain(unit: str) -> str:
    """Return a unit as a keyboard has it: m/s³, m/s^3 and m/s3 are one."""
    return unit.translate(str.maketrans("²³", "23", "^ "))


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
    values = tuple(float(value) for value in objectives if value is not None)
    metric_of = find_metric(requirement.metric)
    missed = sum(arrived is not None and not arrived[k] for k in rows)
    late = [metric_of is not None and metric_of.censored and arrived is not None and not arrived[k] for k in rows]
    least, most = metric_of.bounds(time_limit_s) if metric_of is not None else (None, None)
    two_valued = metric_of is not None and metric_of.two_valued
    if any(late):  # a run may end a tick after its limit
        most = max(value for value, is_late in zip(values, late, strict=True) if is_late)
    violations = sum(requirement.violated_by(value) for value in values)
    judged = requirement.threshold is not None
    runs = len(values)
    undefined = len(objectives) - runs
    status = procedure.status(violations, runs) if judged else Status.UNJUDGED
    interval = None
    if not all(late):
        interval = mean_interval(values, procedure.confidence, least=least, most=most, two_valued=two_valued)
    verdict = Verdict(
        requirement=requirement.name,
        status=status,
        objectives=values,
        mean=math.fsum(values) / runs if runs else None,
        interval=interval,
        violations=violations,
        runs=runs,
        undefined=undefined,
        violation_probability=violations / runs if runs and judged else None,
        violation_interval=clopper_pearson(violations, runs, procedure.confidence) if runs and judged else None,
        confidence=procedure.confidence,
        error_rate=procedure.error_rate if judged else None,
        censored=sum(late),
        median=censored_median(values, late),
        missed=missed - sum(late),
        procedure=procedure,
    )
    return verdict.replace(reason=how_sure(verdict))


def violated(verdict: Verdict) -> bool:
    """Return whether the runs violate the requirement: FAIL, FLAKY, or surely one of the two."""
    return verdict.status in (Status.FAIL, Status.FLAKY) or still_open(verdict)


def still_open(verdict: Verdict) -> bool:
    """Return whether it is surely violated, but not yet whether nearly always (FAIL) or sometimes (FLAKY)."""
    return verdict.status is Status.INCONCLUSIVE and verdict.judged_by.violated(verdict.violations, verdict.runs)


def next_repeats(
    requirement: Requirement, objectives: Sequence[float | None], *, procedure: Procedure = DEFAULT
) -> int:
    """Return how many more runs are worth their time now: the fewest that can decide the status; 0 if it is decided.

    Runs without judgement count against the budget, so the repeats of a scenario always end. Without a limit there
    is nothing to decide and the answer is 0.
    """
    if requirement.threshold is None or len(objectives) >= procedure.max_runs:
        return 0
    values = [value for value in objectives if value is not None]
    violations = sum(requirement.violated_by(value) for value in values)
    left = procedure.max_runs - len(objectives)
    return min([*procedure.fewest_for(violations, len(values)).values(), left])


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


MEASURED = ("contacts", "robot_contacts", "contact_longest", "contact_speed", "min_distance", "completed")
"""The metrics from which the summary is made."""


class Contacts(Record):
    """Runs in which the robot touches a person."""

    runs: int
    """Number of runs with contact."""
    of: int
    """Number of runs in which people were measured."""
    longest_s: float | None
    """Duration of the longest contact; None if there is none."""
    worst_speed_m_s: float | None
    """Largest relative speed in contact; None if there is none."""
    which: tuple[int, ...] = ()
    """Indices of the runs with contact, in the order given."""
    responsible: Annotated[int | None, Field(exclude_if=lambda runs: runs is None)] = None
    """Number of runs with contact for which the robot or both are responsible; None where an older version measured."""

    @property
    def in_words(self) -> str:
        """How many runs have contact, and in how many the robot is responsible."""
        runs = f"{self.runs} of {counted(self.of, 'run')}"
        if not self.runs or self.responsible is None:
            return runs
        return f"{runs} (the robot is responsible in {self.responsible})"


class Arrivals(Record):
    """Runs in which the robot reaches its goal in time."""

    runs: int
    of: int
    missed: tuple[int, ...] = ()
    """Indices of the runs that did not arrive."""


class SafetySummary(Record):
    """What is always reported beside a requirement."""

    contacts: Contacts
    arrived: Arrivals
    least_clearance_m: float | None
    """Smallest gap between the bodies of robot and a person over all runs; negative where they overlap."""
    closest_run: int | None = None
    """Index of the run with the smallest gap."""


def summarise_safety(measured: Sequence[Mapping[str, float | None]]) -> SafetySummary:
    """Sum up the metrics of repeated runs.

    Args:
        measured: The metrics of each run by id; at least `MEASURED`, as `measure` returns them.
    """
    touched = [k for k, values in enumerate(measured) if (values.get("contacts") or 0.0) > 0.0]
    own = [measured[k].get("robot_contacts") for k in touched]
    arrived = [values["completed"] for values in measured if values.get("completed") is not None]
    gaps = {k: gap for k, values in enumerate(measured) if (gap := values.get("min_distance")) is not None}
    closest = min(gaps, key=lambda k: gaps[k], default=None)
    return SafetySummary(
        contacts=Contacts(
            runs=len(touched),
            of=sum(values.get("contacts") is not None for values in measured),
            longest_s=_largest(measured, touched, "contact_longest"),
            worst_speed_m_s=_largest(measured, touched, "contact_speed"),
            which=tuple(touched),
            responsible=None if None in own else sum(value > 0.0 for value in own if value is not None),
        ),
        arrived=Arrivals(
            runs=sum(value == 1.0 for value in arrived),
            of=len(arrived),
            missed=tuple(k for k, values in enumerate(measured) if values.get("completed") == 0.0),
        ),
        least_clearance_m=gaps[closest] if closest is not None else None,
        closest_run=closest,
    )


def _largest(measured: Sequence[Mapping[str, float | None]], rows: Sequence[int], name: str) -> float | None:
    values = [value for k in rows if (value := measured[k].get(name)) is not None]
    return max(values, default=None)
