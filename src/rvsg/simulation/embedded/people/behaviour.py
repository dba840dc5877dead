"""One tick of all people: forces from one snapshot, then each human's behaviour, then its step."""

from __future__ import annotations

import math

from rvsg.simulation.embedded.compiled import kernel
from rvsg.simulation.embedded.people.crowd import Crowd
from rvsg.simulation.embedded.people.forces import (
    coherence_force,
    desired_force,
    gaze_force,
    obstacle_force,
    or_zero,
    reach_of,
    social_force,
    wrap,
)
from rvsg.simulation.embedded.people.obstacles import cell_of, on_segment, point_towards_origin, robot_surface

REGULAR, IMPASSIVE, SURPRISED, SCARED, CURIOUS, THREATENING = 1, 2, 3, 4, 5, 6
GOAL_RADIUS_M = 0.3
GOAL_MARGIN_M = 0.1
HALF_VIEW_RAD = math.pi / 2 + 0.17
CURIOUS_RANGE_M = 10.0
THREATENING_RANGE_M = 4.5
THREATENING_SPEED_M_S = 2.0
THREATENING_GOAL_RADIUS_M = 0.05
FACE_ROBOT_M = 0.6
SURPRISE_TURN_RAD_S = 0.1 * math.pi
SCARE_SIGMA_M = 0.2
SCARE_GAP_M = 0.1
YAW_STEP_RAD = math.radians(10.0)
WALL_GAP_M = 0.05
WAITED_S = 15.0


@kernel
def tick(
    crowd: Crowd, t_s: float, dt_s: float, robot_x: float, robot_y: float, robot_yaw: float, robot_v: float
) -> None:
    """Move everybody by one tick of dt_s (0.1 s in a run); the robot is at its present pose with forward speed robot_v.

    `t_s` is the time since the robot's start; a human stands still before its own start time. Changes `crowd` in
    place and allocates nothing.
    """
    n = crowd.x.size
    robot_vx = robot_v * math.cos(robot_yaw)
    robot_vy = robot_v * math.sin(robot_yaw)
    for i in range(n):
        crowd.logged_x[i] = crowd.old_x[i] = crowd.x[i]
        crowd.logged_y[i] = crowd.old_y[i] = crowd.y[i]
        crowd.logged_yaw[i] = crowd.yaw[i]
        crowd.old_vx[i] = crowd.vx[i]
        crowd.old_vy[i] = crowd.vy[i]
        speed = math.sqrt(crowd.vx[i] ** 2 + crowd.vy[i] ** 2)
        crowd.logged_speed[i] = min(speed, crowd.speed[i])
    _sum_groups(crowd)
    for i in range(n):
        _find_obstacle(crowd, i, robot_x, robot_y, robot_yaw)
    for i in range(n):
        if t_s < crowd.start_time[i] - 1e-9:
            crowd.vx[i] = 0.0
            crowd.vy[i] = 0.0
            if crowd.published and crowd.reacted[i] < 0.0 and _in_sight(crowd, i, robot_x, robot_y):
                # The study's people stood in sight of the robot for about 15 s while their timers already ran.
                crowd.reacted[i] = WAITED_S
            continue
        crowd.reacted[i] = max(0.0, crowd.reacted[i])
        if not _react(crowd, i, dt_s, robot_x, robot_y, robot_yaw):
            _walk(crowd, i, dt_s, robot_x, robot_y, robot_yaw, robot_vx, robot_vy)


@kernel
def _sum_groups(crowd: Crowd) -> None:
    """Sum of positions and number of members of every group."""
    crowd.group_sum[:] = 0.0
    for i in range(crowd.x.size):
        g = crowd.group[i]
        if g >= 0:
            crowd.group_sum[g, 0] += crowd.x[i]
            crowd.group_sum[g, 1] += crowd.y[i]
            crowd.group_sum[g, 2] += 1.0


