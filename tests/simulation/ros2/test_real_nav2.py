"""The stack ros2 with a real Nav2, where a sourced ROS 2 has one. Nothing here has run where this was written."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from rvsg.core.records import Pose
from rvsg.simulation.embedded.rehearsal import empty_room
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.ros2.stack import Ros2Stack
from rvsg.simulation.run import Outcome
from rvsg.simulation.stacks.registry import StackChoice
from rvsg.world.world import Route


def nav2_parameters() -> Path | None:
    """The parameter file of nav2_bringup; None where no sourced ROS 2 has one."""
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        path = Path(prefix) / "share" / "nav2_bringup" / "params" / "nav2_params.yaml"
        if path.is_file():
            return path
    return None


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        nav2_parameters() is None or shutil.which("ros2") is None,
        reason="no sourced ROS 2 with nav2_bringup is found (ros2 on PATH, AMENT_PREFIX_PATH)",
    ),
]


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_nav2_with_its_own_parameters_reaches_a_goal_in_an_empty_room(speed: float) -> None:
    stack = Ros2Stack(
        launch="ros2 launch nav2_bringup navigation_launch.py use_sim_time:=True autostart:=True params_file:={params}",
        params=str(nav2_parameters()), speed=speed,
    )  # fmt: skip
    route = Route(name="room", start=Pose(x=-2.0, y=0.0), goal=Pose(x=1.5, y=0.5), time_limit_s=60.0)
    chosen = StackChoice.of(stack)
    try:
        chosen.driver.prepare(print)
        run = simulate_agents(empty_room(), route, [], seed=0, stack=chosen)
    finally:
        chosen.driver.close()
    assert run.outcome is Outcome.REACHED, run.details["stack"]
