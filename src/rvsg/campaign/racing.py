"""Which configurations deserve another run: estimates from few noisy runs, shared between related configurations.

A configuration that was changed from another is expected to do about as well as that one, and all configurations meet
the same seeds. One linear model holds both, and its variances (of noise, seeds, drafts and changes) are estimated from
the runs of the campaign by expectation maximisation. So one lucky run of a noisy objective does not make a favourite,
and one run of a quiet objective does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.racing_kernel import fit
from rvsg.scenario.scenario import Scenario

ITERATIONS = 8
"""Steps of the estimation of the variances."""
PRIOR_RUNS = 1.0
"""Weight of the variances assumed at the start, in runs."""
SHARES, SMALLEST = np.array([0.1, 0.5, 0.25, 0.1, 4.0]), 1e-6
"""The variances assumed at the start of noise, drafts, changes, seeds and of level and shift, and the smallest of each
later, as shares of the variance of all runs."""
BOUND = 1.645
"""Half-width of the interval of an estimate in standard deviations: 95 % on either side."""


@dataclass(eq=False)
class Candidate:
    """One configuration in the race: what it was changed from, and the badness of its runs by seed."""

    attempt: Attempt
    """Its first attempt."""
    parent: Candidate | None = None
    operator: str = "new"
    badness: dict[int, float] = field(default_factory=dict)
    estimate: float = -math.inf
    deviation: float = math.inf
    last: Attempt = field(init=False)
    """Its last attempt: the one with the most runs."""

    def __post_init__(self) -> None:
        self.last = self.attempt

    @property
    def index(self) -> int:
        """The index of its first attempt."""
        return self.attempt.index

    @property
    def scenario_index(self) -> int:
        """The number of its scenario."""
        return self.attempt.scenario_index

    @property
    def scenario(self) -> Scenario:
        """The scenario that is run."""
        scenario = self.attempt.proposal.scenario
        assert scenario is not None
        return scenario

    @property
    def runs(self) -> int:
        """Return how many runs have an objective."""
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
