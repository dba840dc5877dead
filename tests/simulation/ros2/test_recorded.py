"""What nodes of the real ROS 2 sent to RVSG during four runs: read, and written again byte for byte."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("cyclonedds", reason="ROS 2 needs cyclonedds (extra ros2)")

from rvsg.simulation.ros2.dds import SUCCEEDED
from rvsg.simulation.ros2.interfaces import interfaces

RECORDED = json.loads((Path(__file__).parent / "recorded_jazzy.json").read_text())
JAZZY = interfaces("jazzy")


def message_of(topic: str) -> tuple[Any, bytes]:
    """The recorded message of a topic, and its bytes."""
    (sample,) = (sample for sample in RECORDED["samples"] if sample["topic"] == topic)
    kind = JAZZY.part_of_service(sample["type"]) if topic.startswith("rr/") else JAZZY[sample["type"]]
    data = base64.b64decode(sample["cdr"])
    return kind.deserialize(data), data


@pytest.mark.parametrize("name", sorted(RECORDED["announced"]))
def test_the_real_one_announces_the_hashes_that_are_computed(name: str) -> None:
    assert JAZZY.type_hash(name) == RECORDED["announced"][name]


@pytest.mark.parametrize("topic", [sample["topic"] for sample in RECORDED["samples"]])
def test_a_message_is_written_as_the_real_one_wrote_it(topic: str) -> None:
    message, data = message_of(topic)
    again = message.serialize(use_version_2=False)
    size = min(len(again), len(data))
    assert again[4:size] == data[4:size]
    assert not any(again[size:] + data[size:])  # both fill the last word with zeros, or do not


def test_the_messages_say_what_the_nodes_did() -> None:
    assert message_of("rr/bt_navigator/get_stateReply")[0].current_state.label == "active"
    for action in ("navigate_to_pose", "navigate_through_poses"):
        assert message_of(f"rr/{action}/_action/send_goalReply")[0].accepted
        assert message_of(f"rr/{action}/_action/get_resultReply")[0].status == SUCCEEDED
    assert message_of("rr/navigate_through_poses/_action/get_resultReply")[0].result.error_msg == "all poses passed"
    assert message_of("rt/navigate_to_pose/_action/feedback")[0].feedback.number_of_recoveries == 1
    assert message_of("rt/navigate_to_pose/_action/feedback")[0].feedback.distance_remaining == 2.5
    assert message_of("rt/navigate_through_poses/_action/feedback")[0].feedback.number_of_poses_remaining > 0
    (change,) = message_of("rt/behavior_tree_log")[0].event_log
    assert (change.node_name, change.uid, change.current_status) == ("FollowPath", 9, "RUNNING")
    assert list(message_of("rt/local_costmap/costmap")[0].data) == [0, 99, 100, -1, 0, 0]
