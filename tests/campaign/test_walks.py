from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from tests.campaign.parts import MemoryLedger, plan, searched, warehouse
from tests.evaluation.runs import trajectory

from rvsg.core import plugins
from rvsg.runs.observation import Walk, walks_of
from rvsg.scenario.scenario import Human, HumanConfiguration, Pause, Scenario, Task, begin_at
from rvsg.scenario.variation import differences
from rvsg.search.strategies import StudyStrategy
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run


def to_and_fro(path: tuple[str, ...]) -> tuple[Task, Task]:
    return tuple(Task(name=f"{way[0]} → {way[-1]}", path=way) for way in (path, path[::-1]))  # type: ignore[return-value]


def walker(**changes: object) -> Human:
    path = warehouse().grid.shortest_path("E3", "E9")
    assert path is not None
    return Human(**{"name": "Human 1", "tasks": to_and_fro(path), "speed_m_s": 1.0, **changes})  # type: ignore[arg-type]


def paused(human: Human, index: int, seconds: float) -> Human:
    task = human.tasks[0]
    pauses = (Pause(at=task.path[index], duration_s=seconds),)
    return human.replace(tasks=(task.replace(pauses=pauses), *human.tasks[1:]))


def scenario(human: Human) -> Scenario:
    return Scenario(mission=plan().mission, people=HumanConfiguration(humans=(human,)))


def walk_of(run: Run, human: Human) -> Walk:
    (walk,) = walks_of(run, HumanConfiguration(humans=(human,)), warehouse().grid)
    return walk


def test_a_walk_is_followed_from_leg_to_leg_with_its_delay_and_pause() -> None:
    human = paused(walker(start_delay_s=2.0), 2, 3.0)
    run = KinematicSimulator().run(scenario(human), warehouse(), seed=1)
    walk = walk_of(run, human)
    t = run.trajectory.t
    assert walk.doing[0] == "waiting to start" and "pausing" in walk.doing and walk.stuck_at is None
    arrived = walk.arrivals
    assert [arrival.at for arrival in arrived[:3]] == list(human.tasks[0].path[1:4])
    for arrival in arrived[:4]:
        assert arrival.time_s == pytest.approx(arrival.unhindered_s, abs=0.8)
    assert float(t[walk.doing.index("pausing")]) == pytest.approx(arrived[1].time_s, abs=0.2)


def along(at: np.ndarray) -> tuple[Run, Human]:
    """Somebody who is `at` metres along the way of `walker`, at 10 Hz."""
    human = walker()
    path = human.tasks[0].path
    (x, y), (to_x, to_y) = (warehouse().grid.position(name) for name in (path[0], path[-1]))
    share = at / float(np.hypot(to_x - x, to_y - y))
    run = KinematicSimulator().run(scenario(human), warehouse(), seed=1)
    seen = trajectory(np.arange(len(at)) / 10, 0.0, humans=[(x + (to_x - x) * share, y + (to_y - y) * share)])
    return replace(run, trajectory=seen, log=seen, events=()), human


def test_who_stands_still_until_the_end_is_stuck_and_who_walks_on_is_not() -> None:
    run, human = along(np.concatenate([np.arange(25) / 10, np.full(60, 2.5), 2.5 + np.arange(25) / 10]))
    walk = walk_of(run, human)
    assert walk.stuck_at is None
    ((start, end, place),) = walk.stood
    assert (start, end) == pytest.approx((2.5, 8.5), abs=0.4)
    assert place in human.tasks[0].path
    assert walk.doing[26 + 3] == walk.doing[60] == "standing still"
    assert walk.doing[100].startswith("walking") and "stuck" not in walk.doing
    run, human = along(np.concatenate([np.arange(25) / 10, np.full(60, 2.5)]))
    walk = walk_of(run, human)
    assert walk.stuck_at is not None and walk.stuck_at[0] == pytest.approx(2.5, abs=0.4)
    assert walk.stood == () and walk.doing[-1] == "stuck"


@pytest.mark.parametrize("simulator", ["kinematic", pytest.param("embedded", marks=pytest.mark.slow)])
def test_a_pause_where_people_turn_back_is_a_pause_in_every_round(simulator: str) -> None:
    human = paused(walker(tasks=to_and_fro(walker().tasks[0].path[:3])), 2, 3.0)
    run = plugins.make("simulator", simulator, {}).run(scenario(human), warehouse(), seed=1)
    walk = walk_of(run, human)
    assert walk.stuck_at is None and walk.stood == ()
    assert sum(b == "pausing" != a for a, b in pairwise(walk.doing)) >= 2


