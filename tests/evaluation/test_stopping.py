"""What the interval beside a verdict covers when the runs were added until the status was decided."""

from functools import cache

import numpy as np
import pytest
from scipy.stats import binom

from rvsg.evaluation.statistics import clopper_pearson
from rvsg.evaluation.verdict import DEFAULT, judge, next_repeats
from rvsg.scenario.requirement import shipped_requirements

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


def simulated(q, rng):
    """Whether the interval of one simulated sequence of runs holds q."""
    violations = runs = 0
    while step := more(violations, runs):
        violations += int(rng.binomial(step, q))
        runs += step
    interval = judged(violations, runs)
    return interval is not None and interval[0] <= q <= interval[1]


@cache
def judged(violations, runs):
    return judge(CLEARANCE, objectives(violations, runs)).violation_interval


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


@pytest.mark.parametrize("q", [0.03, 0.225, 0.5, 0.775])
def test_simulated_sequences_of_runs_are_covered_as_computed(q):
    rng = np.random.default_rng([6, round(1000 * q)])
    hits = sum(simulated(q, rng) for _ in range(1500))
    expected = coverage(q)[0]
    assert hits / 1500 == pytest.approx(expected, abs=4 * (expected * (1 - expected) / 1500) ** 0.5)


def test_the_runs_are_spent_where_the_verdict_is_hard():
    assert coverage(0.5)[1] < 6 < 15 < coverage(0.01)[1] < coverage(0.05)[1] < DEFAULT.max_runs
