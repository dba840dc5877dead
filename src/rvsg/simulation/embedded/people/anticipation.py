"""Anticipation: how people of the default profile keep clear of each other and of the robot before they meet.

People regulate the distance at which they expect to pass (Olivier et al., Minimal predicted distance, 2012) and act
ahead of time (Karamouzas, Skinner, Guy, Universal power law, 2014). Each person looks at the distance at closest
approach if they walked on as they prefer and the other as at present, and changes their velocity by what is missing to
the clearance they like over the time that is left, the sooner the more urgent. Whoever likes more room makes it.
`benchmarks/people.py` fits the numbers to recorded people.
"""

from __future__ import annotations

import math

from rvsg.core.kernels import inner
from rvsg.simulation.embedded.people.crowd import (
    IMPASSIVE,
    Anticipation,
    Crowd,
    RobotState,
)
from rvsg.simulation.embedded.people.obstacles import WALL_GAP_M, on_outline
from rvsg.simulation.embedded.people.social_force import body_force, total_force, wall_force, within

EVASION = 0.8
"""The most by which a person changes their velocity for others, as a share of the preferred speed."""
LEAST_PACE = 0.7
"""Somebody held up by who is ahead looks for a way past as if they walked at this share of their speed at least."""
CLOSE_S = 0.5
"""What is missing to a clearance is made up over this time at least."""
TOUCHING_M = 0.05
"""People of the same way keep this gap between bodies."""
STANDING_SHARE = 0.7
"""The share of the clearance that people keep from who stands."""
CROWD_M = 2.0
CROWD = 2.0
"""People make do with less room the more others there are ahead within `CROWD_M`: half of it for `CROWD` more."""
ABREAST = 0.6
ONCOMING_M_S = 0.2
"""Somebody is ahead who is within this share of both bodies off the way, and does not come towards the person."""
CLOSED_UP_M = 3.0
"""Who meets somebody oncoming within this distance closes up to whoever walks ahead, who clears the way."""
ROBOT_GAP_M = 0.3
"""The gap that people keep to a robot ahead."""
OFF_ROBOT_M = 3.0
STOP_S = 0.8
STOP_HORIZON_S = 2.0
BACK_M_S = 0.6
"""Within `OFF_ROBOT_M` people close the gap to the robot's body in `STOP_S` at the fastest, who looks less than
`STOP_HORIZON_S` ahead later; they step back from it at up to `BACK_M_S`."""
BRAKE_M_S2, LATE_M_S2, SUDDEN_M_S2 = 1.0, 2.0, 2.5
"""Who needs the first deceleration to stop before the robot's body, or before a trolley, brakes as hard as it takes.
Who looks less far ahead notices later, up to the second. The third is the most, also where the robot surprises."""
LEAST_GAP_M, AT_ONCE_S = 0.02, 0.1
AVOID_S, AVOID_REACH_M = 1.5, 6.0
AVOID_M = 0.05
AVOID_SHARE = 0.9
"""People avoid to come within `AVOID_M` of bodies within `AVOID_S`; each of two people does this share of the work."""
WALL_S = 0.9
"""People close the gap to a wall in `WALL_S` at the fastest, up to `WALL_GAP_M` between it and their centre."""
YIELD_M = 0.4
"""People who would pass close before the robot pass behind it, even where they would be first (Vassallo 2017)."""
STANDING_S = 1.5
STANDING_GAP_M = 0.1
"""Somebody who stands gives way to who would come within this gap within this time."""
NEAR_PUSH, TOUCH_PUSH = 0.6, 0.95
STEP_BACK_M_S = 0.3
"""Who stands steps back from a robot that comes within a hand (the share of the push of a body that touches), who does
not see it when it touches."""
COMPANY_M = 4.0
COMPANY_M_S = 0.5
"""Members of a group within this distance of its centre look for their place in it, up to this fast."""
DEPTH = 0.7
"""How far the middle of a group of three or four stays back, as a share of the distance between neighbours."""


