"""Bodies of robot and people do not pass through each other in the default profile."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.golden.cases import scenario_of
from tests.simulation.parts import Constant, crowd_of, human, room_cells, route, standing, world_of, world_with

import rvsg
from rvsg.core.kernels import kernel
from rvsg.core.references import refer
from rvsg.scenario.scenario import BODY_RADIUS_M, Behaviour, HumanAgent, reaction_of
from rvsg.simulation.archive import run_from_json, run_to_json
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.people.contact import events_of, touch_people
from rvsg.simulation.embedded.people.crowd import Crowd
from rvsg.simulation.embedded.profiles import profile
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.events import Contact, ObstacleContact, Recovery
from rvsg.simulation.run import Outcome, Run
from rvsg.stacks import StackChoice
from rvsg.world.world import Route, World
from rvsg.world.world_folder import load_world

HALF_LENGTH_M, HALF_WIDTH_M = 0.3585, 0.2485


def overlaps(run: Run) -> tuple[float, float]:
    """Return the largest overlap (m) of a person with the TIAGo's rectangle, and of two people."""
    path = run.trajectory
    radius = np.array(run.human_radius_m)
    cos, sin = np.cos(path.yaw)[:, None], np.sin(path.yaw)[:, None]
    dx, dy = path.human_x - path.x[:, None], path.human_y - path.y[:, None]
    ahead, aside = np.abs(dx * cos + dy * sin) - HALF_LENGTH_M, np.abs(dy * cos - dx * sin) - HALF_WIDTH_M
    gap = np.hypot(np.maximum(ahead, 0.0), np.maximum(aside, 0.0)) + np.minimum(np.maximum(ahead, aside), 0.0)
    between = -math.inf
    for i in range(len(radius)):
        away = np.hypot(path.human_x[:, i, None] - path.human_x[:, :i], path.human_y[:, i, None] - path.human_y[:, :i])
        between = max(between, float((radius[i] + radius[:i] - away).max(initial=-math.inf)))
    return float((radius - gap).max()), between


def stuck_until(run: Run) -> list[tuple[float, float]]:
    """Return the times in which somebody who is stuck may turn sideways."""
    return [(e.time_s, e.until_s + 5.0) for e in run.events if e.kind == "person_stuck"]


