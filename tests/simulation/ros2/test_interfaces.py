"""The message types against public definitions, rosbags, and what the real ROS 2 and Nav2 sent to RVSG."""

from __future__ import annotations

import base64
import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rvsg.core.errors import UnknownName

pytest.importorskip("cyclonedds", reason="ROS 2 needs cyclonedds (extra ros2)")
from rosbags.interfaces import Nodetype
from tests.simulation.ros2.isolated import drive

from rvsg_ros2.dds import SUCCEEDED
from rvsg_ros2.interfaces import RELEASES, dds_type, definitions, interfaces, ros_type

HERE = Path(__file__).parent
PUBLIC = json.loads((HERE / "nav2_msgs.json").read_text())
"""Goal, result, feedback and messages of nav2_msgs as its public repository has them on the branch of each release."""
USED = (
    "rosgraph_msgs/msg/Clock", "tf2_msgs/msg/TFMessage", "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan",
    "nav_msgs/msg/OccupancyGrid", "geometry_msgs/msg/PoseWithCovarianceStamped", "geometry_msgs/msg/Twist",
    "geometry_msgs/msg/TwistStamped", "nav_msgs/msg/Path", "sensor_msgs/msg/JointState",
    "action_msgs/msg/GoalStatusArray", "lifecycle_msgs/msg/State", "rcl_interfaces/msg/ParameterValue",
)  # fmt: skip


@pytest.mark.parametrize("release", RELEASES)
def test_nav2_interfaces_have_the_public_fields(release: Any) -> None:
    store = interfaces(release).store
    for name, expected in PUBLIC[release].items():
        kind = "action" if name.startswith("Navigate") else "srv" if name.startswith("Clear") else "msg"
        fields = store.fielddefs[f"nav2_msgs/{kind}/{name}"][1]
        assert [f"{_written(of)} {field}" for field, of in fields] == expected, name


def _written(of: Any) -> str:
    node, inner = of
    if node == Nodetype.SEQUENCE:
        return f"{_written(inner[0])}[]"
    if node == Nodetype.NAME:
        return str(inner).replace("/msg/", "/").removeprefix("nav2_msgs/")
    return str(inner[0])


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("std_msgs/msg/String", "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"),
        ("std_msgs/msg/Empty", "RIHS01_20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312"),
    ],
)
def test_type_hashes_are_those_that_ros_announces(name: str, expected: str) -> None:
    assert interfaces("jazzy").type_hash(name) == expected


@pytest.mark.parametrize("release", ["humble", "lyrical"])
def test_messages_are_encoded_as_rosbags_encodes_them(release: Any) -> None:
    made, chance = interfaces(release), random.Random(3)
    for name in (*USED, *(name for name in definitions(release) if name.startswith("nav2_msgs"))):
        message, other = _filled(made, name, chance)
        expected = bytes(made.store.serialize_cdr(other, name))
        assert _without_padding(message.serialize(use_version_2=False), expected) == expected, name


def _without_padding(found: bytes, expected: bytes) -> bytes:
    """cyclonedds fills the last word and says by how much in the header's options; CDR leaves both open."""
    assert len(found) - len(expected) in range(4)
    return expected[:4] + found[4 : len(expected)]


def _filled(made: Any, name: str, chance: random.Random) -> tuple[Any, Any]:
    """The same random message of both libraries."""
    fields = made.store.fielddefs[name][1] or [("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))]
    pairs = {field: _value(made, of, chance) for field, of in fields}
    return (
        made[name](**{field: pair[0] for field, pair in pairs.items()}),
        made.store.types[name](**{field: pair[1] for field, pair in pairs.items()}),
    )


def _value(made: Any, of: Any, chance: random.Random) -> tuple[Any, Any]:
    node, inner = of
    if node == Nodetype.NAME:
        return _filled(made, inner, chance)
    if node == Nodetype.BASE:
        one = _primitive(inner[0], chance)
        return one, one
    count = inner[1] if node == Nodetype.ARRAY else chance.randrange(4)
    pairs = [_value(made, inner[0], chance) for _ in range(count)]
    mine, theirs = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    plain = inner[0][0] == Nodetype.BASE and inner[0][1][0] != "string"
    kind = {"byte": "uint8", "char": "uint8"}.get(inner[0][1][0], inner[0][1][0]) if plain else ""
    return mine, np.array(theirs, dtype=kind) if plain else theirs


def _primitive(name: str, chance: random.Random) -> Any:
    if name == "bool":
        return chance.random() < 0.5
    if name == "string":
        return "".join(chance.choice("aé/_9") for _ in range(chance.randrange(7)))
    if name.startswith("float"):
        return float(np.float32(chance.uniform(-1e3, 1e3)))
    return chance.randrange(100)


def test_names_of_types_in_dds_and_back() -> None:
    assert dds_type("geometry_msgs/msg/Twist") == "geometry_msgs::msg::dds_::Twist_"
    assert ros_type("nav2_msgs::srv::dds_::ClearEntireCostmap_Request_") == "nav2_msgs/srv/ClearEntireCostmap_Request"
    assert ros_type("DDS::Unknown") == "DDS::Unknown"


def test_a_request_begins_with_the_header_of_rmw_cyclonedds() -> None:
    kind = interfaces("jazzy").part_of_service("lifecycle_msgs/srv/GetState_Response")
    data = kind(rmw_guid=0x0102030405060708, rmw_sequence=9).serialize(use_version_2=False)
    assert data[4:20] == bytes.fromhex("0807060504030201") + (9).to_bytes(8, "little")


def test_an_unknown_interface_is_an_error() -> None:
    with pytest.raises(UnknownName):
        interfaces("humble")["nav_msgs/msg/Odometri"]


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
