"""Where people start: clear of obstacles, of the robot and of each other."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rvsg.robots.polygons import distance, inside
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission
from rvsg.scenario.validity.findings import Finding
from rvsg.scenario.validity.rules import ROBOT_RADIUS_M
from rvsg.scenario.validity.sizes import outline_on_robot
from rvsg.world.space import human_space
from rvsg.world.world import World


def robot_reach_m(mission: Mission) -> float:
    """Return the radius of a disc around the robot's start that holds its body; the study's for the default robot."""
    return ROBOT_RADIUS_M if isinstance(mission.robot, str) else mission.robot.turning_radius_m


def start_gap_m(radius_m: float, at: tuple[float, float], mission: Mission) -> float:
    """Return the gap between the robot's body at its start and a person at a point, metres; negative: they overlap.

    A robot that is known by name only counts as a disc of `ROBOT_RADIUS_M`.
    """
    start, robot = mission.route.start, mission.robot_record
    if robot is None:
        return math.dist(at, (start.x, start.y)) - ROBOT_RADIUS_M - radius_m
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    dx, dy = at[0] - start.x, at[1] - start.y
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    away = distance(robot.outline, ahead, left)
    return (-away if inside(robot.outline, ahead, left) else away) - radius_m


def spawn_findings(people: HumanConfiguration, mission: Mission, world: World) -> Iterator[Finding]:
    """Yield who starts in an obstacle, on the robot, or on somebody who is listed earlier."""
    placed: list[tuple[Human, tuple[float, float]]] = []
    for human in people.humans:
        at = human.starts_at(world.grid)
        path = human.tasks[0].path
        if at is None or (human.start is None and path[0] not in world.grid.valid | human.points.keys()):
            continue
        wrong = spawn_finding(human, at, placed, mission, world)
        if wrong is not None:
            yield wrong.model_copy(update={"human": human.name, "task": human.tasks[0].name, "position": 0})
        placed.append((human, at))


def spawn_finding(
    human: Human,
    at: tuple[float, float],
    others: list[tuple[Human, tuple[float, float]]],
    mission: Mission,
    world: World,
) -> Finding | None:
    """Return what is wrong with a person starting at a point (metres, world frame), given who is placed; or None."""
    gap = start_gap_m(human.radius_m, at, mission)
    if gap < 0.0:
        start = mission.route.start
        return Finding(
            rule="spawn-on-robot",
            reason=f"The person's body overlaps the robot's by {-gap:.2f} m at the start.",
            suggestion=f"Start farther from ({start.x:g}, {start.y:g}), where the robot stands.",
        )
    if outline_on_robot(human, at, mission, world):
        return Finding(
            rule="spawn-on-robot",
            reason="What the person pushes or sits in stands on the robot at the start.",
            suggestion="Start farther away, or on the way out.",
        )
    for other, where in others:
        if math.dist(at, where) < human.radius_m + other.radius_m:
            return Finding(
                rule="spawn-on-human",
                reason=f"The start is {math.dist(at, where):.2f} m from that of {other.name}.",
                suggestion=f"Start at least {human.radius_m + other.radius_m:.2f} m apart.",
            )
    if not human_space(world).is_free(*at):
        return Finding(
            rule="spawn-in-obstacle", reason="The start lies in an obstacle.", suggestion="Start where it is free."
        )
    return None
