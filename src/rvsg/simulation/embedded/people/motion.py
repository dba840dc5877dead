"""Motion of a person in a tick: the step, walls, and the way from goal to goal."""

from __future__ import annotations

import math

from rvsg.core.kernels import inner
from rvsg.simulation.embedded.people.anticipation import acceleration, at_gap, gap_to_robot, towards, way_given
from rvsg.simulation.embedded.people.crowd import (
    IMPASSIVE,
    PAUSED,
    REACHED,
    SCARED,
    STUCK,
    Crowd,
    RobotState,
    note_until,
)
from rvsg.simulation.embedded.people.obstacles import WALL_GAP_M, cell_of, on_outline, on_segment
from rvsg.simulation.embedded.people.social_force import RELAXATION_S, body_force, social_forces, total_force, wrap
from rvsg.simulation.embedded.people.ways import is_clear

GOAL_MARGIN_M = 0.1
YAW_STEP_RAD = math.radians(10.0)

SUBSTEP_M = 0.05
AHEAD_M = 1.0
"""People steer for the point this far ahead on the line between two waypoints."""
PASSED_M = 0.8
"""A waypoint without a pause also counts as reached when a person passes beside it at this distance, and one on a
straight way at any."""
ASIDE_M, CLEAR_M = 0.3, 0.2
"""Who is farther beside the straight way looks whether the way back to it keeps clear of walls by the second."""
TURN_YAW_RAD_S = 3.5
"""Nobody turns faster: an about-turn takes about a second."""
HURRY = 1.15
"""Anticipating people speed up to this share of their own speed to pass somebody."""
TURN_SHARE, BRAKE_M_S2 = 0.3, 0.8
"""People brake for a waypoint at which they stop or turn round: to this share of their speed, this fast."""
SETTLE_S = 0.6
STEADY_M_S2 = 1.0
"""Somebody who stands takes a step aside only for a push above this."""
PROGRESS_M = 0.1
ROBOT_NEAR_M = 2.0
"""Whose way the robot blocks from this near waits for their patience, then turns back."""
PATIENCE_S = 1.0
TAKEN_M = 1.2
"""After `PATIENCE_S` without progress, a waypoint at which somebody else stands counts as reached from this near."""
SEEN_M = 1.5
SLOW_M_S = 0.2
BESIDE_M = 0.05
"""People walk around who stands, or is slower than `SLOW_M_S`, within `SEEN_M` ahead, with `BESIDE_M` to spare."""
STUCK_S = 5.0
SQUEEZE_S = 3.0


@inner
def distance_to(crowd: Crowd, i: int, x: float, y: float) -> float:
    """Return the distance of a person from a point."""
    return math.sqrt((crowd.x[i] - x) ** 2 + (crowd.y[i] - y) ** 2)


@inner
def step(crowd: Crowd, i: int, dt: float, fx: float, fy: float, cap: float) -> None:
    """Make one semi-implicit Euler step with the speed capped; the yaw follows the direction of motion."""
    vx = crowd.old_vx[i] + fx * dt
    vy = crowd.old_vy[i] + fy * dt
    speed = math.sqrt(vx * vx + vy * vy)
    if speed > cap:
        vx *= cap / speed
        vy *= cap / speed
    crowd.vx[i] = vx
    crowd.vy[i] = vy
    if not crowd.published:
        crowd.cap[i] = cap
        advance(crowd, i, dt)
        _turn(crowd, i, dt)
        return
    crowd.x[i] += vx * dt
    crowd.y[i] += vy * dt
    crowd.walked[i] += math.sqrt(vx * vx + vy * vy) * dt
    # The plugin shows at most half of a turn of more than 10° per tick.
    turn = wrap((0.0 if vx == 0.0 and vy == 0.0 else math.atan2(vy, vx)) - crowd.yaw[i])
    crowd.yaw[i] = wrap(crowd.yaw[i] + (0.5 * turn if abs(turn) > YAW_STEP_RAD else turn))
    # The plugin estimates the velocity from positions and caps each axis.
    if math.sqrt(vx * vx + vy * vy) > crowd.speed[i]:
        crowd.vx[i] = max(-crowd.speed[i], min(crowd.speed[i], vx))
        crowd.vy[i] = max(-crowd.speed[i], min(crowd.speed[i], vy))


