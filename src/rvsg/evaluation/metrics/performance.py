"""The study's objectives and performance metrics, by their correct formulas over our own samples.

Source of the definitions: the RVSG study. None if a run holds no judgement.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.metrics.metric import Metric, measures
from rvsg.evaluation.sampled import Sampled
from rvsg.scenario.requirement import Aim
from rvsg.simulation.run import Outcome

Floats = NDArray[np.float64]

STUDY = "RVSG study"
METRICS: list[Metric] = []
_metric = partial(measures, METRICS, source=STUDY)
_of_people = partial(_metric, of_people=True)


def running_mean(values: Floats) -> Floats:
    """Return the mean of the values up to each of them; NaN counts nowhere."""
    finite = np.isfinite(values)
    count, total = np.cumsum(finite), np.cumsum(np.where(finite, values, 0.0))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


@_of_people(
    "dto",
    "Mean distance to the nearest person",
    "m",
    "smaller",
    Aim.SHARE,
    shown="centre_distance",
    so_far=lambda s: running_mean(s.nearest_distance) if s.people else np.full(len(s), np.nan),
)
def distance_to_obstacles(s: Sampled) -> float | None:
    """dto = (1/T) sum_t min_i |p_robot(t) - p_i(t)|, centre to centre, over the humans i: people alone, no walls.

    Samples in which nobody is there are left out; None where that is all of them.
    """
    nearest = s.nearest_distance[s.present.any(axis=1)]
    return float(nearest.mean()) if len(nearest) else None


def _jerk_so_far(s: Sampled) -> Floats:
    values = np.full(len(s), np.nan)
    if len(s) > 2:
        along, across = s.acceleration
        values[2:] = running_mean(np.hypot(np.diff(along), np.diff(across)) / s.dt[1:])
    return values


@_metric("jerk", "Mean jerk", "m/s³", "larger", Aim.DISTURB, shown="jerk", so_far=_jerk_so_far)
def jerk(s: Sampled) -> float | None:
    """(1/(T-1)) sum_t |a(t+1) - a(t)| / dt, with a the mean acceleration vector of each interval (from v and yaw).

    The vector is (dv/dt, v omega) in the frame of the robot, so no accidental inertial sample decides the value.
    """
    if len(s) < 3:
        return None
    along, across = s.acceleration
    return float((np.hypot(np.diff(along), np.diff(across)) / s.dt[1:]).mean())


@_metric(
    "trg",
    "Time to reach the goal",
    "s",
    "larger",
    Aim.DELAY,
    shown="distance_to_goal",
    so_far=lambda s: np.asarray(s.series.t - s.series.t[0], dtype=np.float64),
    most="time_limit",
    censored=True,
)
def time_to_goal(s: Sampled) -> float | None:
    """t_goal - t_start. A run that did not reach the goal counts with at least its time limit: it took longer."""
    if not len(s):
        return None
    if s.run.outcome is Outcome.REACHED:
        return s.duration_s
    return max(s.duration_s, s.run.time_limit_s)


@_of_people("rpc", "Robot-on-Person Collision", "samples", "larger", Aim.MEET)
def robot_on_person(s: Sampled) -> float | None:
    """Samples (per human) with gap < 0.02 m, the robot moving, and |bearing of robot| < |bearing of person|."""
    robots_doing = s.bearing_of_robot < s.bearing_of_human
    return float((s.near_contact & ~s.still[:, None] & robots_doing).sum())


@_of_people("por", "Person-on-Robot Collision", "samples", "larger", Aim.MEET)
def person_on_robot(s: Sampled) -> float | None:
    """Samples (per human) with gap < 0.02 m and |bearing of robot| > |bearing of person|."""
    return float((s.near_contact & (s.bearing_of_robot > s.bearing_of_human)).sum())


@_metric("chc", "Cumulative Heading Changes", "rad", "larger", Aim.DISTURB, shown="turn_rate")
def heading_changes(s: Sampled) -> float | None:
    """Sum of |wrap(yaw(t+1) - yaw(t))|."""
    return float(np.abs(s.turns).sum()) if len(s) else None


@_metric("pl", "Path Length", "m", "larger", Aim.DELAY, shown="distance_to_goal")
def path_length(s: Sampled) -> float | None:
    """Sum of |p(t+1) - p(t)|."""
    return float(s.steps.sum()) if len(s) else None


def _still_so_far(s: Sampled) -> Floats:
    return np.concatenate([[0.0], np.cumsum(s.dt * s.still[1:])])


@_metric("tnm", "Time Not Moving", "s", "larger", Aim.DELAY, shown="speed", so_far=_still_so_far, most="time_limit")
def time_not_moving(s: Sampled) -> float | None:
    """Seconds of intervals at whose end |v| < 0.01 m/s and |omega| < 0.02 rad/s."""
    return float(s.dt[s.still[1:]].sum()) if len(s) else None


@_metric(
    "completed",
    "Goal reached in time",
    "1 or 0",
    "smaller",
    Aim.DELAY,
    shown="distance_to_goal",
    most=1.0,
    two_valued=True,
)
def completed(s: Sampled) -> float | None:
    """1 where the goal was reached in time, else 0."""
    return 1.0 if s.run.completed else 0.0


def _least_gap_so_far(s: Sampled) -> Floats:
    return np.minimum.accumulate(s.closest_gap) if s.people else np.full(len(s), np.nan)


@_of_people(
    "min_distance", "Minimum distance to people", "m", "smaller", Aim.MEET, so_far=_least_gap_so_far, least=None
)
def minimum_distance(s: Sampled) -> float | None:
    """Smallest gap to a person over the run, surface to surface; negative where the discs overlap."""
    return float(s.closest_gap.min())


@_metric("goal_distance_min", "Minimum distance to the goal", "m", "larger", Aim.DELAY, shown="distance_to_goal")
def goal_distance_minimum(s: Sampled) -> float | None:
    """Smallest distance of the robot's centre from the goal."""
    return float(s.goal_distance.min()) if len(s) else None


