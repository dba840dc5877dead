"""`rvsg ros2 check` against a process that plays Nav2."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, cast

import pytest
from tests.simulation.ros2.isolated import drive

from rvsg.cli import main
from rvsg_ros2 import check
from rvsg_ros2.nodes import Lifecycle
from rvsg_ros2.options import Ros2Options


@pytest.mark.service
def test_a_system_that_can_drive_is_usable() -> None:
    told = drive({"release": "jazzy", "stamped": True}, check=8.0)
    assert told["usable"]
    assert told["release"] == "jazzy"
    found = told["findings"]
    assert found["velocity commands on /cmd_vel"] == ["FOUND", "geometry_msgs/msg/TwistStamped"]
    assert found["node controller_server"] == ["FOUND", "active"]
    assert found["reader of /scan"][0] == "FOUND"
    assert found["reader of /scan_rear"][0] == "ABSENT"
    assert found["reader of /initialpose"][0] == "FOUND"


@pytest.mark.service
def test_what_is_missing_and_of_another_type_is_named() -> None:
    told = drive({"stamped": True, "inactive": ["planner_server"]}, check=8.0, options={
        "cmd_vel_type": "Twist", "nodes": ["planner_server", "smoother_server"],
        "to_pose_action": "/go", "goal": "to_pose",
    })  # fmt: skip
    assert not told["usable"]
    found = told["findings"]
    assert found["velocity commands on /cmd_vel"][0] == "OTHER_TYPE"
    assert found["action /go"][0] == "MISSING"
    assert found["node planner_server"] == ["INACTIVE", "inactive"]
    assert found["node smoother_server"][0] == "MISSING"


@pytest.mark.service
def test_nothing_at_all_is_not_usable() -> None:
    told = drive(None, check=0.5)
    assert not told["usable"]
    assert told["findings"]["lifecycle nodes"][0] == "MISSING"


class Waiting:
    """Nodes of which one answers no question, as while its activation waits for transforms."""

    states: ClassVar[dict[str, int]] = {"bt_navigator": 3}

    def found(self) -> set[str]:
        return {"bt_navigator", "controller_server"}


def test_a_node_that_is_becoming_active_does_not_make_the_system_unusable() -> None:
    options = Ros2Options(nodes=("bt_navigator", "controller_server", "amcl"))
    found = {each.name: each.status for each in check._nodes(cast(Lifecycle, Waiting()), options)}
    assert found["node bt_navigator"] is check.Status.FOUND
    assert found["node controller_server"] is check.Status.INACTIVE
    assert found["node amcl"] is check.Status.MISSING


def test_parameters_are_scaled_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "nav2.yaml"
    path.write_text("controller_server: {ros__parameters: {controller_frequency: 20.0}}\n")
    assert main(["ros2", "params", str(path), "--speed", "8"]) == 0
    captured = capsys.readouterr()
    assert "controller_frequency: 160.0" in captured.out
    assert "controller_server.controller_frequency: 20.0 becomes 160.0" in captured.err
    assert main(["ros2", "params", str(path), "--speed", "8", "--release", "jazy"]) == 2
