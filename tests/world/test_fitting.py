"""Routes and checks for the robot that is to drive there."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from tests.world.parts import map_of, walled

from rvsg.core.records import Pose
from rvsg.robots.robot import Robot, load_robot, shipped_robots
from rvsg.scenario.scenario import HumanConfiguration, Mission
from rvsg.scenario.validity import check
from rvsg.world.checks import check_world
from rvsg.world.grid import Grid
from rvsg.world.passages import line_of, narrow_passages
from rvsg.world.routes import Drive, Hop, clearance_m, fits_through, fitted, propose_routes, setback_m
from rvsg.world.world import Route, World
from rvsg.world.world_folder import SHIPPED, load_world

TUGGER, AMR, TIAGO = (load_robot(name) for name in ("tugger", "industrial_amr", "tiago_omni"))


def hall(gate_m: float = 1.0) -> World:
    """Return a room of 10 x 4 m, divided by a wall with a gate in the middle."""
    cells = walled(80, 200)
    half = round(gate_m / 0.1)
    cells[: 40 - half, 100] = cells[40 + half :, 100] = 100
    return World(
        name="hall", title="A hall", objects=(), occupancy=map_of(cells), lidar_height_m=0.2, areas=(), routes=(),
        grid=Grid(rows=(), columns=(), waypoints=(), hops=()),
    )  # fmt: skip


def test_a_goal_in_front_of_a_wall_moves_back_by_the_body_and_its_stopping_zone() -> None:
    world = hall(2.0)
    fit, notes = fitted(route(9.4), TUGGER, world)
    front = 1.45  # the protective zone ends there
    assert fit.goal.x == pytest.approx(9.95 - front - 0.1, abs=0.06)
    assert len(notes) == 1
    assert fitted(fit, TUGGER, world) == (fit, ())
    assert setback_m(route(8.0).goal, TUGGER, world) == 0.0
    assert setback_m(route(9.4).goal, TIAGO, world) == 0.0
    corner = Pose(x=5.0, y=0.1, yaw=0.0)
    assert setback_m(corner, TUGGER, world) is None  # the goal stays where it is
    assert fitted(route().model_copy(update={"goal": corner}), TUGGER, world)[0].goal == corner


def test_a_slow_robot_gets_the_time_it_needs() -> None:
    slow = load_robot("turtlebot3_waffle")
    fit, _ = fitted(route(), slow, hall())
    assert fit.time_limit_s >= 6.0 / slow.driving_speed_m_s
    assert fitted(fit, slow, hall())[1] == fitted(route(), AMR, hall())[1] == ()


@pytest.mark.parametrize("name", sorted(shipped_robots()))
def test_every_shipped_robot_can_stand_at_the_ends_of_the_warehouse(name: str) -> None:
    world, robot = load_world("warehouse"), load_robot(name)
    for each in world.routes:
        assert setback_m(fitted(each, robot, world)[0].goal, robot, world) == 0.0
        assert fits_through(robot, each, world)


@pytest.mark.parametrize(
    "name",
    ["turtlebot3_waffle", *(pytest.param(name, marks=pytest.mark.exhaustive) for name in ("tugger", "industrial_amr"))],
)
def test_routes_are_proposed_for_the_robot(name: str) -> None:
    world, robot = load_world("hospital"), load_robot(name)
    routes = propose_routes(world, robot=robot)
    assert routes
    for route in routes:
        assert setback_m(route.goal, robot, world) == 0.0
        assert fits_through(robot, route, world)


def route(goal_x: float = 8.0) -> Route:
    return Route(name="through", start=Pose(x=2.0, y=2.0), goal=Pose(x=goal_x, y=2.0), time_limit_s=30.0)


def test_a_robot_wider_than_the_only_gate_is_refused() -> None:
    def findings(robot: Robot | str, gate_m: float) -> list[str]:
        world = hall(gate_m)
        return [f.rule for f in check(HumanConfiguration(humans=()), Mission.of(world, route(), robot=robot), world)]

    assert findings(AMR, 0.4) == ["robot-too-wide"]
    assert findings(AMR, 0.8) == []
    assert findings("tiago_omni", 0.4) == []
    assert math.isclose(AMR.width_m, 0.58)


def test_what_concerns_a_robot_is_a_remark_at_its_route() -> None:
    """Goals that are fitted to it, and routes where nobody can pass it."""
    world = load_world("warehouse")
    found, usual = (check_world(SHIPPED / "warehouse", robot=driver) for driver in (TUGGER, None))
    known = {remark.problem.message for remark in usual}
    added = [remark for remark in found if remark.problem.message not in known]
    assert [remark.code for remark in added].count("route-fitted") == 2
    assert {(remark.problem.path.name, remark.key[0]) for remark in added} == {("routes.yaml", "routes")}
    tight = [r.name for r in world.routes if narrow_passages(world, line_of(world, r), robot=TUGGER)]
    assert [remark.code for remark in found].count("route-no-passing") == len(tight) == 2
    assert "route-no-passing" not in [remark.code for remark in usual]


def test_a_robot_wider_than_every_way_cannot_drive() -> None:
    slim = load_robot("industrial_amr")
    wide = slim.replace(
        footprint=((1.5, 1.5), (-1.5, 1.5), (-1.5, -1.5), (1.5, -1.5)),
        safety_zones=(),
        lidars=tuple(lidar.replace(height_m=1.0) for lidar in slim.lidars),
    )
    found = check_world(SHIPPED / "warehouse", robot=wide)
    assert sum(remark.serious for remark in found) >= 5


def test_a_robot_keeps_clear_by_half_of_its_width() -> None:
    assert clearance_m(load_robot("tiago_omni")) == pytest.approx(0.3, abs=0.003)
    assert clearance_m(load_robot("tugger")) == pytest.approx(0.375)


class NobodyArrives:
    """A trial in which every route ends before its goal."""

    def drive(self, world: World, route: Route) -> Drive:
        return Drive(arrived=False, outcome="timed_out", time_s=60.0, x=0.0, y=0.0, touched_s=())

    def not_walked(self, world: World, hops: Sequence[Hop]) -> tuple[Hop, ...]:
        return ()


@pytest.mark.parametrize(("name", "told"), [("tugger", True), ("turtlebot3_waffle", False)])
def test_a_route_that_a_steered_robot_cannot_drive_tells_its_turning_circle(name: str, told: bool) -> None:
    robot = load_robot(name)
    radius = f"{0.95 / math.tan(1.05):.1f} m radius"
    found = check_world(SHIPPED / "warehouse", trial=NobodyArrives(), robot=robot)
    failed = [remark for remark in found if remark.serious and remark.key[0] == "routes"]
    assert len(failed) == len(load_world("warehouse").routes)
    assert [radius in str(remark) for remark in failed] == [told] * len(failed)


class SomeTouch(NobodyArrives):
    """A trial in which every way is driven, and all but the first few graze something."""

    def __init__(self, clean: int) -> None:
        self.clean = clean

    def drive(self, world: World, route: Route) -> Drive:
        self.clean -= 1
        touched = () if self.clean >= 0 else (3.0,) * (9 + self.clean % 5)
        return Drive(arrived=True, outcome="reached", time_s=60.0, x=0.0, y=0.0, touched_s=touched)


def test_ways_that_graze_something_are_proposed_only_where_there_is_no_other() -> None:
    world = load_world("warehouse")
    clean = propose_routes(world, trial=SomeTouch(1))
    assert [route.name for route in clean] == ["route_1"]
    notes: list[str] = []
    assert propose_routes(world, trial=SomeTouch(1), notes=notes) == clean
    (note,) = notes
    assert note.startswith("not proposed, because the robot alone touches something on the way: ") and " to " in note
    propose_routes(world, trial=SomeTouch(9), notes=notes)
    assert notes == [note]
    grazed = propose_routes(world, trial=SomeTouch(0))
    assert [route.name for route in grazed] == ["route_1", "route_2", "route_3"]
    assert propose_routes(world, trial=NobodyArrives()) == ()
