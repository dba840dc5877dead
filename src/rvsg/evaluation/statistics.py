"""Statistics of repeated runs: intervals, tests with effect sizes, and response surfaces.

`scipy.stats` takes most of a second to load, so the functions that need it load it: most commands do not.

A response surface is the violation probability as a function of parameters, given as shares of their ranges, 0 to 1.
It is a logistic regression on a constant, on the parameters, or on the parameters with squares and products. The
corrected information criterion of Akaike (Hurvich and Tsai 1989) chooses among the three, so that few runs give a plain
surface. A weak normal prior of standard deviation `PRIOR_SD` on all but the constant keeps the coefficients finite
where the runs are separated.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Record

Values = Sequence[float]
RESAMPLES = 4000
FEWEST = 3
SMALLEST_BOOTSTRAP = 5
FARTHEST = 2.0
"""How far either end may lie from the mean, in half widths of Student's t interval."""


def clopper_pearson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the exact two-sided interval of a probability (Clopper and Pearson 1934).

    It covers the truth with at least `confidence` for every probability and number of trials fixed beforehand.
    """
    if trials < 1:
        return (0.0, 1.0)
    from scipy.special import betaincinv

    tail = (1.0 - confidence) / 2.0
    low = 0.0 if successes == 0 else float(betaincinv(successes, trials - successes + 1, tail))
    high = 1.0 if successes == trials else float(betaincinv(successes + 1, trials - successes, 1.0 - tail))
    return (low, high)


def wilson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return Wilson's score interval of a probability (Wilson 1927)."""
    from scipy.special import ndtri  # scipy.stats has this interval, too, and takes most of a second to load

    share, z = successes / trials, float(ndtri(0.5 + 0.5 * confidence))
    whole = 2.0 * (trials + z**2)
    centre = (2.0 * trials * share + z**2) / whole
    half = z / whole * (4.0 * trials * share * (1.0 - share) + z**2) ** 0.5
    return (0.0 if successes == 0 else centre - half, 1.0 if successes == trials else centre + half)


class ShareDifference(Record):
    """The difference of two shares, e.g. of violating runs with people and without."""

    first: float
    second: float
    difference: float
    """`first` - `second`."""
    interval: tuple[float, float]
    paired: bool
    """Whether the two were measured with the same seeds."""
    runs: tuple[int, int]

    @property
    def is_clear(self) -> bool:
        """Return whether the interval does not hold 0."""
        return self.interval[0] > 0.0 or self.interval[1] < 0.0


def share_difference(
    first: Sequence[bool], second: Sequence[bool], *, paired: bool = False, confidence: float = 0.95
) -> ShareDifference | None:
    """Return the difference of two shares of True with Newcombe's interval; None if a sample is empty.

    It joins Wilson's intervals of the two shares (Newcombe, Statistics in Medicine 17, 1998: method 10 of 873-890 for
    independent samples, and of 2635-2650 for `paired` ones, whose correlation narrows it). It stays within -1 and 1.
    """
    n, m = len(first), len(second)
    if not n or not m:
        return None
    if paired and n != m:
        raise ValueError(f"paired samples must have one length, got {n} and {m}")
    p, q = sum(first) / n, sum(second) / m
    (p_low, p_high), (q_low, q_high) = wilson(sum(first), n, confidence), wilson(sum(second), m, confidence)
    correlation = _correlation(first, second) if paired else 0.0
    below, above = (p - p_low, q_high - q), (p_high - p, q - q_low)
    low, high = ((u * u - 2.0 * correlation * u * v + v * v) ** 0.5 for u, v in (below, above))
    return ShareDifference(
        first=p,
        second=q,
        difference=p - q,
        interval=(max(-1.0, p - q - low), min(1.0, p - q + high)),
        paired=paired,
        runs=(n, m),
    )


def _correlation(first: Sequence[bool], second: Sequence[bool]) -> float:
    """Return the correlation phi of two paired samples, with Newcombe's correction for continuity."""
    both = sum(a and b for a, b in zip(first, second, strict=True))
    neither = sum(not a and not b for a, b in zip(first, second, strict=True))
    n, a, b = len(first), sum(first), sum(second)
    margins = a * (n - a) * b * (n - b)
    if not margins:
        return 0.0
    product = float(both * neither - (a - both) * (b - both))
    if product > 0:
        product = max(product - n / 2, 0.0)
    return float(product / margins**0.5)


