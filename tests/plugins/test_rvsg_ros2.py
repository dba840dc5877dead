"""plugins/rvsg-ros2 behind the stack protocol, with a stand-in for rclpy: it has not been run with ROS 2."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from rvsg.core.records import Pose
from rvsg.simulation.embedded.rehearsal import empty_room
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks.registry import StackChoice
from rvsg.world.world import Route

FAKE = Path(__file__).with_name("fake_ros.py")
PLUGIN = Path(__file__).parents[2] / "plugins" / "rvsg-ros2"


def driven(behaviour: str, runs: int = 1, through: tuple[Pose, ...] = (), **parameters: Any) -> list[Run]:
    options = {"timeout_s": 30.0, "parameters": {"speed": 5.0, "start_limit_s": 3.0, "settle_s": 0.1, **parameters}}
    chosen = StackChoice.of(f"exec-stack:{sys.executable} {FAKE} {behaviour}", options)
    route = Route(name="room", start=Pose(x=-2.0, y=0.0), goal=Pose(x=1.0, y=0.5), through=through, time_limit_s=15.0)
    try:
        return [simulate_agents(empty_room(), route, [], seed=seed, stack=chosen) for seed in range(runs)]
    finally:
        chosen.driver.close()


@pytest.mark.slow
def test_it_drives_runs_one_after_another_and_through_poses() -> None:
    assert [run.outcome for run in driven("works", 2)] == [Outcome.REACHED, Outcome.REACHED]
    assert driven("works", through=(Pose(x=0.0, y=0.0),), localises=False)[0].outcome is Outcome.REACHED
    assert driven("works", through=(Pose(x=0.0, y=0.0),))[0].outcome is Outcome.REACHED


@pytest.mark.slow
def test_what_goes_wrong_is_an_outcome_with_its_reason() -> None:
    assert driven("aborts")[0].outcome is Outcome.ABORTED
    for behaviour, said in (("rejects", "rejected"), ("sleeps", "controller_server is not active")):
        (run,) = driven(behaviour)
        assert run.outcome is Outcome.STACK_FAILED
        told = run.details["stack"]
        assert isinstance(told, dict)
        assert said in told["fault"]


def test_the_wheel_takes_the_client_of_this_version() -> None:
    settings = tomllib.loads((PLUGIN / "pyproject.toml").read_text())
    included = settings["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    for source in included:
        assert (PLUGIN / source).resolve().is_file()
