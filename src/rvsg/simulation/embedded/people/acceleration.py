"""The acceleration of one person: the sum of the model's forces, by the rules of the profile."""

from __future__ import annotations

import math

from rvsg.core.kernels import inner
from rvsg.simulation.embedded.people.crowd import Crowd
from rvsg.simulation.embedded.people.forces import (
    RELAXATION_S,
    coherence_force,
    desired_force,
    gaze_force,
    is_beyond,
    obstacle_force,
    or_zero,
    pair_force,
    reach_of,
    social_force,
)
from rvsg.simulation.embedded.people.obstacles import cell_of, on_outline, on_segment, point_towards_origin

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
def find_obstacle(crowd: Crowd, i: int, robot_x: float, robot_y: float, robot_yaw: float) -> None:
    """Find a person's obstacle point by the rule of the profile."""
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
            fx, fy, exponent = pair_force(xs[j] - x, ys[j] - y, vx - vxs[j], vy - vys[j], larger)
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
def pushes_on(
    crowd: Crowd, i: int, robot_in_social: bool, robot_x: float, robot_y: float, robot_vx: float, robot_vy: float
) -> tuple[float, float, float, float]:
    """Return what `social_forces` does, from what `push_pairs` has worked out."""
    social_x = crowd.push_x[i]
    social_y = crowd.push_y[i]
    if robot_in_social:
        fx, fy = social_force(
            robot_x - crowd.old_x[i], robot_y - crowd.old_y[i], crowd.old_vx[i] - robot_vx, crowd.old_vy[i] - robot_vy,
            crowd.factor_social[i], crowd.reach[i], True,
        )  # fmt: skip
        fx, fy = or_zero(fx, fy)
        social_x += fx
        social_y += fy
    social_x, social_y = or_zero(social_x, social_y)
    return social_x, social_y, crowd.near_x[i], crowd.near_y[i]


@inner
def social_forces(
    crowd: Crowd,
    i: int,
    live: bool,
    robot_in_social: bool,
    robot_x: float,
    robot_y: float,
    robot_vx: float,
    robot_vy: float,
) -> tuple[float, float, float, float]:
    """Return the push of all others, and the push of members of the own group who stand too near.

    `live`: take the others where they are now rather than at the beginning of the tick.
    """
    if not crowd.published:
        return pushes_on(crowd, i, robot_in_social, robot_x, robot_y, robot_vx, robot_vy)
    x = crowd.old_x[i]
    y = crowd.old_y[i]
    vx = crowd.old_vx[i]
    vy = crowd.old_vy[i]
    factor = crowd.factor_social[i]
    reach = reach_of(factor, crowd.neglect)
    social_x = 0.0
    social_y = 0.0
    group = crowd.group[i]
    near_x = 0.0
    near_y = 0.0
    xs, ys, vxs, vys = crowd.old_x, crowd.old_y, crowd.old_vx, crowd.old_vy
    if live:
        xs, ys, vxs, vys = crowd.x, crowd.y, crowd.vx, crowd.vy
    groups = crowd.group
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
        fx, fy = social_force(robot_x - x, robot_y - y, vx - robot_vx, vy - robot_vy, factor, reach, False)
        social_x += fx
        social_y += fy
    social_x, social_y = or_zero(social_x, social_y)
    return social_x, social_y, near_x, near_y


@inner
def total_force(
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
    """Return the sum of desired, social, obstacle and group force on a person, each zero where it is undefined.

    `live`: take the others where they are now rather than at the beginning of the tick (HuNavSim recomputes the
    forces of a reacting person after others have already moved). A goal radius of infinity means: no goal.
    """
    x = crowd.old_x[i]
    y = crowd.old_y[i]
    factor = crowd.factor_goal[i]
    desired_x, desired_y = desired_force(
        goal_x - x, goal_y - y, goal_radius, crowd.old_vx[i], crowd.old_vy[i], speed, factor
    )
    desired_x, desired_y = or_zero(desired_x, desired_y)
    social_x, social_y, near_x, near_y = social_forces(
        crowd, i, live, robot_in_social, robot_x, robot_y, robot_vx, robot_vy
    )
    solid_x, solid_y = wall_force(crowd, i)
    if not crowd.published:
        solid_x, solid_y = within(solid_x, solid_y, goal_x - x, goal_y - y, factor * speed / RELAXATION_S)
        px, py = body_force(crowd, i, robot_x, robot_y, robot_yaw)
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
    x = crowd.old_x[i]
    y = crowd.old_y[i]
    group_x = 0.0
    group_y = 0.0
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
def body_force(crowd: Crowd, i: int, robot_x: float, robot_y: float, robot_yaw: float) -> tuple[float, float]:
    """Return the push of the robot's body, as of an obstacle."""
    x = crowd.old_x[i]
    y = crowd.old_y[i]
    sx, sy, _ = on_outline(crowd.outline, x, y, robot_x, robot_y, robot_yaw)
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
