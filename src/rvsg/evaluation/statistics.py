"""Statistics of repeated runs: intervals, tests and effect sizes; effect and p value always stand together.

`scipy.stats` takes most of a second to load, so the functions that need it load it: most commands do not.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence

import numpy as np

from rvsg.core.records import Record

Values = Sequence[float]
RESAMPLES = 4000
SMALLEST_BOOTSTRAP = 5
FARTHEST = 2.0
"""How far either end may lie from the mean, in half widths of Student's t interval."""


def clopper_pearson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """The exact two-sided interval of a probability from `successes` of `trials` (Clopper and Pearson 1934).

    It covers the truth with at least `confidence` for every probability and number of trials fixed beforehand.
    """
    if trials < 1:
        return (0.0, 1.0)
    from scipy import stats

    tail = (1.0 - confidence) / 2.0
    low = 0.0 if successes == 0 else float(stats.beta.ppf(tail, successes, trials - successes + 1))
    high = 1.0 if successes == trials else float(stats.beta.ppf(1.0 - tail, successes + 1, trials - successes))
    return (low, high)


def seed_of(values: Values) -> int:
    """A seed that depends on the values only, so that equal data give equal intervals."""
    data = np.ascontiguousarray(values, dtype=np.float64).tobytes()
    return int.from_bytes(hashlib.sha256(data).digest()[:8], "big")


def mean_interval(
    values: Values, confidence: float = 0.95, *, least: float | None = None
) -> tuple[float, float] | None:
    """An interval of the mean: bootstrap-t (Efron and Tibshirani 1993, ch. 12.5), seeded by the values themselves.

    Studentised, because the percentile bootstrap is too narrow for the five to thirty runs that scenarios get. Where
    a few values repeat themselves the studentised one explodes, so neither end lies farther from the mean than twice
    the reach of Student's t: on distances, times and jerks of repeated scenarios that costs no coverage (five runs:
    88 to 92 %, fifteen: 90 to 94 %) and takes half and more off the widest intervals. Under 5 values resampling says
    too little and Student's t interval stands in; under 2 there is none.
    `least`: the quantity is never smaller. What lies below is cut off, which takes nothing from the coverage.
    """
    found = _mean_interval(values, confidence)
    if found is None or least is None:
        return found
    return max(least, found[0]), max(least, found[1])


def _mean_interval(values: Values, confidence: float) -> tuple[float, float] | None:
    data = np.asarray(values, dtype=np.float64)
    n = len(data)
    if n < 2:
        return None
    mean = float(data.mean())
    error = float(data.std(ddof=1)) / np.sqrt(n)
    if error == 0.0:
        return (mean, mean)
    tail = (1.0 - confidence) / 2.0
    from scipy import stats

    reach = float(stats.t.ppf(1.0 - tail, n - 1)) * error
    if n < SMALLEST_BOOTSTRAP:
        return (mean - reach, mean + reach)
    rng = np.random.default_rng(seed_of(values))
    drawn = data[rng.integers(0, n, size=(RESAMPLES, n))]
    errors = drawn.std(axis=1, ddof=1) / np.sqrt(n)
    good = errors > 1e-12 * abs(error)
    t = (drawn.mean(axis=1)[good] - mean) / errors[good]
    low_t, high_t = np.quantile(t, [tail, 1.0 - tail])
    below, above = float(high_t) * error, -float(low_t) * error
    return (mean - min(below, FARTHEST * reach), mean + min(above, FARTHEST * reach))


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
    """A12 = P(first > second) + P(equal) / 2, from the ranks."""
    from scipy import stats

    n1, n2 = len(first), len(second)
    ranks = stats.rankdata(np.concatenate([np.asarray(first, float), np.asarray(second, float)]))
    return float((ranks[:n1].sum() - n1 * (n1 + 1) / 2) / (n1 * n2))


def compare(first: Values, second: Values) -> Comparison | None:
    """Mann-Whitney U with A12 and Cliff's delta; None where a sample is empty.

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
    """Holm's step-down correction over one family of tests (Holm 1979): adjusted p values by the same keys."""
    ordered = sorted(p_values, key=lambda key: p_values[key])
    corrected: dict[str, float] = {}
    running = 0.0
    for rank, key in enumerate(ordered):
        running = max(running, min(1.0, (len(ordered) - rank) * p_values[key]))
        corrected[key] = running
    return {key: corrected[key] for key in p_values}
