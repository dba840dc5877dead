from itertools import pairwise

import numpy as np
import pytest
from tests.scenario.small_world import MISSION, WORLD, human

from rvsg.generation.forecast import (
    BODIES_M,
    ROBOT_SPEED_M_S,
    STARTS_AFTER_S,
    STOPS_AT_M,
    TURNS_FOR_S,
    Forecaster,
    pace,
    walk,
)
from rvsg.generation.ground import Ground, nearest_on
from rvsg.scenario.brief import Feedback, Sample
from rvsg.scenario.scenario import HumanConfiguration, Pause, Scenario, Task

GROUND = Ground(WORLD, MISSION.route)
AT = GROUND.at
TIMES = np.arange(0.0, 40.0, 0.25)


def test_a_walk_is_cyclic_and_waits_for_its_delay() -> None:
    person = human("A1 → A3: A1 A2 A3", "A3 → A1: A3 A2 A1", speed_m_s=1.0, start_delay_s=2.0)
    at = walk(person, AT, TIMES)
    assert np.allclose(at[TIMES <= 2.0], AT["A1"])
    there = 2.0 + 2.0 / pace(1.0)
    assert at[np.searchsorted(TIMES, there)] == pytest.approx(AT["A3"], abs=0.2)
    assert at[np.searchsorted(TIMES, 2.0 + 4.0 / pace(1.0))] == pytest.approx(AT["A1"], abs=0.2)


def test_a_pause_holds_a_walk_where_it_is() -> None:
    task = Task(name="A1 → A3", path=("A1", "A2", "A3"), pauses=(Pause(at="A2", duration_s=5.0),))
    at = walk(human(task, "A3 → A1: A3 A2 A1", speed_m_s=1.0), AT, TIMES)
    still = np.isclose(at, AT["A2"]).all(axis=1).sum() * 0.25
    rounds = 40.0 / (4.0 / pace(1.0) + 5.0)
    assert still == pytest.approx(5.0 * rounds, abs=1.0)


def test_a_robot_without_people_arrives_after_its_way_at_its_usual_speed() -> None:
    far = human("E1 → E2: E1 E2", "E2 → E1: E2 E1")
    forecast = Forecaster(GROUND, 40.0)([far])
    length = sum(np.hypot(*np.subtract(a, b)) for a, b in pairwise(GROUND.robot_path))
    assert forecast.duration_s == pytest.approx(STARTS_AFTER_S + length / ROBOT_SPEED_M_S + TURNS_FOR_S, abs=0.5)
    assert forecast.blocked_s == 0.0


def test_somebody_who_stands_in_the_way_holds_the_robot_up() -> None:
    way = [name for name in GROUND.corridor if 1.5 < GROUND.along(name)[0] < 3.5 and GROUND.along(name)[1] < 0.2]
    task = Task(
        name="look", path=(way[0], GROUND.hops[way[0]][0][0], way[0]), pauses=(Pause(at=way[0], duration_s=30),)
    )
    forecast = Forecaster(GROUND, 20.0)([human(task)])
    assert forecast.blocked_s > 5.0
    assert forecast.least_gap_m < STOPS_AT_M - BODIES_M + 0.1


def test_paces_and_speed_are_fitted_to_what_was_measured() -> None:
    person = human("A1 → A7: A1 A2 A3 A4 A5 A6 A7", "A7 → A1: A7 A6 A5 A4 A3 A2 A1", speed_m_s=1.2)
    truth = walk(person, AT, TIMES, 0.8)
    series = tuple(
        Sample(time_s=float(t), robot_at="B4", humans_at={"Ada": WORLD.grid.nearest(*truth[k])})
        for k, t in enumerate(TIMES)
        if t == int(t) and t <= 20
    )
    scenario = Scenario(mission=MISSION, people=HumanConfiguration(humans=(person,)))
    feedback = Feedback(scenario=scenario, objectives=(1.0,), mean=1.0, interval=(1.0, 1.0), series=series)
    fitted = Forecaster(GROUND, 20.0).fitted(feedback)
    assert fitted.paces["Ada"] == pytest.approx(0.8, abs=0.06)


def test_paths_along_the_route_are_valid_and_at_most_1_7_times_the_shortest() -> None:
    for start in WORLD.grid.valid:
        for end in ("A1", "E7", "B7"):
            liked, short = GROUND.path(start, end, along_route=True), GROUND.path(start, end)
            assert liked is not None and short is not None
            assert all(b in WORLD.grid.neighbours[a] for a, b in pairwise(liked))
            assert GROUND.length(liked) <= 1.7 * GROUND.length(short) + 1e-9


def test_the_nearest_point_of_a_line_is_told_by_length_and_distance() -> None:
    assert nearest_on(((0.0, 0.0), (4.0, 0.0), (4.0, 4.0)), (5.0, 1.0)) == (5.0, 1.0)