@inner
def acceleration(
    crowd: Crowd, i: int, live: bool, goal_x: float, goal_y: float, goal_radius: float, speed: float,
    robot_in_social: bool, robot: RobotState,
) -> tuple[float, float]:  # fmt: skip
    """Return the acceleration of a person towards a goal by the model of the profile, m/s²; see `total_force`."""
    if not crowd.anticipates:
        return total_force(crowd, i, live, goal_x, goal_y, goal_radius, speed, robot_in_social, robot)
    dx = goal_x - crowd.old_x[i]
    dy = goal_y - crowd.old_y[i]
    distance = math.sqrt(dx * dx + dy * dy)
    ex = ey = 0.0
    if distance > max(goal_radius, 1e-9):
        sway = crowd.manner.sway_rad * math.sin(crowd.sway[i])
        ex = (dx * math.cos(sway) - dy * math.sin(sway)) / distance
        ey = (dx * math.sin(sway) + dy * math.cos(sway)) / distance
    pace = speed * headway(crowd, i, ex, ey, speed, robot_in_social, robot) if distance > goal_radius else 0.0
    bold = max(pace, LEAST_PACE * speed)
    vx, vy = evasion(crowd, i, bold * ex, bold * ey, robot_in_social, robot)
    gx, gy = formation(crowd, i, ex, ey)
    vx += pace * ex + gx
    vy += pace * ey + gy
    pull = speed / crowd.manner.relaxation_s
    fx, fy = wall_force(crowd, i)
    fx, fy = within(fx, fy, dx, dy, pull)
    if (robot.x - crowd.old_x[i]) ** 2 + (robot.y - crowd.old_y[i]) ** 2 < AVOID_REACH_M * AVOID_REACH_M:
        px, py = body_force(crowd, i, robot)
        px, py = within(px, py, dx, dy, pull)
        fx += px
        fy += py
    rate = gain(crowd, i)
    vx, vy = off_bodies(crowd, i, vx + fx / rate, vy + fy / rate, robot)
    vx, vy = at_gap(crowd, i, vx, vy, *gap_to_cart(crowd, i))
    vx, vy = at_gap(crowd, i, vx, vy, *gap_to_robot(crowd, i, robot))
    vx, vy = off_wall(crowd, i, vx, vy)
    return towards(crowd, i, vx, vy, robot)


@inner
def gap_to_robot(crowd: Crowd, i: int, robot: RobotState) -> tuple[float, float, float, float]:
    """Return the direction away from the robot's body, the gap that a person keeps to it, and its speed towards them.

    The gap is infinite for who does not see it, or is far away. To somebody impassive it is as a wall: they do not step
    back from it.
    """
    x, y = crowd.old_x[i], crowd.old_y[i]
    if crowd.horizon[i] <= 0.0 or (x - robot.x) ** 2 + (y - robot.y) ** 2 > OFF_ROBOT_M * OFF_ROBOT_M:
        return 0.0, 0.0, math.inf, 0.0
    px, py, inside = on_outline(crowd.outline, x, y, robot.x, robot.y, robot.yaw)
    dx, dy = x - px, y - py
    distance = math.sqrt(dx * dx + dy * dy)
    if inside or distance < 1e-6:
        return 0.0, 0.0, math.inf, 0.0
    nx, ny = dx / distance, dy / distance
    approach = 0.0 if crowd.behaviour[i] == IMPASSIVE else robot.vx * nx + robot.vy * ny
    return nx, ny, distance - crowd.radius[i] - TOUCHING_M, approach


@inner
def gap_to_cart(crowd: Crowd, i: int) -> tuple[float, float, float, float]:
    """Return the same of the nearest trolley or wheelchair, or of a pusher's own and the robot."""
    gap = math.sqrt(crowd.cart[i, 0] ** 2 + crowd.cart[i, 1] ** 2)
    if crowd.horizon[i] <= 0.0 or gap == 0.0:
        return 0.0, 0.0, math.inf, 0.0
    nx, ny = crowd.cart[i, 0] / gap, crowd.cart[i, 1] / gap
    return nx, ny, gap - TOUCHING_M, crowd.cart[i, 2] * nx + crowd.cart[i, 3] * ny


