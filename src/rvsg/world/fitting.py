"""Fit a route to a robot: its goal where the robot's body can stand, its time limit within what its speed allows.

The routes of a world are written for one robot. A longer one touches the shelf in front of which that robot stops, or
stops before it because a safety scanner sees the shelf; a slower one needs more time.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rvsg.core.records import Pose
from rvsg.robots.polygons import padded, rectangle
from rvsg.robots.robot import Robot
from rvsg.world.route_words import length_m, line_of
from rvsg.world.space import Space, robot_space
from rvsg.world.world import Route, World

STEP_M = 0.05
SAMPLE_M = 0.05
SPARE_M = 0.1
"""A goal that is moved leaves this much between the robot and what stands in front of it."""
CREEPING_M_S = 0.1
"""A safety zone that is watched at this speed stops the robot on its last metre."""
SPARE_BESIDE_M = 0.05
NEAR_M = 0.3
"""A robot whose start or goal is tight stands in the open part of the floor at most this far away."""
SLOWER_THAN_STRAIGHT = 1.2
START_AND_TURN_S = 5.0
"""The time limit is at least this much, and that many times the time at full speed along the route."""


class Fitted(NamedTuple):
    """A route fitted to a robot, and what was changed, in words; nothing where the route fits as it is."""

    route: Route
    notes: tuple[str, ...]


def fitted(route: Route, robot: Robot, world: World) -> Fitted:
    """Return the route for a robot. Fitting a fitted route changes nothing."""
    notes = []
    back = setback_m(route.goal, robot, world)
    if back is not None and back > 0.0:
        goal = _moved(route.goal, back)
        notes.append(
            f"{route.name}: {robot.name} cannot stand at the goal ({route.goal.x:g}, {route.goal.y:g}); its goal is "
            f"{back:.2f} m before it, at ({goal.x:g}, {goal.y:g})."
        )
        route = route.model_copy(update={"goal": goal})
    length = _length_m(route, world)
    needed = math.ceil(SLOWER_THAN_STRAIGHT * length / robot.driving_speed_m_s + START_AND_TURN_S)
    if needed > route.time_limit_s:
        notes.append(
            f"{route.name}: {robot.name} drives at most {robot.driving_speed_m_s:g} m/s; its time limit for the "
            f"{length:.0f} m is {needed} s instead of {route.time_limit_s:g} s."
        )
        route = route.model_copy(update={"time_limit_s": float(needed)})
    return Fitted(route, tuple(notes))


def setback_m(goal: Pose, robot: Robot, world: World) -> float | None:
    """Return how far before a goal, against its heading, the robot has to stop, m.

    0 where it reaches the goal within half of its tolerance; None where there is no free place within the robot's
    length and its stopping zones, so that moving the goal does not help.
    """
    space = robot_space(world)
    (rear, right), (front, left) = stopping_rectangle(robot)
    allowed = 0.5 * robot.navigation.behaviours.goal_tolerance_m
    for step in range(int((front - rear) / STEP_M) + 1):
        back = step * STEP_M
        if _is_free(space, _moved(goal, back), (rear, right), (front, left)):
            return 0.0 if back <= allowed else round(back + SPARE_M, 2)
    return None


def clearance_m(robot: Robot) -> float:
    """Return how far a robot's base keeps from obstacles where it passes between them, m."""
    return round(0.5 * min(robot.width_m, robot.length_m) + SPARE_BESIDE_M, 3)


def fits_through(robot: Robot, route: Route, world: World) -> bool:
    """Return whether some way from the start over the poses to pass to the goal is as wide as the robot."""
    space = robot_space(world)
    slack = space.frame.resolution * math.sqrt(0.5)
    parts = space.parts(max(0.0, 0.5 * min(robot.width_m, robot.length_m) - slack))
    reach = max(1, math.ceil(NEAR_M / space.frame.resolution))
    reached: set[int] | None = None
    for pose in (route.start, *route.through, route.goal):
        column, row = (math.floor(v) for v in space.frame.to_cells(np.array([pose.x, pose.y])))
        near = parts[max(0, row - reach) : max(0, row + reach + 1), max(0, column - reach) : max(0, column + reach + 1)]
        found = {int(number) for number in np.unique(near)} - {0}
        reached = found if reached is None else reached & found
    return bool(reached)


def stopping_rectangle(robot: Robot) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the corners of the rectangle that is free where the robot can drive: footprint and stopping zones."""
    corners = list(padded(robot.footprint, robot.padding_m))
    for zone in robot.safety_zones:
        if zone.speed_m_s == 0.0 and zone.from_speed_m_s <= CREEPING_M_S:
            corners += zone.polygon
    return rectangle(corners)


def _length_m(route: Route, world: World) -> float:
    """Return the length of a route over the grid; straight from pose to pose in a world without waypoints."""
    if world.grid.valid:
        return length_m(line_of(world, route))
    poses = (route.start, *route.through, route.goal)
    return sum(math.dist((a.x, a.y), (b.x, b.y)) for a, b in pairwise(poses))


def _is_free(space: Space, pose: Pose, low: tuple[float, float], high: tuple[float, float]) -> bool:
    along, across = np.meshgrid(
        *(np.linspace(a, b, math.ceil((b - a) / SAMPLE_M) + 1) for a, b in zip(low, high, strict=True))
    )
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    points = np.stack([pose.x + cos * along - sin * across, pose.y + sin * along + cos * across], axis=-1)
    return bool((space.clearances(points) > 0.0).all())


def _moved(pose: Pose, back: float) -> Pose:
    x, y = pose.x - back * math.cos(pose.yaw), pose.y - back * math.sin(pose.yaw)
    return Pose(x=round(x, 3), y=round(y, 3), yaw=pose.yaw)
