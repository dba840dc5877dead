"""Stacks under test: how they are chosen, what they are told, their faults, and those that ship."""

from __future__ import annotations

import math
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.simulation.parts import TIAGO, route

from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.core.plugins import Spec
from rvsg.scenario.scenario import Attention, HumanAgent
from rvsg.simulation.embedded.profiles import profile
from rvsg.simulation.embedded.simulator import EmbeddedSimulator, empty_room, simulate_agents
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks.pure_pursuit import PurePursuit, carrot, pursue, regulated, turn_towards
from rvsg.stacks import Ended, LocalObservation, LocalPlanner, Observation, StackChoice, Task, WholeStack, stack_names
from rvsg.testing import check_stack

ROUTE, ACROSS = route((-2.0, 0.0), (1.5, 0.0), 12.0), route((-2.2, 0.0), (2.0, 0.0), 20.0)
HUMAN = HumanAgent(name="ann", start=(0.0, 1.5), goals=((0.0, 1.5), (1.0, 1.5)), pauses_s=(0.0, 0.0))
EXAMPLE = Path(__file__).parents[2] / "examples" / "stacks" / "follow_the_plan.py"


def drive(stack: Any, seed: int = 0, **options: Any) -> Run:
    return simulate_agents(empty_room(), ROUTE, [HUMAN], seed=seed, stack=StackChoice.of(stack, options))


class Straight(LocalPlanner):
    """Answers what it is made with."""

    def __init__(self, answer: Any = (0.5, 0.0)) -> None:
        self.answer = answer
        self.seen: list[tuple[float, ...]] = []

    def reset(self, task: Task) -> None:
        self.task, self.seen = task, []

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        self.seen.append((seen.t, *seen.pose, len(seen.plan), *seen.goal))
        if self.answer == "raise":
            raise ValueError("no map")
        return self.answer  # type: ignore[no-any-return]


class Towards(WholeStack):
    """Drives straight on for some time, then says how it ended."""

    def __init__(self, until_s: float = 7.0, end: Any = Ended.REACHED) -> None:
        self.until_s, self.end = until_s, end

    def reset(self, task: Task) -> None:
        self.task, self.steps = task, 0

    def step(self, seen: Observation) -> tuple[float, float] | Ended | None:
        self.steps += 1
        self.seen = seen.people(), seen.scan(1), seen.map_from_odom
        if seen.t >= self.until_s:
            return self.end  # type: ignore[no-any-return]
        return (0.5, 0.0)


@pytest.mark.parametrize("period_s", [0.01, 0.05, 0.1])
def test_a_whole_stack_is_told_how_often_it_is_called(period_s: float) -> None:
    """One that keeps pace with a system on the wall's clock paces each call by that."""
    stack = type("Often", (Towards,), {"period_s": period_s})(until_s=2.0)
    drive(stack)
    assert stack.task.period_s == pytest.approx(period_s)
    assert stack.steps * stack.task.period_s == pytest.approx(2.0, abs=2 * period_s)


def test_a_planner_drives_and_is_told_where_it_is() -> None:
    planner = Straight()
    run = drive(planner)
    assert run.outcome is Outcome.REACHED
    assert run.details["stack"] == {"calls": len(planner.seen), "without_command": 0, "not_finite": 0, "clipped": 0}
    _, x, y, _, points, *goal = planner.seen[-1]
    assert math.hypot(x - goal[0], y - goal[1]) < 0.4
    assert points > 10 and abs(goal[0] - 1.5) < 0.2
    assert planner.seen[1][0] - planner.seen[0][0] == pytest.approx(planner.task.period_s)


def test_a_whole_stack_drives_and_says_when_it_has_arrived() -> None:
    stack = Towards()
    run = drive(stack)
    assert run.outcome is Outcome.REACHED
    assert run.trajectory.x[-1] > 1.2
    people, scan, offset = stack.seen
    assert people.shape == (1, 4) and people[0, 1] == pytest.approx(1.3, abs=0.5)
    assert np.isfinite(scan.ranges).all() and scan.ranges.min() > 0.5
    task = stack.task
    assert task.start.x == pytest.approx(-2.0 + offset[0]) and task.goals[-1].x == pytest.approx(1.5 + offset[0])


@pytest.mark.parametrize(
    ("end", "outcome"),
    [(Ended.GAVE_UP, Outcome.ABORTED), (None, Outcome.TIMED_OUT), ((math.nan, 0.0), Outcome.TIMED_OUT)],
)
def test_a_whole_stack_may_give_up_or_fall_silent(end: Any, outcome: Outcome) -> None:
    run = drive(Towards(2.0, end))
    assert run.outcome is outcome
    assert run.trajectory.t[-1] < 2.2 or run.trajectory.v[-1] == 0.0