@_metric("goal_distance", "Final distance to the goal", "m", "larger", Aim.DELAY, shown="distance_to_goal")
def goal_distance_final(s: Sampled) -> float | None:
    """Distance of the robot's centre from the goal at the end."""
    return float(s.goal_distance[-1]) if len(s) else None


@_metric("speed", "Mean speed", "m/s", "neither", Aim.DELAY, shown="speed")
def mean_speed(s: Sampled) -> float | None:
    """Mean over samples of |v|."""
    return float(s.series.speed.mean()) if len(s) else None


@_metric("turn_rate", "Mean turn rate", "rad/s", "neither", Aim.DISTURB, shown="turn_rate")
def mean_turn_rate(s: Sampled) -> float | None:
    """Mean over samples of |omega|."""
    return float(np.abs(s.series.omega).mean()) if len(s) else None


@_metric("acceleration", "Mean inertial acceleration", "m/s²", "larger", Aim.DISTURB, shown="acceleration")
def mean_inertial_acceleration(s: Sampled) -> float | None:
    """Mean over samples of the inertial sensor's horizontal magnitude."""
    return float(s.series.acceleration.mean()) if len(s) else None


@_of_people("human_speed", "Mean speed of the humans", "m/s", "neither", Aim.SHARE, shown="person_speed")
def mean_human_speed(s: Sampled) -> float | None:
    """Mean over samples and humans of their speed, while they are there."""
    if s.present.all():
        return float(s.series.human_speed.mean())
    return float(s.series.human_speed[s.present].mean()) if s.present.any() else None


@_of_people("closest_human_speed", "Mean speed of the closest human", "m/s", "neither", Aim.SHARE, shown="person_speed")
def mean_closest_human_speed(s: Sampled) -> float | None:
    """Mean over samples of the speed of the human whose centre is closest, while anybody is there."""
    anybody = s.present.any(axis=1)
    return float(s.series.human_speed[np.arange(len(s)), s.closest][anybody].mean()) if anybody.any() else None
