"""Several requirements at once: the Pareto front of what a search found, and its hypervolume.

A value is given as a share of what violates: 1 is the limit, more is beyond it. 0 is twice the limit where small values
are bad, and 0 where large ones are. The hypervolume is the volume that the front dominates above 0, so 1 is what one
configuration exactly at all limits has. Neither depends on what else was found, so campaigns can be compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rvsg.campaign.attempt import Attempt, Measurement
from rvsg.campaign.plan import Plan
from rvsg.campaign.ranking import confirmations, in_full
from rvsg.core.records import Record
from rvsg.scenario.requirement import Requirement

Floats = NDArray[np.float64]


class Tried(Record):
    """How a configuration does by one requirement."""

    requirement: str
    mean: float
    share: float
    """The mean as a share of what violates; more than 1 is a violation."""
    violations: int
    runs: int


class FrontPoint(Record):
    """A configuration that no other one beats in every requirement."""

    attempt: int
    scenario_id: str
    tried: tuple[Tried, ...]
    """By requirement, in the order of the plan."""
    confirmed: tuple[Tried, ...] = ()
    """The same in the confirmation runs; empty if it was not confirmed."""


class Front(Record):
    """The configurations that no other beats in every requirement, the worst by the first requirement first."""

    points: tuple[FrontPoint, ...]
    hypervolume: float


def share_of(requirement: Requirement, value: float) -> float:
    """Return a value as a share of what violates, at least 0.

    ValueError for a requirement whose limit gives no scale: none, or 0.
    """
    limit = requirement.threshold
    if not limit:
        raise ValueError(f"{requirement.name} has no limit other than 0, which gives no scale")
    share = (2.0 * limit - value) / limit if requirement.worse == "smaller" else value / limit
    return max(0.0, share)


def value_of(measurement: Measurement, requirement: Requirement, plan: Plan) -> float | None:
    """Return what a run's objective is by one of the plan's requirements; None if it has no value."""
    if requirement == plan.requirement:
        return measurement.objective
    return measurement.values.get(requirement.metric) if requirement.metric is not None else None


def tried_by(measurements: Sequence[Measurement], plan: Plan) -> tuple[Tried, ...] | None:
    """Return how runs do by every requirement of the plan; None if one has no value at all."""
    found = []
    for requirement in (plan.requirement, *plan.also):
        values = [v for m in measurements if (v := value_of(m, requirement, plan)) is not None]
        if not values:
            return None
        mean = math.fsum(values) / len(values)
        found.append(
            Tried(
                requirement=requirement.name,
                mean=mean,
                share=share_of(requirement, mean),
                violations=sum(requirement.violated_by(value) for value in values),
                runs=len(values),
            )
        )
    return tuple(found)


def front_of(plan: Plan, attempts: Sequence[Attempt]) -> Front:
    """Return the front of the configurations that were not given up early."""
    candidates = [(a, tried) for a in in_full(attempts) if (tried := tried_by(a.measurements, plan)) is not None]
    shares = np.array([[each.share for each in tried] for _, tried in candidates])
    chosen = [candidates[k] for k in undominated(shares)]
    chosen.sort(key=lambda pair: (-pair[1][0].share, pair[0].index))
    points = []
    for attempt, tried in chosen:
        assert attempt.proposal.scenario is not None
        name = attempt.proposal.scenario.id
        points.append(
            FrontPoint(attempt=attempt.index, scenario_id=name, tried=tried, confirmed=_confirmed(name, plan, attempts))
        )
    return Front(points=tuple(points), hypervolume=hypervolume([[each.share for each in tried] for _, tried in chosen]))


def undominated(shares: Floats) -> list[int]:
    """Return the rows that no other row equals or exceeds everywhere and exceeds somewhere; the first of equal rows."""
    kept: list[int] = []
    for k, row in enumerate(shares):
        beaten = ((shares >= row).all(axis=1) & (shares > row).any(axis=1)).any()
        if not beaten and not any((shares[other] == row).all() for other in kept):
            kept.append(k)
    return kept


def hypervolume(points: Sequence[Sequence[float]]) -> float:
    """Return the volume that points dominate, from 0 on every axis."""
    left = [tuple(point) for point in points if min(point) > 0.0]
    if not left:
        return 0.0
    if len(left[0]) == 1:
        return max(point[0] for point in left)
    volume, above = 0.0, 0.0
    for height in sorted({point[-1] for point in left}):
        volume += (height - above) * hypervolume([point[:-1] for point in left if point[-1] >= height])
        above = height
    return volume


def _confirmed(scenario_id: str, plan: Plan, attempts: Sequence[Attempt]) -> tuple[Tried, ...]:
    for attempt in confirmations(attempts):
        scenario = attempt.proposal.scenario
        if scenario is not None and scenario.id == scenario_id:
            return tried_by(attempt.measurements, plan) or ()
    return ()
