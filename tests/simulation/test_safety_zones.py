"""Safety fields: what a scanner sees in a zone slows or stops the robot."""

from __future__ import annotations

import numpy as np
import pytest

from rvsg.core.records import Pose
from rvsg.robots.robot import Robot, SafetyZone, load_robot
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.run import Run
from rvsg.world.world import Route

AMR = load_robot("industrial_amr")


def run_past(robot: Robot, *people: tuple[float, float], limit: float = 8.0) -> Run:
    """Drive 3 m straight ahead in an empty room among people who stand."""
    agents = [
        HumanAgent(name=f"human_{k}", start=place, goals=(place,), pauses_s=(0.0,), radius_m=0.3)
        for k, place in enumerate(people)
    ]
    route = Route(name="ahead", start=Pose(x=-2.0, y=0.0), goal=Pose(x=1.5, y=0.0), time_limit_s=limit)
    return simulate_agents(empty_room(), route, agents, robot=robot, seed=0)


def zone(speed: float, low: float, high: float, reach: float = 1.2) -> SafetyZone:
    corners = ((0.5, low), (reach, low), (reach, high), (0.5, high))
    return SafetyZone(name="zone", polygon=corners, speed_m_s=speed, release_s=0.5)


@pytest.mark.parametrize(("speed", "top"), [(0.3, 0.3), (0.0, 0.0)])
def test_somebody_in_a_zone_beside_the_way_limits_the_speed(speed: float, top: float) -> None:
    free = AMR.replace(safety_zones=())
    watched = AMR.replace(safety_zones=(zone(speed, 0.35, 1.2),))
    beside = (0.0, 0.95)
    fast, slow = run_past(free, beside), run_past(watched, beside)
    near = np.abs(slow.trajectory.x + 0.85) < 0.1
    assert fast.trajectory.v[np.abs(fast.trajectory.x + 0.6) < 0.1].max() > 0.5
    if speed > 0.0:
        assert slow.trajectory.v[np.abs(slow.trajectory.x + 0.5) < 0.1].max() <= top + 1e-6
    else:
        assert slow.trajectory.x.max() < 0.0
        assert slow.trajectory.v[-1] == 0.0
    assert not near.any() or slow.trajectory.v.max() > 0.5


def test_a_zone_that_is_clear_limits_nothing() -> None:
    free = run_past(AMR.replace(safety_zones=()))
    watched = run_past(AMR.replace(safety_zones=(zone(0.0, -0.3, 0.3, 0.7),)))
    assert watched.trajectory.v.max() == pytest.approx(free.trajectory.v.max())
