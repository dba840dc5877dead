"""Worlds are checked and routes proposed for the robot that is to drive there."""

from __future__ import annotations

import pytest

from rvsg.robots import load_robot
from rvsg.world.authoring.check import check_world
from rvsg.world.authoring.routes import propose_routes
from rvsg.world.fitting import clearance_m, fits_through, setback_m
from rvsg.world.io.load import SHIPPED, load_world


def messages(robot: str | None) -> list[str]:
    driver = None if robot is None else load_robot(robot)
    return [f"{r.problem}" for r in check_world(SHIPPED / "warehouse", robot=driver)]


def test_what_has_to_be_fitted_to_a_robot_is_a_remark_at_its_route() -> None:
    found = [text for text in messages("tugger") if "tugger" in text]
    assert len(found) == 2
    assert all("routes.yaml" in text for text in found)
    assert not any("tugger" in text for text in messages(None))
    assert len([text for text in messages("turtlebot3_waffle") if "turtlebot3_waffle" in text]) == 5


def test_a_robot_wider_than_every_way_cannot_drive() -> None:
    slim = load_robot("industrial_amr")
    wide = slim.replace(
        footprint=((1.5, 1.5), (-1.5, 1.5), (-1.5, -1.5), (1.5, -1.5)),
        safety_zones=(),
        lidars=tuple(lidar.replace(height_m=1.0) for lidar in slim.lidars),
    )
    found = check_world(SHIPPED / "warehouse", robot=wide)
    assert sum(remark.serious for remark in found) >= 5


@pytest.mark.parametrize(
    "name",
    ["turtlebot3_waffle", *(pytest.param(name, marks=pytest.mark.slow) for name in ("tugger", "industrial_amr"))],
)
def test_routes_are_proposed_for_the_robot(name: str) -> None:
    world, robot = load_world("hospital"), load_robot(name)
    routes = propose_routes(world, robot=robot)
    assert routes
    for route in routes:
        assert setback_m(route.goal, robot, world) == 0.0
        assert fits_through(robot, route, world)


def test_a_robot_keeps_clear_by_half_of_its_width() -> None:
    assert clearance_m(load_robot("tiago_omni")) == pytest.approx(0.3, abs=0.003)
    assert clearance_m(load_robot("tugger")) == pytest.approx(0.375)