@inner
def advance(crowd: Crowd, i: int, dt: float) -> None:
    """Move with the present velocity, in steps too short to pass a wall."""
    vx = crowd.vx[i]
    vy = crowd.vy[i]
    parts = max(1, math.ceil(math.sqrt(vx * vx + vy * vy) * dt / SUBSTEP_M))
    for _ in range(parts):
        x = crowd.x[i] + vx * dt / parts
        y = crowd.y[i] + vy * dt / parts
        crowd.x[i], crowd.y[i] = off_walls(crowd, x, y)


@inner
def _turn(crowd: Crowd, i: int, dt: float) -> None:
    """Turn half of the way to the direction of motion per 0.1 s, at any length of tick; who stands does not turn."""
    vx = crowd.vx[i]
    vy = crowd.vy[i]
    # A step aside is made without turning.
    least = 0.3 if crowd.stands[i] and not crowd.reacting[i] else 0.05
    if vx * vx + vy * vy > least**2:
        turn = (1.0 - 0.5 ** (dt / 0.1)) * wrap(math.atan2(vy, vx) - crowd.yaw[i])
        if crowd.anticipates:
            turn = max(-TURN_YAW_RAD_S * dt, min(TURN_YAW_RAD_S * dt, turn))
        crowd.yaw[i] = wrap(crowd.yaw[i] + turn)


@inner
def off_walls(crowd: Crowd, x: float, y: float) -> tuple[float, float]:
    """Return the nearest point to (x, y) that keeps `WALL_GAP_M` from walls, to the side on which (x, y) lies."""
    rows, columns = crowd.nearest.shape
    for _ in range(3):
        row, column = cell_of(x, y, crowd.raster_x, crowd.raster_y, rows, columns)
        if row < 0:
            return x, y
        s = crowd.nearest[row, column]
        if s < 0:
            return x, y
        px, py = on_segment(
            x, y, crowd.segments[s, 0], crowd.segments[s, 1], crowd.segments[s, 2], crowd.segments[s, 3]
        )
        dx = x - px
        dy = y - py
        away = math.sqrt(dx * dx + dy * dy)
        if away < 1e-9 or (away >= WALL_GAP_M and not crowd.inside[row, column]):
            return x, y
        # The cell's middle says what is inside; near a surface only a point farther out says it surely.
        out = WALL_GAP_M / away
        row, column = cell_of(px + dx * out, py + dy * out, crowd.raster_x, crowd.raster_y, rows, columns)
        if row >= 0 and crowd.inside[row, column]:
            # Somebody who starts inside an object walks out of it.
            x -= min(SUBSTEP_M, away + WALL_GAP_M) * dx / away
            y -= min(SUBSTEP_M, away + WALL_GAP_M) * dy / away
            return x, y
        if away >= WALL_GAP_M:
            return x, y
        x = px + dx * out
        y = py + dy * out
    return x, y


@inner
def walk_published(crowd: Crowd, i: int, dt: float, robot: RobotState) -> None:
    """Walk towards the present goal as HuNavSim does, or stand at the last one while its pause lasts."""
    g = crowd.goal_index[i]
    pausing = crowd.pause_left[i] > 0.0
    if pausing:
        crowd.pause_left[i] -= dt
        g = (g - 1) % crowd.goal_count[i]
    goal_x = crowd.goals[i, g, 0]
    goal_y = crowd.goals[i, g, 1]
    if not pausing and distance_to(crowd, i, goal_x, goal_y) <= crowd.goal_radius[i] + GOAL_MARGIN_M:
        # HuNavSim tests the goal with a margin before it moves, and then does not move in this tick.
        next_goal(crowd, i)
        crowd.vx[i] = 0.0
        crowd.vy[i] = 0.0
        return
    # HuNavSim never makes an impassive human treat the robot as an obstacle: it walks like a regular one.
    fx, fy = total_force(crowd, i, False, goal_x, goal_y, crowd.goal_radius[i], crowd.speed[i], True, robot)
    step(crowd, i, dt, fx, fy, crowd.speed[i])
    if not pausing and distance_to(crowd, i, goal_x, goal_y) <= crowd.goal_radius[i]:
        next_goal(crowd, i)