def aimed(world: World, route: Route, count: int, rng: np.random.Generator) -> list[HumanAgent]:
    """Return people whose ways cross the robot's, with pauses on it."""
    grid, start, goal = world.grid, route.start, route.goal
    way = grid.shortest_path(grid.nearest(start.x, start.y), grid.nearest(goal.x, goal.y))
    assert way is not None
    people: list[HumanAgent] = []
    while len(people) < count:
        middle = way[int(rng.integers(len(way) // 3, len(way)))]
        ends = [
            name
            for name in sorted(grid.valid)
            if 2.0 < math.dist(grid.position(name), grid.position(middle)) < 5.0
            and math.dist(grid.position(name), (start.x, start.y)) > 1.5
            and all(math.dist(grid.position(name), person.start) > 1.0 for person in people)
        ]
        a, b = (str(name) for name in rng.choice(ends, 2, replace=False))
        there, back = grid.shortest_path(a, middle), grid.shortest_path(middle, b)
        if not there or not back:
            continue
        names = [*there, *back[1:]]
        goals = tuple(grid.position(name) for name in [*names, *names[-2:0:-1]])
        pauses = tuple(4.0 if goal == grid.position(middle) else 0.0 for goal in goals)
        behaviour, speed = list(Behaviour)[int(rng.integers(6))], float(rng.uniform(0.5, 2.0))
        person = HumanAgent(
            name=f"human {len(people)}", start=goals[0], goals=goals, pauses_s=pauses, speed_m_s=speed,
            behaviour=behaviour, reaction=reaction_of(behaviour, speed),
        )  # fmt: skip
        people.append(person)
    return people


@kernel
def drive(crowd: Crowd, body: np.ndarray, ticks: int) -> None:
    """Drive straight on with the commanded velocity, in contact with the crowd."""
    for k in range(ticks):
        x, y, yaw = body[base.X], body[base.Y], body[base.YAW]
        body[base.V], body[base.W] = body[base.SMOOTH_V], body[base.SMOOTH_W]
        body[base.X] += body[base.V] * math.cos(yaw) * base.STEP_S
        body[base.Y] += body[base.V] * math.sin(yaw) * base.STEP_S
        body[base.YAW] += body[base.W] * base.STEP_S
        touch_people(crowd, 0.01 * k, body, x, y, yaw, 0.0)


def driven(crowd: Crowd, speed: float, ticks: int, yaw: float = 0.0) -> np.ndarray:
    body = np.zeros(base.BODY_SIZE)
    body[base.YAW] = yaw
    body[base.SMOOTH_V] = speed
    drive(refer(crowd), body, ticks)
    return body


class TestBase:
    @pytest.mark.parametrize("speed", [0.2, 0.5, 2.0])
    def test_a_standing_person_holds_the_base_back(self, speed: float) -> None:
        crowd = crowd_of(human((2.0, 0.0)))
        body = driven(crowd, speed, int(4.0 / speed / 0.01))
        assert body[base.X] == pytest.approx(2.0 - BODY_RADIUS_M - HALF_LENGTH_M, abs=0.001)
        assert body[base.V] == pytest.approx(0.0, abs=0.01)
        assert crowd.x[0] == 2.0
        (contact,) = events_of(crowd, ["a"], [Behaviour.REGULAR])
        assert isinstance(contact, Contact)
        assert contact.moved_by == "robot"
        assert contact.closing_speed_m_s == pytest.approx(speed)
        assert contact.bearing_rad == 0.0
        assert contact.x == pytest.approx(2.0 - BODY_RADIUS_M, abs=0.01)
        assert contact.overlap_m < 0.001

    def test_somebody_who_walks_gives_way(self) -> None:
        crowd = crowd_of(human((2.0, 0.0)))
        crowd.stands[0] = 0
        body = driven(crowd, 0.5, 400)
        assert body[base.X] == pytest.approx(2.0)
        assert crowd.x[0] == pytest.approx(2.0 + HALF_LENGTH_M + BODY_RADIUS_M, abs=0.001)

    def test_somebody_at_a_wall_cannot_give_way(self) -> None:
        crowd = crowd_of(human((2.0, 0.0)), world=world_with((2.4, 0.0, 0.4, 4.0)))
        crowd.stands[0] = 0
        body = driven(crowd, 0.5, 400)
        assert crowd.x[0] < 2.2 - 0.14
        assert body[base.X] + HALF_LENGTH_M + BODY_RADIUS_M == pytest.approx(crowd.x[0], abs=0.001)

    def test_the_base_turns_away_while_it_is_held_back(self) -> None:
        crowd = crowd_of(human((0.8, 0.0)))
        body = np.zeros(base.BODY_SIZE)
        body[base.SMOOTH_V], body[base.SMOOTH_W] = 0.5, 0.5
        drive(refer(crowd), body, 100)
        assert body[base.YAW] > 0.02


@pytest.mark.parametrize("people", [0, 1], ids=["wall", "person at a wall"])
def test_the_recovery_backs_out_of_a_contact(people: int) -> None:
    bump = StackChoice.of(Constant((0.3, 0.0), until_s=7.0))  # then Nav2 recovers
    way, pinned = route((1.2, 0.0), (2.0, -2.0), 21.0), [standing(2.5, 0.0)][:people]
    run = simulate_agents(empty_room(), way, pinned, stack=bump, options=profile("hunavsim"))
    assert any(isinstance(event, Contact if people else ObstacleContact) for event in run.events)
    (back,) = [event for event in run.events if isinstance(event, Recovery) and event.action == "back_up"]
    t, x = run.trajectory.t, run.trajectory.x
    assert np.interp(back.time_s, t, x) - np.interp(back.until_s, t, x) == pytest.approx(0.3, abs=0.03)


PINCHED = 6
"""In a run of this scenario the robot and two people wedge somebody."""
AIMED = [
    pytest.param(n, marks=[pytest.mark.slow if n < 4 or n == PINCHED else pytest.mark.exhaustive]) for n in range(1, 12)
]


class TestRuns:
    @pytest.mark.parametrize("number", [0, *AIMED])
    def test_bodies_stay_apart_in_aimed_scenarios(self, number: int) -> None:
        world = load_world("warehouse")
        way = world.route(f"route_{number % 5 + 1}")
        people = aimed(world, way, 4, np.random.default_rng(number))
        for seed in range(5 if number else 2):
            run = simulate_agents(world, way, people, seed=seed)
            robot, between = overlaps(run)
            assert robot < 0.01
            assert between < 0.01 or stuck_until(run)
            assert list(run.events) == sorted(run.events, key=lambda event: event.time_s) != []
            assert run_from_json(run_to_json(run)).events == run.events

    @pytest.mark.slow
    def test_bodies_stay_apart_in_a_crowd_of_fifty(self) -> None:
        scenario = scenario_of("warehouse", "route_1", "tiago_omni", 50, seed=150)
        assert scenario is not None and len(scenario.people.humans) == 50
        assert overlaps(rvsg.simulate(scenario, [0])[0])[0] < 0.01

    def test_a_hundred_people_in_a_small_room_stay_finite(self) -> None:
        rng = np.random.default_rng(1)
        points = [(float(x), float(y)) for x, y in rng.uniform(-2.5, 2.5, (100, 2))]
        people = [
            HumanAgent(name=f"{i}", start=p, goals=(p, points[i - 1]), pauses_s=(0.0, 0.0))
            for i, p in enumerate(points)
        ]
        run = simulate_agents(empty_room(), route((-2.0, 0.0), (2.0, 0.0), 3.0), people, seed=1)
        assert run.outcome in (Outcome.BLOCKED_START, Outcome.TIMED_OUT)

    def test_a_corridor_with_a_standing_person_stops_the_robot_without_overlap(self) -> None:
        corridor = world_of(room_cells(12.0, 1.3), -6.0, -0.65)
        run = simulate_agents(corridor, route((-4.0, 0.0), (4.0, 0.0)), [standing(0.0, 0.0)], seed=0)
        assert run.outcome is not Outcome.REACHED
        assert overlaps(run)[0] < 0.01
