"""Robots as records: body, drive, limits, sensors and the parameters of the navigation stack."""

from rvsg.robots.files import load_robot, shipped_robots
from rvsg.robots.navigation import Navigation
from rvsg.robots.robot import Bumper, Drive, Imu, Lidar, Limits, Robot, SafetyZone

__all__ = [
    "Bumper",
    "Drive",
    "Imu",
    "Lidar",
    "Limits",
    "Navigation",
    "Robot",
    "SafetyZone",
    "load_robot",
    "shipped_robots",
]
