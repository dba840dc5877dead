"""The robot's base."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.simulation.tiago import STACK

from rvsg.simulation.embedded import base


def body(**values: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    state = np.zeros(base.BODY_SIZE)
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


@pytest.mark.parametrize(("change", "shown"), [(0.0526, 5.26), (0.125, 12.5)])
def test_a_step_of_the_velocity_shows_as_a_spike(change: float, shown: float) -> None:
    state = body(v=0.2, smooth_v=0.2 + change)
    forward, left = base.advance(state, 1.0, 0.287)
    assert math.hypot(forward, left) == pytest.approx(shown)


@pytest.mark.parametrize(("rate", "shown"), [(2 / 19, 2.28), (0.16, 3.47)])
def test_a_step_of_the_yaw_rate_shows_as_the_sensors_lever_tells(rate: float, shown: float) -> None:
    _, left = base.advance(body(smooth_w=rate), 0.755, 0.287)
    assert abs(left) == pytest.approx(shown, abs=0.01)


def test_the_base_turns_by_its_yaw_gain_and_drives_a_circle() -> None:
    state = body(smooth_v=0.5, smooth_w=1.0)
    for _ in range(100):
        base.advance(state, 0.755, 0.287)
    assert state[base.YAW] == pytest.approx(0.755)
    radius = 0.5 / 0.755
    assert state[base.X] == pytest.approx(radius * math.sin(0.755), abs=1e-4)
    assert state[base.Y] == pytest.approx(radius * (1 - math.cos(0.755)), abs=1e-4)


@pytest.mark.parametrize("angle", [-math.pi, math.pi, 3 * math.pi, -7.0, 0.0, 1e3])
def test_angles_are_wrapped_into_minus_pi_to_pi(angle: float) -> None:
    wrapped = base.wrap(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle))
