"""The forces of the social force model as HuNavSim's lightsfm computes them. Unit mass: a force is an acceleration.

Sources: Moussaïd et al., Experimental study of the behavioural mechanisms underlying self-organization in human
crowds (2009) for the social force; Moussaïd et al., The walking behaviour of pedestrian social groups (2010) for the
group force. The constants are lightsfm's defaults.
"""

from __future__ import annotations

import math

from rvsg.core.kernels import inner, kernel
from rvsg.simulation.embedded.people.crowd import Crowd, RobotState
from rvsg.simulation.embedded.people.obstacles import cell_of, on_outline, on_segment, point_towards_origin

LAMBDA = 2.0
GAMMA = 0.35
N_ANGLE = 2.0
N_SPEED = 3.0
SIGMA_OBSTACLE_M = 0.2
RELAXATION_S = 0.5
GAZE = 3.0
COHERENCE = 2.0


@kernel
def wrap(angle: float) -> float:
    """The angle in (-π, π]."""
    while angle <= -math.pi:
        angle += 2.0 * math.pi
    while angle > math.pi:
        angle -= 2.0 * math.pi
    return angle


@kernel
def desired_force(
    dx: float, dy: float, goal_radius: float, vx: float, vy: float, speed: float, factor: float
) -> tuple[float, float]:
    """Pull towards a goal at (dx, dy) from here, m/s²: factor (speed·e - v) / 0.5 s; a brake where it is reached."""
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > goal_radius:
        return (
            factor * (speed * dx / distance - vx) / RELAXATION_S,
            factor * (speed * dy / distance - vy) / RELAXATION_S,
        )
    return -vx / RELAXATION_S, -vy / RELAXATION_S


@kernel
def obstacle_force(dx: float, dy: float, radius: float, factor: float) -> tuple[float, float]:
    """Push away from an obstacle point; (dx, dy) points from it to the human. factor·exp(-(d - radius)/0.2 m)."""
    distance = math.sqrt(dx * dx + dy * dy)
    size = factor * math.exp(-(distance - radius) / SIGMA_OBSTACLE_M)
    return size * dx / distance, size * dy / distance


@inner
def pair_force(dx: float, dy: float, dvx: float, dvy: float, reach: float, aside: bool) -> tuple[float, float, float]:
    """Return the push of `social_force` for a factor of 1, and the exponent that is compared with a person's reach.

    The other person of the pair is pushed by the same, the other way: both see the same angle and the same distance.
    `reach` is the larger one of both; beyond it the exponent is infinite.
    """
    distance = math.sqrt(dx * dx + dy * dy)
    ex = dx / distance
    ey = dy / distance
    ix = LAMBDA * dvx + ex
    iy = LAMBDA * dvy + ey
    length = math.sqrt(ix * ix + iy * iy)
    b = GAMMA * length
    tx = ix / length
    ty = iy / length
    decay = distance / b
    sine = N_ANGLE * b * (tx * ey - ty * ex)
    exponent = decay + sine * sine
    if exponent > reach:
        return 0.0, 0.0, math.inf
    theta = math.atan2(tx * ey - ty * ex, tx * ex + ty * ey)
    speed_angle = N_SPEED * b * theta
    turn_angle = N_ANGLE * b * theta
    along = -math.exp(-decay - speed_angle * speed_angle)
    across = -math.exp(-decay - turn_angle * turn_angle)
    if theta < 0.0:
        across = -across
    elif theta == 0.0 and not aside:
        across = 0.0
    return along * tx - across * ty, along * ty + across * tx, exponent


@kernel
def social_force(
    dx: float, dy: float, dvx: float, dvy: float, factor: float, reach: float, aside: bool = False
) -> tuple[float, float]:
    """Return the push of another person at (dx, dy) from here; (dvx, dvy) is own velocity less the other's.

    With ê the direction to the other, I = 2 (v - v_j) + ê, B = 0.35 |I| and θ the angle from I to ê:
    -exp(-D/B - (3Bθ)²) along I and -sign(θ) exp(-D/B - (2Bθ)²) across it.
    `reach` bounds the exponent (infinity: no bound): a pair beyond it is weaker than √2·factor·exp(-reach) and counts
    as zero, because |θ| >= |sin θ|. `aside`: at θ = 0, where the model has no sideways push, push to the right; two
    people who meet head-on would otherwise stop each other.
    """
    fx, fy, _ = pair_force(dx, dy, dvx, dvy, reach, aside)
    return factor * fx, factor * fy


