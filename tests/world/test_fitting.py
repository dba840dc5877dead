"""A route is fitted to the robot that drives it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rvsg.core.records import Pose
from rvsg.robots.robot import Robot, load_robot, shipped_robots
from rvsg.scenario.scenario import HumanConfiguration, Mission
from rvsg.scenario.validity import check
from rvsg.world.grid import Grid
from rvsg.world.routes import fits_through, fitted, setback_m
from rvsg.world.world import OccupancyMap, Route, World
from rvsg.world.world_folder import load_world

TUGGER, AMR, TIAGO = (load_robot(name) for name in ("tugger", "industrial_amr", "tiago_omni"))


def hall(gate_m: float = 1.0) -> World:
    """Return a room of 10 x 4 m, divided by a wall with a gate in the middle."""
    cells = np.zeros((80, 200), np.uint8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    half = round(gate_m / 0.1)
    cells[: 40 - half, 100] = 100
    cells[40 + half :, 100] = 100
    return World(
        name="hall",
        title="A hall",
        objects=(),
        occupancy=OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=0.0, y=0.0)),
        lidar_height_m=0.2,
        grid=Grid(rows=(), columns=(), waypoints=(), hops=()),
        areas=(),
        routes=(),
    )


def route(goal_x: float = 8.0) -> Route:
    return Route(name="through", start=Pose(x=2.0, y=2.0), goal=Pose(x=goal_x, y=2.0), time_limit_s=30.0)


def test_a_goal_in_front_of_a_wall_moves_back_by_the_body_and_its_stopping_zone() -> None:
    world = hall(2.0)
    fit, notes = fitted(route(9.4), TUGGER, world)
    front = 1.45  # the protective zone ends there
    assert fit.goal.x == pytest.approx(9.95 - front - 0.1, abs=0.06)
    assert len(notes) == 1
    assert fitted(fit, TUGGER, world) == (fit, ())
    assert setback_m(route(8.0).goal, TUGGER, world) == 0.0
    assert setback_m(route(9.4).goal, TIAGO, world) == 0.0


def test_a_goal_that_no_setback_helps_stays() -> None:
    corner = Pose(x=5.0, y=0.1, yaw=0.0)
    assert setback_m(corner, TUGGER, hall(2.0)) is None
    asked = route().model_copy(update={"goal": corner})
    assert fitted(asked, TUGGER, hall(2.0))[0].goal == corner


def test_a_slow_robot_gets_the_time_it_needs() -> None:
    slow = load_robot("turtlebot3_waffle")
    fit, _ = fitted(route(), slow, hall())
    assert fit.time_limit_s >= 6.0 / slow.driving_speed_m_s
    assert fitted(fit, slow, hall())[1] == ()
    assert fitted(route(), AMR, hall())[1] == ()


@pytest.mark.parametrize("name", sorted(shipped_robots()))
def test_every_shipped_robot_can_stand_at_the_ends_of_the_warehouse(name: str) -> None:
    world = load_world("warehouse")
    for each in world.routes:
        assert setback_m(fitted(each, load_robot(name), world)[0].goal, load_robot(name), world) == 0.0
        assert fits_through(load_robot(name), each, world)


def test_a_robot_wider_than_the_only_gate_is_refused() -> None:
    def findings(robot: Robot | str, gate_m: float) -> list[str]:
        world = hall(gate_m)
        return [f.rule for f in check(HumanConfiguration(humans=()), Mission.of(world, route(), robot=robot), world)]

    assert findings(AMR, 0.4) == ["robot-too-wide"]
    assert findings(AMR, 0.8) == []
    assert findings("tiago_omni", 0.4) == []
    assert math.isclose(AMR.width_m, 0.58)