@inner
def next_goal(crowd: Crowd, i: int) -> None:
    """Start the pause of the goal that is reached and head for the next one.

    The pause at the start is the one the first task asks for; it is not the pause of the last task, which ends there.
    """
    g = crowd.goal_index[i]
    crowd.pause_left[i] = crowd.pauses[i, g]
    if crowd.start_pause[i] >= 0.0:
        crowd.pause_left[i] = crowd.start_pause[i]
        crowd.start_pause[i] = -1.0
    crowd.goal_index[i] = (g + 1) % crowd.goal_count[i]
    crowd.place_x[i] = crowd.goals[i, g, 0]
    crowd.place_y[i] = crowd.goals[i, g, 1]
    if crowd.ends[i, g] == g or crowd.back[i]:
        crowd.from_x[i] = crowd.place_x[i]
        crowd.from_y[i] = crowd.place_y[i]
    if crowd.back[i]:
        crowd.pause_left[i] = crowd.patience[i]
        crowd.back[i] = 0
    crowd.best[i] = math.inf
    crowd.idle[i] = 0.0


@inner
def end_of_way(crowd: Crowd, i: int) -> int:
    """Return the goal at which the straight way ends that a person is on."""
    g = crowd.goal_index[i]
    return g if crowd.back[i] else crowd.ends[i, g]


@inner
def turn_back(crowd: Crowd, i: int) -> None:
    """Head for the waypoint before, wait there and try again."""
    crowd.goal_index[i] = (crowd.goal_index[i] - 1) % crowd.goal_count[i]
    crowd.back[i] = 1
    crowd.from_x[i] = crowd.x[i]
    crowd.from_y[i] = crowd.y[i]
    crowd.best[i] = math.inf
    crowd.idle[i] = 0.0
    crowd.open[i, STUCK] = -1


@inner
def walk(crowd: Crowd, i: int, t: float, dt: float, robot: RobotState) -> None:
    """Walk along the line to the present goal, or stand at the last one while its pause lasts."""
    crowd.stands[i] = 0
    # Somebody impassive does not make room for the robot, but does not walk through it.
    social = crowd.behaviour[i] != IMPASSIVE
    g = crowd.goal_index[i]
    there = distance_to(crowd, i, crowd.goals[i, g, 0], crowd.goals[i, g, 1]) <= crowd.goal_radius[i]
    if crowd.pause_left[i] > 0.0 or (there and crowd.goal_count[i] == 1):
        if crowd.pause_left[i] > 0.0:
            g = (crowd.goal_index[i] - 1) % crowd.goal_count[i]
            note_until(crowd, PAUSED, i, t, t + dt, crowd.place_x[i], crowd.place_y[i], float(g))
            crowd.pause_left[i] -= dt
        stand_at_place(crowd, i, dt, social, robot)
        return
    aim_x, aim_y = aim(crowd, i)
    aim_x, aim_y = around(crowd, i, aim_x, aim_y)
    speed = before_turn(crowd, i) if crowd.anticipates else crowd.speed[i]
    fx, fy = acceleration(crowd, i, False, aim_x, aim_y, 0.0, speed, social, robot)
    step(crowd, i, dt, fx, fy, (HURRY if crowd.anticipates else 1.0) * crowd.speed[i])


@inner
def before_turn(crowd: Crowd, i: int) -> float:
    """Return the speed from which a person can still brake for what ends the straight way: a turn or a stop."""
    g = end_of_way(crowd, i)
    goal_x, goal_y = crowd.goals[i, g, 0], crowd.goals[i, g, 1]
    following = crowd.ends[i, (g + 1) % crowd.goal_count[i]]
    ax, ay = goal_x - crowd.from_x[i], goal_y - crowd.from_y[i]
    bx, by = crowd.goals[i, following, 0] - goal_x, crowd.goals[i, following, 1] - goal_y
    size = math.sqrt((ax * ax + ay * ay) * (bx * bx + by * by))
    share = 0.0
    if crowd.pauses[i, g] == 0.0 and crowd.start_pause[i] <= 0.0 and size > 1e-9:
        share = 0.5 + 0.5 * (ax * bx + ay * by) / size
    after = max(TURN_SHARE, share) * crowd.speed[i]
    left = max(0.0, distance_to(crowd, i, goal_x, goal_y) - crowd.goal_radius[i])
    return min(crowd.speed[i], math.sqrt(after * after + 2.0 * BRAKE_M_S2 * left))


