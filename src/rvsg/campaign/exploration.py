"""What a scenario with ranges does: the points that were run, and the surface fitted to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Record
from rvsg.evaluation.response import Sensitivity, Surface
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.variation import Range

FEWEST = 10
"""The least number of runs a surface is fitted to."""


class Point(Record):
    """One point of the ranges, and the run made there."""

    values: tuple[float, ...]
    """In the order of the ranges."""
    seed: int
    problems: tuple[str, ...] = ()
    """Why the scenario at this point is not valid; then it is not run."""
    objective: float | None = None
    violated: bool | None = None
    outcome: str = ""


class Exploration(Record):
    """How the violation probability depends on the ranges of a scenario."""

    scenario: Scenario
    """With every range at its middle."""
    ranges: tuple[Range, ...]
    requirement: Requirement
    simulator: str
    seed: int
    points: tuple[Point, ...]
    violations: int
    runs: int
    """Runs with a value of the objective."""
    interval: tuple[float, float]
    """95 % interval of the violation probability over all of the ranges (Clopper-Pearson)."""
    surface: Surface | None = None
    """None with fewer than `FEWEST` runs."""
    sensitivities: tuple[Sensitivity, ...] = ()

    @property
    def judged(self) -> tuple[Point, ...]:
        """The points whose run has a value."""
        return tuple(point for point in self.points if point.violated is not None)


def shares_of(ranges: Sequence[Range], points: Sequence[Point]) -> NDArray[np.float64]:
    """Return points (N, D) as shares of their ranges, 0 to 1."""
    low = np.array([each.low for each in ranges])
    size = np.array([each.high - each.low for each in ranges])
    shares: NDArray[np.float64] = (np.array([point.values for point in points]) - low) / size
    return shares
