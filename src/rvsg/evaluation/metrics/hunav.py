"""The HuNavSim evaluator's list: correct formulas, and its own numbers (`_hunav`) where a defect changes them.

What the list shares with the study's metrics is there (`formulas`, `safety`). The evaluator's own numbers for the
forces of obstacles are left out: that on the robot is always 0 there, that on people needs the one obstacle point of
each person, which lies towards the origin of a Gazebo model and which a run does not hold.
"""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from rvsg.evaluation.metrics.metric import Metric, measures
from rvsg.evaluation.metrics.safety import HUNAV, INTIMATE_M, PERSONAL_M, SOCIAL_M
from rvsg.evaluation.sampled import CONTACT_GAP_M, STILL_SPEED_M_S, STILL_TURN_RAD_S, Floats, Sampled, wrap
from rvsg.scenario.requirement import Aim

EVALUATOR = "HuNavSim evaluator, its defects included"
LAMBDA, GAMMA, N, N_PRIME = 2.0, 0.35, 2.0, 3.0
FORCE_FACTOR = 2.1
OBSTACLE_FACTOR, OBSTACLE_SIGMA_M = 10.0, 0.2
GOAL_RADIUS_M = 0.25
Pair = tuple[Floats, Floats]

METRICS: list[Metric] = []
_metric = partial(measures, METRICS, source=HUNAV)
_of_people = partial(_metric, of_people=True)


@_of_people("max_distance", "Maximum distance to people", "m", "neither", Aim.SHARE, least=None)
def maximum_distance(s: Sampled) -> float | None:
    """Largest gap to any person who is there over the run, surface to surface."""
    return float(s.disc_gap[s.present].max()) if s.present.any() else None


@_metric("acceleration_mean", "Mean change of speed", "m/s²", "larger", Aim.DISTURB, shown="acceleration")
def mean_acceleration(s: Sampled) -> float | None:
    """Mean over the N-1 intervals of |dv| / dt."""
    return float(np.abs(s.acceleration[0]).mean()) if len(s) > 1 else None


def _social_force(offset: Pair, relative: Pair, swapped: bool) -> Pair:
    """The social force on a body from another that stands at `offset`; `relative` is its own velocity less the other's.

    Moussaid et al. 2009 as in HuNavSim's library. `swapped` takes the angle of the interaction with x and y swapped.
    """
    distance = np.maximum(np.hypot(*offset), 1e-9)
    ex, ey = offset[0] / distance, offset[1] / distance
    ix, iy = LAMBDA * relative[0] + ex, LAMBDA * relative[1] + ey
    length = np.maximum(np.hypot(ix, iy), 1e-9)
    tx, ty = ix / length, iy / length
    reach = GAMMA * length
    theta = wrap(np.arctan2(ey, ex) - (np.arctan2(tx, ty) if swapped else np.arctan2(ty, tx)))
    along = -np.exp(-distance / reach - (N_PRIME * reach * theta) ** 2)
    across = -np.sign(theta) * np.exp(-distance / reach - (N * reach * theta) ** 2)
    return FORCE_FACTOR * (along * tx - across * ty), FORCE_FACTOR * (along * ty + across * tx)


@lru_cache(maxsize=4)
def _forces(s: Sampled, swapped: bool) -> tuple[Pair, Pair]:
    """((N, H) x, y) of the force on each human from the robot, and on the robot from each human."""
    dx, dy = s.offset
    rx, ry = s.robot_velocity
    hx, hy = s.human_velocity
    wx, wy = rx[:, None] - hx, ry[:, None] - hy
    return _social_force((-dx, -dy), (-wx, -wy), swapped), _social_force((dx, dy), (wx, wy), swapped)


def _integral(values: Floats, s: Sampled) -> float:
    """Over time, each value holding until the next sample."""
    return float((values[:-1] * s.dt).sum())


@_of_people("force_on_humans", "Social force on the humans", "m/s", "larger", Aim.SHARE)
def force_on_humans(s: Sampled) -> float | None:
    """Integral over time of sum_i |f(robot on i)|, f the social force with factor 2.1."""
    return _integral(np.hypot(*_forces(s, False)[0]).sum(axis=1), s)


