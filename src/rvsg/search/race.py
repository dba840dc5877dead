"""The race for further runs: estimates from few noisy runs, shared between related configurations.

A configuration that was changed from another is expected to do about as well as that one, and all configurations meet
the same seeds. One linear model holds both, and its variances (of noise, seeds, drafts and changes) are estimated from
the runs of the campaign by expectation maximisation. So one lucky run of a noisy objective does not make a favourite,
and one run of a quiet objective does.

The unknowns are the value of each configuration and a few effects that all share: one for each seed, the level of
drafts and the shift of changes. The normal equations are

    [ D  S ] [ values ]   [ pulls        ]
    [ S' B ] [ common ] = [ pulls_shared ]

D couples a configuration only with the one it was changed from, so D is a tree: the values are eliminated one by one,
the last first, without fill-in. Then the small block B (`border`) is inverted, and the values follow in order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import float64, inner, int64, kernel
from rvsg.search.candidates import Candidate

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

NOISE, DRAFT, CHANGE, SEED, WEAK = range(5)
"""Indices of the variances: of a run, a draft, a change, a seed, and of level and shift."""


@inner
def _invert(a: Floats) -> None:
    """Invert a symmetric positive definite matrix in its place."""
    n = len(a)
    for k in range(n):
        pivot = 1.0 / a[k, k]
        a[k, k] = 1.0
        for j in range(n):
            a[k, j] *= pivot
        for i in range(n):
            if i != k:
                factor = a[i, k]
                a[i, k] = 0.0
                for j in range(n):
                    a[i, j] -= factor * a[k, j]


@inner(arrays=True)
def _solve(
    parents: Integers, who: Integers, when: Integers, badness: Floats, seeds: int, variances: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats]:
    """Solve the normal equations; the arguments are those of `fit`, `variances` in the order of the indices above.

    Returns:
        With n values and m shared effects: the means of the values (n) and of the shared effects (m), the mean
        covariance of each value with all values (n), the variances of the values (n), their covariances with their
        parents (n) and with the shared effects (n, m), and the covariance of the shared effects (m, m).
    """
    n, m = len(parents), seeds + 2
    level, shift = seeds, seeds + 1
    weight = 1.0 / variances
    diagonal, shared, border = np.zeros(n), np.zeros((n, m)), np.zeros((m, m))
    pulls, pulls_shared = np.zeros((n, 2)), np.zeros((m, 2))
    pulls[:, 1] = 1.0 / n
    for r in range(len(who)):
        diagonal[who[r]] += weight[NOISE]
        shared[who[r], when[r]] += weight[NOISE]
        border[when[r], when[r]] += weight[NOISE]
        pulls[who[r], 0] += badness[r] * weight[NOISE]
        pulls_shared[when[r], 0] += badness[r] * weight[NOISE]
    for k in range(n):
        p = parents[k]
        if p < 0:
            diagonal[k] += weight[DRAFT]
            shared[k, level] -= weight[DRAFT]
            border[level, level] += weight[DRAFT]
        else:
            diagonal[k] += weight[CHANGE]
            diagonal[p] += weight[CHANGE]
            shared[k, shift] -= weight[CHANGE]
            shared[p, shift] += weight[CHANGE]
            border[shift, shift] += weight[CHANGE]
    for j in range(m):
        border[j, j] += weight[SEED] if j < seeds else weight[WEAK]
    for k in range(n - 1, -1, -1):
        p = parents[k]
        if p >= 0:
            factor = -weight[CHANGE] / diagonal[k]
            diagonal[p] += factor * weight[CHANGE]
            for j in range(m):
                shared[p, j] -= factor * shared[k, j]
            for j in range(2):
                pulls[p, j] -= factor * pulls[k, j]
        for i in range(m):
            factor = shared[k, i] / diagonal[k]
            if factor != 0.0:
                for j in range(m):
                    border[i, j] -= factor * shared[k, j]
                for j in range(2):
                    pulls_shared[i, j] -= factor * pulls[k, j]
    _invert(border)
    common = np.zeros((m, 2))
    for i in range(m):
        for j in range(m):
            for c in range(2):
                common[i, c] += border[i, j] * pulls_shared[j, c]
    found, own, with_parent, with_shared = np.zeros((n, 2)), np.zeros(n), np.zeros(n), np.zeros((n, m))
    for k in range(n):
        p, link = parents[k], -weight[CHANGE]
        for c in range(2):
            total = pulls[k, c]
            for j in range(m):
                total -= shared[k, j] * common[j, c]
            if p >= 0:
                total -= link * found[p, c]
            found[k, c] = total / diagonal[k]
        for j in range(m):
            total = 0.0
            for i in range(m):
                total += shared[k, i] * border[i, j]
            if p >= 0:
                total += link * with_shared[p, j]
            with_shared[k, j] = -total / diagonal[k]
        spread = 0.0
        for j in range(m):
            spread += shared[k, j] * with_shared[k, j]
        if p >= 0:
            total = link * own[p]
            for j in range(m):
                total += shared[k, j] * with_shared[p, j]
            with_parent[k] = -total / diagonal[k]
            spread += link * with_parent[k]
        own[k] = (1.0 - spread) / diagonal[k]
    return found[:, 0].copy(), common[:, 0].copy(), found[:, 1].copy(), own, with_parent, with_shared, border


@kernel
def fit(
    parents: Integers,
    who: Integers,
    when: Integers,
    badness: Floats,
    seeds: int,
    start: Floats,
    least: float,
    prior: float,
    iterations: int,
) -> tuple[Floats, Floats]:
    """Fit the variances by expectation maximisation.

    Returns:
        The mean of each value, and the variance of its difference to the mean of all values.

    Args:
        parents: What each configuration was changed from, an earlier one; -1 for a draft.
        who, when, badness: Configuration, seed and centred badness of each run.
        seeds: How many seeds there are.
        start: The variances at the start.
        prior: How many runs the start counts as.
        least: The smallest variance.
        iterations: Steps of expectation maximisation.
    """
    n, level, shift = len(parents), seeds, seeds + 1
    variances = start.copy()
    for _ in range(iterations):
        values, common, _, own, with_parent, with_shared, border = _solve(parents, who, when, badness, seeds, variances)
        squares, count = np.zeros(4), np.zeros(4)
        for r in range(len(who)):
            k, s = who[r], when[r]
            squares[NOISE] += (badness[r] - values[k] - common[s]) ** 2
            squares[NOISE] += own[k] + border[s, s] + 2.0 * with_shared[k, s]
            count[NOISE] += 1.0
        for k in range(n):
            p = parents[k]
            if p < 0:
                squares[DRAFT] += (values[k] - common[level]) ** 2
                squares[DRAFT] += own[k] + border[level, level] - 2.0 * with_shared[k, level]
                count[DRAFT] += 1.0
            else:
                squares[CHANGE] += (values[k] - values[p] - common[shift]) ** 2
                squares[CHANGE] += own[k] + own[p] + border[shift, shift] - 2.0 * with_parent[k]
                squares[CHANGE] += 2.0 * (with_shared[p, shift] - with_shared[k, shift])
                count[CHANGE] += 1.0
        for s in range(seeds):
            squares[SEED] += common[s] ** 2 + border[s, s]
            count[SEED] += 1.0
        for v in range(4):
            if count[v] > 0.0:
                variances[v] = max((squares[v] + prior * start[v]) / (count[v] + prior), least)
    values, _, mean, own, _, _, _ = _solve(parents, who, when, badness, seeds, variances)
    return values, own - 2.0 * mean + mean.mean()


FIT = (int64[::1], int64[::1], int64[::1], float64[::1], int64, float64[::1], float64, float64, int64)
"""numba's types of the arguments of `fit`, to compile it beforehand."""
ITERATIONS = 8
"""Steps of the estimation of the variances."""
PRIOR_RUNS = 1.0
"""Weight of the variances assumed at the start, in runs."""
SHARES, SMALLEST = np.array([0.1, 0.5, 0.25, 0.1, 4.0]), 1e-6
"""The variances assumed at the start of noise, drafts, changes, seeds and of level and shift, and the smallest of each
later, as shares of the variance of all runs."""


