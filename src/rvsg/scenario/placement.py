"""Rules of places: where people and the robot start, how much room people need, and what stands in the robot's way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Pose
from rvsg.robots.polygons import distance, inside
from rvsg.scenario.rules import ROBOT_RADIUS_M, SPEED_RANGE_M_S, Finding
from rvsg.scenario.scenario import LIMITS, TROLLEY_SPEEDS_M_S, Human, HumanConfiguration, Mission, PersonKind
from rvsg.world.space import Space, driving_space, frame_of, human_space, world_map
from rvsg.world.world import SolidObject, World


def speed_range(human: Human) -> tuple[float, float]:
    """Return the smallest and the largest speed of a person, m/s."""
    if human.kind in LIMITS:
        return LIMITS[human.kind].speeds_m_s
    return TROLLEY_SPEEDS_M_S if human.trolley is not None else SPEED_RANGE_M_S


def size_findings(human: Human, world: World) -> Iterator[Finding]:
    """Yield a size that no such person has, a child or a wheelchair that pushes, and ways that are too narrow."""
    if human.kind is PersonKind.ADULT and human.trolley is None:
        return
    if human.trolley is not None and human.kind is not PersonKind.ADULT:
        yield Finding(
            rule="trolley-pusher",
            human=human.name,
            reason=f"Only adults push a trolley, and this is a {human.kind.value}.",
            suggestion="Leave the trolley out, or make the person an adult.",
        )
    limits = LIMITS.get(human.kind)
    if limits is not None and not limits.radii_m[0] <= human.radius_m <= limits.radii_m[1]:
        low, high = limits.radii_m
        yield Finding(
            rule="size-out-of-range",
            human=human.name,
            reason=f"A {human.kind.value} has a radius of {low:g} to {high:g} m, not {human.radius_m:g} m.",
            suggestion=f"Take {limits.radius_m:g} m.",
        )
    yield from _narrow_findings(human, world)


def _narrow_findings(human: Human, world: World) -> Iterator[Finding]:
    """Yield the hops that are narrower than what the person sits in or pushes."""
    if not human.outline:
        return
    space = human_space(world)
    half = max(abs(y) for _, y in human.outline)
    what = "wheelchair" if human.kind is PersonKind.WHEELCHAIR else "trolley"
    for task in human.tasks:
        for position, (a, b) in enumerate(pairwise(task.path), start=1):
            start, end = human.position(a, world.grid), human.position(b, world.grid)
            if start is None or end is None or space.segment_free(start, end, half - space.frame.resolution):
                continue
            yield Finding(
                rule="too-wide",
                human=human.name,
                task=task.name,
                position=position,
                reason=f"The {what} is {2 * half:.2f} m wide; the way from {a} to {b} is narrower.",
                suggestion="Choose another way, or a narrower trolley.",
            )


def outline_on_robot(human: Human, at: tuple[float, float], mission: Mission, world: World) -> bool:
    """Return whether what a person sits in or pushes overlaps the robot at the start; people look along their way."""
    robot = mission.robot_record
    if not human.outline or robot is None:
        return False
    from shapely import Polygon

    ways = [human.position(name, world.grid) for task in human.tasks for name in task.path]
    ahead = next((point for point in ways if point is not None and math.dist(point, at) > 1e-6), (at[0] + 1.0, at[1]))
    corners = _in_world(human.outline, Pose(x=at[0], y=at[1], yaw=math.atan2(ahead[1] - at[1], ahead[0] - at[0])))
    return bool(Polygon(_in_world(robot.outline, mission.route.start)).intersects(Polygon(corners)))


def _in_world(outline: Sequence[tuple[float, float]], pose: Pose) -> list[tuple[float, float]]:
    """Return the corners of an outline that stands at a pose, in the world frame."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return [(pose.x + x * cos - y * sin, pose.y + x * sin + y * cos) for x, y in outline]


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


REACH_M = 0.25
"""Nav2's goal tolerance: how near to its goal the robot has to come."""


def staged_findings(mission: Mission, world: World) -> Iterator[Finding]:
    """Yield what is wrong with the doors and the moved objects of a mission: unknown, off the map, or no way left.

    The world is as the mission finds it.
    """
    wrong = [*_unknown_doors(mission, world), *_off_the_map(mission, world)]
    yield from wrong
    if not wrong and (mission.moved or world.still_doors):
        yield from _way_findings(mission, world)


def _unknown_doors(mission: Mission, world: World) -> Iterator[Finding]:
    known = [door.name for door in world.doors]
    for name in mission.doors:
        if name not in known:
            yield Finding(
                rule="unknown-door",
                reason=f"{world.name} has no door {name}.",
                suggestion=f"Doors: {', '.join(known)}." if known else "The world has no doors.",
            )


def _off_the_map(mission: Mission, world: World) -> Iterator[Finding]:
    for thing in mission.moved:
        if not _on_map(thing, world):
            yield Finding(
                rule="moved-off-map",
                reason=f"The moved object {thing.name} lies outside the map.",
                suggestion="Give a place on the floor, in metres of the world frame.",
            )


def _way_findings(mission: Mission, world: World) -> Iterator[Finding]:
    """Yield doors that stand still in the robot's only way, else moved objects that do."""
    half_width = _half_width_m(mission)
    start, goal = mission.route.start, mission.route.goal
    doors = driving_space(world.with_moved(()))
    space = driving_space(world)
    if world.still_doors and not _leads(doors, start, goal, half_width):
        names = ", ".join(door.name for door in world.still_doors)
        yield Finding(
            rule="door-blocks-route",
            reason=f"The doors of {world.name} that do not move ({names}) leave the robot no way to the goal of "
            f"{mission.route.name}.",
            suggestion="Open one in the scenario or in doors.yaml, make it automatic, or choose another route.",
        )
    elif mission.moved and space.clearance(start.x, start.y) < half_width:
        yield Finding(
            rule="moved-on-robot",
            reason=f"A moved object stands where the robot starts ({start.x:g}, {start.y:g}).",
            suggestion=f"Keep {half_width:.2f} m from it.",
        )
    elif mission.moved and not _leads(space, start, goal, half_width):
        yield Finding(
            rule="moved-blocks-route",
            reason=f"The moved objects leave the robot no way to the goal of {mission.route.name}.",
            suggestion=f"Leave {2 * half_width:.2f} m free somewhere.",
        )


def _on_map(thing: SolidObject, world: World) -> bool:
    corners = frame_of(world_map(world)).corners
    low, high = corners.min(axis=0), corners.max(axis=0)
    points = np.array(thing.footprint)
    return bool((points >= low).all() and (points <= high).all())


def _half_width_m(mission: Mission) -> float:
    """Return the radius of the largest disc within the robot's body around its base frame."""
    robot = mission.robot_record
    return ROBOT_RADIUS_M if robot is None else distance(robot.outline, 0.0, 0.0)


def _leads(space: Space, start: Pose, goal: Pose, half_width: float) -> bool:
    from scipy.ndimage import label

    parts, _ = label(space.field >= half_width)
    return bool(_near(parts, space, start, REACH_M) & _near(parts, space, goal, half_width + REACH_M))


def _near(parts: NDArray[np.int32], space: Space, pose: Pose, reach_m: float) -> set[int]:
    """Return the numbers of the parts of the floor within reach of a pose."""
    column, row = (math.floor(v) for v in space.frame.to_cells(np.array([pose.x, pose.y])))
    r = max(1, math.ceil(reach_m / space.frame.resolution))
    window = parts[max(row - r, 0) : row + r + 1, max(column - r, 0) : column + r + 1]
    return set(np.unique(window).tolist()) - {0}