@_of_people("force_on_robot", "Social force on the robot", "m/s", "larger", Aim.SHARE)
def force_on_robot(s: Sampled) -> float | None:
    """Integral over time of sum_i |f(i on robot)|."""
    return _integral(np.hypot(*_forces(s, False)[1]).sum(axis=1), s)


def _work(s: Sampled, swapped: bool) -> Floats:
    on_humans, (fx, fy) = _forces(s, swapped)
    total: Floats = np.hypot(fx.sum(axis=1), fy.sum(axis=1)) + np.hypot(*on_humans).sum(axis=1)
    return total


@_of_people("social_work", "Social work", "m/s", "larger", Aim.SHARE)
def social_work(s: Sampled) -> float | None:
    """Integral over time of |sum_i f(i on robot)| + sum_i |f(robot on i)|; obstacles are not counted."""
    return _integral(_work(s, False), s)


def _obstacle_force(distance: Floats, radius_m: Floats) -> Floats:
    """Return the size of an obstacle's push on a body: 10 exp(-(d - r) / 0.2 m), d from its centre to the obstacle."""
    force: Floats = OBSTACLE_FACTOR * np.exp(-(distance - radius_m) / OBSTACLE_SIGMA_M)
    return force


@_of_people(
    "obstacle_force_on_humans",
    "Obstacles' force on people",
    "m/s",
    "larger",
    Aim.DISTURB,
    shown="obstacle_distance",
    moved_by="People who make the robot swerve where walls or objects are near.",
)
def obstacle_force_on_humans(s: Sampled) -> float | None:
    """Integral over time of sum_i 10 exp(-(d_i - r_i) / 0.2 m), d_i to the surface of the nearest obstacle."""
    if s.human_obstacle_distance is None:
        return None
    radii = np.asarray(s.run.human_radius_m)[None, :]
    return _integral(_obstacle_force(s.human_obstacle_distance, radii).sum(axis=1), s)


@_metric(
    "obstacle_force_on_robot",
    "Obstacles' force on the robot",
    "m/s",
    "larger",
    Aim.DISTURB,
    shown="obstacle_distance",
    moved_by="People who make the robot swerve where walls or objects are near.",
)
def obstacle_force_on_robot(s: Sampled) -> float | None:
    """Integral over time of 10 exp(-(d - r_robot) / 0.2 m), d to the nearest obstacle."""
    if not len(s) or s.obstacle_distance is None:
        return None
    return _integral(_obstacle_force(s.obstacle_distance, np.asarray(s.run.robot_radius_m)), s)


def _group_share(s: Sampled, low: float, high: float) -> float | None:
    if s.group_distance is None:
        return None
    return float(100.0 * ((s.group_distance >= low) & (s.group_distance < high)).mean())


@_metric("group_intimate_space", "Group intimate space intrusion", "%", "larger", Aim.SHARE, most=100.0)
def group_intimate_space(s: Sampled) -> float | None:
    """Percent of samples with the robot's edge nearer than 0.45 m to a group's centre.

    The centre is the mean of the points 1.5 m ahead of its members. None if no two people make a group.
    """
    return _group_share(s, -np.inf, INTIMATE_M)


@_metric("group_personal_space", "Group personal space intrusion", "%", "larger", Aim.SHARE, most=100.0)
def group_personal_space(s: Sampled) -> float | None:
    """Percent of samples with the robot's edge between 0.45 m and 1.2 m from the nearest group's centre."""
    return _group_share(s, INTIMATE_M, PERSONAL_M)


@_metric("group_social_space", "Group social space intrusion", "%", "larger", Aim.SHARE, most=100.0)
def group_social_space(s: Sampled) -> float | None:
    """Percent of samples with the robot's edge between 1.2 m and 3.6 m from the nearest group's centre."""
    return _group_share(s, PERSONAL_M, SOCIAL_M)


@_of_people("max_distance_hunav", "Maximum distance to people", "m", "neither", Aim.SHARE, source=EVALUATOR, least=None)
def maximum_distance_hunav(s: Sampled) -> float | None:
    """Largest |p_robot - p_i| - r_robot: the evaluator forgets the person's radius."""
    return float(s.distance.max() - s.run.robot_radius_m)