def fisher(successes: int, trials: int, others: int, other_trials: int) -> float:
    """Return the one-sided p value of Fisher's exact test that the first share is not larger than the other one."""
    total, ways = successes + others, math.comb(trials + other_trials, successes + others)
    most = min(trials, total)
    return sum(math.comb(trials, k) * math.comb(other_trials, total - k) for k in range(successes, most + 1)) / ways


def welch(first: Values, second: Values) -> float | None:
    """Return the two-sided p value of Welch's t test that two means are equal; None with a single value in a sample.

    Two samples without any spread give 1 where they are equal, else 0.
    """
    if min(len(first), len(second)) < 2:
        return None
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if not (np.ptp(a) or np.ptp(b)):
        return float(a[0] == b[0])
    from scipy.special import stdtr  # loads in a tenth of the time of scipy.stats, and every campaign needs it

    shares = np.array([np.var(a, ddof=1) / len(a), np.var(b, ddof=1) / len(b)])
    freedom = shares.sum() ** 2 / (shares**2 / np.array([len(a) - 1, len(b) - 1])).sum()
    return float(2.0 * stdtr(freedom, -abs(a.mean() - b.mean()) / math.sqrt(shares.sum())))


def mean_interval(
    values: Values,
    confidence: float = 0.95,
    *,
    least: float | None = None,
    most: float | None = None,
    two_valued: bool = False,
) -> tuple[float, float] | None:
    """Return an interval of the mean by bootstrap-t (Efron and Tibshirani 1993, ch. 12.5), or None.

    Fewer than `FEWEST` values give none: Student's t with one degree of freedom is ten times as wide as what it is
    about. Under `SMALLEST_BOOTSTRAP` values it is Student's t interval. The bootstrap is studentised because the
    percentile bootstrap is too narrow for 5 to 30 runs. Where few values repeat it explodes, so neither end lies
    farther from the mean than twice the reach of Student's t; on distances, times and jerks of repeated scenarios that
    costs no coverage (five runs: 88 to 92 %, fifteen: 90 to 94 %). The values themselves seed it.

    Args:
        least: The smallest value that the quantity can have; the interval is cut off there.
        most: The largest value that the quantity can have.
        two_valued: Every value is `least` or `most`, so the interval is that of a probability.
    """
    n = len(values)
    if n < FEWEST:
        return None
    if two_valued and least is not None and most is not None and all(value in (least, most) for value in values):
        low, high = clopper_pearson(sum(value == most for value in values), n, confidence)
        return least + low * (most - least), least + high * (most - least)
    low, high = (
        min(max(end, -math.inf if least is None else least), math.inf if most is None else most)
        for end in _mean_interval(np.asarray(values, dtype=np.float64), confidence)
    )
    return low, high


def _mean_interval(data: NDArray[np.float64], confidence: float) -> tuple[float, float]:
    n = len(data)
    mean = float(data.mean())
    error = float(data.std(ddof=1)) / np.sqrt(n)
    if error == 0.0:
        return (mean, mean)
    tail = (1.0 - confidence) / 2.0
    from scipy.special import stdtrit

    reach = float(stdtrit(n - 1, 1.0 - tail)) * error
    if n < SMALLEST_BOOTSTRAP:
        return (mean - reach, mean + reach)
    digest = hashlib.sha256(np.ascontiguousarray(data).tobytes()).digest()
    rng = np.random.default_rng(int.from_bytes(digest[:8], "big"))  # equal data give equal intervals
    drawn = data[rng.integers(0, n, size=(RESAMPLES, n))]
    errors = drawn.std(axis=1, ddof=1) / np.sqrt(n)
    good = errors > 1e-12 * abs(error)
    t = (drawn.mean(axis=1)[good] - mean) / errors[good]
    low_t, high_t = np.quantile(t, [tail, 1.0 - tail])
    below, above = float(high_t) * error, -float(low_t) * error
    return (mean - min(below, FARTHEST * reach), mean + min(above, FARTHEST * reach))


