"""Robots that move sideways: what commands them, what holds them, and where the lateral speed is recorded."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.simulation.parts import MECANUM as MECANUM_FILE
from tests.simulation.parts import TIAGO, Constant, route, standing

from rvsg.robots.robot import Robot, load_robot
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.archive import PackedRun, run_from_json, run_to_json
from rvsg.simulation.embedded.simulator import EmbeddedSimulator, empty_room, simulate_agents
from rvsg.simulation.events import Contact, ObstacleContact
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks.external_process import write_clients_to
from rvsg.stacks import Ended, Observation, StackChoice, Task, Twist, WholeStack
from rvsg.world.world import Route

MECANUM = load_robot(MECANUM_FILE)
ASIDE = route((0.0, -1.5), (0.0, 1.5), 15.0)


class Crab(WholeStack):
    """Goes to the goal without turning."""

    def reset(self, task: Task) -> None:
        self.goal = task.goals[-1]

    def step(self, seen: Observation) -> Twist | Ended:
        dx, dy = self.goal.x - seen.pose[0], self.goal.y - seen.pose[1]
        if math.hypot(dx, dy) < 0.1:
            return Ended.REACHED
        return Twist(max(-0.4, min(0.4, dx)), max(-0.4, min(0.4, dy)), 0.0)


def drive(stack: Any, way: Route = ASIDE, robot: Robot = MECANUM, *people: HumanAgent) -> Run:
    return simulate_agents(empty_room(), way, people, robot=robot, stack=StackChoice.of(stack))


def sideways() -> Constant:
    return Constant((0.0, 0.4, 0.0))


def test_a_planner_that_commands_a_lateral_speed_moves_the_robot_sideways() -> None:
    planner = sideways()
    run = drive(planner)
    path = run.trajectory
    assert run.outcome is Outcome.REACHED
    assert np.abs(path.x).max() < 0.02 and np.abs(path.yaw).max() < 1e-6
    assert path.y[-1] > 1.2
    assert path.lateral.max() == pytest.approx(0.4) and np.abs(path.v).max() == 0.0
    assert np.allclose(np.diff(path.y)[20:40], path.lateral[20:40] * np.diff(path.t)[20:40], atol=1e-3)
    assert max(planner.lateral) == pytest.approx(0.4)
    assert run.details["stack"]["clipped"] == 0  # type: ignore[index]
    assert np.allclose(path.speed, path.lateral)


def test_a_whole_stack_drives_sideways_to_a_goal_beside_it() -> None:
    run = drive(Crab())
    assert run.outcome is Outcome.REACHED
    assert np.abs(run.trajectory.yaw).max() < 1e-6


def test_another_robot_is_not_moved_sideways() -> None:
    run = drive(Constant((0.2, 0.4, 0.0)), robot=TIAGO)
    told: Any = run.details["stack"]
    assert told["clipped"] == told["calls"] > 0
    assert np.abs(run.trajectory.y + 1.5).max() < 1e-6
    assert run.trajectory.lateral.size == 0


def test_a_process_that_speaks_protocol_2_drives_sideways(tmp_path: Path) -> None:
    write_clients_to(tmp_path)
    (tmp_path / "crab.py").write_text(
        "import rvsg_client\n"
        "class Crab(rvsg_client.Planner):\n    scans = people = costmap = False\n    def command(self, seen):\n"
        "        assert 0.0 <= seen.lateral <= 0.4 + 1e-9\n        return 0.0, 0.4, 0.0\n"
        "rvsg_client.serve(Crab())\n"
    )
    choice = StackChoice.of(f"exec:{sys.executable} {tmp_path / 'crab.py'}")
    try:
        piped = simulate_agents(empty_room(), ASIDE, [], robot=MECANUM, stack=choice)
    finally:
        choice.driver.close()
    assert piped.stack_fault == ""
    assert np.array_equal(piped.trajectory.y, drive(sideways()).trajectory.y)


def test_dwb_samples_lateral_speeds_where_the_robot_file_asks_for_it() -> None:
    navigation = MECANUM.navigation
    without = MECANUM.replace(navigation=navigation.replace(dwb=navigation.dwb.replace(max_lateral_m_s=0.0)))
    run, straight = (simulate_agents(empty_room(), ASIDE, [], robot=robot) for robot in (MECANUM, without))
    assert run.outcome is Outcome.REACHED
    assert np.abs(run.trajectory.lateral).max() > 0.1
    assert np.abs(straight.trajectory.lateral).max() == 0.0


TO_THE_WALL = route((0.0, 0.0), (0.0, -2.0), 10.0)


def test_a_wall_beside_the_robot_holds_it() -> None:
    run = drive(sideways(), TO_THE_WALL)
    contacts = [event for event in run.events if isinstance(event, ObstacleContact)]
    assert contacts and contacts[0].speed_m_s == pytest.approx(0.4)
    half = 0.188
    assert run.trajectory.y.max() < 3.0 - half + 0.002


def test_a_person_between_the_robot_and_a_wall_holds_it_and_the_contact_is_an_event() -> None:
    run = drive(sideways(), TO_THE_WALL, MECANUM, standing(0.0, 2.6))
    contacts = [event for event in run.events if isinstance(event, Contact)]
    assert contacts and contacts[0].robot_part_m_s > 0.2
    assert contacts[0].bearing_rad == pytest.approx(math.pi / 2, abs=0.3)
    assert max(contact.overlap_m for contact in contacts) < 0.01


@pytest.mark.parametrize(
    ("stack", "told"), [("nav2-rpp", 1), ("nav2-mppi", 1), ("social", 1), ("nav2-dwb", 0), (sideways(), 0)]
)
def test_a_stack_that_never_moves_sideways_says_so(stack: Any, told: int) -> None:
    made = EmbeddedSimulator(stack=stack)
    assert len(made.notes(MECANUM)) == told
    assert made.notes(TIAGO) == ()


def test_a_run_keeps_its_lateral_speed_in_every_form() -> None:
    run = drive(sideways())
    for again in (run_from_json(run_to_json(run)), PackedRun.of(run).unpack()):
        assert np.array_equal(again.trajectory.lateral, run.trajectory.lateral)
        assert np.array_equal(again.log.lateral, run.log.lateral)
    plain = drive(Constant((0.2, 0.0)), robot=TIAGO)
    assert run_from_json(run_to_json(plain)).trajectory.lateral.size == 0


def test_a_bag_of_a_run_holds_the_lateral_speed(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rvsg.recording.recorded_run import recorded_run
    from rvsg.recording.tracks import load_recording
    from rvsg_exchange.bag import write_bag
    from rvsg_exchange.recordings import bag_messages, open_bag

    run, path = drive(Crab()), tmp_path / "run.mcap"
    write_bag(run, empty_room(), path)
    with open_bag(path) as reader:
        odometry = [message for _, _, message in bag_messages(reader, path, ["/odom"])]
    assert [message.twist.twist.linear.y for message in odometry] == run.trajectory.lateral.tolist()
    again = recorded_run(load_recording(path, world=empty_room()))[0]
    assert np.allclose(again.trajectory.lateral, run.trajectory.lateral[: len(again.trajectory)], atol=1e-6)


def test_a_trace_holds_the_lateral_speed_and_its_samples() -> None:
    from rvsg.scenario.scenario import HumanConfiguration, Mission, Scenario
    from rvsg.simulation.embedded.trace import trace_run
    from rvsg.world.world_folder import load_world
    from rvsg_exchange.bag import TraceMessages, rosbags_types

    world = load_world("warehouse")
    mission = Mission.of(world, world.route("route_1"), robot=MECANUM)
    trace = trace_run(Scenario(mission=mission, people=HumanConfiguration(humans=())), world, seed=0)
    assert any(frame.command[2] != 0.0 for frame in trace.frames)
    (tried, *_) = [frame.evaluation for frame in trace.frames if frame.evaluation is not None]
    assert tried.velocity.shape[1] == 3 and np.unique(tried.velocity[:, 2]).size >= 5
    sent = [m for _, topic, m in TraceMessages(rosbags_types(), trace, (0.0, 0.0)).all() if topic == "/cmd_vel"]
    assert [m.linear.y for m in sent] == [frame.command[2] for frame in trace.frames]


def test_robots_that_stand_keep_their_ids() -> None:
    dumped = TIAGO.model_dump(mode="json")
    assert "lateral_m_s" not in dumped["limits"]
    assert not {"max_lateral_m_s", "lateral_samples"} & dumped["navigation"]["dwb"].keys()