@inner
def at_gap(
    crowd: Crowd, i: int, vx: float, vy: float, nx: float, ny: float, gap: float, approach: float
) -> tuple[float, float]:
    """Return a velocity that closes a gap no faster than a person can stop, who steps back at `BACK_M_S` at most.

    `approach`: speed of the body along (nx, ny), towards the person.
    """
    look = STOP_S * min(1.0, crowd.horizon[i] / STOP_HORIZON_S)
    least = approach - gap / look
    least = min(least, BACK_M_S)
    away = vx * nx + vy * ny
    if away >= least:
        return vx, vy
    return vx + (least - away) * nx, vy + (least - away) * ny


@inner
def off_wall(crowd: Crowd, i: int, vx: float, vy: float) -> tuple[float, float]:
    """Return a velocity that does not close the gap to the nearest wall faster than a person can stop before it."""
    if crowd.obstacle_near[i] != 1:
        return vx, vy
    dx, dy = crowd.old_x[i] - crowd.obstacle_x[i], crowd.old_y[i] - crowd.obstacle_y[i]
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-6:
        return vx, vy
    too_fast = -(vx * dx + vy * dy) / distance - max(0.0, distance - WALL_GAP_M) / WALL_S
    if too_fast <= 0.0:
        return vx, vy
    return vx + too_fast * dx / distance, vy + too_fast * dy / distance


@inner
def off_bodies(crowd: Crowd, i: int, vx: float, vy: float, robot: RobotState) -> tuple[float, float]:
    """Return the velocity, changed as little as it takes to touch neither the robot nor others within `AVOID_S`.

    The members of a group do not avoid each other in this way. Who makes no room for the robot avoids its body only.
    """
    look = AVOID_S * min(1.0, crowd.horizon[i] / STOP_HORIZON_S)
    if look <= 0.0:
        return vx, vy
    for j in range(crowd.x.size):
        rx, ry = crowd.old_x[j] - crowd.old_x[i], crowd.old_y[j] - crowd.old_y[i]
        if rx * rx + ry * ry > AVOID_REACH_M * AVOID_REACH_M or j == i:
            continue
        if crowd.group[i] >= 0 and crowd.group[i] == crowd.group[j]:
            continue
        bodies = crowd.radius[i] + crowd.radius[j] + AVOID_M
        ux, uy = past_body(rx, ry, vx - crowd.old_vx[j], vy - crowd.old_vy[j], bodies, look)
        walks = crowd.old_vx[j] ** 2 + crowd.old_vy[j] ** 2 > ONCOMING_M_S**2
        share = AVOID_SHARE if walks else 1.0
        vx += share * ux
        vy += share * uy
    x, y = crowd.old_x[i], crowd.old_y[i]
    if (robot.x - x) ** 2 + (robot.y - y) ** 2 > AVOID_REACH_M * AVOID_REACH_M:
        return vx, vy
    reach = crowd.radius[i] + AVOID_M
    ux, uy = past_body(robot.x - x, robot.y - y, vx - robot.vx, vy - robot.vy, reach + crowd.robot_radius, look)
    vx += ux
    vy += uy
    px, py, inside = on_outline(crowd.outline, x, y, robot.x, robot.y, robot.yaw)
    if inside:
        return vx, vy
    ux, uy = past_body(px - x, py - y, vx - robot.vx, vy - robot.vy, reach, look)
    return vx + ux, vy + uy


@inner
def past_body(rx: float, ry: float, wx: float, wy: float, bodies: float, look: float) -> tuple[float, float]:
    """Return the least change of the relative velocity (wx, wy) after which nobody is touched within `look` seconds.

    The velocities that touch somebody at (rx, ry) form a cone with a round end (van den Berg et al., Reciprocal n-body
    collision avoidance, 2011). `bodies`: distance of centres at which both touch.
    """
    square = rx * rx + ry * ry
    closing = rx * wx + ry * wy
    if closing <= 0.0 or square < 1e-9:
        return 0.0, 0.0
    if square <= bodies * bodies:
        return -closing * rx / square, -closing * ry / square
    cx, cy = wx - rx / look, wy - ry / look
    length = math.sqrt(cx * cx + cy * cy)
    along = cx * rx + cy * ry
    if along < 0.0 and along * along > bodies * bodies * length * length:
        inside = bodies / look - length
        if inside <= 0.0 or length < 1e-9:
            return 0.0, 0.0
        return inside * cx / length, inside * cy / length
    leg = math.sqrt(square - bodies * bodies)
    side = 1.0 if rx * cy - ry * cx > 0.0 else -1.0
    ex, ey = (rx * leg - side * ry * bodies) / square, (ry * leg + side * rx * bodies) / square
    if side * (ex * wy - ey * wx) >= 0.0:
        return 0.0, 0.0
    outside = wx * ex + wy * ey
    return outside * ex - wx, outside * ey - wy


