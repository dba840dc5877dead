"""The study's objectives and performance metrics, by their correct formulas over our own samples.

Source of the definitions: the RVSG study. None if a run holds no judgement.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.metrics.metric import Metric
from rvsg.evaluation.sampled import Sampled
from rvsg.scenario.requirement import Aim
from rvsg.simulation.run import Outcome

Floats = NDArray[np.float64]

STUDY = "RVSG study"


def distance_to_obstacles(s: Sampled) -> float | None:
    """dto = (1/T) sum_t min_i |p_robot(t) - p_i(t)|, centre to centre, over the humans i: people alone, no walls."""
    return float(s.distance.min(axis=1).mean()) if s.people else None


def jerk(s: Sampled) -> float | None:
    """(1/(T-1)) sum_t |a(t+1) - a(t)| / dt, with a the mean acceleration vector of each interval (from v and yaw).

    The vector is (dv/dt, v omega) in the frame of the robot, so no accidental inertial sample decides the value.
    """
    if len(s) < 3:
        return None
    along, across = s.acceleration
    return float((np.hypot(np.diff(along), np.diff(across)) / s.dt[1:]).mean())


def time_to_goal(s: Sampled) -> float | None:
    """t_goal - t_start. A run that did not reach the goal counts with at least its time limit: it took longer."""
    if not len(s):
        return None
    if s.run.outcome is Outcome.REACHED:
        return s.duration_s
    return max(s.duration_s, s.run.time_limit_s)


def robot_on_person(s: Sampled) -> float | None:
    """Samples (per human) with gap < 0.02 m, the robot moving, and |bearing of robot| < |bearing of person|."""
    if not s.people:
        return None
    robots_doing = s.bearing_of_robot < s.bearing_of_human
    return float((s.near_contact & ~s.still[:, None] & robots_doing).sum())


def person_on_robot(s: Sampled) -> float | None:
    """Samples (per human) with gap < 0.02 m and |bearing of robot| > |bearing of person|."""
    if not s.people:
        return None
    return float((s.near_contact & (s.bearing_of_robot > s.bearing_of_human)).sum())


def heading_changes(s: Sampled) -> float | None:
    """Sum of |wrap(yaw(t+1) - yaw(t))|."""
    return float(np.abs(s.turns).sum()) if len(s) else None


def path_length(s: Sampled) -> float | None:
    """Sum of |p(t+1) - p(t)|."""
    return float(s.steps.sum()) if len(s) else None


def time_not_moving(s: Sampled) -> float | None:
    """Seconds of intervals at whose end |v| < 0.01 m/s and |omega| < 0.02 rad/s."""
    return float(s.dt[s.still[1:]].sum()) if len(s) else None


def completed(s: Sampled) -> float | None:
    """1 where the goal was reached in time, else 0."""
    return 1.0 if s.run.completed else 0.0


def minimum_distance(s: Sampled) -> float | None:
    """Smallest gap to a person over the run, surface to surface; negative where the discs overlap."""
    return float(s.closest_gap.min()) if s.people else None


def goal_distance_minimum(s: Sampled) -> float | None:
    """Smallest distance of the robot's centre from the goal."""
    return float(s.goal_distance.min()) if len(s) else None


def goal_distance_final(s: Sampled) -> float | None:
    """Distance of the robot's centre from the goal at the end."""
    return float(s.goal_distance[-1]) if len(s) else None


def mean_speed(s: Sampled) -> float | None:
    """Mean over samples of |v|."""
    return float(s.series.speed.mean()) if len(s) else None


def mean_turn_rate(s: Sampled) -> float | None:
    """Mean over samples of |omega|."""
    return float(np.abs(s.series.omega).mean()) if len(s) else None


def mean_inertial_acceleration(s: Sampled) -> float | None:
    """Mean over samples of the inertial sensor's horizontal magnitude."""
    return float(s.series.acceleration.mean()) if len(s) else None


def mean_human_speed(s: Sampled) -> float | None:
    """Mean over samples and humans of their speed."""
    return float(s.series.human_speed.mean()) if s.people else None


def mean_closest_human_speed(s: Sampled) -> float | None:
    """Mean over samples of the speed of the human whose centre is closest."""
    if not s.people:
        return None
    return float(s.series.human_speed[np.arange(len(s)), s.closest].mean())


def _mean_distance_so_far(s: Sampled) -> Floats:
    if not s.people:
        return np.full(len(s), np.nan)
    return running_mean(s.distance.min(axis=1))


