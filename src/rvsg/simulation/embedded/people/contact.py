"""Contact of bodies: people with each other and with the robot. Bodies are discs; the robot's is its outline."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner
from rvsg.simulation.embedded.people.crowd import Crowd
from rvsg.simulation.embedded.people.log import AGAIN_S, FIRST, TOUCHED, UNTIL, note_until
from rvsg.simulation.embedded.people.motion import off_walls
from rvsg.simulation.embedded.people.obstacles import on_outline

Floats = NDArray[np.float64]

TOUCH_M = 0.005
"""Bodies this near touch."""
ROUNDS = 12
STRAY_M = 0.2
"""Who can touch is found once for as long as nobody moves farther than this."""
SLACK_M = 0.002
"""Overlaps below this are left as they are."""
FASTEST_M_S = 2.5
"""Nobody is pushed faster than this, also where people start in each other."""
LEFT_M = 0.01
"""No tick leaves an overlap above this that was not there before."""
STANDING_SHARE = 0.1
"""Who stands gives way to who walks by this share of what a walking person does."""
SQUEEZED = 0.5
"""People who block each other turn sideways: their distance shrinks to this share of the sum of their radii."""
# Columns of a contact behind `FIRST`: relative speed along the normal, the robot's and the person's part of it (m/s),
# bearing of the person off the robot's heading (rad), largest overlap (m).
CLOSING, ROBOT_PART, PERSON_PART, BEARING, OVERLAP = range(FIRST + 1, FIRST + 6)


@inner
def separate(crowd: Crowd, dt: float, robot_x: float, robot_y: float, robot_yaw: float) -> None:
    """Push people apart who overlap after their steps, and out of the robot; then set the velocities they moved with.

    The robot does not give way here: people do not push it. Who is pinned, so that no push parts them, does not move.
    """
    n = crowd.x.size
    count = -1
    for _ in range(ROUNDS):
        if count < 0:
            count = _find_pairs(crowd)
        worst, strayed = _part_all(crowd, count)
        for i in range(n):
            if may_touch(crowd, i, robot_x, robot_y):
                overlap = _out_of_robot(crowd, i, robot_x, robot_y, robot_yaw)
                worst = max(worst, overlap)
                strayed = strayed or (overlap > 0.0 and _has_strayed(crowd, i))
        if worst <= SLACK_M:
            break
        if strayed:
            count = -1
    for i in range(n):
        dx = crowd.x[i] - crowd.old_x[i]
        dy = crowd.y[i] - crowd.old_y[i]
        moved = math.sqrt(dx * dx + dy * dy)
        if moved > FASTEST_M_S * dt:
            share = FASTEST_M_S * dt / moved
            crowd.x[i] = crowd.old_x[i] + share * dx
            crowd.y[i] = crowd.old_y[i] + share * dy
            count = -1
            dx *= share
            dy *= share
            moved = FASTEST_M_S * dt
        crowd.walked[i] += moved
        speed = moved / dt
        share = min(1.0, crowd.cap[i] / speed) if speed > 0.0 else 0.0
        crowd.vx[i] = share * dx / dt
        crowd.vy[i] = share * dy / dt
    _keep_pinned(crowd, count)


@inner
def _keep_pinned(crowd: Crowd, count: int) -> None:
    """Undo the steps of two who overlap by more than `LEFT_M`, and by more than before these steps.

    `count` is the number of pairs that can touch, -1 if it is not known. This ends, at the latest with everybody back.
    """
    again = True
    while again:
        if count < 0:
            count = _find_pairs(crowd)
        again = False
        for k in range(count):
            i = crowd.pairs[k, 0]
            j = crowd.pairs[k, 1]
            left = _overlap(crowd, i, j, crowd.x, crowd.y)
            if left > LEFT_M and left > _overlap(crowd, i, j, crowd.old_x, crowd.old_y):
                _step_back(crowd, i)
                _step_back(crowd, j)
                again = True
        count = -1


@inner
def _overlap(crowd: Crowd, i: int, j: int, xs: Floats, ys: Floats) -> float:
    """Return by how much two people overlap at these positions."""
    dx = xs[j] - xs[i]
    dy = ys[j] - ys[i]
    reach = crowd.radius[i] + crowd.radius[j]
    square = dx * dx + dy * dy
    if square >= reach * reach:
        return 0.0
    return reach * (1.0 - (1.0 - SQUEEZED) * max(crowd.squeeze[i], crowd.squeeze[j])) - math.sqrt(square)


@inner
def _step_back(crowd: Crowd, i: int) -> None:
    """Undo the step of a person."""
    dx = crowd.x[i] - crowd.old_x[i]
    dy = crowd.y[i] - crowd.old_y[i]
    crowd.walked[i] -= math.sqrt(dx * dx + dy * dy)
    crowd.x[i] = crowd.old_x[i]
    crowd.y[i] = crowd.old_y[i]
    crowd.vx[i] = 0.0
    crowd.vy[i] = 0.0


@inner
def _find_pairs(crowd: Crowd) -> int:
    """Write the pairs that can touch while nobody strays; return their number."""
    count = 0
    xs, ys, radius, pairs = crowd.x, crowd.y, crowd.radius, crowd.pairs
    for i in range(xs.size):
        crowd.paired_x[i] = xs[i]
        crowd.paired_y[i] = ys[i]
        for j in range(i + 1, xs.size):
            dx = xs[j] - xs[i]
            dy = ys[j] - ys[i]
            reach = radius[i] + radius[j] + 2.0 * STRAY_M
            if dx * dx + dy * dy < reach * reach:
                pairs[count, 0] = i
                pairs[count, 1] = j
                count += 1
    return count


@inner
def _has_strayed(crowd: Crowd, i: int) -> bool:
    """Whether a person may touch somebody with whom no pair was found."""
    dx = crowd.x[i] - crowd.paired_x[i]
    dy = crowd.y[i] - crowd.paired_y[i]
    return not dx * dx + dy * dy < (0.99 * STRAY_M) ** 2


@inner
def _part_all(crowd: Crowd, count: int) -> tuple[float, bool]:
    """Push apart all who overlap, in the order of their numbers; return the largest overlap and whether one strayed.

    The pairs that were found are all that can overlap, until somebody strays; then every other pair is looked at.
    """
    n = crowd.x.size
    worst = 0.0
    for k in range(count):
        i = crowd.pairs[k, 0]
        j = crowd.pairs[k, 1]
        overlap = _part(crowd, i, j)
        if overlap > 0.0:
            worst = max(worst, overlap)
            if _has_strayed(crowd, i) or _has_strayed(crowd, j):
                j += 1
                while i < n:
                    while j < n:
                        worst = max(worst, _part(crowd, i, j))
                        j += 1
                    i += 1
                    j = i + 1
                return worst, True
    return worst, False


@inner
def _part(crowd: Crowd, i: int, j: int) -> float:
    """Push two people apart who overlap; return by how much they did."""
    overlap = _overlap(crowd, i, j, crowd.x, crowd.y)
    if overlap <= 0.0:
        return 0.0
    dx = crowd.x[j] - crowd.x[i]
    dy = crowd.y[j] - crowd.y[i]
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-6:
        # Two at the very same point part in a direction of their own.
        dx = math.cos(2.4 * (i + j + 1))
        dy = math.sin(2.4 * (i + j + 1))
        distance = 1.0
    first = STANDING_SHARE if crowd.stands[i] else 1.0
    second = STANDING_SHARE if crowd.stands[j] else 1.0
    share = first / (first + second)
    ux = dx / distance
    uy = dy / distance
    crowd.x[i], crowd.y[i] = off_walls(crowd, crowd.x[i] - share * overlap * ux, crowd.y[i] - share * overlap * uy)
    share = 1.0 - share
    crowd.x[j], crowd.y[j] = off_walls(crowd, crowd.x[j] + share * overlap * ux, crowd.y[j] + share * overlap * uy)
    return overlap


@inner
def _out_of_robot(crowd: Crowd, i: int, robot_x: float, robot_y: float, robot_yaw: float) -> float:
    """Push a person out of the robot's body; return how deep they were in it."""
    gap, ux, uy = robot_gap(crowd, i, robot_x, robot_y, robot_yaw)
    if gap >= 0.0:
        return 0.0
    crowd.x[i] -= gap * ux
    crowd.y[i] -= gap * uy
    return -gap


