"""Parts of the report page: words, tables, the conversation with a model, and labels."""

from __future__ import annotations

import itertools
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis.strategies import floats, lists, tuples

from rvsg.findings.feedback import MapCell
from rvsg.generation.generator import Call
from rvsg.generation.vlm.call_log import CallLog
from rvsg.generation.vlm.model import Answer, Message, Request
from rvsg.report.conversations import Transcript
from rvsg.report.page import broken
from rvsg.report.stills import beside, box_around, free_place, spread
from rvsg.report.words import robot_words, under_test
from rvsg.scenario.brief import Encounter
from rvsg.scenario.scenario import Mission
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.simulation.run import Run
from rvsg.world.world_folder import load_world


def call(recording: CallLog, number: int, *texts: tuple[str, str], answer: str | None) -> Call:
    messages = tuple(Message(role=role, text=text) for role, text in texts)  # type: ignore[arg-type]
    request = Request(session="s000-c00", number=number, purpose=f"step {number}", messages=messages)
    given = Answer(text=answer, model="m") if answer is not None else None
    recording.keep(request, "m", answer=given, error=None if answer is not None else "no connection")
    return Call(purpose=request.purpose, model="m", recording=request.key)


def test_every_message_is_shown_once_and_every_answer(tmp_path: Path) -> None:
    recording = CallLog(tmp_path)
    asked = (("system", "You test."), ("user", "One?"))
    first = call(recording, 1, *asked, answer="Two.")
    second = call(recording, 2, *asked, ("assistant", "Two."), ("user", "Again?"), answer="No.")
    shown = Transcript(recording).of([first, second])
    assert [[(m["role"], m["text"]) for m in each["said"]] for each in shown] == [
        [("system", "You test."), ("user", "One?")],
        [("user", "Again?")],
    ]
    assert [each["answer"] for each in shown] == ["Two.", "No."]


def test_a_failed_call_and_one_that_is_not_kept(tmp_path: Path) -> None:
    recording = CallLog(tmp_path)
    failed = call(recording, 1, ("user", "One?"), answer=None)
    other = Call(purpose="x", model="m", recording="another")
    shown, unrecorded = Transcript(recording).of([failed, other])
    assert "no connection" in shown["answer"]
    assert unrecorded["said"] == [] and unrecorded["answer"] == ""
    assert Transcript(None).of([failed])[0]["said"] == []


def test_a_long_conversation_is_cut_with_a_word(tmp_path: Path) -> None:
    recording = CallLog(tmp_path)
    made = call(recording, 1, ("user", "0123456"), answer="789abcdef")
    (shown,) = Transcript(recording, most=10).of([made])
    assert shown["said"][0]["text"] == "0123456"
    assert shown["answer"].startswith("789 …") and "6 more" in shown["answer"]


def cell(stretch: str, place: str, kind: str, mean: float) -> MapCell:
    met = Encounter(stretch=stretch, place=place, who="Human 1", kind=kind)
    return MapCell(encounter=met, attempt=1, scenario_id="s", mean=mean, violations=1, runs=2, configurations=1)


def test_a_place_and_a_kind_show_their_worst_cell_on_any_part_of_the_way() -> None:
    worst, other = (
        cell(part, "Shelf 1", "crosses", mean) for part, mean in (("first third", 0.5), ("last third", 0.9))
    )
    third = cell("last third", "Area 2", "stands", 1.0)
    table = broken([worst, other, third])
    assert table["places"] == ("Shelf 1", "Area 2")
    assert dict(table["rows"]) == {"crosses": [worst, None], "stands": [None, third]}
    assert broken([])["rows"] == []


def stack_run(**stack: Any) -> Run:
    options = {"stack": {"name": "ros2", "options": {"launch": "ros2 launch x", "params": None}}}
    how = {
        "id": str(stack),
        "simulator": "gazebo",
        "details": {"stack": stack},
        "stack_warnings": stack.get("warnings", ()),
    }
    return cast(Run, SimpleNamespace(options=options, **how))


