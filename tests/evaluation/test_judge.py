import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.stats import binom
from tests.evaluation.runs import run_of, trajectory

from rvsg.evaluation.statistics import clopper_pearson
from rvsg.evaluation.verdict import (
    DEFAULT,
    Procedure,
    Status,
    Verdict,
    judge,
    next_repeats,
    number,
    objective,
    status_in_words,
    still_open,
    value_in_words,
    violated,
)
from rvsg.scenario.requirement import Requirement, shipped_requirements
from rvsg.simulation.run import Outcome

NEAR = Requirement(name="near", title="t", text="t", metric="min_distance", worse="smaller", limit=0.5)
GOOD, BAD = 1.0, 0.0


@pytest.mark.parametrize(
    ("good", "bad", "status"),
    [(15, 0, "PASS"), (14, 0, "INCONCLUSIVE"), (0, 15, "FAIL"), (0, 1, "INCONCLUSIVE"), (2, 2, "FLAKY")],
)
def test_the_counts_of_runs_decide_the_status(good, bad, status):
    verdict = judge(NEAR, [GOOD] * good + [BAD] * bad)
    low, high = verdict.violation_interval
    assert verdict.status.value == status
    assert low <= verdict.violation_probability == bad / (good + bad) <= high


def test_a_violation_is_sure_before_it_is_known_whether_it_is_constant():
    verdict = judge(NEAR, [BAD] * 8)
    assert verdict.status is Status.INCONCLUSIVE
    assert violated(verdict) and still_open(verdict)
    assert status_in_words(verdict).startswith("VIOLATED (FAIL or FLAKY")
    assert not violated(judge(NEAR, [BAD])) and not violated(judge(NEAR, [GOOD] * 8))
    assert not still_open(judge(NEAR, [BAD] * 15))


@given(st.integers(0, 60), st.integers(0, 60))
def test_what_fails_or_is_flaky_is_violated_and_what_passes_is_not(bad, good):
    status = DEFAULT.status(bad, bad + good)
    if status is not Status.INCONCLUSIVE:
        assert DEFAULT.violated(bad, bad + good) == (status in (Status.FAIL, Status.FLAKY))


def test_how_many_more_runs_a_verdict_takes_depends_on_the_verdict():
    assert DEFAULT.fewest_for(5, 5) == {Status.FLAKY: 2, Status.FAIL: 10}
    assert DEFAULT.fewest_for(0, 5) == {Status.FLAKY: 2, Status.PASS: 10}
    assert DEFAULT.fewest_for(2, 29) == {}


def test_runs_without_judgement_are_counted_apart_and_without_a_limit_none_is_judged():
    verdict = judge(NEAR, [None] * 20)
    assert verdict.status is Status.INCONCLUSIVE
    assert (verdict.undefined, verdict.runs, verdict.mean) == (20, 0, None)
    verdict = judge(NEAR.model_copy(update={"limit": None}), [GOOD, BAD])
    assert (verdict.status, verdict.violation_interval, verdict.mean) == (Status.UNJUDGED, None, 0.5)


def test_the_interval_of_a_quantity_that_is_never_negative_is_not_either():
    mean = NEAR.model_copy(update={"metric": "dto"})
    low, high = judge(mean, [0.1, 2.0, 4.0]).interval  # Student's t reaches down to -2.8 m
    assert (low, high) == (0.0, pytest.approx(2.0333 + 4.3027 * 1.95021 / 3**0.5, abs=0.01))
    signed = NEAR.model_copy(update={"metric": "min_distance"})
    robust = NEAR.model_copy(update={"metric": None, "formula": "always speed < 1"})
    assert judge(signed, [0.1, 2.0, 4.0]).interval[0] < 0.0
    assert judge(robust, [0.1, 2.0, 4.0]).interval[0] < 0.0


TIMELY = Requirement(name="t", title="t", text="t", metric="trg", worse="larger", limit=33.0)


def test_the_interval_of_a_time_stays_within_the_time_limit():
    times = [49.0, 12.0, 49.5, 49.9, 20.0, 48.0]
    assert judge(TIMELY, times).interval[1] > 50.0
    assert judge(TIMELY, times, arrived=[True] * 6, time_limit_s=50.0).interval[1] == 50.0


