"""The stack ros2 with a real Nav2, where a sourced ROS 2 has one or RVSG_NAV2_LAUNCH says how to start it.

`RVSG_NAV2_LAUNCH` is a launch command with `{params}`, for a Nav2 that is started otherwise than by nav2_bringup.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from rvsg.core.records import Pose
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.run import Outcome
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.world.world import Route
from rvsg_ros2.nav2_file import new_nav2_params
from rvsg_ros2.stack import Ros2Stack


def launch_command() -> str | None:
    """How to start Nav2; None where there is none."""
    if given := os.environ.get("RVSG_NAV2_LAUNCH"):
        return given
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if (Path(prefix) / "share" / "nav2_bringup").is_dir() and shutil.which("ros2"):
            return (
                "ros2 launch nav2_bringup navigation_launch.py use_sim_time:=True autostart:=True params_file:={params}"
            )
    return None


LAUNCH = launch_command()
pytestmark = [
    pytest.mark.service,
    pytest.mark.skipif(
        LAUNCH is None,
        reason="no Nav2 is found: neither RVSG_NAV2_LAUNCH nor a sourced ROS 2 with nav2_bringup (ros2 on PATH)",
    ),
]


@pytest.mark.parametrize("speed", [1.0, 4.0])
@pytest.mark.parametrize("through", [(), (Pose(x=-1.0, y=0.3), Pose(x=0.0, y=0.0))], ids=["goal", "poses"])
def test_nav2_reaches_a_goal_in_an_empty_room(speed: float, through: tuple[Pose, ...], tmp_path: Path) -> None:
    params = tmp_path / "nav2.yaml"
    params.write_text(new_nav2_params(stack="nav2-dwb", release="jazzy"))
    stack = Ros2Stack(launch=LAUNCH, params=str(params), speed=speed)
    route = Route(
        name="room", start=Pose(x=-2.0, y=0.0), goal=Pose(x=1.5, y=0.5), through=through, time_limit_s=60.0
    )  # fmt: skip
    chosen = StackChoice.of(stack)
    try:
        chosen.driver.prepare(print)
        run = simulate_agents(empty_room(), route, [], seed=0, stack=chosen)
    finally:
        chosen.driver.close()
    facts = run.details["stack"]
    assert run.outcome is Outcome.REACHED, facts
    assert facts["release"] == "jazzy"
    assert facts["recoveries"] == 0
    assert facts["plans"]
    assert facts["costmaps"]
    assert {"FollowPath", "NavigateRecovery"} <= {name for _, name, _ in facts["behaviour_tree"]}
