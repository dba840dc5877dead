"""From named waypoints to coordinates, for ours and for the study's configurations."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.coded import coded
from tests.published_data import published_data

from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.scenario.scenario import Behaviour, Human, HumanConfiguration, Pause, Task, decode, reaction_of
from rvsg.world.grid import Grid, Waypoint
from rvsg_study.study_format import decode_study, read_study_configuration


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


def study(*paths: list[str]) -> dict[str, object]:
    return {
        f"Worker {i + 1} Tasks": [{"Task": "a → b", "Start": p[0] if p else "", "End": "", "Path": p}]
        for i, p in enumerate(paths)
    }


def test_the_study_drops_unknown_and_invalid_names_and_we_list_them() -> None:
    decoded = decode_study(study(["A1", "Z9", "B1", "A2"], ["A3"]), grid())
    assert decoded.humans[0].waypoints == ("A1", "A2")
    assert [(d.human, d.position, d.name) for d in decoded.dropped] == [("Human 1", 1, "Z9"), ("Human 1", 2, "B1")]


def test_human_2_of_the_study_draws_its_factors() -> None:
    first, second = decode_study(study(["A1"], ["A2"]), grid()).agents(grid())
    assert first.factors != "random_normal"
    assert second.factors == "random_normal"


def test_the_study_doubles_the_waypoint_between_two_tasks() -> None:
    value = study(["A1", "A2"], ["A3"])
    value["Worker 1 Tasks"] = [{"Task": "x", "Path": ["A1", "A2"]}, {"Task": "y", "Path": ["A2", "A1"]}]
    assert len(decode_study(value, grid()).agents(grid())[0].goals) == 4


def test_a_human_without_any_waypoint_is_an_input_error() -> None:
    decoded = decode_study(study(["Z1"], ["A3"]), grid())
    with pytest.raises(InputError, check=coded("no-waypoint")):
        decoded.agents(grid())


@pytest.mark.parametrize("text", ["[]", "{}", '{"Worker 1 Tasks": 3}', '{"Worker 1 Tasks": [{"Path": "A1"}]}', "{"])
def test_a_file_of_another_shape_is_refused_with_its_name(tmp_path: Path, text: str) -> None:
    file = tmp_path / "x_0.json"
    file.write_text(text)
    with pytest.raises(FileError) as refused:
        read_study_configuration(file, grid())
    assert refused.value.path == file


def test_every_published_file_decodes_with_the_known_number_of_dropped_names() -> None:
    data = published_data()
    if data is None:
        pytest.skip("the published data is not here")
    from rvsg.world.world_folder import load_world

    known = load_world("warehouse").grid
    files = [
        file
        for method in ("distance", "jerk", "reach")
        for file in sorted((data / "published" / method).glob("route_*/*/*_[0-9].json"))
    ]
    assert len(files) == 450
    dropped = sum(len(read_study_configuration(file, known).dropped) for file in files)
    raw = [json.loads(file.read_text()) for file in files]
    names = [name for value in raw for tasks in value.values() for task in tasks for name in task["Path"]]
    assert dropped == sum(name not in known.valid for name in names)
