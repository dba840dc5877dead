"""The robot's base."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.simulation.parts import MECANUM, STACK, TIAGO

from rvsg.core.angles import wrap
from rvsg.core.references import refer
from rvsg.robots.robot import Robot, load_robot
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.robot_parameters import stack_of

NONE = np.zeros((1, 3))


def body(**values: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    state = base.new_body()
    for name, value in values.items():
        state[getattr(base, name.upper())] = value
    return state


def test_the_smoother_caps_speed_and_steps_from_its_own_last_output() -> None:
    state = body(command_v=1.0, command_w=1.0, v=0.3)
    seen = []
    for _ in range(8):
        base.smooth(state, 0.0, STACK)
        seen.append((state[base.SMOOTH_V], state[base.SMOOTH_W]))
    assert [v for v, _ in seen] == pytest.approx([0.125, 0.25, 0.375, 0.5, 0.5, 0.5, 0.5, 0.5])
    assert [w for _, w in seen] == pytest.approx([0.16, 0.32, 0.48, 0.64, 0.8, 0.96, 1.0, 1.0])


def test_a_command_older_than_a_second_counts_as_zero() -> None:
    state = body(command_v=1.0, smooth_v=0.5, command_t=2.0)
    base.smooth(state, 3.0, STACK)
    assert state[base.SMOOTH_V] == 0.5
    base.smooth(state, 3.01, STACK)
    assert state[base.SMOOTH_V] == 0.375


@pytest.mark.parametrize(
    ("begin", "gain", "shown"),
    [
        ({"v": 0.2, "smooth_v": 0.2526}, 1.0, 5.26),
        ({"v": 0.2, "smooth_v": 0.325}, 1.0, 12.5),
        ({"smooth_w": 2 / 19}, 0.755, 2.28),  # by the sensor's lever
        ({"smooth_w": 0.16}, 0.755, 3.47),
    ],
)
def test_a_step_of_a_velocity_shows_as_a_spike(begin: dict[str, float], gain: float, shown: float) -> None:
    assert math.hypot(*base.advance(body(**begin), gain, NONE, 0, STACK)) == pytest.approx(shown, abs=0.01)


def test_the_base_turns_by_its_yaw_gain_and_drives_a_circle() -> None:
    state = body(smooth_v=0.5, smooth_w=1.0)
    for _ in range(100):
        base.advance(state, 0.755, NONE, 0, STACK)
    assert state[base.YAW] == pytest.approx(0.755)
    radius = 0.5 / 0.755
    assert state[base.X] == pytest.approx(radius * math.sin(0.755), abs=1e-4)
    assert state[base.Y] == pytest.approx(radius * (1 - math.cos(0.755)), abs=1e-4)


@pytest.mark.parametrize("angle", [-math.pi, math.pi, 3 * math.pi, -7.0, 0.0, 1e3])
def test_angles_are_wrapped_into_minus_pi_to_pi(angle: float) -> None:
    wrapped = wrap(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle))


def driven(robot: Robot, ticks: int, v: float, w: float, **begin: float) -> np.ndarray:
    """States of the base, one per tick, whose smoother has long reached (v, w)."""
    stack = stack_of(robot)
    state = body(smooth_v=v, smooth_w=w, **begin)
    waiting = np.zeros((max(1, stack.latency_ticks), 3))
    rows = []
    for k in range(ticks):
        base.advance(state, 1.0, waiting, k, refer(stack))
        rows.append(state.copy())
    return np.array(rows)


class TestDrive:
    """Limits of another robot's base."""

    AMR = load_robot("industrial_amr")
    TUGGER = load_robot("tugger")

    def test_acceleration_and_jerk_are_limited_and_the_speed_is_reached_without_overshoot(self) -> None:
        rows = driven(self.AMR, 300, 1.5, 0.0)
        v = rows[:, base.V]
        rates = np.diff(v, prepend=0.0) / 0.01
        assert rates.max() <= 1.5 + 1e-9
        assert np.abs(np.diff(rates, prepend=0.0)).max() <= 8.0 * 0.01 * 1.3
        assert v.max() <= 1.5 + 1e-9
        assert v[-1] == pytest.approx(1.5, abs=1e-3)

    def test_a_command_waits_for_the_latency_of_the_base(self) -> None:
        rows = driven(self.AMR, 20, 1.0, 0.0)
        assert (rows[:5, base.V] == 0.0).all()
        assert rows[5, base.V] > 0.0

    def test_the_yaw_rate_is_limited_in_change_and_size(self) -> None:
        rows = driven(self.AMR, 200, 0.0, 3.0)
        rates = np.diff(rows[:, base.W], prepend=0.0) / 0.01
        assert rates.max() <= 2.0 + 1e-9
        assert rows[-1, base.W] == pytest.approx(1.0)

    def test_a_steered_robot_turns_by_its_wheel_and_not_on_the_spot(self) -> None:
        assert np.ptp(driven(self.TUGGER, 300, 0.0, 1.0)[:, base.YAW]) == 0.0
        rows = driven(self.TUGGER, 600, 0.3, 1.0)
        assert np.abs(np.diff(rows[:, base.STEERING])).max() <= 1.5 * 0.01 + 1e-12
        assert rows[-1, base.STEERING] == pytest.approx(1.05)
        assert rows[-1, base.W] == pytest.approx(0.3 * math.tan(1.05) / 0.95, rel=1e-3)

    @pytest.mark.parametrize(
        ("robot", "ticks", "command", "begin", "reached"),
        [
            (AMR, 300, (-1.0, 0.0), {}, -0.3),
            (AMR, 300, (1.5, 0.0), {"cap_ahead": 0.4}, 0.4),
            (AMR, 300, (-0.2, 0.0), {"cap_ahead": 0.0}, -0.2),
            (AMR, 100, (1.0, 0.5), {"stopped_t": 9.0}, 0.0),
            (TIAGO, 1, (0.5, 1.0), {}, 0.5),
        ],
        ids=["reverse", "scanner ahead", "scanner behind", "bumper", "TIAGo: at once"],
    )
    def test_the_speed_that_is_reached(
        self, robot: Robot, ticks: int, command: tuple[float, float], begin: dict[str, float], reached: float
    ) -> None:
        assert driven(robot, ticks, *command, **begin)[-1, base.V] == pytest.approx(reached, abs=1e-3)

    def test_the_base_takes_on_a_lateral_speed_as_fast_as_its_limits_allow(self) -> None:
        robot = load_robot(MECANUM)
        rows = driven(robot, 100, 0.0, 0.0, smooth_side=1.0)
        assert rows[19, base.SIDE] == pytest.approx(0.2 * robot.limits.acceleration_m_s2)
        assert rows[-1, base.SIDE] == robot.limits.lateral_m_s
        assert rows[-1, base.Y] > 0.2 and rows[-1, base.X] == 0.0
