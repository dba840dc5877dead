from itertools import pairwise

import numpy as np
import pytest
from tests.scenario.small_world import MISSION, WORLD, human

from rvsg.generation.forecast import (
    PACE,
    ROBOT_SPEED_M_S,
    SOCIAL_WEIGHT,
    STARTS_AFTER_S,
    STEP_S,
    TURNS_FOR_S,
    Forecaster,
    goals_of,
    kinds_of_run_all,
    push,
    run_all,
)
from rvsg.generation.workplaces import WalkingGraph, nearest_on
from rvsg.scenario.brief import Feedback, Sample
from rvsg.scenario.scenario import Human, HumanConfiguration, Pause, Scenario, Task
from rvsg.world.world_folder import load_world

GROUND = WalkingGraph(WORLD, MISSION.route)
FAR = human("E1 → E2: E1 E2", "E2 → E1: E2 E1")


def track(person: Human, seconds: float = 40.0) -> np.ndarray:
    """Where somebody is every STEP_S (steps, 2) when the robot stays away."""
    away = WalkingGraph(WORLD, MISSION.route)
    away.robot_path = ((50.0, 50.0), (60.0, 50.0))
    _, kept = Forecaster(away, seconds)._run([[person]], [0.4], [1.0], keep=True)
    walked = kept[:, 0, 1]
    return np.stack([walked.real, walked.imag], axis=1)


def after(seconds: float) -> int:
    return round(seconds / STEP_S)


def test_a_walk_is_cyclic_and_waits_for_its_delay() -> None:
    person = human("A1 → A3: A1 A2 A3", "A3 → A1: A3 A2 A1", speed_m_s=1.0, start_delay_s=2.0)
    at = track(person)
    assert np.allclose(at[: after(2.0)], GROUND.at["A1"])
    there = at[:, 1].argmax() * STEP_S - 2.0
    assert 1.6 < there < 3.5  # two metres at 1 m/s, with a stop on the way
    assert np.hypot(*(at[after(2.0 + 2 * there)] - GROUND.at["A1"])) < 0.6


def test_a_pause_holds_a_walk_where_it_is() -> None:
    task = Task(name="A1 → A3", path=("A1", "A2", "A3"), pauses=(Pause(at="A2", duration_s=5.0),))
    with_pause = track(human(task, "A3 → A1: A3 A2 A1", speed_m_s=1.0))[:, 1].argmax()
    without = track(human("A1 → A3: A1 A2 A3", "A3 → A1: A3 A2 A1", speed_m_s=1.0))[:100, 1].argmax()
    assert (with_pause - without) * STEP_S == pytest.approx(5.0, abs=0.5)


def test_pauses_where_two_tasks_meet_add_up_as_in_the_simulator() -> None:
    first = Task(name="A1 → A2", path=("A1", "A2"), pauses=(Pause(at="A2", duration_s=2.0),))
    second = Task(name="A2 → A1", path=("A2", "A1"), pauses=(Pause(at="A2", duration_s=3.0),))
    assert goals_of(human(first, second), GROUND.at) == ([GROUND.at["A1"], GROUND.at["A2"]], [0.0, 5.0])


def test_the_social_force_is_that_of_the_published_check_values() -> None:
    mine, opposite = 1.5 + 0j, -1.0 + 0j
    aside, head_on, myself = 2.0 + 0.3j, 2.0 + 0j, 0j
    assert SOCIAL_WEIGHT * push(aside, mine - opposite) == pytest.approx(-0.999606 - 1.478699j, abs=1e-5)
    assert SOCIAL_WEIGHT * push(head_on, mine - opposite) == pytest.approx(-1.929107, abs=1e-5)
    assert push(myself, mine) == 0


def test_a_robot_without_people_near_arrives_after_its_way_at_its_usual_speed() -> None:
    forecast = Forecaster(GROUND, 40.0)([FAR])
    length = sum(np.hypot(*np.subtract(a, b)) for a, b in pairwise(GROUND.robot_path))
    assert forecast.duration_s == pytest.approx(STARTS_AFTER_S + length / ROBOT_SPEED_M_S + TURNS_FOR_S, abs=0.3)
    assert forecast.blocked_s == 0.0 and forecast.swerved_m == 0.0
    assert tuple(run_all.signatures[0]) == kinds_of_run_all(), "what is compiled beforehand is what is called"


