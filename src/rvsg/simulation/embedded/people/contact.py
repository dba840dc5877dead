"""Contact of bodies: people with each other and with the robot; people are discs, the robot is its outline."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rvsg.core.angles import wrap
from rvsg.core.kernels import inner
from rvsg.scenario.scenario import Behaviour
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.people.crowd import (
    AGAIN_S,
    FIRST,
    FROM,
    KIND,
    PERSON,
    REACHED,
    REACTED,
    STUCK,
    TOUCHED,
    UNTIL,
    Crowd,
    RobotState,
    X,
    Y,
    note_until,
)
from rvsg.simulation.embedded.people.motion import off_walls
from rvsg.simulation.embedded.people.obstacles import on_outline
from rvsg.simulation.events import Contact, PersonPaused, PersonReached, PersonReacted, PersonStuck, RecordedEvent

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
def separate(crowd: Crowd, dt: float, robot: RobotState) -> None:
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
            if may_touch(crowd, i, robot):
                gap, ux, uy = robot_gap(crowd, i, robot)
                if gap < 0.0:
                    crowd.x[i] -= gap * ux
                    crowd.y[i] -= gap * uy
                    worst = max(worst, -gap)
                    strayed = strayed or _has_strayed(crowd, i)
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
                for who in (i, j):
                    dx = crowd.x[who] - crowd.old_x[who]
                    dy = crowd.y[who] - crowd.old_y[who]
                    crowd.walked[who] -= math.sqrt(dx * dx + dy * dy)
                    crowd.x[who], crowd.y[who] = crowd.old_x[who], crowd.old_y[who]
                    crowd.vx[who] = crowd.vy[who] = 0.0
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
def may_touch(crowd: Crowd, i: int, robot: RobotState) -> bool:
    """Whether a person is so near that the robot may touch them at some heading."""
    far = crowd.outline_reach + crowd.radius[i] + 2.0 * TOUCH_M
    dx = crowd.x[i] - robot.x
    dy = crowd.y[i] - robot.y
    return not dx * dx + dy * dy > far * far


@inner
def robot_gap(crowd: Crowd, i: int, robot: RobotState) -> tuple[float, float, float]:
    """Return the gap between a person's disc and the robot's outline (negative: overlap), and the outward normal."""
    x = crowd.x[i]
    y = crowd.y[i]
    far = crowd.outline_reach + crowd.radius[i]
    dx = x - robot.x
    dy = y - robot.y
    square = dx * dx + dy * dy
    if square > (far + 1.0) ** 2:
        return math.sqrt(square) - far, 1.0, 0.0
    px, py, inside = on_outline(crowd.outline, x, y, robot.x, robot.y, robot.yaw)
    dx = x - px
    dy = y - py
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-9:
        away = max(math.sqrt((px - robot.x) ** 2 + (py - robot.y) ** 2), 1e-9)
        return -crowd.radius[i], (px - robot.x) / away, (py - robot.y) / away
    if inside:
        return -distance - crowd.radius[i], -dx / distance, -dy / distance
    return distance - crowd.radius[i], dx / distance, dy / distance


@inner
def note_overlap(crowd: Crowd, i: int, robot: RobotState) -> None:
    """Keep the largest overlap of the present contact."""
    row = crowd.open[i, TOUCHED]
    if row >= 0:
        gap, _, _ = robot_gap(crowd, i, robot)
        crowd.events[row, OVERLAP] = max(crowd.events[row, OVERLAP], -gap)


@inner
def note_touch(crowd: Crowd, i: int, t: float, robot: RobotState, robot_w: float) -> None:
    """Note the contact of a person and the robot, where they touch, with the speeds before it is resolved.

    `robot_w` is the yaw rate of the robot, rad/s.
    """
    gap, ux, uy = robot_gap(crowd, i, robot)
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
        there_vx = robot.vx - robot_w * (y - robot.y)
        there_vy = robot.vy + robot_w * (x - robot.x)
        approach = there_vx * ux + there_vy * uy
        person = -(crowd.vx[i] * ux + crowd.vy[i] * uy)
        bearing = math.atan2(crowd.y[i] - robot.y, crowd.x[i] - robot.x) - robot.yaw
        crowd.events[row, CLOSING] = max(0.0, approach + person)
        crowd.events[row, ROBOT_PART] = approach
        crowd.events[row, PERSON_PART] = person
        crowd.events[row, BEARING] = math.atan2(math.sin(bearing), math.cos(bearing))


HALVINGS = 10
LEAST_M = 1e-4
"""Overlaps below this do not hold the base back."""


@inner(cached=True)
def touch_people(crowd: Crowd, t: float, body: Floats, x: float, y: float, yaw: float, bumper_s: float) -> float:
    """Resolve the contacts of the base after its step from the pose (x, y, yaw); return the change of its speed, m/s.

    A person who walks is moved out of the way unless walls or other people are there. Where a person stands or is
    pinned, the base makes only the part of its step that does not enter the body: less translation first, then less
    rotation. A touched body triggers the bumper, which stops the drive for `bumper_s`, whoever gives way.
    """
    crowd.free[0] -= math.sqrt((body[base.X] - x) ** 2 + (body[base.Y] - y) ** 2)
    if crowd.free[0] > 0.0:
        return 0.0
    free = math.inf
    touched = False
    cos = math.cos(body[base.YAW])
    sin = math.sin(body[base.YAW])
    robot = RobotState(
        body[base.X], body[base.Y], body[base.YAW],
        body[base.V] * cos - body[base.SIDE] * sin, body[base.V] * sin + body[base.SIDE] * cos,
    )  # fmt: skip
    for i in range(crowd.x.size):
        dx = crowd.x[i] - robot.x
        dy = crowd.y[i] - robot.y
        least = math.sqrt(dx * dx + dy * dy) - (crowd.outline_reach + crowd.radius[i]) - TOUCH_M
        free = min(free, least)
        if least > 0.0:
            continue
        gap, ux, uy = robot_gap(crowd, i, robot)
        if gap > TOUCH_M:
            continue
        touched = True
        note_touch(crowd, i, t, robot, body[base.W])
        if gap <= LEAST_M and bumper_s > 0.0:
            body[base.STOPPED_T] = max(body[base.STOPPED_T], t + bumper_s)
        if gap < 0.0 and crowd.stands[i] == 0:
            was_x = crowd.x[i]
            was_y = crowd.y[i]
            _give_way(crowd, i, -gap * ux, -gap * uy)
            after, _, _ = robot_gap(crowd, i, robot)
            if after < gap:
                # Walls would push the person deeper into the robot: pinned between both.
                crowd.x[i] = was_x
                crowd.y[i] = was_y
    crowd.free[0] = free
    if not touched:
        return 0.0
    change = _hold_back(crowd, body, x, y, yaw)
    held = RobotState(body[base.X], body[base.Y], body[base.YAW], 0.0, 0.0)
    for i in range(crowd.x.size):
        note_overlap(crowd, i, held)
    return change


@inner
def _give_way(crowd: Crowd, i: int, dx: float, dy: float) -> None:
    """Move a person by (dx, dy) as far as walls allow, and not at all into somebody else."""
    x, y = off_walls(crowd, crowd.x[i] + dx, crowd.y[i] + dy)
    for j in range(crowd.x.size):
        reach = crowd.radius[i] + crowd.radius[j]
        square = (crowd.x[j] - x) ** 2 + (crowd.y[j] - y) ** 2
        before = (crowd.x[j] - crowd.x[i]) ** 2 + (crowd.y[j] - crowd.y[i]) ** 2
        if j != i and square < reach * reach and square < before:
            return
    crowd.x[i] = x
    crowd.y[i] = y


@inner
def deepest(crowd: Crowd, x: float, y: float, yaw: float) -> float:
    """Return the largest overlap of a person with the robot at a pose; 0 where there is none."""
    found = 0.0
    robot = RobotState(x, y, yaw, 0.0, 0.0)
    for i in range(crowd.x.size):
        gap, _, _ = robot_gap(crowd, i, robot)
        found = max(found, -gap)
    return found


@inner
def _hold_back(crowd: Crowd, body: Floats, x: float, y: float, yaw: float) -> float:
    """Shorten the base's last step so that no overlap grows; return the change of its speed, m/s."""
    allowed = max(LEAST_M, deepest(crowd, x, y, yaw))
    if deepest(crowd, body[base.X], body[base.Y], body[base.YAW]) <= allowed:
        return 0.0
    dx = body[base.X] - x
    dy = body[base.Y] - y
    turn = wrap(body[base.YAW] - yaw)
    moved = 0.0
    turned = 1.0
    if deepest(crowd, x, y, yaw + turn) <= allowed:
        blocked = 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (moved + blocked)
            if deepest(crowd, x + middle * dx, y + middle * dy, yaw + turn) <= allowed:
                moved = middle
            else:
                blocked = middle
    else:
        turned = 0.0
        blocked = 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (turned + blocked)
            if deepest(crowd, x, y, yaw + middle * turn) <= allowed:
                turned = middle
            else:
                blocked = middle
    body[base.X] = x + moved * dx
    body[base.Y] = y + moved * dy
    body[base.YAW] = wrap(yaw + turned * turn)
    change = (moved - 1.0) * body[base.V]
    body[base.V] *= moved
    body[base.SIDE] *= moved
    body[base.W] *= turned
    return change