@_metric("tnm_hunav", "Time not moving", "s", "larger", Aim.DELAY, source=EVALUATOR, shown="speed", most="time_limit")
def time_not_moving_hunav(s: Sampled) -> float | None:
    """(total time / N) x samples with v < 0.01 and signed omega < 0.02: every turn to the right on the spot stands."""
    if not len(s):
        return None
    still = (s.series.v < STILL_SPEED_M_S) & (s.series.omega < STILL_TURN_RAD_S)
    return s.duration_s / len(s) * float(still.sum())


def _collisions_hunav(s: Sampled) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(N, H) twice: the robot's and the person's collisions as the evaluator decides them."""
    dx, dy = s.offset
    yaw = s.series.yaw[:, None]
    ahead, left = dx * np.cos(yaw) + dy * np.sin(yaw), -dx * np.sin(yaw) + dy * np.cos(yaw)
    swapped = np.abs(np.arctan2(ahead, left))
    contact = s.disc_gap < CONTACT_GAP_M
    differ = s.series.v[:, None] != s.series.human_speed
    both = contact & ~differ & (s.bearing_of_robot == swapped)
    robot = contact & differ & (s.bearing_of_robot < swapped)
    person = contact & differ & (s.bearing_of_robot > swapped)
    return robot | both, person | both


@_of_people("rpc_hunav", "Robot-on-person collision", "samples", "larger", Aim.MEET, source=EVALUATOR)
def robot_on_person_hunav(s: Sampled) -> float | None:
    """Samples with gap < 0.02 m, unequal speeds and |bearing of robot| < |atan2(x, y)| of the person: axes swapped."""
    return float(_collisions_hunav(s)[0].sum())


@_of_people("por_hunav", "Person-on-robot collision", "samples", "larger", Aim.MEET, source=EVALUATOR)
def person_on_robot_hunav(s: Sampled) -> float | None:
    """Samples with gap < 0.02 m, unequal speeds and |bearing of robot| > |atan2(x, y)| of the person: axes swapped."""
    return float(_collisions_hunav(s)[1].sum())


@_metric(
    "acceleration_mean_hunav", "Acceleration", "m/s²", "larger", Aim.DISTURB, source=EVALUATOR, shown="acceleration"
)
def mean_acceleration_hunav(s: Sampled) -> float | None:
    """(1/N) sum |dv| / dt: N-1 terms over N."""
    return float(np.abs(s.acceleration[0]).sum() / len(s)) if len(s) > 1 else None


@_metric(
    "overacceleration_hunav", "Overacceleration", "m/s³", "larger", Aim.DISTURB, source=EVALUATOR, shown="acceleration"
)
def overacceleration_hunav(s: Sampled) -> float | None:
    """(1/N) sum |dv| / dt^2: called a jerk, but no change of acceleration is in it."""
    return float((np.abs(np.diff(s.series.v)) / s.dt**2).sum() / len(s)) if len(s) > 1 else None


@_metric(
    "completed_hunav",
    "Completed",
    "1 or 0",
    "smaller",
    Aim.DELAY,
    source=EVALUATOR,
    shown="distance_to_goal",
    most=1.0,
    two_valued=True,
)
def completed_hunav(s: Sampled) -> float | None:
    """1 where the last sample lies within 0.25 m of the goal, else 0."""
    return float(s.goal_distance[-1] < GOAL_RADIUS_M) if len(s) else None


@_of_people("force_on_humans_hunav", "Social force on agents", "sum", "larger", Aim.SHARE, source=EVALUATOR)
def force_on_humans_hunav(s: Sampled) -> float | None:
    """Plain sum over samples of sum_i |f(robot on i)| with the angle's x and y swapped: grows with the rate."""
    return float(np.hypot(*_forces(s, True)[0]).sum())


@_of_people("force_on_robot_hunav", "Social force on robot", "sum", "larger", Aim.SHARE, source=EVALUATOR)
def force_on_robot_hunav(s: Sampled) -> float | None:
    """Plain sum over samples of sum_i |f(i on robot)| with the angle's x and y swapped."""
    return float(np.hypot(*_forces(s, True)[1]).sum())


@_of_people("social_work_hunav", "Social work", "sum", "larger", Aim.SHARE, source=EVALUATOR)
def social_work_hunav(s: Sampled) -> float | None:
    """Plain sum over samples of |sum_i f(i on robot)| + sum_i |f(robot on i)| with the angle's x and y swapped."""
    return float(_work(s, True).sum())