@inner
def gain(crowd: Crowd, i: int) -> float:
    """Return how fast a person takes on a velocity, 1/s."""
    return 0.5 * crowd.factor_goal[i] / crowd.manner.relaxation_s


@inner
def towards(crowd: Crowd, i: int, vx: float, vy: float, robot: RobotState) -> tuple[float, float]:
    """Return the acceleration to a velocity within a person's limits; they brake before what they would walk into."""
    rate = gain(crowd, i)
    fx, fy = limited(rate * (vx - crowd.old_vx[i]), rate * (vy - crowd.old_vy[i]), crowd.manner.acceleration_m_s2)
    fx, fy = braked(crowd, i, fx, fy, *gap_to_cart(crowd, i))
    return braked(crowd, i, fx, fy, *gap_to_robot(crowd, i, robot))


@inner
def braked(
    crowd: Crowd, i: int, fx: float, fy: float, nx: float, ny: float, gap: float, approach: float
) -> tuple[float, float]:
    """Return the acceleration, with the least change after which a person stops before a body."""
    own = -(crowd.old_vx[i] * nx + crowd.old_vy[i] * ny)
    closing = own + max(0.0, approach)
    along = fx * nx + fy * ny
    if gap <= 0.0:
        needed = min(SUDDEN_M_S2, own / AT_ONCE_S)
    elif gap == math.inf or own <= 0.0:
        return fx, fy
    else:
        needed = min(SUDDEN_M_S2, closing * closing / (2.0 * max(gap, LEAST_GAP_M)))
        if needed < min(LATE_M_S2, BRAKE_M_S2 * STOP_HORIZON_S / min(STOP_HORIZON_S, crowd.horizon[i])):
            return fx, fy
    if along >= needed:
        return fx, fy
    return fx + (needed - along) * nx, fy + (needed - along) * ny


@inner
def limited(x: float, y: float, most: float) -> tuple[float, float]:
    """Return a vector, shortened to a length."""
    length = math.sqrt(x * x + y * y)
    if length > most:
        return x * most / length, y * most / length
    return x, y


@inner
def evasion(crowd: Crowd, i: int, vx: float, vy: float, with_robot: bool, robot: RobotState) -> tuple[float, float]:
    """Return by how much a person changes the preferred velocity (vx, vy) to pass others and the robot, m/s."""
    sum_x = sum_y = 0.0
    x, y = crowd.old_x[i], crowd.old_y[i]
    horizon = crowd.horizon[i]
    speed = math.sqrt(vx * vx + vy * vy)
    reach = horizon * (speed + 2.0)
    manner = crowd.manner
    ux, uy, own = crowd.old_vx[i], crowd.old_vy[i], crowd.clearance[i]
    ahead = 0
    for j in range(crowd.x.size):
        rx = crowd.old_x[j] - x
        ry = crowd.old_y[j] - y
        if j != i and rx * rx + ry * ry < CROWD_M * CROWD_M and rx * vx + ry * vy > 0.0:
            ahead += 1
    room = 1.0 / (1.0 + max(0, ahead - 1) / CROWD)
    for j in range(crowd.x.size):
        rx = crowd.old_x[j] - x
        ry = crowd.old_y[j] - y
        if rx * rx + ry * ry > reach * reach or j == i:
            continue
        if crowd.group[i] >= 0 and crowd.group[i] == crowd.group[j]:
            continue
        bodies = crowd.radius[i] + crowd.radius[j] + TOUCHING_M
        clearance = bodies + room * (own - bodies)
        dx, dy = turn_off(
            manner, rx, ry, vx, vy, ux, uy, crowd.old_vx[j], crowd.old_vy[j], horizon, own, bodies, clearance, False
        )  # fmt: skip
        sum_x += dx
        sum_y += dy
    if with_robot:
        bodies = crowd.radius[i] + crowd.robot_radius + TOUCHING_M
        clearance = own + crowd.robot_radius - crowd.radius[i]
        dx, dy = turn_off(
            manner, robot.x - x, robot.y - y, vx, vy, ux, uy, robot.vx, robot.vy, horizon, own, bodies, clearance, True
        )  # fmt: skip
        sum_x += dx
        sum_y += dy
    return limited(sum_x, sum_y, EVASION * max(speed, 0.5))


