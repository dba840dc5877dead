"""The judged quantity of a run over time: what the requirement would measure if the run ended at each moment.

The values come from the requirement's own metric or formula, applied to the first part of the run. So the curve of a
mean is its running mean, the curve of a minimum is the minimum so far, the curve of a formula is its robustness so
far, and every curve ends at the objective that the verdict uses. Plug-in metrics need nothing extra.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.judge import objective
from rvsg.evaluation.metrics.registry import find_metric
from rvsg.evaluation.sampled import sampled
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Outcome, Run, Trajectory
from rvsg.world.world import World

Floats = NDArray[np.float64]

POINTS = 80
IMU_RATE_HZ = 100.0
SETTLED_S = 1.5
"""A mean over fewer seconds than this says little, so its swings do not count as decisive."""


@dataclass(frozen=True, eq=False)
class Curve:
    """The judged quantity at increasing times (s); NaN where the first part of the run holds no judgement."""

    t: Floats
    value: Floats

    @property
    def is_known(self) -> bool:
        """Return whether the curve has at least two values."""
        return int(np.isfinite(self.value).sum()) >= 2


def prefix(run: Run, end: int) -> Run:
    """Return the run as if it had ended, at its goal, with sample `end` - 1 of its trajectory."""
    if end >= len(run.trajectory):
        return run
    t_s = float(run.trajectory.t[end - 1])
    trajectory = _first(run.trajectory, end)
    log = (
        trajectory
        if run.log is run.trajectory
        else _first(run.log, int(np.searchsorted(run.log.t * run.clock_ratio, t_s, side="right")))
    )
    imu = run.imu[: round(t_s * IMU_RATE_HZ) + 1]
    return dataclasses.replace(run, trajectory=trajectory, log=log, imu=imu, outcome=Outcome.REACHED)


def judged_curve(run: Run, requirement: Requirement, world: World | None, *, points: int = POINTS) -> Curve:
    """Return the judged quantity at about `points` moments of the run, the last being its end."""
    samples = len(run.trajectory)
    if samples < 2:
        return Curve(np.empty(0), np.empty(0))
    ends = np.unique(np.linspace(2, samples, min(points, samples - 1)).round().astype(int))
    metric = find_metric(requirement.metric)
    if metric is not None and metric.so_far is not None and metric.series == "trajectory":
        values = metric.so_far(sampled(run, world))[ends - 1]
        ends_at = objective(run, requirement, world=world)
        values[-1] = np.nan if ends_at is None else ends_at
    else:
        found = [objective(prefix(run, int(end)), requirement, world=world) for end in ends]
        values = np.array([np.nan if value is None else value for value in found])
    return Curve(run.trajectory.t[ends - 1], values)


Why = Literal["limit", "worst", "time", "share", "closest"]


class Decisive(NamedTuple):
    """The moment that decides a requirement in a run."""

    time_s: float
    why: Why
    """`limit`: the limit is passed. `worst`: the final value is reached. `time`: the robot loses most time. `share`:
    the run adds most to a mean. `closest`: the closest approach, where the curve tells nothing."""


def decisive(run: Run, requirement: Requirement, curve: Curve) -> Decisive:
    """Return the moment that decides the requirement in this run.

    A quantity that only gets worse (a minimum, a count) is decided where it passes its limit, else where it got its
    final value. A quantity that rises with the clock is decided where the robot loses most time. A mean is decided
    where the run adds most to it. Without a curve it is the closest approach.
    """
    known = np.isfinite(curve.value)
    t, worse = curve.t[known], np.array([requirement.badness(float(v)) for v in curve.value[known]])
    closest = Decisive(closest_approach(run), "closest")
    if len(t) < 3 or np.ptp(worse) == 0.0:
        return closest
    limit = requirement.badness(requirement.threshold) if requirement.threshold is not None else None
    if np.allclose(worse[:-1] - worse[0], t[:-1] - t[0], atol=0.15):
        lost = _longest_standstill(run)
        return Decisive(lost, "time") if lost is not None else closest
    if (np.diff(worse) >= -1e-9).all():
        if limit is not None and worse[-1] > limit:
            return Decisive(float(t[int(np.argmax(worse > limit))]), "limit")
        return Decisive(float(t[int(np.argmax(worse >= worse[-1] - 1e-9))]), "worst")
    contribution = np.diff(t * worse) / np.diff(t)  # of a running mean: the mean over each step
    contribution[t[1:] < SETTLED_S] = -np.inf
    if not np.isfinite(contribution).any():
        return closest
    return Decisive(float(t[1:][int(contribution.argmax())]), "share")


def closest_approach(run: Run) -> float:
    """Return the time (s) at which robot and people are nearest; 0 without people."""
    if not len(run.trajectory) or not run.trajectory.human_x.shape[1]:
        return 0.0
    return float(run.trajectory.t[int(sampled(run).closest_gap.argmin())])


def _longest_standstill(run: Run) -> float | None:
    """Return when the robot, once under way, makes least way in the next 3 s; None where it is never under way."""
    path = run.trajectory
    travelled = np.concatenate([[0.0], np.hypot(np.diff(path.x), np.diff(path.y)).cumsum()])
    later = np.searchsorted(path.t, path.t + 3.0)
    usable = np.flatnonzero((later < len(path)) & (travelled > 0.1))
    if not len(usable):
        return None
    return float(path.t[usable[int((travelled[later[usable]] - travelled[usable]).argmin())]])


def _first(series: Trajectory, count: int) -> Trajectory:
    return series.at(slice(max(1, count)))
