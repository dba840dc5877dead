"""The message types against public definitions, and their encoding against rosbags."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rvsg.core.errors import UnknownName

pytest.importorskip("cyclonedds", reason="ROS 2 needs cyclonedds (extra ros2)")
from rosbags.interfaces import Nodetype

from rvsg_ros2.interfaces import RELEASES, dds_type, definitions, interfaces, ros_type

PUBLIC = json.loads((Path(__file__).parent / "nav2_msgs.json").read_text())
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
