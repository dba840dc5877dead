"""A running ROS 2 navigation system: check it; write and scale Nav2's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rvsg.core.errors import UnknownName
from rvsg.robots.files import DEFAULT_ROBOT, load_robot
from rvsg.robots.robot import Robot
from rvsg.simulation.stacks.registry import StackChoice, StackLike
from rvsg_ros2.check import Found, check_system
from rvsg_ros2.interfaces import RELEASES, Release
from rvsg_ros2.nav2_file import nav2_text
from rvsg_ros2.options import read_options
from rvsg_ros2.scaling import Scaled, scale_file

__all__ = [
    "RELEASES",
    "Found",
    "Release",
    "Scaled",
    "check_ros2",
    "new_nav2_params",
    "release_named",
    "scale_nav2_params",
]


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


def new_nav2_params(
    robot: Robot | str | Path = DEFAULT_ROBOT,
    stack: StackLike = "nav2-dwb",
    options: Mapping[str, Any] | None = None,
    *,
    release: Release = "jazzy",
) -> str:
    """Return the Nav2 parameter file of a robot, with the parameters that a built-in stack drives it with.

    Args:
        stack: nav2-dwb, nav2-rpp or nav2-mppi.
        options: of that stack.

    Raises:
        InputError: the stack has no controller of Nav2.
    """
    given = robot if isinstance(robot, Robot) else load_robot(robot)
    return nav2_text(given, StackChoice.of(stack, options).driver, release)