def _jerk_so_far(s: Sampled) -> Floats:
    values = np.full(len(s), np.nan)
    if len(s) > 2:
        along, across = s.acceleration
        values[2:] = running_mean(np.hypot(np.diff(along), np.diff(across)) / s.dt[1:])
    return values


def _time_so_far(s: Sampled) -> Floats:
    return np.asarray(s.series.t - s.series.t[0], dtype=np.float64)


def _least_gap_so_far(s: Sampled) -> Floats:
    return np.minimum.accumulate(s.closest_gap) if s.people else np.full(len(s), np.nan)


def _still_so_far(s: Sampled) -> Floats:
    return np.concatenate([[0.0], np.cumsum(s.dt * s.still[1:])])


def running_mean(values: Floats) -> Floats:
    """Return the mean of the values up to each of them."""
    return np.asarray(np.cumsum(values) / np.arange(1, len(values) + 1), dtype=np.float64)


_close = partial(Metric, source=STUDY, aim=Aim.SHARE, moved_by="People who work close to the robot all along its way.")
_meeting = partial(
    Metric, source=STUDY, aim=Aim.MEET, moved_by="People who meet the robot where it has no room to pass."
)
_smooth = partial(
    Metric, source=STUDY, aim=Aim.DISTURB, moved_by="People who come up in front of the robot repeatedly."
)
_progress = partial(Metric, source=STUDY, aim=Aim.DELAY, moved_by="People who walk or stand in the robot's lane.")

METRICS = (
    _close(
        id="dto",
        title="Mean distance to the nearest person",
        unit="m",
        worse="smaller",
        of=distance_to_obstacles,
        so_far=_mean_distance_so_far,
        shown="centre_distance",
    ),
    _smooth(id="jerk", title="Mean jerk", unit="m/s³", worse="larger", of=jerk, so_far=_jerk_so_far, shown="jerk"),
    _progress(
        id="trg",
        title="Time to reach the goal",
        unit="s",
        worse="larger",
        of=time_to_goal,
        so_far=_time_so_far,
        shown="distance_to_goal",
        most="time_limit",
        censored=True,
    ),
    _meeting(id="rpc", title="Robot-on-Person Collision", unit="samples", worse="larger", of=robot_on_person),
    _meeting(id="por", title="Person-on-Robot Collision", unit="samples", worse="larger", of=person_on_robot),
    _smooth(
        id="chc", title="Cumulative Heading Changes", unit="rad", worse="larger", of=heading_changes, shown="turn_rate"
    ),
    _progress(id="pl", title="Path Length", unit="m", worse="larger", of=path_length, shown="distance_to_goal"),
    _progress(
        id="tnm",
        title="Time Not Moving",
        unit="s",
        worse="larger",
        of=time_not_moving,
        so_far=_still_so_far,
        shown="speed",
        most="time_limit",
    ),
    _progress(
        id="completed",
        title="Goal reached in time",
        unit="1 or 0",
        worse="smaller",
        of=completed,
        shown="distance_to_goal",
        most=1.0,
        two_valued=True,
    ),
    _meeting(
        id="min_distance",
        title="Minimum distance to people",
        unit="m",
        worse="smaller",
        of=minimum_distance,
        so_far=_least_gap_so_far,
        least=None,
    ),
    _progress(
        id="goal_distance_min",
        title="Minimum distance to the goal",
        unit="m",
        worse="larger",
        of=goal_distance_minimum,
        shown="distance_to_goal",
    ),
    _progress(
        id="goal_distance",
        title="Final distance to the goal",
        unit="m",
        worse="larger",
        of=goal_distance_final,
        shown="distance_to_goal",
    ),
    _progress(id="speed", title="Mean speed", unit="m/s", worse="neither", of=mean_speed, shown="speed"),
    _smooth(
        id="turn_rate", title="Mean turn rate", unit="rad/s", worse="neither", of=mean_turn_rate, shown="turn_rate"
    ),
    _smooth(
        id="acceleration",
        title="Mean inertial acceleration",
        unit="m/s²",
        worse="larger",
        of=mean_inertial_acceleration,
        shown="acceleration",
    ),
    _close(
        id="human_speed",
        title="Mean speed of the humans",
        unit="m/s",
        worse="neither",
        of=mean_human_speed,
        shown="person_speed",
    ),
    _close(
        id="closest_human_speed",
        title="Mean speed of the closest human",
        unit="m/s",
        worse="neither",
        of=mean_closest_human_speed,
        shown="person_speed",
    ),
)
