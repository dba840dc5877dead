"""packages/rvsg-ros2 behind the stack protocol: with a stand-in for rclpy, and with rclpy and Nav2 where they are.

`RVSG_RCLPY` is a command that runs a Python with rclpy; without it the `python3` of a sourced ROS 2 is taken.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from tests.simulation.ros2.test_real_nav2 import LAUNCH

from rvsg.core.records import Pose
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg.world.world import Route
from rvsg_ros2.launch import Launched, ros_environment
from rvsg_ros2.nav2_file import new_nav2_params

FAKE = Path(__file__).with_name("fake_ros.py")
BRIDGE = Path(__file__).with_name("run_bridge.py")


def driven(behaviour: str, runs: int = 1, through: tuple[Pose, ...] = (), **parameters: Any) -> list[Run]:
    options = {"timeout_s": 30.0, "parameters": {"speed": 5.0, "start_limit_s": 3.0, "settle_s": 0.1, **parameters}}
    chosen = StackChoice.of(f"exec-stack:{sys.executable} {FAKE} {behaviour}", options)
    route = Route(name="room", start=Pose(x=-2.0, y=0.0), goal=Pose(x=1.0, y=0.5), through=through, time_limit_s=15.0)
    try:
        return [simulate_agents(empty_room(), route, [], seed=seed, stack=chosen) for seed in range(runs)]
    finally:
        chosen.driver.close()


@pytest.mark.exhaustive
def test_it_drives_runs_one_after_another_and_through_poses() -> None:
    assert [run.outcome for run in driven("works", 2)] == [Outcome.REACHED, Outcome.REACHED]
    assert driven("works", through=(Pose(x=0.0, y=0.0),), localises=False)[0].outcome is Outcome.REACHED
    assert driven("works", through=(Pose(x=0.0, y=0.0),))[0].outcome is Outcome.REACHED


@pytest.mark.service
def test_what_goes_wrong_is_an_outcome_with_its_reason() -> None:
    assert driven("aborts")[0].outcome is Outcome.ABORTED
    for behaviour, said in (("rejects", "rejected"), ("sleeps", "controller_server is not active")):
        (run,) = driven(behaviour)
        assert run.outcome is Outcome.STACK_FAILED
        told = run.details["stack"]
        assert isinstance(told, dict)
        assert said in told["fault"]


@cache
def rclpy_command() -> str | None:
    """How to run a Python with rclpy; None where there is none."""
    command = os.environ.get("RVSG_RCLPY", "python3")
    try:
        done = subprocess.run([*shlex.split(command), "-c", "import rclpy"], capture_output=True, timeout=60.0)
    except OSError:
        return None
    return command if done.returncode == 0 else None


@pytest.mark.service
@pytest.mark.parametrize("through", [(), (Pose(x=0.0, y=0.0),)], ids=["goal", "poses"])
def test_a_real_rclpy_drives_a_real_nav2(
    through: tuple[Pose, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if LAUNCH is None or rclpy_command() is None:
        pytest.skip("no Nav2 is found (see test_real_nav2), or no Python with rclpy (RVSG_RCLPY, else python3)")
    domain = 170 + os.getpid() % 30
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    params = tmp_path / "nav2.yaml"
    params.write_text(new_nav2_params(stack="nav2-dwb", release="jazzy"))
    parameters = {"localises": False, "publish_map": True, "start_limit_s": 100.0}
    options = {"timeout_s": 120.0, "period_s": 0.02, "parameters": parameters}
    chosen = StackChoice.of(f"exec-stack:{rclpy_command()} {BRIDGE}", options)
    route = Route(name="room", start=Pose(x=-2.0, y=0.0), goal=Pose(x=1.5, y=0.5), through=through, time_limit_s=60.0)
    nav2 = Launched(LAUNCH.replace("{params}", str(params)), ros_environment(domain))
    try:
        runs = [simulate_agents(empty_room(), route, [], seed=seed, stack=chosen) for seed in range(2)]
    finally:
        chosen.driver.close()
        nav2.close()
    assert [(run.outcome, run.stack_fault) for run in runs] == [(Outcome.REACHED, "")] * 2