@kernel
def _find_obstacle(crowd: Crowd, i: int, robot_x: float, robot_y: float, robot_yaw: float) -> None:
    """The obstacle point of a human, by the rule of the profile."""
    x = crowd.x[i]
    y = crowd.y[i]
    crowd.obstacle_near[i] = 0
    if crowd.published:
        ox, oy, found = point_towards_origin(
            x, y, crowd.height[i], crowd.boxes, crowd.origins, robot_x, robot_y, robot_yaw, crowd.robot_box,
            crowd.robot_height,
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


@kernel
def _total_force(
    crowd: Crowd,
    i: int,
    live: bool,
    goal_x: float,
    goal_y: float,
    goal_radius: float,
    speed: float,
    robot_in_social: bool,
    robot_x: float,
    robot_y: float,
    robot_yaw: float,
    robot_vx: float,
    robot_vy: float,
) -> tuple[float, float]:
    """Desired, social, obstacle and group force on a human, each zero where it is undefined.

    `live`: take the others where they are now rather than at the beginning of the tick (HuNavSim recomputes the
    forces of a reacting human after others have already moved). A goal radius of infinity means: no goal.
    """
    x = crowd.old_x[i]
    y = crowd.old_y[i]
    vx = crowd.old_vx[i]
    vy = crowd.old_vy[i]
    desired_x, desired_y = desired_force(goal_x - x, goal_y - y, goal_radius, vx, vy, speed, crowd.factor_goal[i])
    desired_x, desired_y = or_zero(desired_x, desired_y)

    reach = reach_of(crowd.factor_social[i], crowd.neglect)
    social_x = 0.0
    social_y = 0.0
    group = crowd.group[i]
    near_x = 0.0
    near_y = 0.0
    xs, ys, vxs, vys = crowd.old_x, crowd.old_y, crowd.old_vx, crowd.old_vy
    if live:
        xs, ys, vxs, vys = crowd.x, crowd.y, crowd.vx, crowd.vy
    for j in range(xs.size):
        if j == i:
            continue
        dx = xs[j] - x
        dy = ys[j] - y
        fx, fy = social_force(dx, dy, vx - vxs[j], vy - vys[j], crowd.factor_social[i], reach)
        if not crowd.published:
            fx, fy = or_zero(fx, fy)
        social_x += fx
        social_y += fy
        if group >= 0 and crowd.group[j] == group and math.sqrt(dx * dx + dy * dy) < crowd.radius[i] + crowd.radius[j]:
            near_x -= dx
            near_y -= dy
    if robot_in_social:
        fx, fy = social_force(robot_x - x, robot_y - y, vx - robot_vx, vy - robot_vy, crowd.factor_social[i], reach)
        if not crowd.published:
            fx, fy = or_zero(fx, fy)
        social_x += fx
        social_y += fy
    social_x, social_y = or_zero(social_x, social_y)

    solid_x, solid_y = _obstacle_forces(crowd, i, robot_x, robot_y, robot_yaw)
    group_x = 0.0
    group_y = 0.0
    if group >= 0 and crowd.group_sum[group, 2] >= 2.0:
        members = crowd.group_sum[group, 2]
        gx = crowd.group_sum[group, 0]
        gy = crowd.group_sum[group, 1]
        distance = math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)
        if distance > goal_radius:
            group_x, group_y = gaze_force(
                (goal_x - x) / distance,
                (goal_y - y) / distance,
                (gx - x) / (members - 1.0) - x,
                (gy - y) / (members - 1.0) - y,
            )
        fx, fy = coherence_force(gx / members - x, gy / members - y, int(members))
        group_x, group_y = or_zero(group_x + fx + near_x, group_y + fy + near_y)
    return desired_x + social_x + solid_x + group_x, desired_y + social_y + solid_y + group_y