@inner
def aim(crowd: Crowd, i: int) -> tuple[float, float]:
    """Return the point to steer for, farther on the straight way: `AHEAD_M`, or as far as people who anticipate look.

    Somebody pushed aside comes back to the line, which is clear of obstacles; soon where a wall is on the straight way
    to the point.
    """
    g = end_of_way(crowd, i)
    goal_x = crowd.goals[i, g, 0]
    goal_y = crowd.goals[i, g, 1]
    dx = goal_x - crowd.from_x[i]
    dy = goal_y - crowd.from_y[i]
    length = math.sqrt(dx * dx + dy * dy)
    if length < 1e-9:
        return goal_x, goal_y
    here = max(0.0, ((crowd.x[i] - crowd.from_x[i]) * dx + (crowd.y[i] - crowd.from_y[i]) * dy) / length)
    along = min(length, here + (crowd.manner.ahead_m if crowd.anticipates else AHEAD_M))
    x, y = crowd.from_x[i] + along * dx / length, crowd.from_y[i] + along * dy / length
    aside = abs((crowd.y[i] - crowd.from_y[i]) * dx - (crowd.x[i] - crowd.from_x[i]) * dy) / length
    if not crowd.anticipates or aside < ASIDE_M or is_clear(
        crowd.segments, crowd.nearest, crowd.inside, crowd.raster_x, crowd.raster_y, crowd.x[i], crowd.y[i], x, y,
        CLEAR_M,
    ):  # fmt: skip
        return x, y
    along = min(length, here + AHEAD_M)
    return crowd.from_x[i] + along * dx / length, crowd.from_y[i] + along * dy / length


@inner
def find_slow(crowd: Crowd) -> None:
    """Note who stands or is slow at the beginning of the tick: people walk around them."""
    count = 0
    for j in range(crowd.x.size):
        if not crowd.old_vx[j] ** 2 + crowd.old_vy[j] ** 2 > SLOW_M_S**2:
            crowd.slow[count] = j
            count += 1
    crowd.slow_count[0] = count


@inner
def around(crowd: Crowd, i: int, aim_x: float, aim_y: float) -> tuple[float, float]:
    """Return the point to steer for if somebody stands on the straight way to (aim_x, aim_y): beside them.

    People pass on the side that is nearer, on the right if both are, and on the other one where a wall is in the way.
    """
    x = crowd.old_x[i]
    y = crowd.old_y[i]
    distance = math.sqrt((aim_x - x) ** 2 + (aim_y - y) ** 2)
    if crowd.anticipates or distance < 1e-9:
        return aim_x, aim_y
    ex = (aim_x - x) / distance
    ey = (aim_y - y) / distance
    nearest = SEEN_M
    met = -1
    for k in range(crowd.slow_count[0]):
        j = crowd.slow[k]
        along = (crowd.old_x[j] - x) * ex + (crowd.old_y[j] - y) * ey
        if j == i or along <= 0.0 or along >= nearest:
            continue
        if abs((crowd.old_y[j] - y) * ex - (crowd.old_x[j] - x) * ey) < crowd.radius[i] + crowd.radius[j]:
            nearest = along
            met = j
    if met < 0:
        return aim_x, aim_y
    across = (crowd.old_y[met] - y) * ex - (crowd.old_x[met] - x) * ey
    away = crowd.radius[i] + crowd.radius[met] + BESIDE_M
    side = away if across < -BESIDE_M else -away
    for _ in range(2):
        px = crowd.old_x[met] - side * ey
        py = crowd.old_y[met] + side * ex
        qx, qy = off_walls(crowd, px, py)
        if abs(qx - px) + abs(qy - py) < 0.05:
            return px, py
        side = -side
    return aim_x, aim_y


@inner
def stand_at_place(crowd: Crowd, i: int, dt: float, social: bool, robot: RobotState) -> None:
    """Stand at the waypoint; step aside for a strong push only, and come back."""
    dx = crowd.place_x[i] - crowd.x[i]
    dy = crowd.place_y[i] - crowd.y[i]
    away = math.sqrt(dx * dx + dy * dy)
    if crowd.anticipates:
        gx, gy = way_given(crowd, i, robot, social)
        crowd.stands[i] = 1
        pace = min(crowd.speed[i], away / SETTLE_S) / away if away > 0.05 and gx == 0.0 and gy == 0.0 else 0.0
        vx, vy = at_gap(crowd, i, pace * dx + gx, pace * dy + gy, *gap_to_robot(crowd, i, robot))
        fx, fy = towards(crowd, i, vx, vy, robot)
        step(crowd, i, dt, fx, fy, crowd.speed[i])
        return
    push_x, push_y, _, _ = social_forces(crowd, i, False, social, robot)
    body_x, body_y = body_force(crowd, i, robot)
    push_x += body_x
    push_y += body_y
    push = math.sqrt(push_x * push_x + push_y * push_y)
    rest = max(0.0, 1.0 - STEADY_M_S2 / push) if push > 0.0 else 0.0
    crowd.stands[i] = 1
    if rest == 0.0 and away < 0.05 and crowd.old_vx[i] ** 2 + crowd.old_vy[i] ** 2 < 0.2**2:
        crowd.vx[i] = 0.0
        crowd.vy[i] = 0.0
        crowd.x[i], crowd.y[i] = off_walls(crowd, crowd.x[i], crowd.y[i])
        return
    pace = min(crowd.speed[i], away / SETTLE_S) / max(away, 1e-9)
    gain = min(crowd.factor_goal[i] / RELAXATION_S, 0.5 / dt)
    fx = gain * (pace * dx - crowd.old_vx[i]) + rest * push_x
    fy = gain * (pace * dy - crowd.old_vy[i]) + rest * push_y
    step(crowd, i, dt, fx, fy, crowd.speed[i])