@pytest.mark.parametrize("answer", ["raise", "fast", (1.0,), (1.0, 2.0, 3.0, 4.0)])
def test_a_planner_that_fails_ends_its_run(answer: Any) -> None:
    run = drive(Straight(answer))
    assert run.outcome is Outcome.STACK_FAILED
    assert run.details["stack"]["calls"] == 1 and run.stack_fault == run.details["stack"]["fault"] != ""  # type: ignore[index]
    assert run.trajectory.t[-1] < 1.0


def test_a_velocity_that_is_not_finite_counts_as_no_command_and_an_impossible_one_is_clipped() -> None:
    run = drive(Straight((math.nan, 0.0)))
    told: Any = run.details["stack"]
    assert run.outcome is not Outcome.REACHED
    assert told["not_finite"] == told["without_command"] == told["calls"] > 0
    run = drive(Straight((99.0, 0.0)))
    assert run.details["stack"]["clipped"] == run.details["stack"]["calls"]  # type: ignore[index]
    assert run.trajectory.v.max() <= 0.5 + 1e-9


def test_the_default_stack_is_that_of_the_profile_and_only_the_study_s_is_not_stored() -> None:
    for people, name in (("default", "nav2-dwb"), ("hunavsim", "nav2-dwb"), ("published-study", "nav2-dwb-humble")):
        plain, named = EmbeddedSimulator(people), EmbeddedSimulator(people, stack=name)
        assert plain.options == named.options
        assert plain.options.get("stack", {"name": "nav2-dwb-humble"})["name"] == name  # type: ignore[index]
    study = simulate_agents(empty_room(), ROUTE, [HUMAN], options=profile("published-study"))
    assert "stack" not in study.options and simulate_agents(empty_room(), ROUTE, []).options["stack"]


def test_the_stack_is_part_of_the_options() -> None:
    one = EmbeddedSimulator(stack=f"{EXAMPLE}:FollowThePlan")
    other = EmbeddedSimulator(stack=Spec(f"{EXAMPLE}:FollowThePlan", {"speed": 0.4}))
    assert one.options != other.options
    record: Any = other.options["stack"]
    assert record["options"] == {"speed": 0.4} and record["version"].startswith("1+")
    assert pickle.loads(pickle.dumps(other.options)) == other.options
    assert EmbeddedSimulator(stack=record).options == other.options


@pytest.mark.parametrize(
    ("stack", "error"),
    [
        ("nav2-dbw", UnknownName),
        ("no_such_module:Planner", InputError),
        ("missing.py:Planner", FileError),
        ("broken.py:Planner", FileError),
        ("fine.py:Planner", InputError),
        ("fine.py:Other", UnknownName),
        (Spec(f"{EXAMPLE}:FollowThePlan", {"sped": 1}), InputError),
        ({"name": "nav2-dwb", "version": "1"}, InputError),
    ],
)
def test_a_stack_that_cannot_be_chosen(
    stack: Any, error: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("broken.py").write_text("class Planner:\n    pass\nx = (\n")
    Path("fine.py").write_text("class Planner:\n    pass\n")
    with pytest.raises(error):
        StackChoice.of(stack)


def drive_past(
    stack: str, *walk: tuple[float, float], attention: Attention = Attention.ATTENTIVE, **options: Any
) -> Run:
    """A run across the room past somebody who walks from point to point and stays at the last."""
    pauses = (*(0.0 for _ in walk[1:]), 60.0)
    human = HumanAgent(name="ann", start=walk[0], goals=walk, pauses_s=pauses, attention=attention)
    return simulate_agents(empty_room(), ACROSS, [human], stack=StackChoice.of(stack, options))


def nearest(run: Run) -> float:
    path = run.trajectory
    return float(np.hypot(path.x - path.human_x[:, 0], path.y - path.human_y[:, 0]).min())


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", sorted({*stack_names()} - {"nav2-dwb", "nav2-dwb-humble", "exec", "exec-stack", "ros2"})
)
def test_every_stack_that_ships_passes_the_exam(name: str) -> None:
    check_stack(name)


def test_the_example_passes_the_exam() -> None:
    said = check_stack(f"{EXAMPLE}:FollowThePlan")
    assert re.search(r":FollowThePlan \S+ passes: it crosses an empty room in \d+\.\d s with \d+ calls", said)


def test_stop_and_go_waits_before_a_person_and_nav2_drives_around() -> None:
    walk = ((0.0, -2.3), (0.0, 0.0))
    waiting = drive_past("stop-and-go", *walk, attention=Attention.UNSEEING)
    assert waiting.outcome is Outcome.TIMED_OUT and waiting.recoveries == 0
    assert waiting.trajectory.x.max() < -0.5 and nearest(waiting) > 0.7
    around = drive_past("nav2-rpp", *walk)
    assert around.trajectory.x.max() > 0.5