def test_somebody_who_stands_in_the_way_is_swerved_around() -> None:
    start, goal = np.array(GROUND.robot_path[0]), np.array(GROUND.robot_path[-1])
    way = min(WORLD.grid.valid, key=lambda n: np.hypot(*(np.array(GROUND.at[n]) - (start + goal) / 2)))
    beside = GROUND.hops[way][0][0]
    task = Task(name="look", path=(way, beside, way), pauses=(Pause(at=way, duration_s=60),))
    forecast = Forecaster(GROUND, 20.0)([human(task)])
    assert forecast.swerved_m > 0.5
    assert forecast.least_gap_m < 0.5


def test_variants_forecast_side_by_side_are_those_forecast_alone() -> None:
    forecaster = Forecaster(GROUND, 20.0)
    other = human("A1 → A7: A1 A2 A3 A4 A5 A6 A7", "A7 → A1: A7 A6 A5 A4 A3 A2 A1")
    assert forecaster.compare([[FAR], [other]]) == [forecaster([FAR]), forecaster([other])]


def test_paces_are_fitted_to_what_was_measured() -> None:
    slow = human("A1 → A7: A1 A2 A3 A4 A5 A6 A7", "A7 → A1: A7 A6 A5 A4 A3 A2 A1", speed_m_s=0.96)
    person = slow.model_copy(update={"speed_m_s": 1.2})
    truth = track(slow)
    series = tuple(
        Sample(time_s=float(t), robot_at=robot_at(t), humans_at={"Ada": WORLD.grid.nearest(*truth[after(t)])})
        for t in range(12)
    )
    scenario = Scenario(mission=MISSION, people=HumanConfiguration(humans=(person,)))
    feedback = Feedback(scenario=scenario, objectives=(1.0,), mean=1.0, interval=(1.0, 1.0), series=series)
    assert Forecaster(GROUND, 20.0).fitted(feedback).pace == pytest.approx(0.8 * PACE, abs=0.1)
    bare = feedback.model_copy(update={"series": ()})
    assert Forecaster(GROUND, 20.0).fitted(bare).pace == PACE


def robot_at(t: float) -> str:
    (ax, ay), (bx, by) = GROUND.robot_path[0], GROUND.robot_path[-1]
    share = min(1.0, 0.49 * max(0.0, t - 0.5) / float(np.hypot(bx - ax, by - ay)))
    return WORLD.grid.nearest(ax + share * (bx - ax), ay + share * (by - ay))


def test_the_robot_is_expected_to_drive_straight_where_the_map_leaves_it_room() -> None:
    warehouse = load_world("warehouse")
    route = warehouse.route("route_1")
    path = WalkingGraph(warehouse, route).robot_path
    assert path[0] == (route.start.x, route.start.y) and path[-1] == (route.goal.x, route.goal.y)
    length = sum(np.hypot(*np.subtract(a, b)) for a, b in pairwise(path))
    assert 8.4 < length < 9.0  # the grid path along `via` has 10.1 m


def test_paths_along_the_route_are_valid_and_at_most_1_7_times_the_shortest() -> None:
    for start in WORLD.grid.valid:
        for end in ("A1", "E7", "B7"):
            liked, short = GROUND.path(start, end, along_route=True), GROUND.path(start, end)
            assert all(b in WORLD.grid.neighbours[a] for a, b in pairwise(liked))
            length, least = (sum(np.hypot(*np.diff([GROUND.at[n] for n in way], axis=0).T)) for way in (liked, short))
            assert length <= 1.7 * least + 1e-9


def test_the_nearest_point_of_a_line_is_told_by_length_and_distance() -> None:
    assert nearest_on(((0.0, 0.0), (4.0, 0.0), (4.0, 4.0)), (5.0, 1.0)) == (5.0, 1.0)