@pytest.mark.slow
@pytest.mark.parametrize("simulator", ["kinematic", "embedded"])
@pytest.mark.parametrize("asked", [True, False])
def test_a_pause_is_held_at_the_start_only_where_the_first_task_asks_for_it(simulator: str, asked: bool) -> None:
    human = walker()
    if asked:
        human = paused(human, 0, 8.0)
    else:
        last = human.tasks[-1]
        assert last.path[-1] == human.tasks[0].path[0]
        at_the_end = last.replace(pauses=(Pause(at=last.path[-1], duration_s=8.0),))
        human = human.replace(tasks=(*human.tasks[:-1], at_the_end))
    run = plugins.make("simulator", simulator, {}).run(scenario(human), warehouse(), seed=1)
    path = run.trajectory
    k = int(path.t.searchsorted(3.0))
    moved = abs(path.human_x[k, 0] - path.human_x[0, 0]) + abs(path.human_y[k, 0] - path.human_y[0, 0])
    assert (moved < 0.2) if asked else (moved > 1.0)


def test_a_refinement_reads_a_table_the_best_and_all_that_was_tried() -> None:
    ledger, the_plan = MemoryLedger(), plan(scenarios=1, refinements=3, confirmations=0)
    attempts = [a for a in searched(StudyStrategy, the_plan, ledger) if a.purpose == "search"]
    feedback = attempts[-1].brief.feedback
    assert feedback is not None
    assert [row.time_s for row in feedback.rows[:3]] == pytest.approx([0.0, 2.0, 4.0], abs=0.1)
    for row in feedback.rows:
        assert set(row.people) == {human.name for human in feedback.scenario.people.humans}
        assert all(person.side in ("ahead", "behind", "left", "right") for person in row.people.values())
    ordered = sorted(attempts[:3], key=lambda a: a.mean)
    assert [(tried.number, tried.mean) for tried in feedback.tried] == [(a.index, a.mean) for a in ordered]
    means = [a.mean for a in attempts[:3]]
    best = attempts[means.index(feedback.best_mean)].proposal.scenario
    assert best is not None and feedback.best in (None, best)
    assert (feedback.best is None) == (feedback.mean == feedback.best_mean)
    assert [tried.runs for tried in feedback.tried] == [len(a.measurements) for a in ordered]
    assert feedback.best_mean == min(tried.mean for tried in feedback.tried)
    assert 3 <= len(feedback.parts) <= 4
    assert feedback.arrived <= len(feedback.objectives)


def test_differences_name_what_changed_and_nothing_else() -> None:
    one = HumanConfiguration(humans=(walker(),))
    assert differences(one, one) == "no change"
    faster = HumanConfiguration(humans=(walker(speed_m_s=1.4),))
    assert differences(one, faster) == "Human 1 walks at 1.4 m/s (was 1)"
    waits = HumanConfiguration(humans=(paused(walker(), 1, 4.0),))
    assert differences(one, waits) == "Human 1 pauses 4 s at E4 (leg 1)"
    way, other, work = (
        HumanConfiguration(humans=(walker(tasks=(Task(name=name, path=("G12", middle, "G14")),)),))
        for name, middle in (("a", "F13"), ("a", "H13"), ("b", "H13"))
    )
    assert differences(way, other) == "Human 1 goes G12 H13 G14 (from leg 1) instead of G12 F13 G14"
    assert differences(way, work) == "Human 1 now does b, no longer a"

    # A pause is told with the leg at whose end it is held, and a stop that moved by its waypoints.
    twice = paused(walker(), 1, 4.0)
    twice = twice.replace(tasks=(twice.tasks[0], twice.tasks[1].replace(pauses=twice.tasks[0].pauses)))
    again, legs = HumanConfiguration(humans=(twice,)), 2 * (len(twice.tasks[0].path) - 1)
    assert differences(waits, again) == f"Human 1 pauses 4 s at E4 (leg {legs - 1})"
    assert differences(again, waits) == "Human 1 no longer pauses 4 s at E4"
    onward = Task(name="b", path=("G15", "G16"))
    moved, stayed = (
        HumanConfiguration(
            humans=(walker(tasks=(Task(name="a", path=("G12", "F13", at)), onward.replace(path=(at, "G16")))),)
        )
        for at in ("G15", "G14")
    )
    assert differences(stayed, moved) == "Human 1 stops at G15 instead of G14"

    # No task is named by the waypoint where it is cut.
    out = Task(name="A to B", path=("G12", "H13", "G14"), start_area="A", end_area="B")
    back = Task.between("B", "A", ("G14", "H13", "G12"))
    one, other, underway = (
        HumanConfiguration(humans=(walker().replace(tasks=tasks),))
        for tasks in ((out, back), (back, out), begin_at((out, back), 0, 1))
    )
    assert underway.humans[0].tasks[0].name == "H13 → B"
    assert differences(one, underway) == "Human 1 starts at H13 on the way to B (was G12)"
    assert differences(underway, one) == "Human 1 starts at G12 (was H13 on the way to B)"
    assert differences(one, other) == "Human 1 starts at G14 (was G12)"
    turned = HumanConfiguration(humans=(walker().replace(tasks=begin_at((out, back), 1, 1)),))
    assert differences(underway, turned) == "Human 1 starts at H13 on the way to A (was H13 on the way to B)"
