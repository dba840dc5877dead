from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from tests.evaluation.runs import run_of, trajectory

from rvsg.evaluation.detection import EncounterKind, encounters_of, events_of
from rvsg.evaluation.metrics import measure
from rvsg.evaluation.sampled import Sampled
from rvsg.evaluation.story import story_of
from rvsg.evaluation.verdict import MEASURED, summarise_safety
from rvsg.scenario.scenario import Behaviour, Human, HumanConfiguration, Mission, Pause, Scenario, Task
from rvsg.simulation import events as recorded
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.simulation.events import (
    EVENTS,
    Abort,
    BlockedGoal,
    Contact,
    GoalReached,
    HardBrake,
    NearMiss,
    PersonPaused,
    PersonReached,
    PersonStuck,
    RecordedEvent,
    RunEvent,
    StandStill,
    TimeOut,
)
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Outcome
from rvsg.world.world import Route, World
from rvsg.world.world_folder import load_world

T = np.arange(0.0, 20.001, 0.05)
REACH = 0.75
"""The radii of robot and person together, metres."""


def of(kind: type, run, **known):
    return [event for event in events_of(run, **known) if isinstance(event, kind)]


def passing(gap: np.ndarray, *, robot_speed=0.0, person_speed=0.0, person_yaw=np.pi):
    """A robot at the origin that looks along x, and a person straight ahead of it."""
    return run_of(
        trajectory(T, 0.0, v=robot_speed, humans=[(gap + REACH, 0.0, person_yaw, person_speed)]), goal=(9.0, 0.0, 0.0)
    )


def dip(at: float, least: float, width: float = 1.0) -> np.ndarray:
    return 3.0 - (3.0 - least) * np.exp(-(((T - at) / width) ** 2))


@pytest.mark.parametrize(
    ("robot_speed", "person_speed", "person_yaw", "mover"),
    [(0.5, 0.0, 0.0, "robot"), (0.0, 1.0, np.pi, "person"), (0.5, 0.6, np.pi, "both"), (0.0, 1.0, 0.0, "neither")],
)
def test_a_contact_says_who_when_how_fast_and_who_moved_into_whom(robot_speed, person_speed, person_yaw, mover) -> None:
    gap = np.where((T >= 5) & (T < 7), -0.1, 1.0)
    (contact,) = of(Contact, passing(gap, robot_speed=robot_speed, person_speed=person_speed, person_yaw=person_yaw))
    assert (contact.person, contact.moved_by, contact.bearing_rad) == ("Human 1", mover, 0.0)
    assert contact.time_s == 5.0 and contact.duration_s == pytest.approx(1.95)
    towards = robot_speed + (person_speed if person_yaw else -person_speed)
    assert contact.closing_speed_m_s == pytest.approx(max(0.0, towards), abs=1e-3)
    assert contact.robot_part_m_s + contact.person_part_m_s == pytest.approx(towards, abs=1e-3)
    assert (contact.robot_speed_m_s, contact.person_speed_m_s) == (robot_speed, person_speed)
    assert contact.overlap_m == pytest.approx(0.1)


def test_contacts_are_those_that_the_metric_counts() -> None:
    chance = np.random.default_rng(3)
    for _ in range(20):
        gap = np.repeat(chance.uniform(-0.3, 0.6, 81), 5)[: len(T)]
        run = passing(gap)
        assert len(of(Contact, run)) == measure(run, ["contacts"])["contacts"]


def test_a_near_miss_is_told_at_its_closest_and_a_contact_is_none() -> None:
    (miss,) = of(NearMiss, passing(dip(8, 0.1), robot_speed=0.5))
    assert miss.time_s == 8.0 and miss.gap_m == pytest.approx(0.1)
    assert of(NearMiss, passing(dip(8, -0.1), robot_speed=0.5)) == []
    assert of(NearMiss, passing(dip(8, 0.3), robot_speed=0.5)) == []
    assert of(NearMiss, passing(np.full(len(T), 0.1))) == [], "two bodies that stand beside each other"
    assert len(of(NearMiss, passing(np.minimum(dip(5, 0.1), dip(12, 0.1)), robot_speed=0.5))) == 2


def test_a_hard_brake_is_found_on_the_way_and_not_at_the_goal() -> None:
    v = np.where(T < 6, 0.5, np.where(T < 10, 0.0, 0.5))
    (brake,) = of(HardBrake, run_of(trajectory(T, 0.0, v=v)))
    assert 5.4 <= brake.time_s <= 6.0 and brake.from_speed_m_s == 0.5 and brake.to_speed_m_s == 0.0
    arriving = np.where(T < 19.5, 0.5, 0.0)
    assert of(HardBrake, run_of(trajectory(T, 0.0, v=arriving))) == []
    slowly = np.interp(T, [5, 8], [0.5, 0.0])
    assert of(HardBrake, run_of(trajectory(T, 0.0, v=slowly))) == []


