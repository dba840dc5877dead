"""ROS messages of what RVSG tells: clock, transforms, odometry, scans, map, poses. Times are nanoseconds."""

from __future__ import annotations

import math
from array import array
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan

OCCUPIED, UNKNOWN = 100, 255
"""Cells of the map that RVSG sends; every other value is free."""


def time_of(nanoseconds: int) -> Time:
    """Return a ROS time."""
    seconds, rest = divmod(nanoseconds, 10**9)
    return Time(sec=seconds, nanosec=rest)


def pose_of(x: float, y: float, yaw: float) -> Pose:
    """Return a pose in the plane."""
    pose = Pose()
    pose.position.x, pose.position.y = float(x), float(y)
    pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return pose


def transform_of(now: int, parent: str, child: str, x: float, y: float, yaw: float) -> TransformStamped:
    """Return the place of `child` in `parent`."""
    made = TransformStamped()
    made.header.stamp, made.header.frame_id, made.child_frame_id = time_of(now), parent, child
    made.transform.translation.x, made.transform.translation.y = float(x), float(y)
    made.transform.rotation.z, made.transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return made


def stamped_pose(now: int, frame: str, x: float, y: float, yaw: float) -> PoseStamped:
    """Return a pose in a frame."""
    made = PoseStamped()
    made.header.stamp, made.header.frame_id, made.pose = time_of(now), frame, pose_of(x, y, yaw)
    return made


def initial_pose(now: int, frame: str, x: float, y: float, yaw: float) -> PoseWithCovarianceStamped:
    """Return the start of a run as localisation takes it; it is known within a few centimetres."""
    made = PoseWithCovarianceStamped()
    made.header.stamp, made.header.frame_id, made.pose.pose = time_of(now), frame, pose_of(x, y, yaw)
    covariance = [0.0] * 36
    covariance[0], covariance[7], covariance[35] = 0.01, 0.01, 0.005
    made.pose.covariance = covariance
    return made


def odometry(now: int, frame: str, child: str, seen: Any) -> Odometry:
    """Return where the base is in the odometry frame, and how fast."""
    made = Odometry()
    made.header.stamp, made.header.frame_id, made.child_frame_id = time_of(now), frame, child
    made.pose.pose = pose_of(*seen.pose)
    made.twist.twist.linear.x, made.twist.twist.angular.z = (float(value) for value in seen.velocity)
    return made


def laser_scan(now: int, frame: str, scan: Any, lidar: dict[str, Any]) -> LaserScan:
    """Return a scan; `lidar` is its part of the robot's record."""
    made = LaserScan()
    made.header.stamp, made.header.frame_id = time_of(now), frame
    made.angle_min, made.angle_increment = float(scan.angle_min), float(scan.angle_increment)
    made.angle_max = made.angle_min + made.angle_increment * (len(scan.ranges) - 1)
    made.scan_time = 1.0 / lidar["rate_hz"]
    made.range_min, made.range_max = float(lidar["min_range_m"]), float(lidar["max_range_m"])
    made.ranges = array("f", scan.ranges)
    return made


def occupancy_grid(now: int, frame: str, world: Any) -> OccupancyGrid:
    """Return the map of a task."""
    made = OccupancyGrid()
    made.header.stamp, made.header.frame_id = time_of(now), frame
    made.info.resolution, made.info.width, made.info.height = float(world.resolution), world.columns, world.rows
    made.info.origin = pose_of(world.origin[0], world.origin[1], 0.0)
    values = {OCCUPIED: 100, UNKNOWN: -1}
    made.data = array("b", (values.get(cell, 0) for cell in world.cells))
    return made
