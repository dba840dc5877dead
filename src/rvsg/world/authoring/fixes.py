"""Changes that mend what the check of a world finds. A person decides on each; it is made like any other edit."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rvsg.core.records import Pose
from rvsg.world.authoring.routes import time_limit_s
from rvsg.world.grid import Grid

FARTHEST_M = 10.0
"""A pose is not moved farther than this."""
TRIED = 60
"""The nearest waypoints that are tried as the new place of a pose."""
SPARE = 1.5
"""A time limit is this many times what the robot needs alone."""
STEP_S = 5.0
"""Time limits are multiples of this."""


@dataclass(frozen=True, kw_only=True)
class Fix:
    """What would mend a finding: in words, and as a change that `edit_world` makes."""

    label: str
    change: Mapping[str, Any]


def rename_area(name: str, wanted: str, taken: Collection[str]) -> Fix:
    """Return the fix that gives an area another name, numbered where that is taken."""
    known = {each.strip().casefold() for each in taken if each != name}
    free = [wanted, *(f"{wanted} {k}" for k in range(2, len(known) + 3))]
    new = next(each for each in free if each.casefold() not in known)
    return Fix(label=f'Rename it to "{new}"', change=_area(name, name=new))


def remove_area(name: str) -> Fix:
    """Return the fix that removes an area."""
    return Fix(label=f'Remove "{name}"', change={"what": "remove area", "name": name})


def renew_waypoints(name: str) -> Fix:
    """Return the fix that derives the waypoints of an area from the grid again."""
    return Fix(label="Find its waypoints again", change={"what": "renew waypoints", "name": name})


def cut_area(name: str, shape: Any, within: Any) -> Fix | None:
    """Return the fix that cuts an area at the edge of the map; None where that leaves several parts."""
    left = shape.intersection(within)
    if left.geom_type != "Polygon" or left.is_empty:
        return None
    outline = [[round(x, 2), round(y, 2)] for x, y in left.exterior.coords[:-1]]
    return Fix(label="Cut it at the edge of the map", change=_area(name, outline=outline))


def move_pose(
    route: str, key: Sequence[str | int], pose: Pose, grid: Grid, stands: Callable[[Pose], bool]
) -> Fix | None:
    """Return the fix that moves a pose of a route to the nearest waypoint on which the robot stands as it is turned.

    Args:
        key: what of the route it is: ("start",), ("goal",) or ("through", number).
    """
    near = sorted(grid.waypoints, key=lambda w: math.dist((w.x, w.y), (pose.x, pose.y)))
    for waypoint in [w for w in near if w.robot][:TRIED]:
        if math.dist((waypoint.x, waypoint.y), (pose.x, pose.y)) > FARTHEST_M:
            return None
        if stands(Pose(x=waypoint.x, y=waypoint.y, yaw=pose.yaw)):
            return _pose(f"Move it to {waypoint.name}", route, key, [waypoint.x, waypoint.y, pose.yaw])
    return None


def in_radians(route: str, key: Sequence[str | int], pose: Pose) -> Fix:
    """Return the fix that reads the yaw of a pose as degrees."""
    yaw = round(math.radians(pose.yaw), 4)
    return _pose(f"Write {yaw:g} radians", route, key, [pose.x, pose.y, yaw])


def allow_time(route: str, *, length_m: float = 0.0, needed_s: float = 0.0) -> Fix:
    """Return the fix that sets the time limit of a route for its length and what the robot needs alone."""
    limit = max(time_limit_s(length_m), math.ceil(SPARE * needed_s / STEP_S) * STEP_S)
    change = {"what": "change route", "name": route, "values": {"time_limit_s": limit}}
    return Fix(label=f"Set the time limit to {limit:g} s", change=change)


def rename_in_activity(activities: Sequence[str], index: int, wrong: str, right: str) -> Fix:
    """Return the fix that corrects the name of an area in an activity."""
    values = list(activities)
    values[index] = values[index].replace(wrong, right)
    return Fix(label=f'Write "{right}"', change={"what": "set activities", "values": values})


def _area(area: str, **values: Any) -> dict[str, Any]:
    return {"what": "change area", "name": area, "values": values}


def _pose(label: str, route: str, key: Sequence[str | int], pose: list[float]) -> Fix:
    values = {"through": {"index": key[1], "pose": pose}} if key[0] == "through" else {str(key[0]): pose}
    return Fix(label=label, change={"what": "change route", "name": route, "values": values})
