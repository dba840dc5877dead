"""Rules of places: where people and the robot start, how much room people need, and what stands in the robot's way."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from rvsg.core.records import Pose
from rvsg.robots.polygons import distance, inside
from rvsg.scenario.rules import ROBOT_RADIUS_M, SPEED_RANGE_M_S, Finding
from rvsg.scenario.scenario import (
    HUNAVSIM_RADIUS_M,
    LIMITS,
    TROLLEY_SPEEDS_M_S,
    Human,
    HumanConfiguration,
    Mission,
    PersonKind,
    Point,
)
from rvsg.world.space import Space, driving_space, frame_of, human_space, world_map
from rvsg.world.world import Route, SolidObject, World


def speed_range(human: Human) -> tuple[float, float]:
    """Return the smallest and the largest speed of a person, m/s."""
    if human.kind in LIMITS:
        return LIMITS[human.kind].speeds_m_s
    return TROLLEY_SPEEDS_M_S if human.trolley is not None else SPEED_RANGE_M_S


def size_findings(human: Human, world: World) -> Iterator[Finding]:
    """Yield a size that no such person has, a child or a wheelchair that pushes, and ways that are too narrow."""
    kind, name = human.kind, human.name
    if human.trolley is not None and kind is not PersonKind.ADULT:
        reason = f"Only adults push a trolley, and this is a {kind.value}."
        yield Finding.of("trolley-pusher", reason, "Leave the trolley out, or make the person an adult.", human=name)
    limits = LIMITS.get(kind)
    if limits is not None and not limits.radii_m[0] <= human.body_radius_m <= limits.radii_m[1]:
        low, high = limits.radii_m
        reason = f"A {kind.value} has a radius of {low:g} to {high:g} m, not {human.body_radius_m:g} m."
        yield Finding.of("size-out-of-range", reason, f"Take {limits.radius_m:g} m.", human=name)
    if not human.outline and human.body_radius_m <= HUNAVSIM_RADIUS_M:
        return  # who turns sideways; scenarios of 0.2 give everybody this radius
    space = human_space(world)
    half = max((abs(y) for _, y in human.outline), default=human.body_radius_m)
    what = ("wheelchair" if kind is PersonKind.WHEELCHAIR else "trolley") if human.outline else "person"
    for task in human.tasks:
        for position, (a, b) in enumerate(pairwise(task.path), start=1):
            start, end = human.position(a, world.grid), human.position(b, world.grid)
            if start is None or end is None or space.segment_free(start, end, half - space.frame.resolution):
                continue
            reason = f"The {what} is {2 * half:.2f} m wide; the way from {a} to {b} is narrower."
            place = {"human": name, "task": task.name, "position": position}
            if not human.outline:
                yield Finding.of("person-too-wide", reason, "Choose a smaller radius_m, or another way.", **place)
                return  # one size, one finding
            yield Finding.of("too-wide", reason, "Choose another way, or a narrower trolley.", **place)


def _outline_on_robot(human: Human, at: Point, mission: Mission, world: World) -> bool:
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


def start_gap_m(radius_m: float, at: Point, mission: Mission) -> float:
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
    placed: list[tuple[Human, Point]] = []
    for human in people.humans:
        at = human.starts_at(world.grid)
        if human.track is not None and (
            human.track.start_s > 0.0 or start_gap_m(human.body_radius_m, human.track.points[0], mission) >= 0.0
        ):
            continue  # who comes later; and no other rule is for where people were recorded
        path = human.tasks[0].path
        if at is None or (human.start is None and path[0] not in world.grid.valid | human.points.keys()):
            continue
        wrong = spawn_finding(human, at, placed, mission, world)
        if wrong is not None:
            yield wrong.model_copy(update={"human": human.name, "task": human.tasks[0].name, "position": 0})
        placed.append((human, at))


def spawn_finding(
    human: Human, at: Point, others: list[tuple[Human, Point]], mission: Mission, world: World
) -> Finding | None:
    """Return what is wrong with a person starting at a point (metres, world frame), given who is placed; or None."""
    gap, start = start_gap_m(human.body_radius_m, at, mission), mission.route.start
    if gap < 0.0:
        reason = f"The person's body overlaps the robot's by {-gap:.2f} m at the start."
        better = f"Start farther from ({start.x:g}, {start.y:g}), where the robot stands."
        return Finding.of("spawn-on-robot", reason, better)
    if _outline_on_robot(human, at, mission, world):
        reason = "What the person pushes or sits in stands on the robot at the start."
        return Finding.of("spawn-on-robot", reason, "Start farther away, or on the way out.")
    for other, where in others:
        apart = human.body_radius_m + other.body_radius_m
        if math.dist(at, where) < apart:
            reason = f"The start is {math.dist(at, where):.2f} m from that of {other.name}."
            return Finding.of("spawn-on-human", reason, f"Start at least {apart:.2f} m apart.")
    if not human_space(world).is_free(*at):
        return Finding.of("spawn-in-obstacle", "The start lies in an obstacle.", "Start where it is free.")
    return None


REACH_M = 0.25
"""Nav2's goal tolerance: how near to its goal the robot has to come."""


