"""People walk every legal hop, stand where they are told to, and pause as the tasks say, in the default profile."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.simulation.parts import crowd_of, human, tick, walk, world_with

from rvsg.scenario.scenario import Behaviour
from rvsg.scenario.validity import is_walkable
from rvsg.simulation.embedded.people.behaviour import not_walked
from rvsg.simulation.embedded.people.contact import events_of
from rvsg.world.grid import Grid, Waypoint
from rvsg.world.space import human_space
from rvsg.world.world import World
from rvsg.world.world_folder import load_world

WORLDS = ("warehouse", "office", "hospital")
SOME = [pytest.param(name, marks=pytest.mark.exhaustive) if name != "office" else name for name in WORLDS]


def both_ways(world: World) -> list[tuple[str, ...]]:
    return [*world.grid.hops, *((b, a) for a, b in world.grid.hops)]


class TestHops:
    @pytest.mark.parametrize("speed", [0.3, 1.5])
    def test_the_narrowest_hops_of_the_warehouse_are_walked(self, speed: float) -> None:
        world = load_world("warehouse")
        position = world.grid.position
        space = human_space(world)

        def room(way: tuple[str, ...]) -> float:
            a, b = (np.array(position(name)) for name in way)
            return float(space.clearances(a + (b - a) * np.linspace(0.0, 1.0, 20)[:, None]).min())

        hops = sorted(both_ways(world), key=room)[:12]
        assert not_walked(world, hops, [speed]) == []

    @pytest.mark.parametrize("way", [("L6", "M7", "M6"), ("L4", "M3", "M4"), ("K6", "L6", "M7", "M6", "L6")])
    def test_hops_that_were_never_walked_are_walked(self, way: tuple[str, ...]) -> None:
        world = load_world("warehouse")
        for speed in (0.3, 0.5, 1.0):
            assert not_walked(world, [way], [speed]) == []

    @pytest.mark.slow
    @pytest.mark.parametrize("name", SOME)
    def test_every_hop_is_walked_both_ways(self, name: str) -> None:
        world = load_world(name)
        for speed in (0.3, 1.5):
            assert not_walked(world, both_ways(world), [speed]) == []

    @pytest.mark.slow
    @pytest.mark.parametrize("name", SOME)
    def test_the_ways_between_all_areas_are_walked(self, name: str) -> None:
        world = load_world(name)
        ends = sorted({min(area.waypoints) for area in world.areas if area.waypoints})
        ways = (world.grid.shortest_path(a, b) for a in ends for b in ends if a != b)
        assert not_walked(world, [way for way in ways if way], [1.2]) == []


def gap_world(width_m: float, beside_m: float) -> World:
    """Return a world with one hop of 2 m through a gap between two boxes, whose middle lies beside the line."""
    gap = world_with((0.0, 2.0 + width_m / 2 + beside_m, 1.0, 4.0), (0.0, -2.0 - width_m / 2 + beside_m, 1.0, 4.0))
    ends = (("A1", -1.0), ("A2", 1.0))
    waypoints = tuple(Waypoint(name=name, x=x, y=0.0, row=0, column=i) for i, (name, x) in enumerate(ends))
    return replace(gap, grid=Grid(rows=("A",), columns=("1", "2"), waypoints=waypoints, hops=(("A1", "A2"),)))


class TestTheChecker:
    @pytest.mark.parametrize("beside_m", [0.0, 0.1])
    @pytest.mark.parametrize("width_m", [0.1, 0.2, 0.3, 0.4, 0.6])
    def test_it_refuses_exactly_the_gaps_that_people_do_not_get_through(self, width_m: float, beside_m: float) -> None:
        world = gap_world(width_m, beside_m)
        for speed in (0.3, 1.5):
            assert is_walkable("A1", "A2", world) == (not_walked(world, [("A1", "A2")], [speed]) == [])

    @pytest.mark.parametrize("name", WORLDS)
    def test_every_hop_of_the_shipped_worlds_is_walkable(self, name: str) -> None:
        world = load_world(name)
        assert [hop for hop in world.grid.hops if not is_walkable(*hop, world)] == []


class TestStanding:
    @pytest.mark.parametrize("pushed", [(0.0, 0.0), (0.7, -0.5)], ids=["alone", "pushed aside"])
    def test_somebody_told_to_stand_comes_to_rest_at_the_waypoint(self, pushed: tuple[float, float]) -> None:
        crowd = crowd_of(human((0.0, 0.0), (3.0, 0.0), pauses_s=(0.0, 60.0)))
        walk(crowd, 80)
        crowd.x[0] += pushed[0]
        crowd.y[0] += pushed[1]
        walk(crowd, 60)
        assert math.hypot(crowd.x[0] - 3.0, crowd.y[0]) < 0.06
        x, y, walked = crowd.x[0], crowd.y[0], crowd.walked[0]
        walk(crowd, 60)
        assert (crowd.x[0], crowd.y[0], crowd.walked[0]) == (x, y, walked)

    def test_somebody_who_stands_is_not_moved_by_people_who_pass(self) -> None:
        standing = human((0.0, 0.0), (1.0, 0.0), pauses_s=(60.0, 60.0), start_pause_s=60.0)
        passing = human((-4.0, 1.2), (4.0, 1.2))
        crowd = crowd_of(standing, passing)
        walk(crowd, 60)
        assert math.hypot(crowd.x[0], crowd.y[0]) < 0.15
        assert crowd.x[1] > 2.0


class TestPauses:
    def test_the_pause_of_the_last_waypoint_is_not_held_at_the_start(self) -> None:
        crowd = crowd_of(human((0.0, 0.0), (3.0, 0.0), pauses_s=(5.0, 0.0)))
        walk(crowd, 15)
        assert crowd.x[0] > 1.0
        walk(crowd, 35)
        assert math.hypot(crowd.x[0], crowd.y[0]) < 0.3
        assert crowd.pause_left[0] > 2.0

    def test_a_pause_at_the_start_is_held_once(self) -> None:
        crowd = crowd_of(human((0.0, 0.0), (3.0, 0.0), start_pause_s=2.0))
        walk(crowd, 20)
        assert abs(crowd.x[0]) < 0.05
        walk(crowd, 15)
        assert crowd.x[0] > 1.0
        walk(crowd, 45)
        assert crowd.x[0] > 0.0
        assert crowd.pause_left[0] <= 0.0


class TestDeadlocks:
    def test_two_who_meet_head_on_pass_each_other(self) -> None:
        crowd = crowd_of(human((0.0, 0.0), (6.0, 0.0)), human((6.0, 0.0), (0.0, 0.0)))
        walk(crowd, 55)
        assert set(np.flatnonzero(crowd.reached[:, 1] < 6.0)) == {0, 1}

    def test_a_waypoint_that_somebody_occupies_counts_as_reached_from_beside_it(self) -> None:
        standing = human((3.0, 0.0), (4.0, 0.0), pauses_s=(60.0, 60.0), start_pause_s=60.0)
        crowd = crowd_of(human((0.0, 0.0), (3.0, 0.0), (6.0, 0.0)), standing)
        walk(crowd, 90)
        assert crowd.reached[0, 2] < 9.0

    def test_somebody_who_cannot_get_on_is_recorded_as_stuck(self) -> None:
        closed = world_with((3.0, 0.0, 0.4, 19.0))
        crowd = crowd_of(human((0.0, 0.0), (6.0, 0.0)), world=closed)
        walk(crowd, 120)
        (stuck,) = [e for e in events_of(crowd, ["a"], [Behaviour.REGULAR]) if e.kind == "person_stuck"]
        assert (stuck.person, stuck.goal) == ("a", 1)
        assert 1.5 < stuck.time_s < 5.0
        assert stuck.until_s > 11.0
        assert stuck.x == pytest.approx(2.65, abs=0.1)


class TestRecordedEvents:
    def test_pauses_arrivals_and_reactions_are_recorded(self) -> None:
        agent = human((0.0, 0.0), (2.0, 0.0), (4.0, 0.0), pauses_s=(0.0, 2.0, 0.0), behaviour=Behaviour.SURPRISED)
        crowd = crowd_of(agent)
        walk(crowd, 20)
        walk(crowd, 10, robot=(5.0, 0.0, 0.0, 0.0))
        found = {event.kind: event for event in events_of(crowd, ["a"], [agent.behaviour])}
        assert found["person_paused"].goal == 1
        assert found["person_reached"].goal == 1
        assert found["person_reacted"].behaviour is Behaviour.SURPRISED
        assert found["person_reacted"].until_s - found["person_reacted"].time_s == pytest.approx(1.0)

    def test_a_full_buffer_drops_events_and_counts_them(self) -> None:
        crowd = crowd_of(human((0.0, 0.0), (2.0, 0.0), pauses_s=(1.0, 1.0)))
        small = crowd._replace(events=crowd.events[:1])
        walk(small, 100)
        assert small.event_count[0] == 1
        assert small.event_count[1] > 0


SEES_RAD = 1.74
WITHIN_M = {Behaviour.SURPRISED: 4.0, Behaviour.SCARED: 3.0, Behaviour.CURIOUS: 10.0, Behaviour.THREATENING: 4.5}


def reacts(behaviour: Behaviour, distance_m: float, bearing_rad: float = 0.0, pause_s: float = 0.0) -> bool:
    crowd = crowd_of(human((0.0, 0.0), (5.0, 0.0), behaviour=behaviour, start_pause_s=pause_s))
    crowd.yaw[0] = 0.0
    for k in range(3):
        crowd.x[0] = crowd.y[0] = 0.0
        tick(crowd, 0.1 * k, 0.1, distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad), 0.0, 0.0)
        if crowd.reacting[0]:
            return True
    return False


class TestReactions:
    """Simulated people react to the robot as docs/explanation/people.md says."""

    @pytest.mark.parametrize(("behaviour", "within_m"), WITHIN_M.items())
    def test_people_react_within_the_documented_distance_and_angle(self, behaviour: Behaviour, within_m: float) -> None:
        assert reacts(behaviour, within_m - 0.05)
        assert not reacts(behaviour, within_m + 0.05)
        assert reacts(behaviour, 2.0, SEES_RAD - 0.02)
        assert not reacts(behaviour, 2.0, SEES_RAD + 0.02)
        assert reacts(behaviour, 2.0, pause_s=60.0)  # a reaction interrupts a pause

    @pytest.mark.parametrize("behaviour", [b for b in Behaviour if b not in WITHIN_M])
    def test_the_others_never_react(self, behaviour: Behaviour) -> None:
        assert not reacts(behaviour, 1.0)
