"""The kinematic simulator drives every robot at its own speed."""

from __future__ import annotations

import pytest

import rvsg
from rvsg.robots.robot import load_robot


@pytest.mark.parametrize("name", ["tiago_omni", "turtlebot3_waffle", "industrial_amr"])
def test_a_robot_drives_at_its_own_speed(name: str) -> None:
    scenario = rvsg.scenario("warehouse", "route_1", robot=name)
    run = rvsg.simulate(scenario, 1, simulator="kinematic")[0]
    assert run.completed
    assert run.trajectory.v.max() == pytest.approx(load_robot(name).driving_speed_m_s)
    assert run.robot_radius_m == load_robot(name).radius_m