def censored_median(values: Values, censored: Sequence[bool]) -> float | None:
    """Return the Kaplan-Meier median of values of which some are only lower bounds; None if it is not reached.

    With all bounds at one time limit it is the median of the values as long as it lies below the limit. With an even
    number of values it is the lower of the two in the middle: the first time by which half have arrived.
    """
    order = sorted(range(len(values)), key=lambda k: (values[k], censored[k]))
    surviving, left = 1.0, len(values)
    for k in order:
        if not censored[k]:
            surviving *= 1.0 - 1.0 / left
            if surviving <= 0.5 + 1e-12:
                return float(values[k])
        left -= 1
    return None


class Comparison(Record):
    """Two samples compared: the two-sided Mann-Whitney U test and how large the difference is.

    `a12` is the probability that a value of the first sample exceeds one of the second (ties half, Vargha and
    Delaney 2000), `delta` = 2 a12 - 1 is Cliff's delta, `p` the two-sided p value, `p_holm` the same corrected over
    the family it was tested in.
    """

    n1: int
    n2: int
    u: float
    p: float
    a12: float
    delta: float
    magnitude: str
    p_holm: float | None = None


def magnitude_of(a12: float) -> str:
    """negligible, small (from 0.556), medium (0.638) or large (0.714), mirrored below 0.5 (Vargha and Delaney)."""
    size = max(a12, 1.0 - a12)
    for name, least in (("large", 0.714), ("medium", 0.638), ("small", 0.556)):
        if size >= least:
            return name
    return "negligible"


def vargha_delaney(first: Values, second: Values) -> float:
    """Return A12 = P(first > second) + P(equal) / 2, from the ranks."""
    from scipy import stats

    n1, n2 = len(first), len(second)
    ranks = stats.rankdata(np.concatenate([np.asarray(first, float), np.asarray(second, float)]))
    return float((ranks[:n1].sum() - n1 * (n1 + 1) / 2) / (n1 * n2))


def compare(first: Values, second: Values) -> Comparison | None:
    """Return Mann-Whitney U with A12 and Cliff's delta; None if a sample is empty.

    All values equal gives p = 1 (the test has nothing to rank).
    """
    if not len(first) or not len(second):
        return None
    from scipy import stats

    a12 = vargha_delaney(first, second)
    u = a12 * len(first) * len(second)
    pooled = np.concatenate([np.asarray(first, float), np.asarray(second, float)])
    tied = bool((pooled == pooled[0]).all())
    p = 1.0 if tied else float(stats.mannwhitneyu(first, second, alternative="two-sided").pvalue)
    return Comparison(
        n1=len(first), n2=len(second), u=u, p=p, a12=a12, delta=2.0 * a12 - 1.0, magnitude=magnitude_of(a12)
    )


def holm(p_values: Mapping[str, float]) -> dict[str, float]:
    """Return Holm's step-down correction over one family of tests (Holm 1979): adjusted p values by the same keys."""
    ordered = sorted(p_values, key=lambda key: p_values[key])
    corrected: dict[str, float] = {}
    running = 0.0
    for rank, key in enumerate(ordered):
        running = max(running, min(1.0, (len(ordered) - rank) * p_values[key]))
        corrected[key] = running
    return {key: corrected[key] for key in p_values}


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

    def interval(self, shares: Floats) -> tuple[Floats, Floats]:
        """Return the ends of the 95 % interval of the probability at points (N, D), by the delta method."""
        rows = _features(np.atleast_2d(shares), self.degree)
        middle = rows @ np.array(self.coefficients)
        spread = 1.96 * np.sqrt(np.einsum("ij,jk,ik->i", rows, np.array(self.covariance), rows))
        return _logistic(middle - spread), _logistic(middle + spread)


class Band(Record):
    """The part of a parameter's range in which runs violate most, and how surely it is told from the rest."""

    low: float
    """A share of the range, as `high`."""
    high: float
    inside: tuple[int, int]
    """Violating runs, and all runs."""
    outside: tuple[int, int]
    p: float
    """Of violations that do not depend on the parameter; corrected by Holm over the parameters."""

    @property
    def told(self) -> bool:
        """Whether it is told apart at 5 %."""
        return self.p < 0.05


BINS, DRAWS = 24, 999
"""A band begins and ends at one of so many quantiles; it is compared with so many random orders of the runs."""


