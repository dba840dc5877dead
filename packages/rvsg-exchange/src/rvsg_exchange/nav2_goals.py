"""Nav2 goals: a route as the YAML of a `NavigateThroughPoses` action goal.

Send it with `ros2 action send_goal /navigate_through_poses nav2_msgs/action/NavigateThroughPoses "$(cat goals.yaml)"`.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import yaml

from rvsg.core.records import Pose
from rvsg.world.world import Route, World

Release = Literal["humble", "jazzy", "kilted"]
RELEASES: tuple[Release, ...] = ("humble", "jazzy", "kilted")


def goals_yaml(route: Route, world: World, *, release: Release = "jazzy") -> str:
    """Return the poses the robot must pass and the goal, in the map frame, as the YAML of an action goal.

    Args:
        route: the route; its `through` poses come first, its goal last.
        world: the world of the route; its poses are shifted by `map_offset` into the map frame.
        release: up to Jazzy the goal holds a list of PoseStamped, from Kilted on a nav_msgs/Goals.
    """
    poses = [_pose(pose, world) for pose in (*route.through, route.goal)]
    if release == "kilted":
        goals: Any = {
            "header": {"frame_id": "map"},
            "goals": [{"header": {"frame_id": "map"}, "pose": p} for p in poses],
        }
    else:
        goals = [{"header": {"frame_id": "map"}, "pose": pose} for pose in poses]
    return yaml.safe_dump({"poses": goals, "behavior_tree": ""}, sort_keys=False)


def initial_pose_yaml(route: Route, world: World) -> str:
    """Return the start of the route as the YAML of a `geometry_msgs/PoseWithCovarianceStamped` for `/initialpose`."""
    covariance = [0.0] * 36
    covariance[0] = covariance[7] = 0.25
    covariance[35] = (math.pi / 12) ** 2
    pose = {"pose": _pose(route.start, world), "covariance": covariance}
    return yaml.safe_dump({"header": {"frame_id": "map"}, "pose": pose}, sort_keys=False)


def _pose(pose: Pose, world: World) -> dict[str, dict[str, float]]:
    dx, dy = world.map_offset
    return {
        "position": {"x": pose.x - dx, "y": pose.y - dy, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(pose.yaw / 2), "w": math.cos(pose.yaw / 2)},
    }
