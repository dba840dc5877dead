"""What the real ROS 2 and Nav2 sent to RVSG: read, written again byte for byte, and replayed against the stack ros2."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("cyclonedds", reason="ROS 2 needs cyclonedds (extra ros2)")

from tests.simulation.ros2.isolated import drive

from rvsg_ros2.dds import SUCCEEDED
from rvsg_ros2.interfaces import interfaces

HERE = Path(__file__).parent
NODES = json.loads((HERE / "recorded_jazzy.json").read_text())
"""Four runs with nodes that play Nav2, for what a single run of Nav2 does not send."""
NAV2 = json.loads((HERE / "recorded_nav2.json").read_text())
"""One run of Nav2 through poses, from the answers of its nodes to the result."""
JAZZY = interfaces("jazzy")
ANNOUNCED = NODES["announced"] | NAV2["announced"]


def read(sample: dict[str, Any]) -> tuple[Any, bytes]:
    """A recorded message, and its bytes."""
    kind = JAZZY.part_of_service(sample["type"]) if sample["topic"].startswith("rr/") else JAZZY[sample["type"]]
    data = base64.b64decode(sample["cdr"])
    return kind.deserialize(data), data


def messages(recording: dict[str, Any], topic: str) -> list[Any]:
    """The messages of a topic, in their order."""
    return [read(sample)[0] for sample in recording["samples"] if sample["topic"] == topic]


@pytest.mark.parametrize("name", sorted(ANNOUNCED))
def test_the_real_one_announces_the_hashes_that_are_computed(name: str) -> None:
    assert JAZZY.type_hash(name) == ANNOUNCED[name]


@pytest.mark.parametrize("recording", [NODES, NAV2], ids=["nodes", "nav2"])
def test_a_message_is_written_as_the_real_one_wrote_it(recording: dict[str, Any]) -> None:
    for sample in recording["samples"]:
        message, data = read(sample)
        again = message.serialize(use_version_2=False)
        size = min(len(again), len(data))
        assert again[4:size] == data[4:size], sample["topic"]
        assert not any(again[size:] + data[size:])  # both fill the last word with zeros, or do not


def test_the_messages_say_what_the_nodes_did() -> None:
    def of(topic: str) -> Any:
        return messages(NODES, topic)[0]

    assert of("rr/bt_navigator/get_stateReply").current_state.label == "active"
    for action in ("navigate_to_pose", "navigate_through_poses"):
        assert of(f"rr/{action}/_action/send_goalReply").accepted
        assert of(f"rr/{action}/_action/get_resultReply").status == SUCCEEDED
    assert of("rr/navigate_through_poses/_action/get_resultReply").result.error_msg == "all poses passed"
    assert of("rt/navigate_to_pose/_action/feedback").feedback.number_of_recoveries == 1
    assert of("rt/navigate_to_pose/_action/feedback").feedback.distance_remaining == 2.5
    assert of("rt/navigate_through_poses/_action/feedback").feedback.number_of_poses_remaining > 0
    (change,) = of("rt/behavior_tree_log").event_log
    assert (change.node_name, change.uid, change.current_status) == ("FollowPath", 9, "RUNNING")
    assert list(of("rt/local_costmap/costmap").data) == [0, 99, 100, -1, 0, 0]


def test_the_messages_say_what_nav2_did() -> None:
    states = [topic for topic in {each["topic"] for each in NAV2["samples"]} if topic.endswith("/get_stateReply")]
    assert len(states) == 7
    assert {messages(NAV2, topic)[0].current_state.label for topic in states} == {"active"}
    assert messages(NAV2, "rr/navigate_through_poses/_action/get_resultReply")[0].status == SUCCEEDED
    remaining = [
        m.feedback.number_of_poses_remaining for m in messages(NAV2, "rt/navigate_through_poses/_action/feedback")
    ]
    assert sorted(set(remaining)) == [1, 2, 3]
    assert remaining == sorted(remaining, reverse=True)
    (plan,) = messages(NAV2, "rt/plan")
    last = plan.poses[-1].pose.position
    assert (last.x, last.y) == pytest.approx((1.0, 0.5), abs=0.15)  # the map is off by some centimetres in each run
    names = {change.node_name for log in messages(NAV2, "rt/behavior_tree_log") for change in log.event_log}
    assert {"RemovePassedGoals", "ComputePathThroughPoses", "FollowPath"} <= names
    (grid,) = messages(NAV2, "rt/local_costmap/costmap")
    assert (grid.info.width, grid.info.height) == (60, 60)


@pytest.mark.exhaustive
def test_a_run_of_nav2_is_replayed_to_the_same_end() -> None:
    recording = {"recording": str(HERE / "recorded_nav2.json")}
    told = drive(recording, program="replay.py", through=[(-1.0, 0.3), (0.0, 0.0)], options={"speed": 1.0})
    (run,) = told["runs"]
    facts = run["stack"]
    assert run["outcome"] == NAV2["outcome"] == "REACHED"
    assert facts["release"] == "jazzy"
    assert facts["result"] == {"status": SUCCEEDED, "error_code": 0, "error_msg": ""}
    assert facts["commands"] == NAV2["commands"]
    assert facts["recoveries"] == NAV2["recoveries"]
    assert facts["turned_back"] == NAV2["turned_back"] == 0
    assert run["t"] == pytest.approx(NAV2["end_t"], abs=0.5)
    assert (run["x"], run["y"]) == pytest.approx(NAV2["end"], abs=0.15)
    assert facts["costmaps"][0]["shape"] == [60, 60]
    assert told["heard"] == {"goals": 1, "poses": 3}