def test_runs_that_did_not_arrive_are_censored():
    times = [35.0] * 13 + [30.0, 31.0]
    verdict = judge(TIMELY, times, arrived=[False] * 13 + [True] * 2, time_limit_s=35.0)
    assert (verdict.censored, verdict.runs, verdict.median) == (13, 15, None)
    assert verdict.interval[1] == 35.0
    words = value_in_words(verdict, "s")
    assert "13 of 15" in words and "median" in words
    none = judge(TIMELY, [35.0] * 5, arrived=[False] * 5, time_limit_s=35.0)
    assert none.interval is None and value_in_words(none, "s") == "5 of 5 runs did not arrive in time"
    assert judge(NEAR, [1.0] * 5, arrived=[False] * 5).censored == 0, "a gap has no cap"
    most = judge(TIMELY, [20.0, 21.0, 22.0, 35.0, 35.0], arrived=[True] * 3 + [False] * 2, time_limit_s=35.0)
    assert (most.censored, most.median) == (2, 22.0)


def test_a_time_at_its_limit_is_no_share_and_a_share_has_the_interval_of_a_probability() -> None:
    late = judge(TIMELY, [25.0] * 5, arrived=[False] * 4 + [True], time_limit_s=25.0)
    assert late.interval == (25.0, 25.0)
    spaces = Requirement(name="p", title="t", text="t", metric="personal_space", worse="larger", limit=10)
    assert judge(spaces, [0.0] * 5).interval == (0.0, 0.0)
    arrives = Requirement(name="a", title="t", text="t", metric="completed", worse="smaller", limit=1)
    low, high = judge(arrives, [1.0] * 15).interval
    assert (low, high) == (pytest.approx(0.7820, abs=1e-4), 1.0)


def test_a_verdict_keeps_the_procedure_that_judged():
    strict = Procedure(error_rate=0.01, often=0.1, max_runs=100)
    verdict = judge(NEAR, [BAD, BAD], procedure=strict)
    assert verdict.procedure == strict and verdict.error_rate == 0.01
    assert not violated(verdict) and violated(judge(NEAR, [BAD, BAD]))
    assert Verdict.from_json(verdict.to_json()) == verdict
    # A verdict of an earlier version was judged by the default.
    old = judge(NEAR, [BAD, BAD]).model_dump(mode="json", exclude={"procedure", "censored", "median"})
    assert Verdict.model_validate(old).judged_by == DEFAULT


@given(st.lists(st.booleans(), max_size=35))
def test_next_repeats_never_misses_an_earlier_decision_and_ends(bad):
    objectives = [BAD if b else GOOD for b in bad]
    more = next_repeats(NEAR, objectives)
    assert 0 <= more <= max(0, 30 - len(bad))
    if more > 1:
        for k in range(more):
            for violations in range(k + 1):
                trial = objectives + [BAD] * violations + [GOOD] * (k - violations)
                assert judge(NEAR, trial).status is Status.INCONCLUSIVE
    assert bad or more == 4
    if more == 0 and len(bad) < 30:
        assert judge(NEAR, objectives).status is not Status.INCONCLUSIVE


@settings(max_examples=25, deadline=None)
@given(
    st.floats(0.01, 0.1), st.floats(0.15, 0.45), st.sampled_from([0.01, 0.05, 0.1]), st.floats(0, 1), st.integers(0, 99)
)
def test_wrong_verdicts_stay_within_the_declared_error_rate(rare, often, error, q, seed):
    # Followed run by run to the end and stopped at the first verdict: the worst case for a sequential procedure.
    procedure = Procedure(rare=rare, often=often, error_rate=error, max_runs=60)
    table = np.array(
        [[list(Status).index(procedure.status(min(k, n), n)) for k in range(61)] for n in range(61)], dtype=int
    )
    chance = np.zeros(61)
    chance[0] = 1.0
    decided = dict.fromkeys(Status, 0.0)
    for n in range(1, 61):
        chance = chance * (1 - q) + np.concatenate([[0.0], chance[:-1]]) * q
        for status in (Status.PASS, Status.FAIL, Status.FLAKY):
            here = table[n] == list(Status).index(status)
            decided[status] += chance[here].sum()
            chance = np.where(here, 0.0, chance)
    if q >= often:
        assert decided[Status.PASS] <= error + 1e-9
    if q <= 1 - often:
        assert decided[Status.FAIL] <= error + 1e-9
    if q <= rare or q >= 1 - rare:
        assert decided[Status.FLAKY] <= error + 1e-9


