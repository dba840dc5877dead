"""Which configurations deserve another run: estimates from few noisy runs, shared between related configurations.

A configuration that was changed from another is expected to do about as well as that one. Its few runs are weighed
against this expectation (empirical Bayes): with noise variance s2 of a run and variance t2 of the effect of a change,
n runs weigh n t2 / (n t2 + s2). Both variances are estimated from the runs of the campaign. So one lucky run of a
noisy objective does not make a favourite, and one run of a quiet objective does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief

BOUND = 1.645
"""Half-width of the interval of an estimate in standard deviations: 95 % on either side."""


@dataclass(eq=False)
class Candidate:
    """One configuration in the race: what it was changed from, and the badness of its runs by seed."""

    brief: Brief
    proposal: Proposal
    index: int
    parent: Candidate | None = None
    operator: str = "new"
    badness: dict[int, float] = field(default_factory=dict)
    estimate: float = -math.inf
    deviation: float = math.inf

    @property
    def runs(self) -> int:
        """How many runs have an objective."""
        return len(self.badness)

    @property
    def mean(self) -> float:
        """The mean badness of the runs."""
        return math.fsum(self.badness.values()) / len(self.badness)

    @property
    def upper(self) -> float:
        """The upper bound of the estimate."""
        return self.estimate + BOUND * self.deviation

    @property
    def lower(self) -> float:
        """The lower bound of the estimate."""
        return self.estimate - BOUND * self.deviation


def estimate(candidates: Sequence[Candidate]) -> None:
    """Write the estimate and its standard deviation into every candidate; parents come before their children."""
    known = [c for c in candidates if c.runs]
    if not known:
        return
    noise = _noise(known)
    new = [c.mean for c in known if c.parent is None]
    level = math.fsum(new) / len(new) if new else math.fsum(c.mean for c in known) / len(known)
    between = _variance([(c.mean, c.runs) for c in known if c.parent is None], noise)
    steps = [(c.mean - c.parent.estimate, c.runs) for c in known if c.parent is not None and c.parent.runs]
    shift = math.fsum(step for step, _ in steps) / len(steps) if steps else 0.0
    within = _variance(steps, noise) if len(steps) > 2 else between
    for candidate in known:
        changed = candidate.parent is not None and candidate.parent.runs > 0
        assert candidate.parent is not None or not changed
        prior = candidate.parent.estimate + shift if changed and candidate.parent else level
        spread = within if changed else between
        weight = candidate.runs * spread / (candidate.runs * spread + noise)
        candidate.estimate = weight * candidate.mean + (1.0 - weight) * prior
        candidate.deviation = math.sqrt(spread * (1.0 - weight))


def in_the_race(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates that may still be the best: their upper bound reaches the highest lower bound."""
    known = [c for c in candidates if c.runs]
    best = max((c.lower for c in known), default=-math.inf)
    return [c for c in known if c.upper >= best]


def _noise(known: Sequence[Candidate]) -> float:
    """The variance of single runs around the mean of their configuration, pooled."""
    total, freedom = 0.0, 0
    for candidate in known:
        if candidate.runs > 1:
            mean = candidate.mean
            total += math.fsum((value - mean) ** 2 for value in candidate.badness.values())
            freedom += candidate.runs - 1
    if freedom:
        return max(total / freedom, 1e-12)
    values = [c.mean for c in known]
    mean = math.fsum(values) / len(values)
    return max(0.5 * math.fsum((v - mean) ** 2 for v in values) / max(1, len(values) - 1), 1e-12)


def _variance(means: Sequence[tuple[float, int]], noise: float) -> float:
    """The variance of true values behind noisy means of so many runs (method of moments, at least a tenth of noise)."""
    if len(means) < 2:
        return noise
    centre = math.fsum(value for value, _ in means) / len(means)
    total = math.fsum((value - centre) ** 2 for value, _ in means) / (len(means) - 1)
    share = math.fsum(noise / runs for _, runs in means) / len(means)
    return max(total - share, 0.1 * noise)