def test_speed_that_a_contact_takes_is_no_brake_but_braking_before_it_is() -> None:
    v = np.where(T < 6, 0.5, 0.0)
    assert len(of(HardBrake, run_of(trajectory(T, 0.0, v=v, humans=[(2.0, 0.0)])))) == 1
    crash = run_of(trajectory(T, 0.0, v=v, humans=[(np.where(T < 5.95, 2.0, 0.5), 0.0)]))
    assert of(HardBrake, crash) == [] and len(of(Contact, crash)) == 1
    wall = recorded.ObstacleContact(time_s=5.97, x=0.0, y=0.0, until_s=5.98, speed_m_s=0.5)
    assert of(HardBrake, run_of(trajectory(T, 0.0, v=v), events=(wall,))) == []
    v = np.interp(T, [5.0, 6.0, 6.5], [1.0, 0.3, 0.3])
    run = run_of(trajectory(T, 0.0, v=v, humans=[(np.where(T < 6.5, 2.0, 0.5), 0.0)]))
    (brake,) = of(HardBrake, run)
    assert brake.until_s <= 6.5 and brake.deceleration_m_s2 == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("x", "y", "reason"),
    [(1.2, 0.0, "person_ahead"), (-1.2, 0.0, "person_close"), (0.5, 0.0, "contact"), (4.0, 0.0, "unknown")],
)
def test_a_standstill_has_the_reason_that_is_next_to_the_robot(x, y, reason) -> None:
    v = np.where((T >= 6) & (T < 10), 0.0, 0.5)
    (stop,) = of(StandStill, run_of(trajectory(T, 0.0, v=v, humans=[(x, y)])))
    assert (stop.time_s, stop.reason) == (6.0, reason)
    assert stop.duration_s == pytest.approx(3.95)
    assert stop.person == ("" if reason == "unknown" else "Human 1")


def test_a_robot_that_is_stuck_at_a_wall_stands_because_of_it_and_not_because_of_a_person_before_it() -> None:
    """Seen with people 1 m away: the robot touched a corner of a shelf from the moment it stood."""
    v = np.where(T < 6, 0.5, 0.0)
    wall = recorded.ObstacleContact(time_s=5.9, x=0.3, y=-0.3, until_s=19.95, speed_m_s=0.1)
    for x, reason in ((1.2, "obstacle_contact"), (0.5, "contact")):
        run = run_of(trajectory(T, 0.0, v=v, humans=[(x, 0.0)]), outcome=Outcome.STUCK, events=(wall,))
        (stop,) = of(StandStill, run)
        assert (stop.reason, stop.person) == (reason, "Human 1" if reason == "contact" else "")


def test_waiting_for_the_goal_and_standing_at_it_are_no_standstill() -> None:
    v = np.where((T >= 3) & (T < 15), 0.5, 0.0)
    assert of(StandStill, run_of(trajectory(T, 0.0, v=v))) == []
    assert len(of(StandStill, run_of(trajectory(T, 0.0, v=v), outcome=Outcome.TIMED_OUT))) == 1


def test_a_person_on_the_goal_blocks_it_while_the_robot_is_near() -> None:
    def blocked(until_x):
        series = trajectory(T, np.linspace(0, until_x, len(T)), humans=[(9.1, 0.0)])
        return of(BlockedGoal, run_of(series, goal=(9.0, 0.0, 0.0)))

    (event,) = blocked(8)
    assert event.person == "Human 1" and 14.5 < event.time_s < 15.5 and event.until_s == 20.0
    assert blocked(5) == []


@pytest.mark.parametrize(
    ("outcome", "kind"),
    [(Outcome.REACHED, GoalReached), (Outcome.TIMED_OUT, TimeOut), (Outcome.ABORTED, Abort), (Outcome.NO_PATH, Abort)],
)
def test_the_last_event_is_how_the_run_ended(outcome, kind) -> None:
    events = events_of(run_of(trajectory(T, 0.0), outcome=outcome, goal=(3.0, 4.0, 0.0)))
    assert isinstance(events[-1], kind) and events[-1].time_s == 20.0
    assert kind is GoalReached or events[-1].remaining_m == 5.0
    assert events_of(run_of(trajectory(np.empty(0), np.empty(0)), outcome=outcome)) == ()


@cache
def warehouse() -> World:
    return load_world("warehouse")


def scenario_of(*humans: Human) -> Scenario:
    route: Route = warehouse().route("route_1")
    mission = Mission(world="warehouse", world_id=warehouse().id, route=route)
    return Scenario(mission=mission, people=HumanConfiguration(humans=humans))


