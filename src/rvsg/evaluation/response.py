"""The violation probability as a function of parameters: a logistic response surface, and what each parameter does.

Parameters are given as shares of their ranges, 0 to 1. The surface is a logistic regression on a constant, on the
parameters, or on the parameters with squares and products. The corrected information criterion of Akaike (Hurvich and
Tsai 1989) chooses among the three, so that few runs give a plain surface. A weak normal prior of standard deviation
`PRIOR_SD` on all but the constant keeps the coefficients finite where the runs are separated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Record
from rvsg.evaluation.statistics import holm

Floats = NDArray[np.float64]
Degree = Literal[0, 1, 2]
PRIOR_SD = 5.0
SOBOL_POINTS = 2048
STEPS = 60


class Surface(Record):
    """A fitted response surface."""

    degree: Degree
    """0: the probability is the same everywhere. 1: linear in the logit. 2: with squares and products."""
    coefficients: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]

    def probability(self, shares: Floats) -> Floats:
        """Return the violation probability at points (N, D) of shares."""
        return _logistic(_features(np.atleast_2d(shares), self.degree) @ np.array(self.coefficients))

    def interval(self, shares: Floats, deviations: float = 1.96) -> tuple[Floats, Floats]:
        """Return the ends of the 95 % interval of the probability at points (N, D), by the delta method."""
        rows = _features(np.atleast_2d(shares), self.degree)
        middle = rows @ np.array(self.coefficients)
        spread = deviations * np.sqrt(np.einsum("ij,jk,ik->i", rows, np.array(self.covariance), rows))
        return _logistic(middle - spread), _logistic(middle + spread)


class Sensitivity(Record):
    """What one parameter does to the violation probability and to the objective."""

    name: str
    share: float
    """Total Sobol index: the share of the variance of the probability that vanishes if this parameter is fixed. 0 where
    the surface is flat."""
    at_low: float
    """Mean violation probability with the parameter at the low end of its range."""
    at_high: float
    correlation: float | None
    """Spearman's rank correlation of the parameter with the badness of the objective; positive: larger is worse."""
    p: float | None
    """Of no correlation, corrected by Holm over the parameters."""


def fit_surface(shares: Floats, violated: Sequence[bool]) -> Surface:
    """Fit the surface to points (N, D) of shares and whether each run violates."""
    y = np.asarray(violated, dtype=np.float64)
    candidates: list[tuple[float, Surface]] = []
    for degree in (0, 1, 2):
        rows = _features(shares, degree)
        n, k = rows.shape
        if k >= n - 1 and degree:
            break
        coefficients, covariance, likelihood = _fit(rows, y)
        criterion = 2.0 * k - 2.0 * likelihood + (2.0 * k * (k + 1) / (n - k - 1) if n > k + 1 else 0.0)
        made = Surface(
            degree=degree,
            coefficients=tuple(coefficients.tolist()),
            covariance=tuple(tuple(row) for row in covariance.tolist()),
        )
        candidates.append((criterion, made))
    return min(candidates, key=lambda pair: pair[0])[1]


def sensitivities(
    surface: Surface, names: Sequence[str], shares: Floats, badness: Sequence[float | None], *, seed: int
) -> tuple[Sensitivity, ...]:
    """Return what each parameter does.

    Args:
        shares: the points (N, D) that were run.
        badness: how bad the objective of each run is; None for a run without one.
    """
    from scipy import stats

    known = [k for k, value in enumerate(badness) if value is not None]
    values = np.array([badness[k] for k in known], dtype=np.float64)
    correlations: list[tuple[float, float] | None] = []
    for column in shares[known].T if known else np.empty((len(names), 0)):
        if len(values) < 4 or not np.ptp(values):
            correlations.append(None)
            continue
        found = stats.spearmanr(column, values)
        correlations.append((float(found.statistic), float(found.pvalue)))
    corrected = holm({name: pair[1] for name, pair in zip(names, correlations, strict=True) if pair})
    indices = _total_indices(surface, len(names), seed)
    grid = stats.qmc.LatinHypercube(len(names), rng=np.random.default_rng(seed)).random(512)
    result = []
    for k, (name, pair) in enumerate(zip(names, correlations, strict=True)):
        low, high = grid.copy(), grid.copy()
        low[:, k], high[:, k] = 0.0, 1.0
        result.append(
            Sensitivity(
                name=name,
                share=float(indices[k]),
                at_low=float(surface.probability(low).mean()),
                at_high=float(surface.probability(high).mean()),
                correlation=pair[0] if pair else None,
                p=corrected.get(name),
            )
        )
    return tuple(result)


def _total_indices(surface: Surface, count: int, seed: int) -> Floats:
    if surface.degree == 0:
        return np.zeros(count)
    if count == 1:  # the only parameter is all of the variance; SciPy 1.17 cannot say so
        return np.ones(1)
    from scipy import stats

    dists = [stats.uniform(0.0, 1.0)] * count
    found = stats.sobol_indices(
        func=lambda x: surface.probability(x.T), n=SOBOL_POINTS, dists=dists, rng=np.random.default_rng(seed)
    )
    return np.clip(np.asarray(found.total_order, dtype=np.float64).reshape(count), 0.0, 1.0)


def _features(shares: Floats, degree: int) -> Floats:
    """Return the columns of the regression: the constant, the centred parameters, their squares and products."""
    x = 2.0 * np.asarray(shares, dtype=np.float64) - 1.0
    columns = [np.ones(len(x))]
    if degree >= 1:
        columns += list(x.T)
    if degree >= 2:
        d = x.shape[1]
        columns += [x[:, i] * x[:, j] for i in range(d) for j in range(i, d)]
    return np.stack(columns, axis=1)


def _fit(rows: Floats, y: Floats) -> tuple[Floats, Floats, float]:
    """Return coefficients, their covariance and the log-likelihood, by Newton's method with step halving."""
    precision = np.full(rows.shape[1], PRIOR_SD**-2)
    precision[0] = 1e-4  # the constant is nearly free, but finite where every run violates or none
    beta = np.zeros(rows.shape[1])

    def loss(b: Floats) -> float:
        z = rows @ b
        return float(np.sum(np.logaddexp(0.0, z) - y * z) + 0.5 * np.sum(precision * b * b))

    hessian = np.diag(precision)
    for _ in range(STEPS):
        p = _logistic(rows @ beta)
        hessian = (rows * (p * (1.0 - p))[:, None]).T @ rows + np.diag(precision)
        step = np.linalg.solve(hessian, rows.T @ (y - p) - precision * beta)
        size = 1.0
        while size > 1e-6 and loss(beta + size * step) > loss(beta):
            size /= 2.0
        beta = beta + size * step
        if float(np.abs(size * step).max()) < 1e-10:
            break
    z = rows @ beta
    return beta, np.linalg.inv(hessian), float(-np.sum(np.logaddexp(0.0, z) - y * z))


def _logistic(z: Floats) -> Floats:
    from scipy.special import expit

    return np.asarray(expit(z), dtype=np.float64)