@kernel
def _obstacle_forces(crowd: Crowd, i: int, robot_x: float, robot_y: float, robot_yaw: float) -> tuple[float, float]:
    """The push of the human's obstacle point; in the default profile also of the robot's body."""
    x = crowd.old_x[i]
    y = crowd.old_y[i]
    fx = 0.0
    fy = 0.0
    near = crowd.obstacle_near[i]
    if near != 0:
        dx = near * (x - crowd.obstacle_x[i])
        dy = near * (y - crowd.obstacle_y[i])
        fx, fy = obstacle_force(dx, dy, crowd.radius[i], crowd.factor_obstacle[i])
        fx, fy = or_zero(fx, fy)
    if not crowd.published:
        sx, sy = robot_surface(x, y, robot_x, robot_y, robot_yaw, crowd.robot_box)
        px, py = obstacle_force(x - sx, y - sy, crowd.radius[i], crowd.factor_obstacle[i])
        px, py = or_zero(px, py)
        fx += px
        fy += py
    return fx, fy


@kernel
def _walk(
    crowd: Crowd,
    i: int,
    dt: float,
    robot_x: float,
    robot_y: float,
    robot_yaw: float,
    robot_vx: float,
    robot_vy: float,
) -> None:
    """Walk towards the present goal, or stand at the last one while its pause lasts; the robot is one more human."""
    g = crowd.goal_index[i]
    pausing = crowd.pause_left[i] > 0.0
    if pausing:
        # Who is pushed aside during a pause comes back to its waypoint: it has work there.
        crowd.pause_left[i] -= dt
        g = (g - 1) % crowd.goal_count[i]
    goal_x = crowd.goals[i, g, 0]
    goal_y = crowd.goals[i, g, 1]
    if not pausing and crowd.published and _distance(crowd, i, goal_x, goal_y) <= GOAL_RADIUS_M + GOAL_MARGIN_M:
        # HuNavSim tests the goal with a margin before it moves, and then does not move in this tick.
        _next_goal(crowd, i)
        crowd.vx[i] = 0.0
        crowd.vy[i] = 0.0
        return
    # HuNavSim never makes an impassive human treat the robot as an obstacle: it walks like a regular one.
    social = crowd.published or crowd.behaviour[i] != IMPASSIVE
    fx, fy = _total_force(
        crowd,
        i,
        False,
        goal_x,
        goal_y,
        GOAL_RADIUS_M,
        crowd.speed[i],
        social,
        robot_x,
        robot_y,
        robot_yaw,
        robot_vx,
        robot_vy,
    )
    _step(crowd, i, dt, fx, fy, crowd.speed[i])
    if not pausing and _distance(crowd, i, goal_x, goal_y) <= GOAL_RADIUS_M:
        _next_goal(crowd, i)


@kernel
def _next_goal(crowd: Crowd, i: int) -> None:
    """Begin the pause of the goal that is reached and head for the next one."""
    g = crowd.goal_index[i]
    crowd.pause_left[i] = crowd.pauses[i, g]
    crowd.goal_index[i] = (g + 1) % crowd.goal_count[i]


@kernel
def _distance(crowd: Crowd, i: int, x: float, y: float) -> float:
    return math.sqrt((crowd.x[i] - x) ** 2 + (crowd.y[i] - y) ** 2)


@kernel
def _step(crowd: Crowd, i: int, dt: float, fx: float, fy: float, cap: float) -> None:
    """One semi-implicit Euler step with the speed capped; then the yaw follows the direction of motion."""
    vx = crowd.old_vx[i] + fx * dt
    vy = crowd.old_vy[i] + fy * dt
    speed = math.sqrt(vx * vx + vy * vy)
    if speed > cap:
        vx *= cap / speed
        vy *= cap / speed
    if not crowd.published:
        vx, vy = _keep_out_of_walls(crowd, i, dt, vx, vy)
    crowd.x[i] += vx * dt
    crowd.y[i] += vy * dt
    crowd.walked[i] += math.sqrt(vx * vx + vy * vy) * dt
    if crowd.published:
        _turn_published(crowd, i, 0.0 if vx == 0.0 and vy == 0.0 else math.atan2(vy, vx))
        # The plugin estimates the velocity from positions and caps each axis.
        if math.sqrt(vx * vx + vy * vy) > crowd.speed[i]:
            vx = max(-crowd.speed[i], min(crowd.speed[i], vx))
            vy = max(-crowd.speed[i], min(crowd.speed[i], vy))
    elif vx * vx + vy * vy > 0.05**2:
        # Half of the way per 0.1 s, at any tick length; nobody turns on the spot because they stopped.
        share = 1.0 - 0.5 ** (dt / 0.1)
        crowd.yaw[i] = wrap(crowd.yaw[i] + share * wrap(math.atan2(vy, vx) - crowd.yaw[i]))
    crowd.vx[i] = vx
    crowd.vy[i] = vy