def to_and_fro(to: str = "H15", *, pauses: tuple[Pause, ...] = (), **more: object) -> Scenario:
    """Somebody walks from E15 to another waypoint and back, again and again."""
    path = warehouse().grid.shortest_path("E15", to)
    tasks = (Task(name="out", path=path, pauses=pauses), Task(name="back", path=path[::-1]))
    return scenario_of(Human(**{"name": "Anna", "tasks": tasks, **more}))


def simulated(scenario: Scenario):
    run = KinematicSimulator().run(scenario, warehouse(), seed=1)
    return run, events_of(run, world=warehouse(), scenario=scenario)


def test_people_arrive_and_pause_as_their_tasks_say() -> None:
    _, events = simulated(to_and_fro(pauses=(Pause(at="H15", duration_s=3.0),), speed_m_s=1.0))
    reached = [event for event in events if isinstance(event, PersonReached)]
    assert next((event.task, event.waypoint) for event in reached) == ("out", "H15")
    assert {event.task for event in reached} == {"out", "back"}
    paused = [event for event in events if isinstance(event, PersonPaused)]
    assert paused and paused[0].duration_s == pytest.approx(3.0, abs=0.2) and paused[0].waypoint == "H15"
    assert not [event for event in events if isinstance(event, PersonStuck)]


def test_a_person_who_does_not_come_on_is_stuck_from_then_on() -> None:
    scenario = to_and_fro()
    path = scenario.people.humans[0].tasks[0].path
    start, middle = warehouse().grid.position("E15"), warehouse().grid.position(path[1])
    walked = [np.interp(T, [0, 4], [start[axis], middle[axis]]) for axis in (0, 1)]
    run = run_of(trajectory(T, 90.0, 90.0, humans=[(walked[0], walked[1])]))
    object.__setattr__(run, "human_names", ("Anna",))
    (stuck,) = of(PersonStuck, run, world=warehouse(), scenario=scenario)
    assert 2.5 < stuck.time_s < 4.5 and stuck.until_s == 20.0 and stuck.waypoint == path[1]


def test_somebody_who_walks_to_and_fro_is_not_stuck_and_events_survive_json() -> None:
    _, events = simulated(to_and_fro("F15", speed_m_s=1.5))
    assert not [event for event in events if isinstance(event, PersonStuck)]
    assert events and EVENTS.validate_json(EVENTS.dump_json(events)) == events
    assert [event.time_s for event in events] == sorted(event.time_s for event in events)


OUTLINE = ((0.4, 0.2), (-0.4, 0.2), (-0.4, -0.2), (0.4, -0.2))


@pytest.mark.parametrize(
    ("x", "y", "gap"),
    [(1.0, 0.0, 0.2), (0.0, 0.8, 0.2), (0.7, 0.6, 0.1), (0.1, 0.0, -0.6), (0.0, -0.6, 0.0)],
)
def test_the_gap_of_a_robot_with_an_outline_is_that_of_its_body(x, y, gap) -> None:
    turned = 0.7
    human = (x * np.cos(turned) - y * np.sin(turned), x * np.sin(turned) + y * np.cos(turned))
    series = trajectory([0.0], [0.0], yaw=turned, humans=[human])
    run = run_of(series, robot_outline=OUTLINE)
    assert Sampled(run, series).gap[0, 0] == pytest.approx(gap)
    assert Sampled(run, series).disc_gap[0, 0] == pytest.approx(np.hypot(x, y) - 0.75)


def test_recorded_contacts_are_those_of_events_and_metrics() -> None:
    touched = Contact(
        time_s=5.02, until_s=6.0, x=0.4, y=0.0, person="Human 1", closing_speed_m_s=0.9, robot_part_m_s=0.5,
        person_part_m_s=0.4, bearing_rad=0.1, overlap_m=0.002,
    )  # fmt: skip
    series = trajectory(T, 0.0, v=0.3, humans=[(0.8 + 1e-4, 0.0)])  # a hair apart: overlaps are resolved
    run = run_of(series, robot_outline=OUTLINE, events=(touched,))
    (contact,) = of(Contact, run)
    assert (contact.time_s, contact.until_s, contact.moved_by) == (5.02, 6.0, "both")
    found = measure(run, ["contacts", "contact_longest", "contact_speed", "contact_robot_speed", "ttc"])
    assert found["contacts"] == 1 and found["contact_longest"] == pytest.approx(0.95, abs=0.06)
    assert (found["contact_speed"], found["contact_robot_speed"], found["ttc"]) == (0.9, 0.3, 0.0)
    assert of(NearMiss, run) == []
    assert measure(run_of(series, robot_outline=OUTLINE), ["contacts"])["contacts"] == 0