@inner
def arrive(crowd: Crowd, i: int, t: float, dt: float, robot: RobotState) -> None:
    """Head for the next goal where this one is reached; keep count of the time without progress."""
    g = crowd.goal_index[i]
    goal_x = crowd.goals[i, g, 0]
    goal_y = crowd.goals[i, g, 1]
    away = distance_to(crowd, i, goal_x, goal_y)
    if crowd.stands[i] or crowd.reacting[i]:
        crowd.squeeze[i] = max(0.0, crowd.squeeze[i] - dt / SQUEEZE_S)
        if crowd.behaviour[i] == SCARED and crowd.reacting[i] and away <= crowd.goal_radius[i]:
            next_goal(crowd, i)
        return
    taken = crowd.idle[i] > PATIENCE_S and away <= TAKEN_M and _is_taken(crowd, i, goal_x, goal_y, robot)
    # Beyond the waypoint, on the present line.
    end = end_of_way(crowd, i)
    dx, dy = crowd.goals[i, end, 0] - crowd.from_x[i], crowd.goals[i, end, 1] - crowd.from_y[i]
    past = (crowd.x[i] - goal_x) * dx + (crowd.y[i] - goal_y) * dy > 0.0
    past = past and (g != end or (away <= PASSED_M and crowd.pauses[i, g] == 0.0))
    if away <= crowd.goal_radius[i] or taken or past:
        x = crowd.x[i]
        y = crowd.y[i]
        if crowd.start_pause[i] < 0.0 and math.isnan(crowd.reached[i, g]):
            crowd.reached[i, g] = t
            crowd.open[i, REACHED] = -1
            note_until(crowd, REACHED, i, t, t, x, y, float(g))
        crowd.open[i, STUCK] = -1
        next_goal(crowd, i)
        if taken:
            crowd.place_x[i] = x
            crowd.place_y[i] = y
        return
    if away < crowd.best[i] - PROGRESS_M:
        crowd.best[i] = away
        crowd.idle[i] = 0.0
        crowd.open[i, STUCK] = -1
    else:
        crowd.idle[i] += dt
    came = crowd.back[i] == 0 and (g > 0 or not math.isnan(crowd.reached[i, crowd.goal_count[i] - 1]))
    blocked = crowd.idle[i] > crowd.patience[i] and distance_to(crowd, i, robot.x, robot.y) < ROBOT_NEAR_M
    if crowd.anticipates and came and blocked:
        turn_back(crowd, i)
        return
    if crowd.idle[i] >= STUCK_S:
        note_until(crowd, STUCK, i, t - crowd.idle[i], t, crowd.x[i], crowd.y[i], float(g))
    change = dt if crowd.idle[i] > STUCK_S else -dt / SQUEEZE_S
    crowd.squeeze[i] = min(1.0, max(0.0, crowd.squeeze[i] + change))


@inner
def _is_taken(crowd: Crowd, i: int, x: float, y: float, robot: RobotState) -> bool:
    """Whether somebody else, or the robot, stands so near a point that a person cannot stand there."""
    for j in range(crowd.x.size):
        if j != i and distance_to(crowd, j, x, y) < crowd.radius[i] + crowd.radius[j] - crowd.goal_radius[i]:
            return True
    px, py, inside = on_outline(crowd.outline, x, y, robot.x, robot.y, robot.yaw)
    return inside or math.sqrt((px - x) ** 2 + (py - y) ** 2) < crowd.radius[i]
