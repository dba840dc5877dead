"""Parts that several tests of this folder are made of."""

from __future__ import annotations

from pathlib import Path

import rvsg

RPP = """\
controller_server:
  ros__parameters:
    controller_plugins: ["FollowPath"]
    FollowPath:
      plugin: "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
      desired_linear_vel: 0.31
"""
"""A parameter file of Nav2 with a controller that is not the default."""


def crossing(route: str = "route_1", ends: tuple[str, str] = ("E15", "H15"), **walking: object) -> rvsg.Scenario:
    """Anna crosses the aisle of the warehouse."""
    walk = rvsg.walk("Anna", *ends, **walking)  # type: ignore[arg-type]
    return rvsg.scenario(rvsg.load_world("warehouse"), route, [walk])


def suite_of(folder: Path, *, name: str = "aisle") -> rvsg.Suite:
    """A suite with one case, which every robot of the simulator without physics masters."""
    return rvsg.Suite.create(folder).add(crossing(), "R3", name=name, expected="pass")
