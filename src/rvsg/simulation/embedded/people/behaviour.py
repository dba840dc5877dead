"""One tick of all people: forces from one snapshot, then each human's behaviour, then its step."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from rvsg.core.kernels import inner, kernel
from rvsg.core.references import refer
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.embedded.people.anticipation import SUDDEN_M_S2, acceleration, limited
from rvsg.simulation.embedded.people.contact import TOUCH_M, may_touch, note_overlap, note_touch, robot_gap, separate
from rvsg.simulation.embedded.people.crowd import (
    CURIOUS,
    IMPASSIVE,
    PERIOD_S,
    REACTED,
    SCARED,
    SURPRISED,
    THREATENING,
    Crowd,
    PeopleOptions,
    RobotState,
    initial,
    note_until,
)
from rvsg.simulation.embedded.people.motion import (
    advance,
    aim,
    around,
    arrive,
    distance_to,
    find_slow,
    next_goal,
    stand_at_place,
    step,
    walk,
    walk_published,
)
from rvsg.simulation.embedded.people.social_force import (
    find_obstacle,
    or_zero,
    push_pairs,
    sum_groups,
    wrap,
)
from rvsg.world.world import World

HALF_VIEW_RAD = math.pi / 2 + 0.17
CURIOUS_RANGE_M = 10.0
THREATENING_RANGE_M = 4.5
THREATENING_SPEED_M_S = 2.0
THREATENING_GOAL_RADIUS_M = 0.05
FACE_ROBOT_M = 0.6
SURPRISE_TURN_RAD_S = 0.1 * math.pi
SCARE_SIGMA_M = 0.2
SCARE_GAP_M = 0.1
STEP_BACK_M_S = 0.5
WAITED_S = 15.0


@kernel
def tick(
    crowd: Crowd, t_s: float, dt_s: float, robot_x: float, robot_y: float, robot_yaw: float, robot_v: float,
    robot_side: float,
) -> None:  # fmt: skip
    """Move everybody by one tick of dt_s (0.1 s in a run); the robot is at its present pose.

    `robot_v` and `robot_side` are the robot's speeds ahead and to its left, m/s. `t_s` is the time since the robot's
    start; people stand at their place until their own start time. Changes `crowd` in place and allocates nothing.
    """
    n = crowd.x.size
    for i in range(n):
        crowd.logged_x[i] = crowd.old_x[i] = crowd.x[i]
        crowd.logged_y[i] = crowd.old_y[i] = crowd.y[i]
        crowd.logged_yaw[i] = crowd.yaw[i]
        crowd.old_vx[i] = crowd.vx[i]
        crowd.old_vy[i] = crowd.vy[i]
        speed = math.sqrt(crowd.vx[i] ** 2 + crowd.vy[i] ** 2)
        crowd.logged_speed[i] = min(speed, crowd.speed[i])
    robot = RobotState(
        robot_x, robot_y, robot_yaw,
        robot_v * math.cos(robot_yaw) - robot_side * math.sin(robot_yaw),
        robot_v * math.sin(robot_yaw) + robot_side * math.cos(robot_yaw),
    )  # fmt: skip
    crowd.free[0] = 0.0
    sum_groups(crowd)
    for i in range(n):
        find_obstacle(crowd, i, robot)
    if crowd.anticipates:
        for i in range(n):
            crowd.sway[i] += crowd.sway_rate[i] * dt_s
    else:
        find_slow(crowd)
        if not crowd.published:
            push_pairs(crowd)
    for i in range(n):
        _act(crowd, i, t_s, dt_s, robot)
    if crowd.published:
        return
    for i in range(n):
        if may_touch(crowd, i, robot):
            note_touch(crowd, i, t_s, robot, 0.0)
    separate(crowd, dt_s, robot)
    for i in range(n):
        note_overlap(crowd, i, robot)
        if t_s >= crowd.start_time[i] - 1e-9:
            arrive(crowd, i, t_s, dt_s, robot)


@inner
def _act(crowd: Crowd, i: int, t: float, dt: float, robot: RobotState) -> None:
    """Let a person wait, react or walk."""
    crowd.stands[i] = 1
    crowd.reacting[i] = 0
    crowd.cap[i] = crowd.speed[i]
    waits = t < crowd.start_time[i] - 1e-9
    if waits and crowd.published:
        crowd.vx[i] = 0.0
        crowd.vy[i] = 0.0
        if crowd.reacted[i] < 0.0 and _in_sight(crowd, i, robot):
            # The study's people stood in sight of the robot for about 15 s while their timers already ran.
            crowd.reacted[i] = WAITED_S
        return
    crowd.reacted[i] = max(0.0, crowd.reacted[i])
    if _react(crowd, i, dt, robot):
        crowd.reacting[i] = 1
        crowd.stands[i] = 1 if crowd.vx[i] == 0.0 and crowd.vy[i] == 0.0 else 0
        note_until(crowd, REACTED, i, t, t + dt, crowd.x[i], crowd.y[i], float(crowd.behaviour[i]))
    elif waits:
        stand_at_place(crowd, i, dt, crowd.behaviour[i] != IMPASSIVE, robot)
    elif crowd.published:
        walk_published(crowd, i, dt, robot)
    else:
        walk(crowd, i, t, dt, robot)


@inner
def _in_sight(crowd: Crowd, i: int, robot: RobotState) -> bool:
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
    if distance_to(crowd, i, robot.x, robot.y) > reach:
        return False
    bearing = math.atan2(robot.y - crowd.y[i], robot.x - crowd.x[i])
    return abs(wrap(bearing - crowd.yaw[i])) <= HALF_VIEW_RAD


@inner
def _react(crowd: Crowd, i: int, dt: float, robot: RobotState) -> bool:
    """React to the robot if it is in sight and time is left; says whether this was the human's tick.

    The time runs while the robot is in sight. `once`: spent for good; otherwise the reaction may begin anew.
    """
    if not _in_sight(crowd, i, robot):
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
        _be_surprised(crowd, i, dt, robot)
    elif kind == SCARED:
        _be_scared(crowd, i, dt, robot)
    elif kind == CURIOUS:
        _be_curious(crowd, i, dt, robot)
    else:
        _be_threatening(crowd, i, dt, robot)
    return True


@inner
def _stand(crowd: Crowd, i: int, dt: float, robot: RobotState) -> None:
    """Stand still; step back from a robot that touches, but for the published profile. Who anticipates brakes first."""
    if crowd.anticipates and crowd.old_vx[i] ** 2 + crowd.old_vy[i] ** 2 > 0.1**2:
        fx, fy = limited(-crowd.old_vx[i] / dt, -crowd.old_vy[i] / dt, SUDDEN_M_S2)
        step(crowd, i, dt, fx, fy, crowd.speed[i])
        return
    crowd.vx[i] = 0.0
    crowd.vy[i] = 0.0
    if crowd.published:
        return
    gap, ux, uy = robot_gap(crowd, i, robot)
    if gap < TOUCH_M:
        crowd.vx[i] = STEP_BACK_M_S * ux
        crowd.vy[i] = STEP_BACK_M_S * uy
        advance(crowd, i, dt)


@inner
def _be_surprised(crowd: Crowd, i: int, dt: float, robot: RobotState) -> None:
    """Stop and turn towards the robot at 18°/s."""
    _stand(crowd, i, dt, robot)
    error = wrap(math.atan2(robot.y - crowd.y[i], robot.x - crowd.x[i]) - crowd.yaw[i])
    if crowd.published:
        # A fixed step per tick, whatever its length; to the right it is taken in full even past the robot.
        step = 0.01 * math.pi
        turn = min(error, step) if error > 0.0 else -step
        crowd.yaw[i] = wrap(crowd.yaw[i] + turn)
        return
    step = SURPRISE_TURN_RAD_S * dt
    crowd.yaw[i] = wrap(crowd.yaw[i] + max(-step, min(step, error)))


@inner
def _be_scared(crowd: Crowd, i: int, dt: float, robot: RobotState) -> None:
    """Keep to the goal more slowly, pushed away from the robot by force·0.2 m/gap."""
    g = crowd.goal_index[i]
    goal_x = crowd.goals[i, g, 0]
    goal_y = crowd.goals[i, g, 1]
    if not crowd.published:
        goal_x, goal_y = aim(crowd, i)
        goal_x, goal_y = around(crowd, i, goal_x, goal_y)
    fx, fy = acceleration(
        crowd, i, crowd.published, goal_x, goal_y, crowd.goal_radius[i], crowd.react_speed[i], False, robot
    )
    dx = crowd.x[i] - robot.x
    dy = crowd.y[i] - robot.y
    distance = math.sqrt(dx * dx + dy * dy)
    gap = distance - crowd.radius[i]
    if not crowd.published:
        # HuNavSim's gap passes zero and turns the flight into an attraction.
        gap = max(gap, SCARE_GAP_M)
    size = crowd.react_force[i] * SCARE_SIGMA_M / gap
    sx, sy = or_zero(size * dx / distance, size * dy / distance)
    fx += sx
    fy += sy
    if crowd.anticipates:
        fx, fy = limited(fx, fy, SUDDEN_M_S2)
    step(crowd, i, dt, fx, fy, crowd.react_speed[i])
    if crowd.published and distance_to(crowd, i, goal_x, goal_y) <= crowd.goal_radius[i]:
        next_goal(crowd, i)


@inner
def _be_curious(crowd: Crowd, i: int, dt: float, robot: RobotState) -> None:
    """Approach the robot, slower the nearer it is, stop at a distance and look at it."""
    distance = distance_to(crowd, i, robot.x, robot.y)
    if distance <= crowd.react_distance[i]:
        _stand(crowd, i, dt, robot)
        crowd.yaw[i] = math.atan2(robot.y - crowd.y[i], robot.x - crowd.x[i])
        return
    speed = crowd.react_speed[i] * distance / CURIOUS_RANGE_M
    goal_x, goal_y = robot.x, robot.y
    if not crowd.published:
        goal_x, goal_y = around(crowd, i, robot.x, robot.y)
    fx, fy = acceleration(crowd, i, crowd.published, goal_x, goal_y, crowd.robot_radius, speed, False, robot)
    step(crowd, i, dt, fx, fy, speed)


@inner
def _be_threatening(crowd: Crowd, i: int, dt: float, robot: RobotState) -> None:
    """Hurry to a point in front of the robot and block it."""
    ahead_x = math.cos(robot.yaw)
    ahead_y = math.sin(robot.yaw)
    if crowd.published:
        # Sine and cosine are swapped: the point is mirrored about the 45° line.
        ahead_x, ahead_y = ahead_y, ahead_x
    goal_x = robot.x + crowd.react_distance[i] * ahead_x
    goal_y = robot.y + crowd.react_distance[i] * ahead_y
    if not crowd.published:
        goal_x, goal_y = around(crowd, i, goal_x, goal_y)
    fx, fy = acceleration(
        crowd, i, crowd.published, goal_x, goal_y, THREATENING_GOAL_RADIUS_M, THREATENING_SPEED_M_S, False, robot
    )
    step(crowd, i, dt, fx, fy, THREATENING_SPEED_M_S)
    if distance_to(crowd, i, robot.x, robot.y) <= FACE_ROBOT_M:
        crowd.yaw[i] = math.atan2(robot.y - crowd.y[i], robot.x - crowd.x[i])


SLACK = 1.25
SLACK_S = 1.0
"""A person arrives in time who takes at most `SLACK` times distance over speed, plus `SLACK_S`."""
SLOW_M_S, FAST_M_S = 0.3, 1.5
_FAR = (1000.0, 1000.0, 0.0, 0.0, 0.0)
_NO_NOISE = PeopleOptions(leg_phase_noise=False)


def walking_time_s(world: World, way: Sequence[str], speed_m_s: float, limit_s: float) -> float:
    """Return the seconds a person takes along waypoints with nobody about; infinity where they take over `limit_s`."""
    goals = tuple(world.grid.position(name) for name in way)
    agent = HumanAgent(
        name="p", start=goals[0], goals=goals, pauses_s=(0.0,) * (len(goals) - 1) + (2 * limit_s,), speed_m_s=speed_m_s
    )
    crowd = initial([agent], world, options=_NO_NOISE, seed=0, time_limit_s=limit_s)
    by_reference = refer(crowd)
    for k in range(math.ceil(limit_s / PERIOD_S)):
        tick(by_reference, PERIOD_S * k, PERIOD_S, *_FAR)
        if k > 0 and crowd.goal_index[0] == 0:
            return PERIOD_S * (k + 1)
    return math.inf


def limit_s(world: World, way: Sequence[str], speed_m_s: float) -> float:
    """Return the time within which a person should arrive at the end of a way."""
    points = [world.grid.position(name) for name in way]
    return SLACK * sum(math.dist(a, b) for a, b in pairwise(points)) / speed_m_s + SLACK_S


def not_walked(
    world: World, ways: Iterable[tuple[str, ...]], speeds_m_s: Sequence[float] = (SLOW_M_S, FAST_M_S)
) -> list[tuple[str, ...]]:
    """Return the ways on which a person does not arrive in time at each of the speeds."""
    found = []
    for way in ways:
        for speed in speeds_m_s:
            limit = limit_s(world, way, speed)
            if walking_time_s(world, way, speed, limit) > limit:
                found.append(way)
                break
    return found
