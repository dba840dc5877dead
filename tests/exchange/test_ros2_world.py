"""The simulator ros2-world against a process that publishes the embedded world as Gazebo and HuNavSim do."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tests.coded import coded
from tests.simulation.ros2.isolated import run_isolated

import rvsg
from rvsg.core.errors import InputError, InvalidOptions, SimulationError
from rvsg.core.plugins import make
from rvsg.scenario.scenario import Trolley
from rvsg_ros2.ros2_world import Ros2World

DRIVE = Path(__file__).with_name("drive_world.py")
BUSY = {"start_limit_s": 600.0}  # a process that imports and compiles may start late


@pytest.mark.service
@pytest.mark.parametrize("people_msgs", [False, pytest.param(True, marks=pytest.mark.exhaustive)])
def test_the_recorded_run_is_the_one_that_the_world_played(people_msgs: bool) -> None:
    topic = "people" if people_msgs else "human_states"
    told = run_isolated(
        DRIVE, world={"people_msgs": people_msgs, "topic": topic}, options={"people": f"/{topic}", **BUSY}
    )
    assert told.get("outcome") == "REACHED", told
    assert told["names"] == ["Ann", "Bob"]
    assert told["t"][0] == 0.0
    assert told["rows"] > 100
    assert told["log"][0] == pytest.approx(0.5, abs=0.06)
    assert told["again"]
    assert told["off"]["shift"] > -0.2
    assert told["off"]["robot"] < 0.03
    assert told["off"]["people"] < 0.08


@pytest.mark.service
@pytest.mark.skipif("RVSG_HUNAV_MANAGER" not in os.environ, reason="RVSG_HUNAV_MANAGER does not say how it starts")
def test_people_of_hunavsims_own_agent_manager_are_recorded() -> None:
    told = run_isolated(DRIVE, world={"manager": os.environ["RVSG_HUNAV_MANAGER"]}, options={"dialect": "flat"})
    assert told.get("outcome") == "REACHED", told
    assert told["names"] == ["Ann", "Bob"]
    assert told["off"]["robot"] < 0.03
    assert told["off"]["people"] < 0.15
    assert min(told["walked"]) > 1.0


@pytest.mark.exhaustive
def test_a_world_that_stops_or_lacks_people_is_told() -> None:
    stopped = run_isolated(DRIVE, world={"stop_at_s": 1.0}, options={"answer_limit_s": 1.0, **BUSY})
    assert stopped["outcome"] == "STACK_FAILED"
    lacking = run_isolated(DRIVE, world={"topic": "elsewhere"}, options={"start_limit_s": 90.0})
    assert "agent1, agent2 on /human_states" in lacking["error"]


def test_the_simulator_is_registered_and_checks_its_options() -> None:
    simulator = make("simulator", "ros2-world", {"launch": "ros2 launch {agents}"})
    assert isinstance(simulator, Ros2World)
    assert simulator.options["repeatable"] is False
    with pytest.raises(InputError, check=coded("ros2-no-agents-file")):
        Ros2World().prepare(print)
    with pytest.raises(InvalidOptions, check=lambda error: error.keys == ("speed",)):
        Ros2World(speed=4)


def test_what_a_file_of_agents_cannot_say_is_refused() -> None:
    world = rvsg.load_world("warehouse")
    scenario = rvsg.scenario(world, "route_1", [rvsg.walk("Anna", "E15", "H15")])
    (anna,) = scenario.people.humans
    pusher = anna.replace(trolley=Trolley())
    scenario = scenario.replace(people=scenario.people.replace(humans=(pusher,)))
    with pytest.raises(SimulationError, check=coded("ros2-bodies-unknown")):
        Ros2World(launch="ros2 launch {agents}").run(scenario, world, seed=0)
