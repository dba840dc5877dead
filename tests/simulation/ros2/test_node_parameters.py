"""What the nodes of a running system tell of their parameters."""

from __future__ import annotations

import pytest
from tests.simulation.ros2.isolated import drive

from rvsg.robots.robot import load_robot
from rvsg_ros2.nodes import NodeParameters, _kept_by_a_timer, corners, shortfall

SQUARE = ((0.3, 0.2), (0.3, -0.2), (-0.3, -0.2), (-0.3, 0.2))


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("[[0.3, 0.2], [0.3, -0.2], [-0.3, 0]]", ((0.3, 0.2), (0.3, -0.2), (-0.3, 0.0))),
        ("[]", None),
        ("", None),
        ("[[1, 2], [3, 4]]", None),
        ("[[1, 2, 3], [1, 2, 3], [1, 2, 3]]", None),
        ("[[a", None),
        ("3", None),
        (None, None),
        (0.3, None),
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