@inner
def is_beyond(dx: float, dy: float, dvx: float, dvy: float, reach: float) -> bool:
    """Whether `social_force` is surely zero, told without a division or a branch: most pairs are. Room for rounding.

    With d the way to the other and v the relative velocity, I x ê = 2 (v x d) / |d| and |I|² = 4 |v|² + 1 +
    4 (v · d) / |d|. Both tests of `social_force` are taken times a power of |d|.
    """
    square = dx * dx + dy * dy
    cross = N_ANGLE * GAMMA * LAMBDA * (dvx * dy - dvy * dx)
    rest = (1.00001 * reach + 1e-5) * square - cross * cross
    moving = LAMBDA * LAMBDA * (dvx * dvx + dvy * dvy)
    room = 1.0001 * GAMMA * GAMMA * rest * rest
    cube = square * square * square
    distance = math.sqrt(square)
    along = (moving + 1.0001) * distance + 2.0 * LAMBDA * (dvx * dx + dvy * dy)
    return (rest < 0.0) | (cube > room * (2.0 * moving + 2.0)) | (cube * distance > room * along)


@kernel
def reach_of(factor: float, neglect: float) -> float:
    """The exponent beyond which a pair's force is below `neglect` (m/s²); infinity where nothing is neglected."""
    return math.log(math.sqrt(2.0) * factor / neglect) if neglect > 0.0 and factor > 0.0 else math.inf


@kernel
def gaze_force(ex: float, ey: float, cx: float, cy: float) -> tuple[float, float]:
    """Pull back towards the other members (centre at (cx, cy) from here) where they are out of sight behind."""
    along = ex * cx + ey * cy
    if along >= 0.0:
        return 0.0, 0.0
    return GAZE * along * ex, GAZE * along * ey


@kernel
def coherence_force(cx: float, cy: float, members: int) -> tuple[float, float]:
    """Pull towards the centre of the whole group at (cx, cy) from here, growing beyond (members - 1)/2 metres."""
    distance = math.sqrt(cx * cx + cy * cy)
    size = COHERENCE * 0.5 * (1.0 + math.tanh(distance - (members - 1) / 2.0))
    return size * cx, size * cy


@kernel
def or_zero(fx: float, fy: float) -> tuple[float, float]:
    """The force, or none where it is undefined (two at the very same spot)."""
    if math.isfinite(fx) and math.isfinite(fy):
        return fx, fy
    return 0.0, 0.0


WALL_AGAINST = 0.2
WALL_SHARE = 0.5
"""The push of a wall is at most `WALL_SHARE` of the pull towards the goal, and `WALL_AGAINST` of it in the opposite
direction. The unlimited push stops everybody who walks slowly in a narrow place."""


@inner
def sum_groups(crowd: Crowd) -> None:
    """Sum the positions and count the members of every group."""
    crowd.group_sum[:] = 0.0
    for i in range(crowd.x.size):
        g = crowd.group[i]
        if g >= 0:
            crowd.group_sum[g, 0] += crowd.x[i]
            crowd.group_sum[g, 1] += crowd.y[i]
            crowd.group_sum[g, 2] += 1.0


@inner
def find_obstacle(crowd: Crowd, i: int, robot: RobotState) -> None:
    """Find a person's obstacle point by the rule of the profile."""
    x = crowd.x[i]
    y = crowd.y[i]
    crowd.obstacle_near[i] = 0
    if crowd.published:
        ox, oy, found = point_towards_origin(
            x, y, crowd.height[i], crowd.boxes, crowd.origins, robot.x, robot.y, robot.yaw, crowd.robot_box,
            crowd.robot_height
        )  # fmt: skip
        if found:
            crowd.obstacle_x[i] = ox
            crowd.obstacle_y[i] = oy
            crowd.obstacle_near[i] = 1
        return
    rows, columns = crowd.nearest.shape
    row, column = cell_of(x, y, crowd.raster_x, crowd.raster_y, rows, columns)
    if row < 0:
        return
    s = crowd.nearest[row, column]
    if s < 0:
        return
    ax, ay, bx, by = crowd.segments[s, 0], crowd.segments[s, 1], crowd.segments[s, 2], crowd.segments[s, 3]
    crowd.obstacle_x[i], crowd.obstacle_y[i] = on_segment(x, y, ax, ay, bx, by)
    crowd.obstacle_near[i] = -1 if crowd.inside[row, column] else 1


