"""The words of a verdict: how statuses, counts, values and intervals are written, everywhere."""

from __future__ import annotations

from rvsg.evaluation.verdict import Procedure, Status, Verdict

OPEN = "FAIL or FLAKY is still open"
"""What is added to a verdict that is violated for sure, but not yet FAIL or FLAKY."""


def number(value: float | None, unit: str = "") -> str:
    """Return a value as people read it: three significant digits and its unit; a dash for None."""
    if value is None:
        return "–"
    text = f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
    return f"{text} {unit}".strip()


def counted(count: int, one: str, more: str = "") -> str:
    """Return a number with its noun: `1 run`, `2 runs`; `more` is the plural where an s is not enough."""
    return f"{count} {one if count == 1 else more or one + 's'}"


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
    """Return the status, and where it is open between FAIL and FLAKY that it is violated."""
    procedure = verdict.judged_by
    if verdict.status is Status.INCONCLUSIVE and procedure.violated(verdict.violations, verdict.runs):
        return f"{verdict.status.value} (violated; {OPEN})"
    return verdict.status.value


def reason_of(status: Status, violations: int, runs: int, undefined: int, procedure: Procedure) -> str:
    """Return one sentence that says why the status is what it is."""
    without = ""
    if undefined:
        without = f"; {counted(undefined, 'run')} {'has' if undefined == 1 else 'have'} no value"
    if status is Status.UNJUDGED:
        return f"{counted(runs, 'run')} measured; the requirement has no limit, so none is judged{without}"
    verb = "violates" if violations == 1 else "violate"
    count = f"{violations} of {counted(runs, 'run')} {verb} the requirement{without}"
    sure = f"such a verdict is wrong in at most {percent(procedure.error_rate)} of cases"
    match status:
        case Status.PASS:
            return f"{count}: fewer than {percent(procedure.often)} of runs violate it ({sure})"
        case Status.FAIL:
            return f"{count}: more than {percent(1 - procedure.often)} of runs violate it ({sure})"
        case Status.FLAKY:
            return f"{count}: some runs violate it and some do not ({sure})"
    spent = runs + undefined >= procedure.max_runs
    open_ = f"the budget of {counted(procedure.max_runs, 'run')} is spent" if spent else "too few runs for a verdict"
    if procedure.violated(violations, runs):
        return f"{count}: more than {percent(procedure.rare)} of runs violate it ({sure}); {OPEN}, {open_}"
    return f"{count}: {open_}"
