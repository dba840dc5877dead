"""The aim of a requirement (what people should do to the robot), and the series that shows when it is violated.

The requirement's metric declares both; for a formula, the signals that it names.
"""

from __future__ import annotations

import numpy as np

from rvsg.evaluation.metrics.registry import find_metric
from rvsg.evaluation.sampled import Floats, sampled
from rvsg.evaluation.signals import SIGNALS, NotKnown, formula, known_signals
from rvsg.evaluation.temporal import body_of, signals_of
from rvsg.scenario.requirement import Aim, Requirement
from rvsg.simulation.run import Run
from rvsg.world.world import World

_STRONGEST = (Aim.MEET, Aim.DISTURB, Aim.DELAY, Aim.SHARE)
"""A formula has the first of these aims that one of its signals has: people come before time."""
NEARNESS = "distance_to_person"


def aim_of(requirement: Requirement | None) -> Aim | None:
    """Return the aim for a requirement; None without one, or if its metric is not installed."""
    if requirement is None:
        return None
    if requirement.formula is None:
        known = find_metric(requirement.metric)
        return known.aim if known is not None else None
    aims = {SIGNALS[name].aim for name in signals_of(formula(requirement.formula))}
    return next((aim for aim in _STRONGEST if aim in aims), Aim.DELAY)


def moved_by(requirement: Requirement) -> str:
    """Return one plain sentence on what makes a requirement worse; empty if nothing declares it."""
    known = find_metric(requirement.metric)
    return known.moved_by if known is not None else ""


def series_name(requirement: Requirement) -> str:
    """Return the name of the series of `series_of`, with its unit."""
    if requirement.formula is not None:
        return "room left by the formula (violated below 0)"
    known = find_metric(requirement.metric)
    return SIGNALS[known.shown if known is not None else NEARNESS].words


def series_of(run: Run, requirement: Requirement, *, world: World | None = None) -> Floats:
    """Return (N,) the series that shows when a requirement is violated, at every sample of the trajectory.

    For a metric, it is the signal that the metric declares; for a formula, the robustness of the part that must always
    hold. NaN where there is no value.
    """
    s = sampled(run, world)
    if not len(s):
        return np.empty(0)
    try:
        if requirement.formula is not None:
            return _finite(body_of(formula(requirement.formula)).values(run.trajectory.t, known_signals(s)))
        known = find_metric(requirement.metric)
        return SIGNALS[known.shown if known is not None else NEARNESS].values(s)
    except NotKnown:
        return np.full(len(s), np.nan)


def _finite(values: Floats) -> Floats:
    return np.where(np.isfinite(values), values, np.nan)