@inner
def turn_off(
    manner: Anticipation, rx: float, ry: float, vx: float, vy: float, own_vx: float, own_vy: float, other_vx: float,
    other_vy: float, horizon: float, likes: float, bodies: float, clearance: float, is_robot: bool,
) -> tuple[float, float]:  # fmt: skip
    """Return the change of velocity to pass somebody at (rx, ry) from here at a clearance (m between centres).

    (vx, vy): the preferred velocity, (own_vx, own_vy) the present one. The clearance is for who comes the other way;
    people of the same way keep `bodies` only. Where ways cross, people act earlier and ask for more; who likes much
    room asks for far more: recorded distances spread wide there.
    """
    wx = other_vx - vx
    wy = other_vy - vy
    closing = -(rx * wx + ry * wy)
    square = wx * wx + wy * wy
    if closing <= 0.0 or square < 1e-6 or closing >= horizon * (1.0 + manner.earlier) * square:
        return 0.0, 0.0
    left = closing / square
    across = vx * other_vy - vy * other_vx
    faced = math.sqrt((vx * vx + vy * vy) * (other_vx * other_vx + other_vy * other_vy))
    sine = across / faced if faced > 0.0 else 0.0
    earlier = 1.0 + manner.earlier * sine * sine
    horizon *= earlier
    if left >= horizon:
        return 0.0, 0.0
    urgency = min(1.0, (horizon - left) / max(horizon - manner.first_s * earlier, 0.1))
    size = math.sqrt(square)
    nx = -wy / size
    ny = wx / size
    offset = rx * nx + ry * ny
    # Both see the present velocities alike, so both choose the same side.
    ux = other_vx - own_vx
    uy = other_vy - own_vy
    seen = (ry * ux - rx * uy) / max(math.sqrt(ux * ux + uy * uy), 1e-6)
    side = 1.0 if seen >= manner.keep_right_m else -1.0
    facing = STANDING_SHARE
    if is_robot:
        facing = 1.0
        if abs(offset) < YIELD_M and faced > 0.05 and abs(sine) > 0.5:
            # Behind the robot: its velocity points away from where the person passes.
            side = 1.0 if nx * other_vx + ny * other_vy >= 0.0 else -1.0
    elif faced > 0.0:
        facing = 0.5 - 0.5 * (vx * other_vx + vy * other_vy) / faced
        facing *= 1.0 + manner.crossing * (likes * abs(sine)) ** 3
    clearance = max(bodies, facing * clearance)
    missing = clearance - side * offset
    if missing <= 0.0:
        return 0.0, 0.0
    change = -side * missing * urgency / max(left, CLOSE_S)
    return change * nx, change * ny


@inner
def headway(crowd: Crowd, i: int, ex: float, ey: float, speed: float, with_robot: bool, robot: RobotState) -> float:
    """Return the share of a person's speed at which they keep their distance from who is ahead (Tordeux 2016)."""
    manner = crowd.manner
    full = manner.headway_s * speed
    if crowd.horizon[i] <= 0.0 or full <= 0.0:
        return 1.0
    x, y = crowd.old_x[i], crowd.old_y[i]
    free = full
    for j in range(crowd.x.size):
        rx, ry = crowd.old_x[j] - x, crowd.old_y[j] - y
        square = rx * rx + ry * ry
        along = rx * ex + ry * ey
        reach = crowd.radius[i] + crowd.radius[j] + manner.headway_m
        if j == i or along <= 0.0 or square > max(CLOSED_UP_M, full + reach) ** 2:
            continue
        pace = crowd.old_vx[j] * ex + crowd.old_vy[j] * ey
        if pace < -ONCOMING_M_S:
            if square < CLOSED_UP_M * CLOSED_UP_M:
                free = full
                break
        elif abs(ry * ex - rx * ey) <= ABREAST * (crowd.radius[i] + crowd.radius[j]):
            free = min(free, math.sqrt(square) - reach + manner.headway_ahead_s * max(0.0, pace))
    if with_robot:
        rx, ry = robot.x - x, robot.y - y
        bodies = crowd.radius[i] + crowd.robot_radius
        if rx * ex + ry * ey > 0.0 and abs(ry * ex - rx * ey) <= ABREAST * bodies:
            free = min(free, math.sqrt(rx * rx + ry * ry) - bodies - ROBOT_GAP_M)
    return max(0.0, free) / full