def failing_band(shares: Floats, violated: Sequence[bool], *, seed: int) -> Band | None:
    """Return the band of a parameter (N shares) with most violations for its runs; None where all or none violate.

    A scan statistic: the likelihood ratio of one rate inside and another outside, over all bands. It finds a failing
    middle that a rank correlation and a flat surface do not show.
    """
    y = np.asarray(violated, dtype=np.int64)
    if not 0 < y.sum() < len(y):
        return None
    bins = np.array_split(np.argsort(shares, kind="stable"), min(BINS, len(y)))
    sizes = np.array([len(rows) for rows in bins])
    ends = [(i, j) for i in range(len(bins)) for j in range(i + 1, len(bins) + 1) if j - i < len(bins)]
    first, last = np.array(ends).T
    runs = np.concatenate([[0], sizes.cumsum()])[last] - np.concatenate([[0], sizes.cumsum()])[first]

    def scores(counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats]:
        reached = np.concatenate([np.zeros((len(counts), 1), np.int64), counts.cumsum(axis=1)], axis=1)
        hits = reached[:, last] - reached[:, first]
        inside, outside = hits / runs, (y.sum() - hits) / (len(y) - runs)
        ratio = _entropy(inside) * runs + _entropy(outside) * (len(y) - runs)
        return hits, np.where(inside > outside, ratio, -math.inf)

    hits, ratios = scores(np.array([[y[rows].sum() for rows in bins]]))
    rng = np.random.default_rng(seed)
    drawn = rng.multivariate_hypergeometric(sizes, int(y.sum()), size=DRAWS, method="marginals")
    k = int(ratios[0].argmax())
    as_good = int((scores(drawn)[1].max(axis=1) >= ratios[0, k] - 1e-9).sum())
    band = np.concatenate(bins[first[k] : last[k]])
    return Band(
        low=float(shares[band].min()),
        high=float(shares[band].max()),
        inside=(int(hits[0, k]), int(runs[k])),
        outside=(int(y.sum() - hits[0, k]), int(len(y) - runs[k])),
        p=(1 + as_good) / (1 + DRAWS),
    )


def _entropy(share: Floats) -> Floats:
    """Return the mean log likelihood of a share of violations where that share violates."""
    from scipy.special import xlogy

    return np.asarray(xlogy(share, share) + xlogy(1.0 - share, 1.0 - share))


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
    band: Band | None = None
    """Where in the range runs violate most; None where all or none do."""


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
        surface = Surface(
            degree=degree,
            coefficients=tuple(coefficients.tolist()),
            covariance=tuple(tuple(row) for row in covariance.tolist()),
        )
        candidates.append((criterion, surface))
    return min(candidates, key=lambda pair: pair[0])[1]


def sensitivities(
    surface: Surface,
    names: Sequence[str],
    shares: Floats,
    badness: Sequence[float | None],
    violated: Sequence[bool],
    *,
    seed: int,
) -> tuple[Sensitivity, ...]:
    """Return what each parameter does.

    Args:
        shares: the points (N, D) that were run.
        badness: how bad the objective of each run is; None for a run without one.
    """
    from scipy import stats

    valued = [k for k, value in enumerate(badness) if value is not None]
    values = np.array([badness[k] for k in valued], dtype=np.float64)
    correlations: list[tuple[float, float] | None] = []
    for column in shares[valued].T if valued else np.empty((len(names), 0)):
        if len(values) < 4 or not np.ptp(values):
            correlations.append(None)
            continue
        rank = stats.spearmanr(column, values)
        correlations.append((float(rank.statistic), float(rank.pvalue)))
    corrected = holm({name: pair[1] for name, pair in zip(names, correlations, strict=True) if pair})
    bands = [failing_band(column, violated, seed=seed) for column in shares.T]
    band_p = holm({name: band.p for name, band in zip(names, bands, strict=True) if band})
    indices = _total_indices(surface, len(names), seed)
    grid = stats.qmc.LatinHypercube(len(names), rng=np.random.default_rng(seed)).random(512)
    result = []
    for k, (name, pair, band) in enumerate(zip(names, correlations, bands, strict=True)):
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
                band=band and band.replace(p=band_p[name]),
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
    indices = stats.sobol_indices(
        func=lambda x: surface.probability(x.T), n=SOBOL_POINTS, dists=dists, rng=np.random.default_rng(seed)
    )
    return np.clip(np.asarray(indices.total_order, dtype=np.float64).reshape(count), 0.0, 1.0)


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