@inner
def push_pairs(crowd: Crowd) -> None:
    """Work out how all people push each other at the beginning of the tick, each pair once (default profile).

    Each person's pushes are added up in the order of the others' numbers, as `social_forces` does it.
    """
    xs, ys, vxs, vys = crowd.old_x, crowd.old_y, crowd.old_vx, crowd.old_vy
    push_x, push_y, reaches, groups, beyond = crowd.push_x, crowd.push_y, crowd.reach, crowd.group, crowd.beyond
    n = xs.size
    for i in range(n):
        push_x[i] = push_y[i] = crowd.near_x[i] = crowd.near_y[i] = 0.0
        reaches[i] = reach_of(crowd.factor_social[i], crowd.neglect)
    for i in range(n):
        x, y, vx, vy, reach, group = xs[i], ys[i], vxs[i], vys[i], reaches[i], groups[i]
        factor = crowd.factor_social[i]
        for j in range(i + 1, n):
            larger = reach if reach > reaches[j] else reaches[j]
            beyond[j] = is_beyond(xs[j] - x, ys[j] - y, vx - vxs[j], vy - vys[j], larger)
        if group >= 0:
            push_members(crowd, i)
        sum_x = push_x[i]
        sum_y = push_y[i]
        for j in range(i + 1, n):
            if beyond[j]:
                continue
            larger = reach if reach > reaches[j] else reaches[j]
            fx, fy, exponent = pair_force(xs[j] - x, ys[j] - y, vx - vxs[j], vy - vys[j], larger, True)
            if not exponent > reach:
                gx, gy = or_zero(factor * fx, factor * fy)
                sum_x += gx
                sum_y += gy
            if not exponent > reaches[j]:
                gx, gy = or_zero(crowd.factor_social[j] * fx, crowd.factor_social[j] * fy)
                push_x[j] -= gx
                push_y[j] -= gy
        push_x[i] = sum_x
        push_y[i] = sum_y


@inner
def push_members(crowd: Crowd, i: int) -> None:
    """Let a person and the later members of their group push each other where they stand too near."""
    xs, ys = crowd.old_x, crowd.old_y
    for j in range(i + 1, xs.size):
        dx = xs[j] - xs[i]
        dy = ys[j] - ys[i]
        if crowd.group[j] == crowd.group[i] and math.sqrt(dx * dx + dy * dy) < crowd.radius[i] + crowd.radius[j]:
            crowd.near_x[i] -= dx
            crowd.near_y[i] -= dy
            crowd.near_x[j] += dx
            crowd.near_y[j] += dy


@inner
def social_forces(
    crowd: Crowd, i: int, live: bool, robot_in_social: bool, robot: RobotState
) -> tuple[float, float, float, float]:
    """Return the push of all others, and the push of members of the own group who stand too near.

    `live`: take the others where they are now rather than at the beginning of the tick.
    """
    x, y, vx, vy = crowd.old_x[i], crowd.old_y[i], crowd.old_vx[i], crowd.old_vy[i]
    factor = crowd.factor_social[i]
    reach = crowd.reach[i]
    social_x = crowd.push_x[i]
    social_y = crowd.push_y[i]
    near_x = crowd.near_x[i]
    near_y = crowd.near_y[i]
    if crowd.published:
        reach = reach_of(factor, crowd.neglect)
        social_x = social_y = near_x = near_y = 0.0
        group, groups = crowd.group[i], crowd.group
        xs, ys, vxs, vys = crowd.old_x, crowd.old_y, crowd.old_vx, crowd.old_vy
        if live:
            xs, ys, vxs, vys = crowd.x, crowd.y, crowd.vx, crowd.vy
        for j in range(xs.size):
            if j == i:
                continue
            dx = xs[j] - x
            dy = ys[j] - y
            if group >= 0 and groups[j] == group and math.sqrt(dx * dx + dy * dy) < crowd.radius[i] + crowd.radius[j]:
                near_x -= dx
                near_y -= dy
            if is_beyond(dx, dy, vx - vxs[j], vy - vys[j], reach):
                continue
            fx, fy = social_force(dx, dy, vx - vxs[j], vy - vys[j], factor, reach, False)
            social_x += fx
            social_y += fy
    if robot_in_social:
        fx, fy = social_force(
            robot.x - x, robot.y - y, vx - robot.vx, vy - robot.vy, factor, reach, not crowd.published
        )
        if not crowd.published:
            fx, fy = or_zero(fx, fy)
        social_x += fx
        social_y += fy
    social_x, social_y = or_zero(social_x, social_y)
    return social_x, social_y, near_x, near_y


