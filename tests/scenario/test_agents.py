"""From named waypoints to coordinates."""

from __future__ import annotations

import pytest

from rvsg.core.errors import UnknownName
from rvsg.scenario.scenario import Behaviour, Human, HumanConfiguration, Pause, Task, decode, reaction_of
from rvsg.world.grid import Grid, Waypoint


def grid() -> Grid:
    return Grid(
        rows=("A", "B"),
        columns=("1", "2", "3"),
        waypoints=tuple(
            Waypoint(name=f"{row}{column}", x=float(column), y=float(r), row=r, column=column - 1, human=row == "A")
            for r, row in enumerate("AB")
            for column in (1, 2, 3)
        ),
        hops=(("A1", "A2"), ("A2", "A3")),
    )


def walker(*tasks: Task, **more: object) -> HumanConfiguration:
    return HumanConfiguration(humans=(Human.model_validate({"name": "Human 1", "tasks": tasks} | more),))


def test_goals_are_the_waypoints_of_all_tasks_with_joints_counted_once() -> None:
    there = Task(name="there", path=("A1", "A2", "A3"))
    back = Task(name="back", path=("A3", "A2", "A1"))
    (agent,) = decode(walker(there, back), grid())
    assert agent.goals == ((1.0, 0.0), (2.0, 0.0), (3.0, 0.0), (2.0, 0.0))
    assert agent.start == (1.0, 0.0)


def test_pauses_stay_at_their_waypoint_and_add_up_at_a_joint() -> None:
    there = Task(name="there", path=("A1", "A2"), pauses=(Pause(at="A2", duration_s=3), Pause(at="A1", duration_s=1)))
    back = Task(name="back", path=("A2", "A1"), pauses=(Pause(at="A2", duration_s=4),))
    (agent,) = decode(walker(there, back), grid())
    assert agent.pauses_s == (1.0, 7.0)


def test_a_pause_at_the_start_is_held_only_if_the_first_task_asks_for_it() -> None:
    back = Task(name="back", path=("A2", "A1"), pauses=(Pause(at="A1", duration_s=4),))
    (agent,) = decode(walker(Task(name="there", path=("A1", "A2")), back), grid())
    assert (agent.start_pause_s, agent.pauses_s) == (0.0, (4.0, 0.0))
    there = Task(name="there", path=("A1", "A2"), pauses=(Pause(at="A1", duration_s=1),))
    (agent,) = decode(walker(there, back), grid())
    assert (agent.start_pause_s, agent.pauses_s) == (1.0, (5.0, 0.0))


def test_a_name_that_the_grid_does_not_know_is_refused() -> None:
    with pytest.raises(UnknownName) as refused:
        decode(walker(Task(name="t", path=("A1", "A9"))), grid())
    assert refused.value.name == "A9"


def test_reactions_are_those_of_the_behaviour() -> None:
    assert reaction_of(Behaviour.CURIOUS, 1.2).speed_m_s == 1.2
    (agent,) = decode(walker(Task(name="t", path=("A1",)), behaviour="scared"), grid())
    assert (agent.reaction.distance_m, agent.reaction.speed_m_s) == (3.0, 0.6)