def staged_findings(mission: Mission, world: World) -> Iterator[Finding]:
    """Yield what is wrong with the doors and the moved objects of a mission: unknown, off the map, or no way left.

    The world is as the mission finds it.
    """
    wrong = []
    names = [door.name for door in world.doors]
    for name in mission.doors:
        if name not in names:
            better = f"Doors: {', '.join(names)}." if names else "The world has no doors."
            wrong.append(Finding.of("unknown-door", f"{world.name} has no door {name}.", better))
    for thing in mission.moved:
        if not _on_map(thing, world):
            reason = f"The moved object {thing.name} lies outside the map."
            better = "Give a place on the floor, in metres of the world frame."
            wrong.append(Finding.of("moved-off-map", reason, better))
    yield from wrong
    if not wrong and (mission.moved or world.still_doors):
        yield from _way_findings(mission, world)


def _way_findings(mission: Mission, world: World) -> Iterator[Finding]:
    """Yield doors that stand still in the robot's only way, else moved objects that do."""
    robot, route, start = mission.robot_record, mission.route, mission.route.start
    # The largest disc within the robot's body around its base frame.
    half_width = ROBOT_RADIUS_M if robot is None else distance(robot.outline, 0.0, 0.0)
    space = driving_space(world)
    if world.still_doors and not _leads(driving_space(world.with_moved(())), route, half_width):
        names = ", ".join(door.name for door in world.still_doors)
        reason = (
            f"The doors of {world.name} that do not move ({names}) leave the robot no way to the goal of {route.name}."
        )
        better = "Open one in the scenario or in doors.yaml, make it automatic, or choose another route."
        yield Finding.of("door-blocks-route", reason, better)
    elif mission.moved and space.clearance(start.x, start.y) < half_width:
        reason = f"A moved object stands where the robot starts ({start.x:g}, {start.y:g})."
        yield Finding.of("moved-on-robot", reason, f"Keep {half_width:.2f} m from it.")
    elif mission.moved and not _leads(space, route, half_width):
        reason = f"The moved objects leave the robot no way to the goal of {route.name}."
        yield Finding.of("moved-blocks-route", reason, f"Leave {2 * half_width:.2f} m free somewhere.")


def _on_map(thing: SolidObject, world: World) -> bool:
    corners = frame_of(world_map(world)).corners
    points = np.array(thing.footprint)
    return bool((points >= corners.min(axis=0)).all() and (points <= corners.max(axis=0)).all())


def _leads(space: Space, route: Route, half_width: float) -> bool:
    """Return whether a part of the floor wide enough for the robot reaches from its start to its goal."""
    from scipy.ndimage import label

    parts, _ = label(space.field >= half_width)
    near = []
    for pose, reach_m in ((route.start, REACH_M), (route.goal, half_width + REACH_M)):
        column, row = (math.floor(v) for v in space.frame.to_cells(np.array([pose.x, pose.y])))
        r = max(1, math.ceil(reach_m / space.frame.resolution))
        near.append(set(np.unique(parts[max(row - r, 0) : row + r + 1, max(column - r, 0) : column + r + 1]).tolist()))
    return bool((near[0] & near[1]) - {0})
