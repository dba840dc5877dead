"""The words of a verdict: how statuses, counts, values and intervals are written, everywhere."""

from __future__ import annotations

from rvsg.evaluation.verdict import Status, Verdict
from rvsg.simulation.run import Outcome

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
    """Return the status, and where it is open between FAIL and FLAKY that it is violated."""
    procedure = verdict.judged_by
    if verdict.status is Status.INCONCLUSIVE and procedure.violated(verdict.violations, verdict.runs):
        return f"{verdict.status.value} (violated; {OPEN})"
    return verdict.status.value


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


def how_sure(verdict: Verdict) -> str:
    """Return how sure a verdict is: the share of violating runs with its interval, and what the tests rule out.

    The interval has two sides. The status comes from sequential tests that have one each. So their bounds differ, and
    each is named.
    """
    without = ""
    if verdict.undefined:
        without = f"; {counted(verdict.undefined, 'run')} {'has' if verdict.undefined == 1 else 'have'} no value"
    if verdict.status is Status.UNJUDGED:
        runs = counted(verdict.runs, "run")
        return f"{runs} measured; the requirement has no limit, so none is judged{without}"
    verb = "violates" if 1 in (verdict.violations, verdict.runs) else "violate"
    share = f" ({said})" if (said := share_in_words(verdict)) else ""
    count = f"{verdict.violations} of {counted(verdict.runs, 'run')} {verb} the requirement{share}{without}"
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
    if procedure.violated(verdict.violations, verdict.runs):
        ruled = f"a one-sided test rules out that {percent(rare)} of runs or fewer violate it ({sure})"
        return f"INCONCLUSIVE: {ruled}; {OPEN}, {open_}"
    return f"INCONCLUSIVE: no test has decided; {open_}"


def why_ended(verdict: Verdict) -> str:
    """Return why a confirmation made no more runs, where its verdict is decided; `how_sure` says it of the others."""
    if verdict.status in (Status.INCONCLUSIVE, Status.UNJUDGED):
        return ""
    made, most = verdict.runs + verdict.undefined, verdict.judged_by.max_runs
    return f"The runs ended after {made} of at most {most} because the verdict was decided."
