"""What is kept of a run on a ROS 2 system."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from rvsg.core.records import Pose
from rvsg.simulation.stacks.protocol import Observation, Task
from rvsg_ros2.run_record import RunRecord

SEEN = cast(Observation, SimpleNamespace(t=1.0))


def record() -> RunRecord:
    return RunRecord(1.0, cast(Task, SimpleNamespace(goals=(Pose(x=0.0, y=0.0),))), "jazzy")


def log(*changes: tuple[str, int, str]) -> Any:
    events = [SimpleNamespace(node_name=name, uid=uid, current_status=status) for name, uid, status in changes]
    return SimpleNamespace(event_log=events)


def test_conditions_that_are_asked_at_every_tick_do_not_fill_the_log_of_the_tree() -> None:
    made = record()
    tick = log(("GoalUpdated", 7, "FAILURE"), ("GoalUpdated", 7, "IDLE"))
    begun, ended = log(("Spin", 8, "RUNNING")), log(("Spin", 8, "SUCCESS"), ("Spin", 8, "IDLE"))
    messages = [begun, *[tick] * 5000, ended, begun]
    made._tree_topic = cast(Any, SimpleNamespace(take=lambda: messages))
    made.note(SEEN, None)
    kept = [change[1:] for change in made.facts(1.0)["behaviour_tree"]]
    assert kept == [["Spin", "RUNNING"], ["GoalUpdated", "FAILURE"], ["Spin", "SUCCESS"], ["Spin", "RUNNING"]]


def test_nodes_of_one_name_are_told_apart() -> None:
    made = record()
    messages = [log(("ComputePathToPose", 3, "RUNNING"), ("ComputePathToPose", 4, "RUNNING"))]
    made._tree_topic = cast(Any, SimpleNamespace(take=lambda: messages))
    made.note(SEEN, None)
    assert len(made.facts(1.0)["behaviour_tree"]) == 2