def test_recorded_events_of_people_become_events_of_the_run() -> None:
    scenario = to_and_fro(name="Human 1")
    path = scenario.people.humans[0].tasks[0].path
    at = {"person": "Human 1", "x": 0.0, "y": 0.0}
    told = (
        recorded.PersonReached(time_s=1.0, goal=1, **at),
        recorded.PersonReached(time_s=2.0, goal=len(path) - 1, **at),
        recorded.PersonReacted(time_s=3.0, until_s=99.0, behaviour=Behaviour.SURPRISED, **at),
        recorded.PersonStuck(time_s=4.0, until_s=9.5, goal=0, **at),
        recorded.PersonPaused(time_s=30.0, until_s=31.0, goal=0, **at),
    )
    run = run_of(trajectory(T, 50.0, humans=[(0.0, 0.0)]), events=told)
    events = events_of(run, world=warehouse(), scenario=scenario)[:-1]
    assert [event.kind for event in events] == ["person_reached", "person_reacted", "person_stuck"]
    assert [event.time_s for event in events] == [2.0, 3.0, 4.0]
    assert events[0].task == "out" and events[1].until_s == 20.0


@pytest.mark.exhaustive
def test_the_contacts_of_a_simulated_run_are_those_it_recorded() -> None:
    there = warehouse().grid.shortest_path("E21", "G12")
    tasks = (Task(name="towards", path=there), Task(name="back", path=there[::-1]))
    scenario = scenario_of(Human(name="Anna", tasks=tasks, behaviour=Behaviour.IMPASSIVE))
    run = EmbeddedSimulator().run(scenario, warehouse(), seed=1)
    events = events_of(run, world=warehouse(), scenario=scenario)
    assert sum(isinstance(event, Contact) for event in events) == measure(run, ["contacts"])["contacts"]
    assert Sampled(run, run.trajectory).gap.min() > -0.02


def test_the_reference_page_names_every_kind_and_every_field() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "events.md").read_text(encoding="utf-8")
    others = get_args(get_args(RunEvent)[0])[1:]
    kinds = (*get_args(get_args(RecordedEvent)[0]), *others)
    assert len(kinds) == 16
    for kind in kinds:
        row = next(line for line in page.splitlines() if line.startswith(f"| `{kind.model_fields['kind'].default}` |"))
        for name in kind.model_fields.keys() - {"kind", "time_s", "x", "y", "waypoint", "until_s"}:
            assert f"`{name}`" in row


ROBOT_X = 0.5 * T


@pytest.mark.parametrize(
    ("human", "kind"),
    [
        ((10.0 - 0.5 * T, 0.9, np.pi, 0.5), EncounterKind.HEAD_ON),
        ((3.0 + 0.2 * T, 0.9, 0.0, 0.2), EncounterKind.ROBOT_OVERTAKES),
        ((-4.0 + 1.0 * T, 0.9, 0.0, 1.0), EncounterKind.PERSON_OVERTAKES),
        ((5.0, 10.0 - 1.0 * T, -np.pi / 2, 1.0), EncounterKind.FROM_LEFT),
        ((5.0, -10.0 + 1.0 * T, np.pi / 2, 1.0), EncounterKind.FROM_RIGHT),
        ((5.0, 0.9, 2.0, 0.0), EncounterKind.STANDING),
    ],
)
def test_the_kind_follows_from_the_directions_of_both(human, kind) -> None:  # type: ignore[no-untyped-def]
    run = run_of(trajectory(T, ROBOT_X, v=0.5, humans=[human]))
    (met,) = encounters_of(run)
    assert (met.kind, met.person) == (kind, "Human 1")


def test_someone_far_away_is_not_met_and_a_second_approach_is_a_second_encounter() -> None:
    def beside(y):
        return encounters_of(run_of(trajectory(T, ROBOT_X, v=0.5, humans=[(ROBOT_X, y, 0.0, 0.5)])))

    assert beside(5.0) == ()
    met = beside(np.where((T % 10) < 2, 1.5, 6.0))
    assert [round(each.gap_m, 2) for each in met[:2]] == [0.75, 0.75]
    assert met[0].time_s < 2.0 <= 10.0 <= met[1].time_s
    assert encounters_of(run_of(trajectory(T, ROBOT_X, v=0.5))) == (), "without people"


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
    scenario = to_and_fro()
    story = story_of(simulated(scenario)[0], world=warehouse(), scenario=scenario)
    assert 3 <= len(story) <= 6
    assert any("Anna" in sentence.text for sentence in story)
    start = scenario.mission.route.start
    assert f"({warehouse().place_name(start.x, start.y)})" in story[0].text


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
