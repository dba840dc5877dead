"""The stacks that ship: what distinguishes each, and the exam that all of them pass."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.simulation.parts import TIAGO, route

from rvsg.core.errors import InputError
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.embedded.simulator import EmbeddedSimulator, empty_room, simulate_agents
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks.pure_pursuit import PurePursuit, carrot, pursue, regulated, turn_towards
from rvsg.stacks import StackChoice, stack_names
from rvsg.testing import check_stack

ROUTE = route((-2.2, 0.0), (2.0, 0.0), 20.0)
EXAMPLE = Path(__file__).parents[2] / "examples" / "stacks" / "follow_the_plan.py"


def drive(stack: str, *walk: tuple[float, float], **options: Any) -> Run:
    """A run across the room past somebody who walks from point to point and stays at the last."""
    pauses = (*(0.0 for _ in walk[1:]), 60.0)
    human = HumanAgent(name="ann", start=walk[0], goals=walk, pauses_s=pauses)
    return simulate_agents(empty_room(), ROUTE, [human], stack=StackChoice.of(stack, options))


def nearest(run: Run) -> float:
    path = run.trajectory
    return float(np.hypot(path.x - path.human_x[:, 0], path.y - path.human_y[:, 0]).min())


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({*stack_names()} - {"nav2-dwb", "exec", "exec-stack", "ros2"}))
def test_every_stack_that_ships_passes_the_exam(name: str) -> None:
    check_stack(name)


def test_the_example_passes_the_exam() -> None:
    check_stack(f"{EXAMPLE}:FollowThePlan")


def test_stop_and_go_waits_before_a_person_and_nav2_drives_around() -> None:
    walk = ((0.0, -2.3), (0.0, 0.0))
    waiting = drive("stop-and-go", *walk)
    assert waiting.outcome is Outcome.TIMED_OUT and waiting.recoveries == 0
    assert waiting.trajectory.x.max() < -0.5 and nearest(waiting) > 0.7
    around = drive("nav2-rpp", *walk)
    assert around.trajectory.x.max() > 0.5


def test_social_keeps_more_distance_than_pure_pursuit() -> None:
    beside = (0.0, 0.3)
    assert nearest(drive("social", beside)) > nearest(drive("nav2-rpp", beside)) + 0.1


def numbers(**options: Any) -> Any:
    square = np.array([(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)])
    return PurePursuit(**options).numbers(square, 0.2, math.hypot(0.3, 0.2), 0.25, 0.05)


def test_the_carrot_lies_on_the_circle_between_two_points() -> None:
    plan = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]])
    assert carrot(plan, 0, 0.6, 0.0, 0.0) == pytest.approx((0.6, 0.0))
    x, y = carrot(plan, 0, 0.6, 0.0, 0.3)
    assert math.hypot(x, y - 0.3) == pytest.approx(0.6) and y == 0.0
    assert carrot(plan, 0, 3.0, 0.0, 0.0) == (1.0, 0.0)


def test_the_speed_is_regulated_as_nav2_does() -> None:
    p = numbers()
    assert regulated(0.5, 0.0, 0.0, 9.0, 9.0, p) == 0.5
    # A radius of 0.6 m under the least of 0.9 m: 0.5 (1 - 0.3 / 0.9).
    assert regulated(0.5, 1 / 0.6, 0.0, 9.0, 9.0, p) == pytest.approx(0.5 * (1 - 0.3 / 0.9))
    assert regulated(0.5, 10.0, 0.0, 9.0, 9.0, p) == 0.25
    # Cost 128 is 0.2 m + ln(253 / 128) / 3 from the obstacle.
    away = 0.2 + math.log(253 / 128) / 3
    assert regulated(0.5, 0.0, 128.0, 9.0, 9.0, p) == pytest.approx(0.5 * away / 0.6)
    assert regulated(0.5, 0.0, 0.0, 0.5, 0.3, p) == pytest.approx(0.25)
    assert regulated(0.5, 0.0, 0.0, 0.5, 0.01, p) == pytest.approx(0.05)


def test_it_turns_on_the_spot_within_its_acceleration_and_does_not_overshoot() -> None:
    p = numbers()
    assert turn_towards(1.0, 0.0, p) == pytest.approx(3.2 * 0.05)
    assert turn_towards(-1.0, -1.8, p) == pytest.approx(-1.8)
    assert turn_towards(0.1, 0.9, p) == pytest.approx(math.sqrt(2 * 3.2 * 0.1))


def test_a_lethal_cell_ahead_within_reach_leaves_no_command() -> None:
    plan = np.column_stack([np.linspace(1.5, 2.9, 60), np.full(60, 1.5)])
    cells = np.zeros((60, 60), np.uint8)
    free = pursue(plan, cells, 0.0, 0.0, 0.05, 1.5, 1.5, 0.0, 0.5, 0.0, 0.0, numbers())
    assert free[0] and free[1:] == pytest.approx((0.5, 0.0))
    cells[30, 43] = 254  # 0.65 m ahead: within a second at 0.5 m/s, as the front lies 0.3 m ahead
    assert not pursue(plan, cells, 0.0, 0.0, 0.05, 1.5, 1.5, 0.0, 0.5, 0.0, 0.0, numbers())[0]
    later = numbers(max_allowed_time_to_collision_up_to_carrot=0.3)
    assert pursue(plan, cells, 0.0, 0.0, 0.05, 1.5, 1.5, 0.0, 0.5, 0.0, 0.0, later)[0]


def test_options_change_the_robot_and_wrong_ones_are_one_error() -> None:
    stack = StackChoice.of("nav2-dwb", {"smoother": {"max_speed_m_s": 0.3}, "dwb": {"sim_time_s": 2.0}})
    robot = stack.driver.adapt(TIAGO)
    assert robot.navigation.smoother.max_speed_m_s == 0.3 and robot.navigation.dwb.sim_time_s == 2.0
    assert stack.record.options == {"smoother": {"max_speed_m_s": 0.3}, "dwb": {"sim_time_s": 2.0}}
    assert "stack" in EmbeddedSimulator(stack=stack.record.model_dump()).options
    for name, options in (
        ("nav2-rpp", {"lookahead": 1}),
        ("nav2-rpp", {"lookahead_dist": -1}),
        ("nav2-dwb", {"smoother": {"frequency": 1}}),
        ("stop-and-go", {"warning_m": 0.1}),
    ):
        with pytest.raises(InputError):
            StackChoice.of(name, options)


def test_another_footprint_leaves_the_body() -> None:
    square = [[0.5, 0.4], [-0.5, 0.4], [-0.5, -0.4], [0.5, -0.4]]
    after = StackChoice.of("nav2-rpp", {"footprint": square}).driver.adapt(TIAGO)
    assert after.footprint[0] == (0.5, 0.4) and after.outline == TIAGO.outline
