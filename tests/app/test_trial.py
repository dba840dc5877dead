"""Worlds are tried out in the simulator: routes driven, hops walked, results kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from tests.simulation.test_people_arrive import gap_world

from rvsg.core.records import Pose
from rvsg.simulation.route_trial import SimulatedTrial
from rvsg.world.checks import check_world
from rvsg.world.routes import Drive, Hop, propose_routes, route_notes
from rvsg.world.world import Route, World
from rvsg.world.world_folder import SHIPPED, load_world


class ScriptedTrial:
    """A trial whose results are given; it keeps what it was asked for."""

    def __init__(self, drive: Drive | None = None, blocked: tuple[Hop, ...] = ()) -> None:
        self.result = drive or Drive(arrived=True, outcome="the goal was reached", time_s=21.0, x=0.0, y=0.0)
        self.blocked = blocked
        self.driven: list[Route] = []
        self.hops: list[Hop] = []

    def drive(self, world: World, route: Route) -> Drive:
        self.driven.append(route)
        return self.result

    def not_walked(self, world: World, hops: Sequence[Hop]) -> tuple[Hop, ...]:
        self.hops += hops
        return self.blocked


class TestTheSimulator:
    def test_it_drives_a_route_and_keeps_the_result(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        world = load_world("warehouse")
        said: list[str] = []
        trial = SimulatedTrial(progress=said.append, cache=tmp_path)
        drive = trial.drive(world, world.route("route_1"))
        assert drive.arrived
        assert 10.0 < drive.time_s < 25.0
        assert drive.touched_s == ()
        assert len(list(tmp_path.iterdir())) == 1
        said.clear()
        assert SimulatedTrial(progress=said.append, cache=tmp_path).drive(world, world.route("route_1")) == drive
        assert said == []

    def test_a_damaged_result_is_made_again(self, tmp_path: Path) -> None:
        world = load_world("warehouse")
        trial = SimulatedTrial(cache=tmp_path)
        drive = trial.drive(world, world.route("route_1"))
        (kept,) = tmp_path.iterdir()
        kept.write_text("{")
        assert trial.drive(world, world.route("route_1")) == drive
        assert kept.read_text() != "{"

    def test_a_goal_outside_the_building_is_a_drive_that_does_not_arrive(self) -> None:
        world = load_world("warehouse")
        away = world.route("route_1").model_copy(update={"goal": Pose(x=90.0, y=90.0), "via": ()})
        assert not SimulatedTrial().drive(world, away).arrived

    def test_a_gap_too_narrow_for_a_person_is_not_walked(self) -> None:
        hop = ("A1", "A2")
        assert SimulatedTrial().not_walked(gap_world(0.2, 0.0), [hop]) == (hop,)
        assert SimulatedTrial().not_walked(gap_world(1.0, 0.0), [hop]) == ()


class TestTheCheck:
    def test_a_route_that_is_not_driven_in_time_is_wrong(self) -> None:
        late = Drive(arrived=True, outcome="the goal was reached", time_s=1000.0, x=0.0, y=0.0, touched_s=(3.0,))
        trial = ScriptedTrial(late)
        remarks = check_world(SHIPPED / "warehouse", trial=trial)
        routes = load_world("warehouse").routes
        assert [route.name for route in trial.driven] == [route.name for route in routes]
        wrong = [remark for remark in remarks if remark.serious]
        assert [remark.key for remark in wrong] == [("routes", i, "time_limit_s") for i in range(len(routes))]
        touching = [remark for remark in remarks if remark.key in {("routes", i) for i in range(len(routes))}]
        assert len(touching) == len(routes)
        assert not any(remark.serious for remark in touching)

    def test_a_route_that_does_not_arrive_is_wrong(self) -> None:
        trial = ScriptedTrial(Drive(arrived=False, outcome="no path to the goal was found", time_s=9.0, x=0.0, y=0.0))
        remarks = check_world(SHIPPED / "warehouse", trial=trial)
        assert {remark.key for remark in remarks if remark.serious} == {("routes", i) for i in range(5)}

    @pytest.mark.slow
    def test_hops_are_walked_both_ways_and_named_once(self) -> None:
        quiet = check_world(SHIPPED / "warehouse", trial=(trial := ScriptedTrial()))
        hops = load_world("warehouse").grid.hops
        assert trial.hops == [*hops, *((b, a) for a, b in hops)]
        a, b = hops[0]
        remarks = check_world(SHIPPED / "warehouse", trial=ScriptedTrial(blocked=((a, b), (b, a))))
        assert len(remarks) == len(quiet) + 1


@pytest.mark.exhaustive
class TestProposals:
    def test_a_way_the_robot_does_not_drive_is_no_proposal(self) -> None:
        world = load_world("warehouse")
        trial = ScriptedTrial(Drive(arrived=False, outcome="no path to the goal was found", time_s=9.0, x=0.0, y=0.0))
        assert propose_routes(world, trial=trial) == ()

    def test_the_time_limit_leaves_room_for_the_drive(self) -> None:
        world = load_world("warehouse")
        slow = Drive(arrived=True, outcome="the goal was reached", time_s=100.0, x=0.0, y=0.0)
        assert {route.time_limit_s for route in propose_routes(world, trial=ScriptedTrial(slow))} == {125.0}

    def test_the_waypoints_passed_and_the_time_limit_are_those_of_the_drive(self) -> None:
        world = load_world("warehouse")
        way = ("G12", "F12", "F13", "F14")
        points = tuple(world.grid.position(name) for name in way)
        drive = Drive(arrived=True, outcome="the goal was reached", time_s=60.0, x=0.0, y=0.0, way=points)
        routes = propose_routes(world, trial=ScriptedTrial(drive))
        assert {(route.via, route.time_limit_s) for route in routes} == {(way, 75.0)}

    def test_the_proposals_differ_and_each_has_a_note(self) -> None:
        world = load_world("warehouse")
        routes = propose_routes(world)
        assert len({route.via for route in routes}) == 3
        assert len(route_notes(replace(world, routes=routes), ScriptedTrial())) == 3