@kernel
def _turn_published(crowd: Crowd, i: int, target: float) -> None:
    """The plugin shows at most half of a turn of more than 10° per tick."""
    turn = wrap(target - crowd.yaw[i])
    if abs(turn) > YAW_STEP_RAD:
        turn *= 0.5
    crowd.yaw[i] = wrap(crowd.yaw[i] + turn)


@kernel
def _keep_out_of_walls(crowd: Crowd, i: int, dt: float, vx: float, vy: float) -> tuple[float, float]:
    """The velocity without the part that would carry the human's centre into the nearest surface."""
    near = crowd.obstacle_near[i]
    x = crowd.x[i]
    y = crowd.y[i]
    if near == 1:
        nx = x - crowd.obstacle_x[i]
        ny = y - crowd.obstacle_y[i]
        distance = math.sqrt(nx * nx + ny * ny)
        if distance > 1e-9:
            nx /= distance
            ny /= distance
            slowest = -max(0.0, distance - WALL_GAP_M) / dt
            normal = vx * nx + vy * ny
            if normal < slowest:
                vx += (slowest - normal) * nx
                vy += (slowest - normal) * ny
    rows, columns = crowd.inside.shape
    row, column = cell_of(x + vx * dt, y + vy * dt, crowd.raster_x, crowd.raster_y, rows, columns)
    if near != -1 and row >= 0 and crowd.inside[row, column]:
        return 0.0, 0.0
    return vx, vy


@kernel
def _in_sight(crowd: Crowd, i: int, robot_x: float, robot_y: float) -> bool:
    """Whether a human with a reaction sees the robot: within its range and 99.7° of its yaw. Walls do not hide it."""
    kind = crowd.behaviour[i]
    if kind in (SURPRISED, SCARED):
        reach = crowd.react_distance[i]
    elif kind == CURIOUS:
        reach = CURIOUS_RANGE_M
    elif kind == THREATENING:
        reach = THREATENING_RANGE_M
    else:
        return False
    if _distance(crowd, i, robot_x, robot_y) > reach:
        return False
    bearing = math.atan2(robot_y - crowd.y[i], robot_x - crowd.x[i])
    return abs(wrap(bearing - crowd.yaw[i])) <= HALF_VIEW_RAD


@kernel
def _react(crowd: Crowd, i: int, dt: float, robot_x: float, robot_y: float, robot_yaw: float) -> bool:
    """React to the robot if it is in sight and time is left; says whether this was the human's tick.

    The time runs while the robot is in sight. `once`: spent for good; otherwise the reaction may begin anew.
    """
    if not _in_sight(crowd, i, robot_x, robot_y):
        return False
    crowd.reacted[i] += dt
    if crowd.expired[i]:
        return False
    if crowd.reacted[i] >= crowd.duration[i]:
        if crowd.once[i]:
            crowd.expired[i] = 1
        else:
            crowd.reacted[i] = 0.0
        return False
    kind = crowd.behaviour[i]
    if kind == SURPRISED:
        _be_surprised(crowd, i, dt, robot_x, robot_y)
    elif kind == SCARED:
        _be_scared(crowd, i, dt, robot_x, robot_y, robot_yaw)
    elif kind == CURIOUS:
        _be_curious(crowd, i, dt, robot_x, robot_y, robot_yaw)
    else:
        _be_threatening(crowd, i, dt, robot_x, robot_y, robot_yaw)
    return True


@kernel
def _stand(crowd: Crowd, i: int) -> None:
    crowd.vx[i] = 0.0
    crowd.vy[i] = 0.0


