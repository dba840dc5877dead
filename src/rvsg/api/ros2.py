"""A running ROS 2 navigation system: check it, and scale Nav2's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rvsg.core.errors import UnknownName
from rvsg.robots import Robot, load_robot
from rvsg.robots.files import DEFAULT_ROBOT
from rvsg.simulation.ros2.check import Found, check_system
from rvsg.simulation.ros2.interfaces import RELEASES, Release
from rvsg.simulation.ros2.options import read_options
from rvsg.simulation.ros2.scaling import Scaled, scale_file

__all__ = ["RELEASES", "Found", "Release", "Scaled", "check_ros2", "release_named", "scale_nav2_params"]


def check_ros2(
    options: Mapping[str, Any] | None = None, robot: Robot | str | Path = DEFAULT_ROBOT, *, seconds: float = 5.0
) -> Found:
    """Return what of the running system is found, missing, or of another type.

    Args:
        options: those of the stack `ros2`.
        robot: whose lidars the system must read.
        seconds: how long to look.
    """
    given = robot if isinstance(robot, Robot) else load_robot(robot)
    return check_system(read_options(dict(options or {})), given, seconds=seconds)


def release_named(name: str) -> Release:
    """Return the release of a name; UnknownName with the nearest one where there is none."""
    for release in RELEASES:
        if release == name:
            return release
    raise UnknownName("ROS 2 release", name, RELEASES)


def scale_nav2_params(path: str | Path, speed: float, release: Release = "jazzy") -> Scaled:
    """Return Nav2 parameters for `speed` times real time, with every change and what cannot be scaled."""
    return scale_file(Path(path), speed, release)
