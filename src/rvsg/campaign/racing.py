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
from numpy.typing import NDArray

from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Scenario

Floats = NDArray[np.float64]

ITERATIONS = 8
"""Steps of the estimation of the variances."""
PRIOR_RUNS = 1.0
"""Weight of the variances assumed at the start, in runs."""
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
    def scenario(self) -> Scenario:
        """The scenario that is run."""
        assert self.proposal.scenario is not None
        return self.proposal.scenario

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
    tree = _Tree(known)
    for _ in range(ITERATIONS):
        tree.solve()
        tree.update_variances()
    tree.solve()
    variances = tree.relative_variances(len(known))
    for k, candidate in enumerate(known):
        candidate.estimate = tree.rounded(tree.values[k]) + tree.centre
        candidate.deviation = tree.rounded(math.sqrt(max(float(variances[k]), 0.0)))


class _Tree:
    """The linear model of all runs: a run's badness is the value of its configuration plus the effect of its seed
    plus noise. The value of a draft is drawn around a level, that of a changed configuration around the value of the
    one it was changed from plus a shift that all changes share.

    Attributes:
        values: The posterior means of the unknowns: values of configurations, effects of seeds, level and shift.
        covariance: Their covariance.
    """

    def __init__(self, known: Sequence[Candidate]) -> None:
        place = {id(candidate): k for k, candidate in enumerate(known)}
        seeds = list(dict.fromkeys(seed for candidate in known for seed in candidate.badness))
        count, level = len(known), len(known) + len(seeds)
        at_seed = {seed: count + k for k, seed in enumerate(seeds)}
        self.runs = [(k, at_seed[seed]) for k, c in enumerate(known) for seed in c.badness]
        self.badness = np.array([value for c in known for value in c.badness.values()])
        self.centre = float(self.badness.mean())
        self.total = max(float(self.badness.var()), 1e-12)
        parents = [place.get(id(c.parent)) for c in known]
        self.drafts = [(k, level) for k, parent in enumerate(parents) if parent is None]
        self.changes = [(k, parent, level + 1) for k, parent in enumerate(parents) if parent is not None]
        self.rows = {
            "noise": self._rows(level + 2, [{k: 1.0, s: 1.0} for k, s in self.runs]),
            "draft": self._rows(level + 2, [{k: 1.0, at: -1.0} for k, at in self.drafts]),
            "change": self._rows(level + 2, [{k: 1.0, p: -1.0, at: -1.0} for k, p, at in self.changes]),
            "seed": self._rows(level + 2, [{count + k: 1.0} for k in range(len(seeds))]),
            "weak": self._rows(level + 2, [{level: 1.0}, {level + 1: 1.0}]),
        }
        self.products = {name: rows.T @ rows for name, rows in self.rows.items()}
        self.pulls = self.rows["noise"].T @ (self.badness - self.centre)
        shares = {"noise": 0.1, "draft": 0.5, "change": 0.25, "seed": 0.1, "weak": 4.0}
        self.variances = {name: share * self.total for name, share in shares.items()}
        self.start = dict(self.variances)

    @staticmethod
    def _rows(unknowns: int, entries: Sequence[dict[int, float]]) -> Floats:
        rows = np.zeros((len(entries), unknowns))
        for k, entry in enumerate(entries):
            for at, factor in entry.items():
                rows[k, at] = factor
        return rows

    def solve(self) -> None:
        """Compute means and covariance of the unknowns for the present variances."""
        information = np.zeros((self.rows["noise"].shape[1],) * 2)
        for name, product in self.products.items():
            information += product / self.variances[name]
        self.covariance = np.linalg.inv(information)
        self.values = self.covariance @ self.pulls / self.variances["noise"]

    def rounded(self, value: float) -> float:
        """Round to a millionth of the spread: the last digits differ by the number of BLAS threads."""
        step = 1e-6 * math.sqrt(self.total)
        return round(float(value) / step) * step

    def relative_variances(self, count: int) -> Floats:
        """Return the variances of the first values, less their mean: what all have in common decides nothing."""
        part = self.covariance[:count, :count]
        return np.asarray(np.diag(part) - 2.0 * part.mean(axis=1) + part.mean())

    def update_variances(self) -> None:
        """One step of expectation maximisation, with one run's worth of what was assumed at the start."""
        for name, rows in self.rows.items():
            if name == "weak" or not len(rows):
                continue
            target = self.badness - self.centre if name == "noise" else 0.0
            squares = ((target - rows @ self.values) ** 2).sum() + (self.covariance * self.products[name]).sum()
            found = (squares + PRIOR_RUNS * self.start[name]) / (len(rows) + PRIOR_RUNS)
            self.variances[name] = max(float(found), 1e-6 * self.total)


def in_the_race(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates that may still be the best: their upper bound reaches the highest lower bound."""
    known = [c for c in candidates if c.runs]
    best = max((c.lower for c in known), default=-math.inf)
    return [c for c in known if c.upper >= best]
