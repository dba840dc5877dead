"""What the page tells of the stack under test."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from rvsg.report.answer import under_test
from rvsg.simulation.run import Run


def run(**stack: Any) -> Run:
    options = {"stack": {"name": "ros2", "options": {"launch": "ros2 launch x", "params": None}}}
    return cast(
        Run,
        SimpleNamespace(
            id=str(stack), details={"stack": stack}, options=options, stack_warnings=stack.get("warnings", ())
        ),
    )


def test_pace_and_missed_periods_are_summed_up() -> None:
    kept = {"repeatable": False, "release": "jazzy", "speed_asked": 5.0, "missed_periods": 0, "commands": 600}
    told = under_test([
        run(**kept, speed=5.0), run(**{**kept, "missed_periods": 30, "commands": 570}, speed=4.9, warnings=("slow",)),
        run(calls=3, fault="gone"), run(calls=3, fault="gone"),
    ])  # fmt: skip
    assert not told.repeatable
    assert dict(told.rows) == {
        "Launch command": "ros2 launch x",
        "ROS 2": "jazzy",
        "Speed, in times of real time": "5 asked, 4.90 to 5.00 reached",
        "Control periods missed": "30 of 1,200 (2.5 %), at most 5 % in one run",
        "Runs with warnings of the stack": "1 of 3; for instance: slow",
    }


def test_refused_velocities_are_counted_and_the_built_in_stack_says_nothing() -> None:
    told = under_test([run(calls=9, clipped=4, not_finite=0), run(calls=9, clipped=1, not_finite=2)])
    assert told.repeatable
    assert dict(told.rows)["Velocities beyond the limits of the robot, cut"] == "5 in 2 runs"
    assert dict(told.rows)["Velocities that are no numbers, left out"] == "2 in 1 run"
    built_in = cast(Run, SimpleNamespace(id="", details={}, options={}, stack_warnings=()))
    assert under_test([built_in]).rows == ()
