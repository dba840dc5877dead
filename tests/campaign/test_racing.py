"""The estimates of a race against the same linear model solved by inverting its matrix."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rvsg.runs.attempt import Attempt
from rvsg.search.candidates import Candidate
from rvsg.search.race import ITERATIONS, PRIOR_RUNS, SHARES, SMALLEST, estimate


def race(seed: int, count: int, seeds: int) -> list[Candidate]:
    rng = np.random.default_rng(seed)
    found: list[Candidate] = []
    for index in range(count):
        parent = found[int(rng.integers(index))] if index and rng.random() < 0.8 else None
        met = rng.permutation(seeds)[: int(rng.integers(seeds + 1))]
        badness = {int(each): float(rng.normal()) for each in met}
        found.append(Candidate(Attempt.model_construct(index=index), parent, "new", badness))
    return found


def dense(candidates: list[Candidate]) -> dict[int, tuple[float, float]]:
    """Return estimate and deviation of each candidate with runs, by its index."""
    known = [c for c in candidates if c.runs]
    place = {c.index: k for k, c in enumerate(known)}
    seeds = list(dict.fromkeys(seed for c in known for seed in c.badness))
    n, m = len(known), len(seeds)
    last = [[{n + j: 1.0} for j in range(m)], [{n + m: 1.0}, {n + m + 1: 1.0}]]
    entries: list[list[dict[int, float]]] = [[], [], [], *last]
    for k, c in enumerate(known):
        entries[0] += [{k: 1.0, n + seeds.index(seed): 1.0} for seed in c.badness]
        parent = place.get(c.parent.index) if c.parent is not None else None
        if parent is None:
            entries[1].append({k: 1.0, n + m: -1.0})
        else:
            entries[2].append({k: 1.0, parent: -1.0, n + m + 1: -1.0})
    rows = [np.zeros((len(each), n + m + 2)) for each in entries]
    for matrix, each in zip(rows, entries, strict=True):
        for row, entry in zip(matrix, each, strict=True):
            for at, factor in entry.items():
                row[at] = factor
    badness = np.array([value for c in known for value in c.badness.values()])
    centre, total = badness.mean(), max(badness.var(), 1e-12)
    start = total * SHARES
    variances = start.copy()
    for step in range(ITERATIONS + 1):
        covariance = np.linalg.inv(sum(r.T @ r / v for r, v in zip(rows, variances, strict=True)))
        values = covariance @ rows[0].T @ (badness - centre) / variances[0]
        if step == ITERATIONS:
            break
        for v in range(4):
            if len(rows[v]):
                rest = (badness - centre if v == 0 else 0.0) - rows[v] @ values
                squares = (rest**2).sum() + np.trace(rows[v] @ covariance @ rows[v].T)
                found = (squares + PRIOR_RUNS * start[v]) / (len(rows[v]) + PRIOR_RUNS)
                variances[v] = max(found, SMALLEST * total)
    part = covariance[:n, :n]
    spread = np.diag(part) - 2.0 * part.mean(axis=1) + part.mean()
    return {c.index: (values[k] + centre, math.sqrt(max(spread[k], 0.0))) for k, c in enumerate(known)}


@pytest.mark.parametrize(("seed", "count", "seeds"), [(0, 1, 1), (1, 5, 2), (2, 30, 12), (3, 60, 4)])
def test_estimates_are_those_of_the_whole_matrix(seed: int, count: int, seeds: int) -> None:
    candidates = race(seed, count, seeds)
    estimate(candidates)
    expected = dense(candidates)
    for candidate in candidates:
        if candidate.runs:
            found = (candidate.estimate, candidate.deviation)
            assert found == pytest.approx(expected[candidate.index], abs=1e-5)
        else:
            assert candidate.estimate == -math.inf


def test_a_race_without_runs_has_no_estimates() -> None:
    candidates = [Candidate(Attempt.model_construct(index=0))]
    estimate(candidates)
    assert candidates[0].estimate == -math.inf
