"""When the commands of a ROS 2 system act."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

from rvsg_ros2.stack import STEP_S, CommandQueue


@pytest.mark.parametrize("rate_hz", [10.0, 20.0, 25.0, 50.0])
def test_commands_of_a_usual_rate_act_at_equal_distances(rate_hz: float) -> None:
    step, period = round(1000 * STEP_S), round(1000 / rate_hz)
    for phase in range(period):
        acts = [-(-(phase + k * period) // step) * step for k in range(50)]
        assert {later - earlier for earlier, later in pairwise(acts)} == {period}


def sent(at: float, v: float) -> Any:
    velocity = SimpleNamespace(linear=SimpleNamespace(x=v, y=0.0), angular=SimpleNamespace(z=0.0))
    return SimpleNamespace(twist=velocity, sample_info=SimpleNamespace(source_timestamp=round(at * 1e9)))


def test_commands_that_are_taken_late_act_at_the_distances_in_which_they_were_sent() -> None:
    queue = CommandQueue()
    assert queue.put([sent(10.01, 0.1), sent(10.02, 0.2), sent(10.03, 0.3)], now=10.035)
    assert not queue.put([], now=10.035)
    acted = [[twist.vx for _, twist in queue.before(10.0 + 0.005 * k)] for k in range(1, 8)]
    assert acted == [[], [0.1], [], [0.2], [], [0.3], []]


def test_a_sender_whose_clock_is_ahead_is_obeyed_when_it_is_heard() -> None:
    queue = CommandQueue()
    queue.put([sent(99.0, 0.4)], now=10.0)
    assert [(at, twist.vx) for at, twist in queue.before(10.0)] == [(10.0, 0.4)]