def test_hypotheses_that_overlap_are_refused():
    with pytest.raises(ValidationError):
        Procedure(rare=0.3, often=0.2)


def test_the_objective_of_a_requirement_is_its_metric_unless_the_stack_failed():
    run = run_of(trajectory([0, 1], 0, humans=[(2, 0)]))
    assert objective(run, NEAR) == pytest.approx(1.25)

    failed = replace(run, outcome=Outcome.STACK_FAILED)
    for requirement in (NEAR, NEAR.replace(metric=None, limit=None, formula="always (speed > 1)")):
        assert objective(failed, requirement) is None


def test_what_judges_and_measures_loads_without_scipy_stats() -> None:
    code = "import sys, rvsg.evaluation.verdict, rvsg.report.answer_row; sys.exit('scipy.stats' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


CLEARANCE = shipped_requirements()["clearance"]
GRID = np.linspace(0.005, 0.995, 199)


def objectives(violations, runs):
    """Objectives of which so many violate the requirement."""
    limit = CLEARANCE.threshold
    return [limit - 0.1] * violations + [limit + 0.1] * (runs - violations)


@cache
def more(violations, runs):
    """How many runs are added in this state; 0: the procedure stops."""
    return next_repeats(CLEARANCE, objectives(violations, runs))


@cache
def covers(violations, runs, q):
    low, high = clopper_pearson(violations, runs, DEFAULT.confidence)
    return low <= q <= high


def coverage(q):
    """Exactly, by following the probability of every pair of counts: (coverage, expected number of runs)."""
    waiting, covered, spent = {(0, 0): 1.0}, 0.0, 0.0
    while waiting:
        violations, runs = min(waiting, key=lambda state: state[1])
        probability = waiting.pop((violations, runs))
        step = more(violations, runs)
        if step == 0:
            covered += probability * covers(violations, runs, q)
            spent += probability * runs
            continue
        for bad, chance in enumerate(binom.pmf(np.arange(step + 1), step, q)):
            state = (violations + bad, runs + step)
            waiting[state] = waiting.get(state, 0.0) + probability * chance
    return covered, spent


def ends():
    """Every (violations, runs) at which the procedure can stop."""
    waiting, seen = [(0, 0)], {(0, 0)}
    while waiting:
        violations, runs = waiting.pop()
        step = more(violations, runs)
        if step == 0:
            yield violations, runs
        after = {(violations + bad, runs + step) for bad in range(step + 1)} - seen
        seen |= after
        waiting += after


def test_the_interval_covers_as_often_as_it_says_although_the_runs_stopped_on_the_verdict():
    # Coverage jumps down only where q passes a bound of an interval: looking there misses no dip.
    jumps = {bound + aside for end in ends() for bound in clopper_pearson(*end) for aside in (-1e-9, 1e-9)}
    covered = [coverage(q)[0] for q in sorted(jumps) if 0 < q <= 0.5]  # violations and clean runs count alike
    assert DEFAULT.confidence <= min(covered) < 0.951
    assert np.mean([coverage(float(q))[0] for q in GRID[::8]]) == pytest.approx(0.986, abs=0.004)


def test_the_runs_are_spent_where_the_verdict_is_hard():
    assert coverage(0.5)[1] < 6 < 15 < coverage(0.01)[1] < coverage(0.05)[1] < DEFAULT.max_runs


@pytest.mark.parametrize(
    ("value", "unit", "said"), [(1.0, "events", "1 event"), (2.0, "events", "2 events"), (1.0, "1 or 0", "1")]
)
def test_a_value_is_told_as_people_say_it(value, unit, said):
    assert number(value, unit) == said