def events_of(crowd: Crowd, names: Sequence[str], behaviours: Sequence[Behaviour]) -> tuple[RecordedEvent, ...]:
    """Return the events of a run in order of time.

    Args:
        names: The name of each person.
        behaviours: The behaviour of each person.
    """
    rows = crowd.events[: int(crowd.event_count[0])]
    rows = rows[np.lexsort((rows[:, PERSON], rows[:, KIND], rows[:, FROM]))]
    return tuple(_event(row, names, behaviours) for row in rows.tolist())


def _event(row: Sequence[float], names: Sequence[str], behaviours: Sequence[Behaviour]) -> RecordedEvent:
    person = int(row[PERSON])
    kind = int(row[KIND])
    time_s, until_s = round(row[FROM], 3), round(row[UNTIL], 3)
    x, y = round(row[X], 3), round(row[Y], 3)
    name = names[person]
    if kind == TOUCHED:
        return Contact(
            time_s=time_s,
            until_s=until_s,
            x=x,
            y=y,
            person=name,
            closing_speed_m_s=round(row[CLOSING], 3),
            robot_part_m_s=round(row[ROBOT_PART], 3),
            person_part_m_s=round(row[PERSON_PART], 3),
            bearing_rad=round(row[BEARING], 3),
            overlap_m=round(row[OVERLAP], 4),
        )
    if kind == REACTED:
        behaviour = behaviours[person]
        return PersonReacted(time_s=time_s, until_s=until_s, x=x, y=y, person=name, behaviour=behaviour)
    goal = int(row[FIRST])
    if kind == REACHED:
        return PersonReached(time_s=time_s, x=x, y=y, person=name, goal=goal)
    lasting = PersonStuck if kind == STUCK else PersonPaused
    return lasting(time_s=time_s, until_s=until_s, x=x, y=y, person=name, goal=goal)
