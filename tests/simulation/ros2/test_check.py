"""`rvsg ros2 check` against a process that plays Nav2, and what nodes tell of their parameters."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, cast

import pytest
from tests.simulation.ros2.isolated import drive

from rvsg.cli import main
from rvsg.robots.robot import load_robot
from rvsg_ros2 import check
from rvsg_ros2.nodes import Lifecycle, NodeParameters, _kept_by_a_timer, corners, shortfall
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


SQUARE = ((0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2))


NO_FOOTPRINT = ("[]", "", "[[1, 2], [3, 4]]", "[[1, 2, 3], [1, 2, 3], [1, 2, 3]]", "[[a", "3", None, 0.3)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("[[0.3, 0.2], [0.3, -0.2], [-0.3, 0]]", ((0.3, 0.2), (0.3, -0.2), (-0.3, 0.0))),
        *((text, None) for text in NO_FOOTPRINT),
    ],
)
def test_a_footprint_is_read_as_nav2_writes_it(text: object, found: object) -> None:
    assert corners(text) == found


def test_the_shortfall_is_that_of_the_direction_in_which_outlines_differ_most() -> None:
    assert shortfall(SQUARE, SQUARE) == 0.0
    assert shortfall(0.2, SQUARE) == pytest.approx(0.1606, abs=1e-3)  # at a corner
    assert shortfall(0.5, SQUARE) == pytest.approx(-0.3)  # at the side
    assert shortfall(tuple((x - 0.15, y) for x, y in SQUARE), SQUARE) in (pytest.approx(0.15), pytest.approx(-0.15))


def test_only_a_costmap_for_another_robot_is_named() -> None:
    robot = load_robot("tiago_omni")
    told = NodeParameters(None, {"/a": robot.footprint, "/b": 0.9, "/c": 0.05})
    wrong = told.of_another_robot(robot)
    assert list(wrong) == ["/b", "/c"]
    assert "larger" in wrong["/b"]
    assert "smaller" in wrong["/c"]


@pytest.mark.parametrize(("rate", "kept"), [(20.0, 20.0), (60.0, 62.5), (160, 1000 / 6), (0.0, None), ("x", None)])
def test_the_smoother_keeps_whole_milliseconds(rate: object, kept: float | None) -> None:
    assert _kept_by_a_timer(rate) == (kept if kept is None else pytest.approx(kept))


@pytest.mark.service
def test_rate_and_robot_are_those_of_the_running_nodes() -> None:
    parameters = {
        "controller_server": {"controller_frequency": 40.0},
        "local_costmap/local_costmap": {"footprint": "[]", "robot_radius": 0.9},
        "global_costmap/global_costmap": {"footprint": str([list(c) for c in load_robot("tiago_omni").footprint])},
        "velocity_smoother": {"other": 1},
    }
    told = drive({"parameters": parameters}, options={"speed": 2.0})
    (run,) = told["runs"]
    assert run["outcome"] == "REACHED"
    assert run["stack"]["control_hz"] == 20.0
    (warning,) = [text for text in run["stack"]["warnings"] if "robot" in text]
    assert warning.startswith("local_costmap/local_costmap: its radius")
    found = drive({"parameters": parameters}, check=8.0)["findings"]
    assert found["rate of velocity commands"] == ["FOUND", "40 Hz, as its node says"]
    assert found["robot of local_costmap/local_costmap"][0] == "OTHER_ROBOT"
    assert found["robot of global_costmap/global_costmap"][0] == "FOUND"
