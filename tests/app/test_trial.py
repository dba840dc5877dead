"""Worlds are tried out in the simulator: routes driven, hops walked, results kept."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.simulation.test_people_arrive import gap_world

from rvsg.core.records import Pose
from rvsg.robots.robot import Robot, load_robot, shipped_robots
from rvsg.simulation.route_trial import SimulatedTrial
from rvsg.world.checks import check_world
from rvsg.world.routes import Drive, Hop, fitted, propose_routes, route_notes
from rvsg.world.world import Route, World
from rvsg.world.world_folder import SHIPPED, load_world, shipped_worlds


def drive(**changes: Any) -> Drive:
    there = {"arrived": True, "outcome": "the goal was reached", "time_s": 21.0, "x": 0.0, "y": 0.0}
    return Drive(**there | changes)


LOST = drive(arrived=False, outcome="no path to the goal was found", time_s=9.0)


class ScriptedTrial:
    """A trial whose results are given; it keeps what it was asked for."""

    def __init__(self, result: Drive | None = None, blocked: tuple[Hop, ...] = ()) -> None:
        self.result, self.blocked = result or drive(), blocked
        self.driven: list[Route] = []
        self.hops: list[Hop] = []

    def drive(self, world: World, route: Route) -> Drive:
        self.driven.append(route)
        return self.result

    def not_walked(self, world: World, hops: Sequence[Hop]) -> tuple[Hop, ...]:
        self.hops += hops
        return self.blocked


@pytest.fixture(scope="module")
def world() -> World:
    return load_world("warehouse")


def test_a_route_is_driven_once_and_a_damaged_result_made_again(world: World, tmp_path: Path) -> None:
    said: list[str] = []
    trial = SimulatedTrial(progress=said.append, cache=tmp_path)
    found = trial.drive(world, world.route("route_1"))
    assert found.arrived and found.touched_s == ()
    assert 10.0 < found.time_s < 25.0
    (kept,) = tmp_path.iterdir()
    said.clear()
    assert SimulatedTrial(progress=said.append, cache=tmp_path).drive(world, world.route("route_1")) == found
    assert said == []
    kept.write_text("{")
    assert trial.drive(world, world.route("route_1")) == found
    assert kept.read_text() != "{"


def test_a_stack_that_is_asked_for_drives_and_its_results_are_its_own(world: World, tmp_path: Path) -> None:
    route, stacks = world.route("route_1"), (None, "nav2-rpp", "stop-and-go")
    times = [SimulatedTrial(None, stack, cache=tmp_path).drive(world, route).time_s for stack in stacks]
    assert len(set(times)) == len(list(tmp_path.iterdir())) == len(stacks)


def test_a_goal_outside_the_building_is_a_drive_that_does_not_arrive(world: World) -> None:
    away = world.route("route_1").model_copy(update={"goal": Pose(x=90.0, y=90.0), "via": ()})
    assert not SimulatedTrial().drive(world, away).arrived


def test_a_gap_too_narrow_for_a_person_is_not_walked() -> None:
    hop = ("A1", "A2")
    assert SimulatedTrial().not_walked(gap_world(0.2, 0.0), [hop]) == (hop,)
    assert SimulatedTrial().not_walked(gap_world(1.0, 0.0), [hop]) == ()


def test_a_route_that_is_not_driven_in_time_or_does_not_arrive_is_wrong(world: World) -> None:
    trial = ScriptedTrial(drive(time_s=1000.0, touched_s=(3.0,)))
    remarks = check_world(SHIPPED / "warehouse", trial=trial)
    assert [route.name for route in trial.driven] == [route.name for route in world.routes]
    wrong = [remark for remark in remarks if remark.serious]
    assert [remark.key for remark in wrong] == [("routes", i, "time_limit_s") for i in range(5)]
    touching = [remark for remark in remarks if remark.key in {("routes", i) for i in range(5)}]
    assert len(touching) == 5 and not any(remark.serious for remark in touching)
    remarks = check_world(SHIPPED / "warehouse", trial=ScriptedTrial(LOST))
    assert {remark.key for remark in remarks if remark.serious} == {("routes", i) for i in range(5)}


@pytest.mark.slow
def test_hops_are_walked_both_ways_and_named_once(world: World) -> None:
    quiet = check_world(SHIPPED / "warehouse", trial=(trial := ScriptedTrial()))
    hops = world.grid.hops
    assert trial.hops == [*hops, *((b, a) for a, b in hops)]
    a, b = hops[0]
    remarks = check_world(SHIPPED / "warehouse", trial=ScriptedTrial(blocked=((a, b), (b, a))))
    assert len(remarks) == len(quiet) + 1


@pytest.mark.exhaustive
def test_proposals_are_of_drives_that_arrive_and_leave_room_in_time(world: World) -> None:
    assert propose_routes(world, trial=ScriptedTrial(LOST)) == ()
    slow = propose_routes(world, trial=ScriptedTrial(drive(time_s=100.0)))
    assert {route.time_limit_s for route in slow} == {125.0}
    way = ("G12", "F12", "F13", "F14")
    points = tuple(world.grid.position(name) for name in way)
    routes = propose_routes(world, trial=ScriptedTrial(drive(time_s=60.0, way=points)))
    assert {(route.via, route.time_limit_s) for route in routes} == {(way, 75.0)}


@pytest.mark.exhaustive
def test_the_proposals_differ_and_each_has_a_note(world: World) -> None:
    routes = propose_routes(world)
    assert len({route.via for route in routes}) == 3
    assert len(route_notes(replace(world, routes=routes), ScriptedTrial())) == 3


def drives(robot: str, stack: str, place: str, route: str) -> Drive:
    world, driver = load_world(place), load_robot(robot)
    return SimulatedTrial(driver, stack).drive(world, fitted(world.route(route), driver, world)[0])


@pytest.mark.parametrize(
    ("robot", "stack", "place", "route"),
    [
        *((robot, "stop-and-go", "warehouse", "route_1") for robot in sorted(shipped_robots())),
        ("tiago_omni", "stop-and-go", "office", "route_1"),
        ("tugger", "nav2-rpp", "warehouse", "route_1"),
        ("tugger", "social", "warehouse", "route_1"),
    ],
)
def test_a_shipped_robot_arrives_with_a_shipped_stack(robot: str, stack: str, place: str, route: str) -> None:
    assert drives(robot, stack, place, route).arrived


def test_a_long_tractor_drives_with_what_follows_from_its_size(world: World) -> None:
    tugger = load_robot("tugger").model_dump(mode="json", exclude={"navigation", "safety_zones"})
    size = {"footprint": [[1.75, 0.4], [-0.45, 0.4], [-0.45, -0.4], [1.75, -0.4]]}
    drive = {"kind": "ackermann", "wheelbase_m": 1.3, "max_steering_rad": 1.1}
    lidars = [tugger["lidars"][0] | {"x": 1.7}, tugger["lidars"][1] | {"x": -0.4}]
    tractor = Robot.model_validate_json(json.dumps(tugger | size | {"drive": drive, "lidars": lidars}))
    assert SimulatedTrial(tractor).drive(world, fitted(world.route("route_3"), tractor, world)[0]).arrived


@pytest.mark.exhaustive
@pytest.mark.parametrize("stack", ["nav2-dwb", "nav2-dwb-humble", "nav2-mppi", "nav2-rpp", "social", "stop-and-go"])
@pytest.mark.parametrize("place", shipped_worlds())
@pytest.mark.parametrize("robot", sorted(shipped_robots()))
def test_every_shipped_pair_arrives_or_the_check_says_why_not(robot: str, place: str, stack: str) -> None:
    driver, folder = load_robot(robot), SHIPPED / place
    for route in load_world(place).routes:
        if not drives(robot, stack, place, route.name).arrived:
            # The field of stop-and-go sees the jamb of a narrow door, and it waits for that as for a person.
            assert place != "warehouse" and (driver.turning_note or stack == "stop-and-go")
            found = check_world(folder, trial=ScriptedTrial(LOST), robot=driver)
            assert any(remark.code == "route-not-driven" and driver.turning_note in str(remark) for remark in found)