@inner
def total_force(
    crowd: Crowd, i: int, live: bool, goal_x: float, goal_y: float, goal_radius: float, speed: float,
    robot_in_social: bool, robot: RobotState,
) -> tuple[float, float]:  # fmt: skip
    """Return the sum of desired, social, obstacle and group force on a person, each zero where it is undefined.

    `live`: take the others where they are now rather than at the beginning of the tick (HuNavSim recomputes the
    forces of a reacting person after others have already moved). A goal radius of infinity means: no goal.
    """
    x = crowd.old_x[i]
    y = crowd.old_y[i]
    factor = crowd.factor_goal[i]
    desired_x, desired_y = or_zero(
        *desired_force(goal_x - x, goal_y - y, goal_radius, crowd.old_vx[i], crowd.old_vy[i], speed, factor)
    )
    social_x, social_y, near_x, near_y = social_forces(crowd, i, live, robot_in_social, robot)
    solid_x, solid_y = wall_force(crowd, i)
    if not crowd.published:
        solid_x, solid_y = within(solid_x, solid_y, goal_x - x, goal_y - y, factor * speed / RELAXATION_S)
        px, py = body_force(crowd, i, robot)
        solid_x += px
        solid_y += py
    group_x, group_y = group_force(crowd, i, goal_x, goal_y, goal_radius, near_x, near_y)
    return desired_x + social_x + solid_x + group_x, desired_y + social_y + solid_y + group_y


@inner
def group_force(
    crowd: Crowd, i: int, goal_x: float, goal_y: float, goal_radius: float, near_x: float, near_y: float
) -> tuple[float, float]:
    """Return what keeps the members of a group together; `near` is the push of members who stand too near."""
    group = crowd.group[i]
    if group < 0 or crowd.group_sum[group, 2] < 2.0:
        return 0.0, 0.0
    x, y = crowd.old_x[i], crowd.old_y[i]
    gx, gy, members = crowd.group_sum[group, 0], crowd.group_sum[group, 1], crowd.group_sum[group, 2]
    group_x = 0.0
    group_y = 0.0
    distance = math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)
    if distance > goal_radius:
        group_x, group_y = gaze_force(
            (goal_x - x) / distance, (goal_y - y) / distance, (gx - x) / (members - 1.0) - x,
            (gy - y) / (members - 1.0) - y,
        )  # fmt: skip
    fx, fy = coherence_force(gx / members - x, gy / members - y, int(members))
    return or_zero(group_x + fx + near_x, group_y + fy + near_y)


@inner
def wall_force(crowd: Crowd, i: int) -> tuple[float, float]:
    """Return the push of the person's obstacle point."""
    near = crowd.obstacle_near[i]
    if near == 0:
        return 0.0, 0.0
    dx = near * (crowd.old_x[i] - crowd.obstacle_x[i])
    dy = near * (crowd.old_y[i] - crowd.obstacle_y[i])
    fx, fy = obstacle_force(dx, dy, crowd.radius[i], crowd.factor_obstacle[i])
    return or_zero(fx, fy)


@inner
def body_force(crowd: Crowd, i: int, robot: RobotState) -> tuple[float, float]:
    """Return the push of the robot's body, as of an obstacle."""
    x = crowd.old_x[i]
    y = crowd.old_y[i]
    sx, sy, _ = on_outline(crowd.outline, x, y, robot.x, robot.y, robot.yaw)
    fx, fy = obstacle_force(x - sx, y - sy, crowd.radius[i], crowd.factor_obstacle[i])
    return or_zero(fx, fy)


@inner
def within(fx: float, fy: float, dx: float, dy: float, pull: float) -> tuple[float, float]:
    """Return the push of a wall within its share of the pull (m/s²) in the direction (dx, dy)."""
    size = math.sqrt(fx * fx + fy * fy)
    if size > WALL_SHARE * pull:
        fx *= WALL_SHARE * pull / size
        fy *= WALL_SHARE * pull / size
    distance = math.sqrt(dx * dx + dy * dy)
    if distance == 0.0:
        return fx, fy
    too_much = -(fx * dx + fy * dy) / distance - WALL_AGAINST * pull
    if too_much <= 0.0:
        return fx, fy
    return fx + too_much * dx / distance, fy + too_much * dy / distance