@inner
def may_touch(crowd: Crowd, i: int, robot_x: float, robot_y: float) -> bool:
    """Whether a person is so near that the robot may touch them at some heading."""
    far = crowd.outline_reach + crowd.radius[i] + 2.0 * TOUCH_M
    dx = crowd.x[i] - robot_x
    dy = crowd.y[i] - robot_y
    return not dx * dx + dy * dy > far * far


@inner
def robot_gap(crowd: Crowd, i: int, robot_x: float, robot_y: float, robot_yaw: float) -> tuple[float, float, float]:
    """Return the gap between a person's disc and the robot's outline (negative: overlap), and the outward normal."""
    x = crowd.x[i]
    y = crowd.y[i]
    far = crowd.outline_reach + crowd.radius[i]
    dx = x - robot_x
    dy = y - robot_y
    square = dx * dx + dy * dy
    if square > (far + 1.0) ** 2:
        return math.sqrt(square) - far, 1.0, 0.0
    px, py, inside = on_outline(crowd.outline, x, y, robot_x, robot_y, robot_yaw)
    dx = x - px
    dy = y - py
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-9:
        away = max(math.sqrt((px - robot_x) ** 2 + (py - robot_y) ** 2), 1e-9)
        return -crowd.radius[i], (px - robot_x) / away, (py - robot_y) / away
    if inside:
        return -distance - crowd.radius[i], -dx / distance, -dy / distance
    return distance - crowd.radius[i], dx / distance, dy / distance


