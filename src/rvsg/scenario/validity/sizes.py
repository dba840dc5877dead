"""What is wrong with people of other sizes: children, wheelchairs, and who pushes a trolley."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from rvsg.core.records import Pose
from rvsg.scenario.bodies import LIMITS, TROLLEY_SPEEDS_M_S, PersonKind
from rvsg.scenario.scenario import Human, Mission
from rvsg.scenario.validity.findings import Finding
from rvsg.scenario.validity.rules import SPEED_RANGE_M_S
from rvsg.world.space import human_space
from rvsg.world.world import World


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
