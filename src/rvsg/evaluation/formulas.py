"""The study's measures: one small function each of a sampled run. None where a run holds no judgement.

Source of the definitions: the RVSG study and, for what its runs logged, its client (see docs/reference/metrics.md).
"""

from __future__ import annotations

import numpy as np

from rvsg.evaluation.sampled import Sampled
from rvsg.simulation.run import Outcome

LOG_INTERVAL_S = 0.509
IMU_PERIOD_S = 0.01
GOAL_ZEROED_M = 0.25


def distance_to_obstacles(s: Sampled) -> float | None:
    """dto = (1/T) sum_t min_i |p_robot(t) - p_i(t)|, centre to centre, over the humans i: people alone, no walls."""
    return float(s.distance.min(axis=1).mean()) if s.people else None


def distance_to_obstacles_logged(s: Sampled) -> float | None:
    """Mean over samples of max(0, min_i (|p_robot - p_i| - r_robot - r_i)): surface to surface, clamped at 0.

    People alone, no walls.
    """
    return float(s.clamped_gap.mean()) if s.people else None


def jerk(s: Sampled) -> float | None:
    """(1/(T-1)) sum_t |a(t+1) - a(t)| / dt, with a the mean acceleration vector of each interval (from v and yaw).

    The vector is (dv/dt, v omega) in the frame of the robot, so no accidental inertial sample decides the value.
    """
    if len(s) < 3:
        return None
    along, across = s.acceleration
    return float((np.hypot(np.diff(along), np.diff(across)) / s.dt[1:]).mean())


def jerk_logged(s: Sampled) -> float | None:
    """Mean over the N-1 intervals of |a(t+1) - a(t)| / dt, a the inertial sensor's horizontal magnitude."""
    if len(s) < 2:
        return None
    return float((np.abs(np.diff(s.series.acceleration)) / s.dt).mean())


def expected_jerk(s: Sampled) -> float | None:
    """What `jerk_logged` is on average over the phase at which the log samples the inertial sensor.

    E = 1/(K-m) sum_k |a(k+m) - a(k)| / (m 0.01 / RTF), over all K samples at 100 Hz, m = 0.509 RTF / 0.01 rounded:
    the mean over phases and over intervals commute. The log's short last interval is left out.
    """
    samples = s.run.imu
    lag = round(LOG_INTERVAL_S * s.run.clock_ratio / IMU_PERIOD_S)
    if lag < 1 or len(samples) <= lag:
        return None
    change = np.abs(samples[lag:] - samples[:-lag])
    return float(change.mean() / (lag * IMU_PERIOD_S / s.run.clock_ratio))


def time_to_goal(s: Sampled) -> float | None:
    """t_goal - t_start. A run that did not reach the goal counts with at least its time limit: it took longer."""
    if not len(s):
        return None
    if s.run.outcome is Outcome.REACHED:
        return s.duration_s
    return max(s.duration_s, s.run.time_limit_s)


def last_time(s: Sampled) -> float | None:
    """Time stamp of the last row, whatever the outcome (wall clock)."""
    return float(s.series.t[-1]) if len(s) else None


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


def time_not_moving_logged(s: Sampled) -> float | None:
    """(total time / (N-1)) x number of still samples, the first excluded."""
    if len(s) < 2:
        return None
    return float(s.series.t[-1] / (len(s) - 1) * s.still[1:].sum())


def completed(s: Sampled) -> float | None:
    """1 where the goal was reached in time, else 0."""
    return 1.0 if s.run.completed else 0.0


def minimum_distance(s: Sampled) -> float | None:
    """Smallest gap to a person over the run, surface to surface; negative where the discs overlap."""
    return float(s.closest_gap.min()) if s.people else None


def minimum_distance_clamped(s: Sampled) -> float | None:
    """Smallest gap to a person over the run, 0 where the discs overlap."""
    return float(s.clamped_gap.min()) if s.people else None


def goal_distance_minimum(s: Sampled) -> float | None:
    """Smallest distance of the robot's centre from the goal."""
    return float(s.goal_distance.min()) if len(s) else None


def goal_distance_final(s: Sampled) -> float | None:
    """Distance of the robot's centre from the goal at the end."""
    return float(s.goal_distance[-1]) if len(s) else None


def goal_distance_final_logged(s: Sampled) -> float | None:
    """Distance from the goal in the last row; the study's client wrote 0 where it was at most 0.25 m."""
    if not len(s):
        return None
    final = float(s.goal_distance[-1])
    return 0.0 if final <= GOAL_ZEROED_M else final


def mean_speed(s: Sampled) -> float | None:
    """Mean over samples of |v|."""
    return float(np.abs(s.series.v).mean()) if len(s) else None


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