@kernel
def _be_surprised(crowd: Crowd, i: int, dt: float, robot_x: float, robot_y: float) -> None:
    """Stop and turn towards the robot at 18°/s."""
    _stand(crowd, i)
    error = wrap(math.atan2(robot_y - crowd.y[i], robot_x - crowd.x[i]) - crowd.yaw[i])
    if crowd.published:
        # A fixed step per tick, whatever its length; to the right it is taken in full even past the robot.
        step = 0.01 * math.pi
        turn = min(error, step) if error > 0.0 else -step
        crowd.yaw[i] = wrap(crowd.yaw[i] + turn)
        return
    step = SURPRISE_TURN_RAD_S * dt
    crowd.yaw[i] = wrap(crowd.yaw[i] + max(-step, min(step, error)))


@kernel
def _be_scared(crowd: Crowd, i: int, dt: float, robot_x: float, robot_y: float, robot_yaw: float) -> None:
    """Keep to the goal more slowly, pushed away from the robot by force·0.2 m/gap."""
    g = crowd.goal_index[i]
    fx, fy = _total_force(
        crowd,
        i,
        crowd.published,
        crowd.goals[i, g, 0],
        crowd.goals[i, g, 1],
        GOAL_RADIUS_M,
        crowd.react_speed[i],
        False,
        robot_x,
        robot_y,
        robot_yaw,
        0.0,
        0.0,
    )
    dx = crowd.x[i] - robot_x
    dy = crowd.y[i] - robot_y
    distance = math.sqrt(dx * dx + dy * dy)
    gap = distance - crowd.radius[i]
    if not crowd.published:
        # HuNavSim's gap passes zero and turns the flight into an attraction.
        gap = max(gap, SCARE_GAP_M)
    size = crowd.react_force[i] * SCARE_SIGMA_M / gap
    sx, sy = or_zero(size * dx / distance, size * dy / distance)
    _step(crowd, i, dt, fx + sx, fy + sy, crowd.react_speed[i])
    if _distance(crowd, i, crowd.goals[i, g, 0], crowd.goals[i, g, 1]) <= GOAL_RADIUS_M:
        _next_goal(crowd, i)


@kernel
def _be_curious(crowd: Crowd, i: int, dt: float, robot_x: float, robot_y: float, robot_yaw: float) -> None:
    """Approach the robot, slower the nearer it is, stop at a distance and look at it."""
    distance = _distance(crowd, i, robot_x, robot_y)
    if distance <= crowd.react_distance[i]:
        _stand(crowd, i)
        crowd.yaw[i] = math.atan2(robot_y - crowd.y[i], robot_x - crowd.x[i])
        return
    speed = crowd.react_speed[i] * distance / CURIOUS_RANGE_M
    fx, fy = _total_force(
        crowd,
        i,
        crowd.published,
        robot_x,
        robot_y,
        crowd.robot_radius,
        speed,
        False,
        robot_x,
        robot_y,
        robot_yaw,
        0.0,
        0.0,
    )
    _step(crowd, i, dt, fx, fy, speed)


@kernel
def _be_threatening(crowd: Crowd, i: int, dt: float, robot_x: float, robot_y: float, robot_yaw: float) -> None:
    """Hurry to a point in front of the robot and block it."""
    ahead_x = math.cos(robot_yaw)
    ahead_y = math.sin(robot_yaw)
    if crowd.published:
        # Sine and cosine are swapped: the point is mirrored about the 45° line.
        ahead_x, ahead_y = ahead_y, ahead_x
    goal_x = robot_x + crowd.react_distance[i] * ahead_x
    goal_y = robot_y + crowd.react_distance[i] * ahead_y
    fx, fy = _total_force(
        crowd,
        i,
        crowd.published,
        goal_x,
        goal_y,
        THREATENING_GOAL_RADIUS_M,
        THREATENING_SPEED_M_S,
        False,
        robot_x,
        robot_y,
        robot_yaw,
        0.0,
        0.0,
    )
    _step(crowd, i, dt, fx, fy, THREATENING_SPEED_M_S)
    if _distance(crowd, i, robot_x, robot_y) <= FACE_ROBOT_M:
        crowd.yaw[i] = math.atan2(robot_y - crowd.y[i], robot_x - crowd.x[i])