@inner
def formation(crowd: Crowd, i: int, ex: float, ey: float) -> tuple[float, float]:
    """Return the change of velocity to the own place in a group: two walk abreast, three in a V, four in a U.

    Moussaïd et al., The walking behaviour of pedestrian social groups (2010). People who are too far from the group
    to walk in it, or stand, do not look for their place.
    """
    group = crowd.group[i]
    if group < 0 or crowd.group_sum[group, 2] < 2.0 or (ex == 0.0 and ey == 0.0):
        return 0.0, 0.0
    members = crowd.group_sum[group, 2]
    cx = crowd.group_sum[group, 0] / members - crowd.old_x[i]
    cy = crowd.group_sum[group, 1] / members - crowd.old_y[i]
    if cx * cx + cy * cy > COMPANY_M * COMPANY_M:
        return 0.0, 0.0
    # Places are taken from the right in the order in which the members walk, so nobody crosses another's way.
    rank = 0
    mine = cx * ey - cy * ex
    for j in range(crowd.x.size):
        if j != i and crowd.group[j] == group:
            other = (crowd.old_x[i] + cx - crowd.old_x[j]) * ey - (crowd.old_y[i] + cy - crowd.old_y[j]) * ex
            if other < mine or (other == mine and j < i):
                rank += 1
    middle = 0.5 * (members - 1.0)
    aside = (rank - middle) * crowd.manner.formation_m
    behind = 0.0
    if members >= 3.0:
        behind = DEPTH * crowd.manner.formation_m * (2.0 / 3.0 - abs(rank - middle) / middle)
    gx = cx - aside * ey - behind * ex
    gy = cy + aside * ex - behind * ey
    return limited(gx, gy, COMPANY_M_S)


@inner
def way_given(crowd: Crowd, i: int, robot: RobotState, with_robot: bool) -> tuple[float, float]:
    """Return the velocity at which somebody who stands gives way to who would walk into them and to the robot, m/s."""
    sum_x = sum_y = 0.0
    x, y = crowd.old_x[i], crowd.old_y[i]
    n = crowd.x.size
    for j in range(n + 1):
        if j == i or (j == n and not with_robot):
            continue
        if j < n:
            rx, ry, wx, wy = crowd.old_x[j] - x, crowd.old_y[j] - y, crowd.old_vx[j], crowd.old_vy[j]
            room = crowd.radius[i] + crowd.radius[j] + STANDING_GAP_M
        else:
            rx, ry, wx, wy = robot.x - x, robot.y - y, robot.vx, robot.vy
            room = crowd.radius[i] + crowd.robot_radius + STANDING_GAP_M
        square = wx * wx + wy * wy
        closing = -(rx * wx + ry * wy)
        if square < 0.04 or closing <= 0.0 or closing > STANDING_S * square or crowd.horizon[i] <= 0.0:
            continue
        size = math.sqrt(square)
        offset = (ry * wx - rx * wy) / size
        side = 1.0 if offset >= crowd.manner.keep_right_m else -1.0
        missing = room - side * offset
        if missing > 0.0:
            change = -side * missing / max(closing / square, CLOSE_S)
            sum_x -= change * wy / size
            sum_y += change * wx / size
    sum_x, sum_y = limited(sum_x, sum_y, 1.0)
    fx, fy = body_force(crowd, i, robot)
    push = math.sqrt(fx * fx + fy * fy)
    if push > crowd.factor_obstacle[i] * (NEAR_PUSH if crowd.horizon[i] > 0.0 else TOUCH_PUSH):
        sum_x += STEP_BACK_M_S * fx / push
        sum_y += STEP_BACK_M_S * fy / push
    return sum_x, sum_y
