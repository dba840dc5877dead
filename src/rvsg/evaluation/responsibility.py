"""Responsibility: whether the robot, the person or both cause that their bodies touch or come close.

The rule reads the motion before the moment, each step in order:

1. A robot that stands for `STANDING_S` is not responsible: the person is.
2. Where constant velocity leads the person within `PREDICTED_M` of the actual place over the robot's stopping time, the
   robot is responsible if it comes nearer in that time, turning included; the person if it gives way; else both.
3. A person who is elsewhere than predicted is responsible if they would have stayed farther away; else both are.

The stopping time is the reaction of `stopping_margin` and the time to brake: 0.3 s + latency + v / deceleration.
Sources: a robot that stands, and the predictable way of a person, as in responsibility-sensitive safety
(Shalev-Shwartz 2017) and the competent and careful driver of UN R157; 0.3 s as for the personnel detection of
ISO 3691-4:2023. 0.3 m: people who walk near a mobile robot (PAMELA) are within 0.21 m of the prediction in the median
1 s ahead, within 0.41 to 0.47 m in 90 %.
"""

from __future__ import annotations

import numpy as np

from rvsg.evaluation.sampled import Floats, Sampled
from rvsg.simulation.events import Side

REACTION_S = 0.3
STANDING_S, STANDS_M_S, STANDS_RAD_S = 1.0, 0.05, 0.1
"""A robot slower than both for this long stands; 0.1 rad/s moves the rim of a body of half a metre at 0.05 m/s."""
PREDICTED_M = 0.3
STEPS = 9
"""Moments of the stopping time at which a predicted person is looked at."""
SAME_GAP_M = 0.02
"""The moment is the first at which the gap is as small as at the sample but for this."""


def responsible(s: Sampled, row: int, person: int) -> Side:
    """Return who is responsible for the gap between the robot and a person at a sample, from the motion before it."""
    path, t = s.series, s.series.t
    wider = np.flatnonzero(s.gap[: row + 1, person] > s.gap[row, person] + SAME_GAP_M)
    row = int(wider[-1]) + 1 if len(wider) else 0
    before = slice(int(np.searchsorted(t, t[row] - STANDING_S - 1e-9)), row + 1)
    fastest = float(path.speed[before].max())
    if fastest < STANDS_M_S and float(np.abs(path.omega[before]).max()) < STANDS_RAD_S:
        return "person"
    stopping_s = REACTION_S + s.run.robot_latency_s + fastest / s.run.robot_deceleration_m_s2
    then = max(0, int(np.searchsorted(t, t[row] - stopping_s + 1e-9, side="right")) - 1)
    elapsed = float(t[row] - t[then])
    robot, now = _pose(s, then), np.array([path.human_x[row, person], path.human_y[row, person]])
    velocity = np.array([v[then, person] for v in s.human_velocity])
    predicted = np.array([path.human_x[then, person], path.human_y[then, person]]) + velocity * elapsed
    gap = float(s.gap[row, person])
    if float(np.hypot(*(predicted - now))) <= PREDICTED_M:
        nearer = _gap(s, row, person, robot, now) - gap
        least = STANDS_M_S * elapsed
        return "robot" if nearer > least else "person" if nearer < -least else "shared"
    ahead = np.linspace(0.0, stopping_s, STEPS)[:, None]
    drift = np.array([*(v[max(0, row - 1)] for v in s.robot_velocity), path.omega[max(0, row - 1)]])
    farther = _gap(s, row, person, _pose(s, row) + drift * ahead, predicted + velocity * ahead) > max(gap, 0.0)
    return "person" if farther else "shared"


def _pose(s: Sampled, row: int) -> Floats:
    return np.array([s.series.x[row], s.series.y[row], s.series.yaw[row]])


def _gap(s: Sampled, row: int, person: int, robot: Floats, place: Floats) -> float:
    """Return the smallest gap for poses (x, y, yaw) of the robot and places of a person turned as at a sample."""
    robot, place = np.atleast_2d(robot), np.atleast_2d(place)
    dx, dy = (place[:, k] - robot[:, k] for k in (0, 1))
    turn = np.full(dx.shape, s.series.human_yaw[row, person])
    return float(s.gap_of(person, robot[:, 2], dx, dy, turn).min())
