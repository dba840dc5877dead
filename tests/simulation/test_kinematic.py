"""The kinematic simulator: pauses by the rules of the embedded one, and every robot at its own speed."""

from __future__ import annotations

import numpy as np
import pytest

import rvsg
from rvsg.robots.robot import load_robot
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.kinematic import _walk

TIME = np.arange(0.0, 30.0, 0.05)


def standing(pause_s: float, start_pause_s: float) -> list[tuple[float, float]]:
    """Return where a person stands (x) and for how long, in order."""
    agent = HumanAgent(
        name="a", start=(0.0, 0.0), goals=((0.0, 0.0), (3.0, 0.0)), pauses_s=(pause_s, 0.0), start_pause_s=start_pause_s
    )
    x, _, _, speed = _walk(agent, TIME, np.random.default_rng(1))
    still = np.concatenate([[False], speed[1:] == 0.0, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    return [(float(x[a]), float(b - a) * 0.05) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def test_the_pause_of_the_last_waypoint_is_held_on_return_only() -> None:
    first, *later = standing(5.0, 0.0)
    assert first[1] < 0.6  # the start delay
    assert all(place < 0.2 and abs(lasting - 5.0) < 0.2 for place, lasting in later[:2])


def test_a_pause_at_the_start_is_held_once() -> None:
    first, *later = standing(0.0, 2.0)
    assert first[0] == 0.0
    assert 1.9 < first[1] < 2.6
    assert not later


@pytest.mark.parametrize("name", ["tiago_omni", "turtlebot3_waffle", "industrial_amr"])
def test_a_robot_drives_at_its_own_speed(name: str) -> None:
    scenario = rvsg.scenario("warehouse", "route_1", robot=name)
    run = rvsg.simulate(scenario, 1, simulator="kinematic")[0]
    assert run.completed
    assert run.trajectory.v.max() == pytest.approx(load_robot(name).driving_speed_m_s)
    assert run.robot_radius_m == load_robot(name).radius_m