def estimate(candidates: Sequence[Candidate]) -> None:
    """Write the estimate and its standard deviation into every candidate that has runs."""
    known = [c for c in candidates if c.runs]
    if not known:
        return
    place = {id(candidate): k for k, candidate in enumerate(known)}
    seeds = {seed: k for k, seed in enumerate(dict.fromkeys(seed for c in known for seed in c.badness))}
    badness = np.array([value for c in known for value in c.badness.values()])
    centre, total = float(badness.mean()), max(float(badness.var()), 1e-12)
    values, variances = fit(
        np.array([place.get(id(c.parent), -1) for c in known], np.int64),
        np.array([k for k, c in enumerate(known) for _ in c.badness], np.int64),
        np.array([seeds[seed] for c in known for seed in c.badness], np.int64),
        badness - centre,
        len(seeds),
        total * SHARES,
        SMALLEST * total,
        PRIOR_RUNS,
        ITERATIONS,
    )
    step = 1e-6 * math.sqrt(total)  # the last digits mean nothing
    for k, candidate in enumerate(known):
        candidate.estimate = round(float(values[k]) / step) * step + centre
        candidate.deviation = round(math.sqrt(max(float(variances[k]), 0.0)) / step) * step


def in_the_race(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates that may still be the best: their upper bound reaches the highest lower bound."""
    known = [c for c in candidates if c.runs]
    best = max((c.lower for c in known), default=-math.inf)
    return [c for c in known if c.upper >= best]