@inner
def note_overlap(crowd: Crowd, i: int, robot_x: float, robot_y: float, robot_yaw: float) -> None:
    """Keep the largest overlap of the present contact."""
    row = crowd.open[i, TOUCHED]
    if row >= 0:
        gap, _, _ = robot_gap(crowd, i, robot_x, robot_y, robot_yaw)
        crowd.events[row, OVERLAP] = max(crowd.events[row, OVERLAP], -gap)


@inner
def note_touch(
    crowd: Crowd,
    i: int,
    t: float,
    robot_x: float,
    robot_y: float,
    robot_yaw: float,
    robot_vx: float,
    robot_vy: float,
    robot_w: float,
) -> None:
    """Note the contact of a person and the robot, where they touch, with the speeds before it is resolved.

    `robot_vx` and `robot_vy` are the velocity of the base frame in the world, m/s.
    """
    gap, ux, uy = robot_gap(crowd, i, robot_x, robot_y, robot_yaw)
    if gap > TOUCH_M:
        return
    x = crowd.x[i] - (crowd.radius[i] + gap) * ux
    y = crowd.y[i] - (crowd.radius[i] + gap) * uy
    row = crowd.open[i, TOUCHED]
    fresh = row < 0 or t - crowd.events[row, UNTIL] >= AGAIN_S
    row = note_until(crowd, TOUCHED, i, t, t, x, y, 0.0)
    if row < 0:
        return
    if fresh:
        there_vx = robot_vx - robot_w * (y - robot_y)
        there_vy = robot_vy + robot_w * (x - robot_x)
        robot = there_vx * ux + there_vy * uy
        person = -(crowd.vx[i] * ux + crowd.vy[i] * uy)
        bearing = math.atan2(crowd.y[i] - robot_y, crowd.x[i] - robot_x) - robot_yaw
        crowd.events[row, CLOSING] = max(0.0, robot + person)
        crowd.events[row, ROBOT_PART] = robot
        crowd.events[row, PERSON_PART] = person
        crowd.events[row, BEARING] = math.atan2(math.sin(bearing), math.cos(bearing))
