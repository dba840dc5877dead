"""What is wrong with the doors of a mission and with the objects it puts in the robot's way."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Pose
from rvsg.robots.polygons import distance
from rvsg.scenario.scenario import Mission
from rvsg.scenario.validity.findings import Finding
from rvsg.scenario.validity.rules import ROBOT_RADIUS_M
from rvsg.world.space import Space, driving_space, frame_of, world_map
from rvsg.world.world import SolidObject, World

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