def test_social_keeps_more_distance_than_pure_pursuit() -> None:
    beside = (0.0, 0.3)
    assert nearest(drive_past("social", beside)) > nearest(drive_past("nav2-rpp", beside)) + 0.1


def numbers(**options: Any) -> Any:
    square = np.array([(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)])
    return PurePursuit(**options).numbers(square, 0.2, math.hypot(0.3, 0.2), 0.25, 0.05, math.inf)


def test_the_carrot_lies_on_the_circle_between_two_points() -> None:
    plan = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]])
    assert carrot(plan, 0, 0.6, 0.0, 0.0) == pytest.approx((0.6, 0.0))
    x, y = carrot(plan, 0, 0.6, 0.0, 0.3)
    assert math.hypot(x, y - 0.3) == pytest.approx(0.6) and y == 0.0
    assert carrot(plan, 0, 3.0, 0.0, 0.0) == (1.0, 0.0)


def test_the_speed_is_regulated_as_nav2_does() -> None:
    p = numbers()
    assert regulated(0.5, 0.0, 0.0, 9.0, 9.0, p) == 0.5
    # A radius of 0.6 m under the least of 0.9 m: 0.5 (1 - 0.3 / 0.9).
    assert regulated(0.5, 1 / 0.6, 0.0, 9.0, 9.0, p) == pytest.approx(0.5 * (1 - 0.3 / 0.9))
    assert regulated(0.5, 10.0, 0.0, 9.0, 9.0, p) == 0.25
    # Cost 128 is 0.2 m + ln(253 / 128) / 3 from the obstacle.
    away = 0.2 + math.log(253 / 128) / 3
    assert regulated(0.5, 0.0, 128.0, 9.0, 9.0, p) == pytest.approx(0.5 * away / 0.6)
    assert regulated(0.5, 0.0, 0.0, 0.5, 0.3, p) == pytest.approx(0.25)
    assert regulated(0.5, 0.0, 0.0, 0.5, 0.01, p) == pytest.approx(0.05)


def test_it_turns_on_the_spot_within_its_acceleration_and_does_not_overshoot() -> None:
    p = numbers()
    assert turn_towards(1.0, 0.0, p) == pytest.approx(3.2 * 0.05)
    assert turn_towards(-1.0, -1.8, p) == pytest.approx(-1.8)
    assert turn_towards(0.1, 0.9, p) == pytest.approx(math.sqrt(2 * 3.2 * 0.1))


def test_a_lethal_cell_ahead_within_reach_leaves_no_command() -> None:
    plan = np.column_stack([np.linspace(1.5, 2.9, 60), np.full(60, 1.5)])
    cells = np.zeros((60, 60), np.uint8)
    free = pursue(plan, cells, 0.0, 0.0, 0.05, 1.5, 1.5, 0.0, 0.5, 0.0, 0.0, numbers())
    assert free[0] and free[1:] == pytest.approx((0.5, 0.0))
    cells[30, 43] = 254  # 0.65 m ahead: within a second at 0.5 m/s, as the front lies 0.3 m ahead
    assert not pursue(plan, cells, 0.0, 0.0, 0.05, 1.5, 1.5, 0.0, 0.5, 0.0, 0.0, numbers())[0]
    later = numbers(max_allowed_time_to_collision_up_to_carrot=0.3)
    assert pursue(plan, cells, 0.0, 0.0, 0.05, 1.5, 1.5, 0.0, 0.5, 0.0, 0.0, later)[0]


def test_options_change_the_robot_and_wrong_ones_are_one_error() -> None:
    stack = StackChoice.of("nav2-dwb", {"smoother": {"max_speed_m_s": 0.3}, "sim_time": 2.0})
    robot = stack.driver.adapt(TIAGO)
    assert robot.navigation.smoother.max_speed_m_s == 0.3 and robot.navigation.dwb.sim_time_s == 2.0
    assert stack.record.options == {"smoother": {"max_speed_m_s": 0.3}, "sim_time": 2.0}
    assert "stack" in EmbeddedSimulator(stack=stack.record.model_dump()).options
    for name, options in (
        ("nav2-rpp", {"lookahead": 1}),
        ("nav2-rpp", {"lookahead_dist": -1}),
        ("nav2-dwb", {"smoother": {"frequency": 1}}),
        ("stop-and-go", {"warning_m": 0.1}),
    ):
        with pytest.raises(InputError):
            StackChoice.of(name, options)


def test_another_footprint_leaves_the_body() -> None:
    square = [[0.5, 0.4], [-0.5, 0.4], [-0.5, -0.4], [0.5, -0.4]]
    after = StackChoice.of("nav2-rpp", {"footprint": square}).driver.adapt(TIAGO)
    assert after.footprint[0] == (0.5, 0.4) and after.outline == TIAGO.outline