def test_pace_and_missed_periods_are_summed_up() -> None:
    kept = {"repeatable": False, "release": "jazzy", "speed_asked": 5.0, "missed_periods": 0, "commands": 600}
    late = stack_run(**{**kept, "missed_periods": 30, "commands": 570}, speed=4.9, warnings=("slow",))
    told = under_test([stack_run(**kept, speed=5.0), late, *[stack_run(calls=3, fault="gone")] * 2])
    assert not told.repeatable
    assert dict(told.rows) == {
        "Launch command": "ros2 launch x",
        "ROS 2": "jazzy",
        "Speed, in times of real time": "5 asked, 4.90 to 5.00 reached",
        "Control periods missed": "30 of 1,200 (2.5 %), at most 5 % in one run",
        "Runs with warnings of the stack": "1 of 3; for instance: slow",
    }


def test_refused_velocities_are_counted_and_the_built_in_stack_says_nothing() -> None:
    told = under_test([stack_run(calls=9, clipped=4, not_finite=0), stack_run(calls=9, clipped=1, not_finite=2)])
    assert told.repeatable
    assert dict(told.rows)["Velocities beyond the limits of the robot, cut"] == "5 in 2 runs"
    assert dict(told.rows)["Velocities that are no numbers, left out"] == "2 in 1 run"
    built_in = cast(Run, SimpleNamespace(id="", simulator="kinematic", details={}, options={}, stack_warnings=()))
    assert under_test([built_in]).rows == ()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (EmbeddedSimulator().options, "default profile"),
        (EmbeddedSimulator("hunavsim").options, "hunavsim"),
        (EmbeddedSimulator("published-study").options, "published-study"),
        ({"profile": "default"}, "hunavsim"),
    ],
    ids=["default", "hunavsim", "published-study", "stored by 0.2"],
)
def test_the_profile_of_the_people_is_named(options: dict[str, object], said: str) -> None:
    run = SimpleNamespace(id="", simulator="embedded", details={}, options=options, stack_warnings=())
    assert under_test([cast(Run, run)]).rows == (("People", said),)


def test_only_the_calibrated_robot_is_called_calibrated() -> None:
    world = load_world("warehouse")
    ours, other, unknown = (
        robot_words(Mission.of(world, world.routes[0], robot=name)) for name in ("tiago_omni", "tugger", "elsewhere")
    )
    assert "calibrated" in ours and "not calibrated" not in ours
    assert "not calibrated" in other and unknown == "elsewhere"


INSIDE = (0.0, 0.0, 30.0, 20.0)
PLACE = tuples(floats(1.0, 29.0), floats(1.0, 19.0))


@given(lists(PLACE, max_size=8))
def test_no_marker_covers_another_one_or_leaves_the_map(points: list[tuple[float, float]]) -> None:
    radius = 0.5
    placed = spread(points, radius, INSIDE)
    for (ax, ay), (bx, by) in itertools.combinations(placed, 2):
        assert max(abs(ax - bx), abs(ay - by)) >= 2 * radius - 1e-9
    assert all(0.5 <= x <= 29.5 and 0.5 <= y <= 19.5 for x, y in placed)
    if points:
        assert placed[0] == points[0]


def test_markers_on_one_point_all_find_a_place() -> None:
    assert len({(round(x, 3), round(y, 3)) for x, y in spread([(15.0, 10.0)] * 8, 0.5, INSIDE)}) == 8


def test_a_name_stands_above_its_body_unless_that_is_taken() -> None:
    half = (1.0, 0.2)
    above = free_place(beside(10.0, 10.0, 0.4, half), half, [], INSIDE)
    assert above == (10.0, 9.4)
    below = free_place(beside(10.0, 10.0, 0.4, half), half, [box_around(*above, *half)], INSIDE)
    assert below == (10.0, 10.6)
