from __future__ import annotations

import numpy as np
import pytest
from tests.evaluation.runs import run_of, trajectory
from tests.evaluation.test_events import REACH, T, a_run, dip, passing, scenario_of, warehouse

from rvsg.evaluation.detection import events_of
from rvsg.evaluation.metrics.registry import measure
from rvsg.evaluation.run_events import Contact, place_name
from rvsg.evaluation.story import story_of
from rvsg.evaluation.verdict import MEASURED, summarise_safety
from rvsg.scenario.scenario import Human, Task
from rvsg.simulation.run import Outcome


def test_a_story_tells_start_contact_and_end_at_their_times() -> None:
    gap = np.where((T >= 5) & (T < 7), -0.1, 1.5)
    story = story_of(passing(gap, robot_speed=0.5))
    assert [sentence.time_s for sentence in story] == [0.0, 5.0, 20.0]
    assert "Human 1" in story[1].text and "2.0 s" in story[1].text


def test_the_contact_stays_in_a_story_with_many_events() -> None:
    gap = np.min([dip(at, 0.05, 0.3) for at in np.arange(2, 18, 2.5)], axis=0)
    gap[(T >= 9) & (T < 9.5)] = -0.05
    run = passing(gap, robot_speed=0.5)
    story = story_of(run)
    (contact,) = (event for event in events_of(run) if isinstance(event, Contact))
    assert len(story) == 6
    assert contact.time_s in [sentence.time_s for sentence in story]
    assert [sentence.time_s for sentence in story] == sorted(sentence.time_s for sentence in story)


def test_the_story_of_a_run_in_which_nobody_comes_near_tells_the_closest_approach() -> None:
    story = story_of(passing(dip(8, 2.0)))
    assert [sentence.time_s for sentence in story] == [0.0, 8.0, 20.0]
    assert story_of(run_of(trajectory(np.empty(0), np.empty(0)))) == ()


def test_a_simulated_run_has_a_story_with_the_names_of_its_places() -> None:
    path = warehouse().grid.shortest_path("E15", "H15")
    scenario = scenario_of(Human(name="Anna", tasks=(Task(name="a", path=path), Task(name="b", path=path[::-1]))))
    story = story_of(a_run(scenario), world=warehouse(), scenario=scenario)
    assert 3 <= len(story) <= 6
    assert any("Anna" in sentence.text for sentence in story)
    start = scenario.mission.route.start
    assert f"({place_name(warehouse(), start.x, start.y)})" in story[0].text


def test_what_is_reported_beside_a_requirement_counts_contacts_arrivals_and_clearance() -> None:
    touching = passing(np.where((T >= 5) & (T < 7), -0.1, 1.0), robot_speed=0.5)
    late = run_of(trajectory(T, 0.0, humans=[(REACH + 0.4, 0.0)]), outcome=Outcome.TIMED_OUT)
    nobody = run_of(trajectory(T, 0.0))
    summary = summarise_safety([measure(run, MEASURED) for run in (late, touching, nobody)])
    assert (summary.contacts.runs, summary.contacts.of, summary.contacts.which) == (1, 2, (1,))
    assert summary.contacts.longest_s == pytest.approx(1.95)
    assert summary.contacts.worst_speed_m_s == pytest.approx(0.5)
    assert (summary.arrived.runs, summary.arrived.of, summary.arrived.missed) == (2, 3, (0,))
    assert summary.least_clearance_m == pytest.approx(-0.1) and summary.closest_run == 1
    apart = summarise_safety([measure(run_of(trajectory(T, 0.0, humans=[(5.0, 0.0)])), MEASURED)])
    assert (apart.contacts.runs, apart.contacts.longest_s, apart.contacts.worst_speed_m_s) == (0, None, None)
