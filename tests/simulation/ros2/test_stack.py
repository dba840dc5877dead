"""The stack ros2 against a process that plays Nav2."""

from __future__ import annotations

import base64
import re
import zlib
from typing import Any

import pytest
from tests.simulation.ros2.isolated import drive

pytestmark = pytest.mark.service
SPEED = 3


def test_a_running_system_drives_two_runs_one_after_another() -> None:
    told = drive({}, runs=2, options={"speed": SPEED})
    assert [run["outcome"] for run in told["runs"]] == ["REACHED", "REACHED"]
    first, second = told["runs"]
    assert first["id"] != second["id"]
    facts = first["stack"]
    assert facts["release"] == "humble"
    assert facts["result"]["status"] == 4
    assert first["recoveries"] == 2
    assert facts["commands"] > 50
    assert facts["speed"] < 1.1 * SPEED
    assert any("reached" in text for text in facts["warnings"]) == (facts["speed"] < 0.95 * SPEED)  # a busy machine
    assert facts["plans"][0][1][-1] == pytest.approx([1.0, 0.5], abs=0.2)
    assert facts["behaviour_tree"][0][1:] == ["FollowPath", "RUNNING"]
    costmaps = facts["costmaps"]
    assert len(costmaps) == pytest.approx(first["t"], abs=2.0)  # one a second, of two that are published
    assert costmaps[0]["shape"] == [2, 3]
    assert costmaps[0]["frame"] == "odom"
    assert zlib.decompress(base64.b64decode(costmaps[0]["cells"])) == bytes([0, 99, 100, 255, 0, 0])
    assert first["entities"] == second["entities"]  # a campaign does not pile up readers
    heard = told["heard"]
    assert heard["goals"] == 2
    assert heard["clears"] == 4
    assert heard["scans"] == {"front": 818}
    assert heard["static"] == ["base_link", "front", "rear"]
    assert heard["initial"][-1] == pytest.approx([-2.0, 0.0], abs=0.3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("release", ["jazzy", "kilted", "lyrical"])
def test_the_release_is_read_from_the_announced_types(release: str) -> None:
    told = drive({"release": release, "stamped": True}, through=[(-1.0, 0.0)], options={"speed": SPEED})
    (run,) = told["runs"]
    assert run["outcome"] == "REACHED"
    assert run["stack"]["release"] == release


@pytest.mark.exhaustive
def test_map_and_transform_are_given_where_the_system_has_no_localisation() -> None:
    told = drive({"localises": False, "map": False}, options={"speed": SPEED})
    assert told["runs"][0]["outcome"] == "REACHED"
    assert told["heard"]["initial"] == []
    assert told["heard"]["map"] == [120, 120]


GONE = {"lose_controller_at_s": 1.0}
NOT_ACTIVE = "Not active after 15 s: planner_server is inactive."


@pytest.mark.parametrize(
    ("peer", "options", "fault", "from_s"),
    [
        pytest.param({"reject": True}, {}, "", 0.0, marks=pytest.mark.exhaustive),
        ({"hang_at_s": 1.0}, {"speed": SPEED, "answer_limit_s": 1.0}, "controller_server:", 1.0),
        pytest.param(GONE, {"answer_limit_s": 1.0}, "controller_server:", 1.0, marks=pytest.mark.exhaustive),
        ({"inactive": ["planner_server"]}, {"start_limit_s": 15.0}, NOT_ACTIVE, 0.0),
        ({**GONE, "abort_at_s": 1.3}, {"answer_limit_s": 2.0}, "controller_server", 0.0),
        ({"abort_at_s": -0.5}, {}, "without a velocity command", 0.0),
    ],
    ids=["rejected", "hangs", "gone", "not active", "gone before the navigator gives up", "ends at once"],
)
def test_what_fails_is_named(peer: dict[str, Any], options: dict[str, Any], fault: str, from_s: float) -> None:
    (run,) = drive(peer, options=options)["runs"]
    assert run["outcome"] == "STACK_FAILED"
    assert fault in run["stack"]["fault"]
    assert from_s <= run["stack"]["fault_t"] < 10.0


@pytest.mark.exhaustive
def test_an_aborted_goal_and_a_late_run_end_with_an_outcome() -> None:
    (run,) = drive({"release": "jazzy", "abort_at_s": 1.0}, options={"speed": SPEED})["runs"]
    assert run["outcome"] == "ABORTED"
    assert run["stack"]["result"] == {"status": 6, "error_code": 9000, "error_msg": "stuck"}
    late = drive({"speed_m_s": 0.01}, limit=2.0, options={"speed": SPEED})
    assert late["runs"][0]["outcome"] == "TIMED_OUT"
    assert late["heard"]["cancels"] == 3  # both actions before the run, the goal after it


@pytest.mark.exhaustive
def test_missed_control_periods_are_told_and_lower_the_speed() -> None:
    told = drive({"miss_every": 4}, runs=2, options={"speed": 4.0}, limit=60.0)
    assert told["runs"][0]["outcome"] == "STACK_FAILED"  # a fifth of the periods and more: no verdict rests on it
    first, second = (run["stack"] for run in told["runs"])
    assert first["missed_periods"] > 5
    assert first["warnings"]
    assert "periods" in first["fault"]
    assert 1.0 <= first["speed_of_next_runs"] <= 3.0  # 3, or what a busy machine reached
    assert second["speed_asked"] == first["speed_of_next_runs"]


ABSENT = {"to_pose_action": "/elsewhere", "through_poses_action": "/nowhere", "start_limit_s": 15.0}


@pytest.mark.parametrize(
    ("peer", "options", "said"),
    [
        (None, {"start_limit_s": 1.0}, "/navigate_to_pose"),
        ({"inactive": ["planner_server"]}, ABSENT, "planner_server is inactive"),
        (None, {"launch": "sh -c 'echo no such package; exit 3'"}, "ended with code 3.*no such package"),
    ],
    ids=["missing", "a node that keeps the action away", "a launch command that ends"],
)
def test_what_keeps_the_first_run_from_starting_is_an_error(peer: Any, options: Any, said: str) -> None:
    told = drive(peer, options=options)
    assert re.search(said, told["error"], re.DOTALL)
    assert "bt_navigator" not in told["error"]  # it is active
    assert told["runs"] == []


def test_a_second_system_in_the_domain_is_named_before_the_first_run() -> None:
    told = drive({"twice": ["controller_server", "bt_navigator"]})
    assert "Two navigation systems are in DDS domain" in told["messages"][0]
    assert "bt_navigator is there 2 times, controller_server is there 2 times. End one" in told["error"]
    assert told["runs"] == []


@pytest.mark.parametrize(
    ("peer", "fault"),
    [
        ({"die_at_s": 1.0}, r"crashed: python.* \(\d+\) ended\."),
        ({"hang_at_s": 1.0}, "hanging: all processes of the launch command run"),
    ],
    ids=["crash", "hang"],
)
def test_a_crash_of_a_launched_node_is_told_apart_from_a_hang(peer: dict[str, Any], fault: str) -> None:
    (run,) = drive(peer, options={"launch": "sh -c '{peer}; sleep 300'", "answer_limit_s": 1.0})["runs"]
    assert run["outcome"] == "STACK_FAILED"
    assert re.search(fault, run["stack"]["fault"])


def test_a_launched_system_is_restarted_after_a_crash_and_leaves_no_process() -> None:
    told = drive({"die_at_s": 1.0}, runs=2, options={"launch": "{peer}", "answer_limit_s": 1.0})
    assert [run["outcome"] for run in told["runs"]] == ["STACK_FAILED", "STACK_FAILED"]
    assert "ended with code 7" in told["runs"][0]["stack"]["fault"]
    assert "ended with code 7" in told["runs"][1]["stack"]["fault"]
    assert told["left"] == []


@pytest.mark.exhaustive
def test_a_launched_system_that_works_is_ended_with_its_children() -> None:
    told = drive({}, options={"launch": "sh -c 'setsid sleep 300 & exec {peer}'", "speed": 1.0})
    assert told["runs"][0]["outcome"] == "REACHED"
    assert told["mark"]
    assert told["left"] == []
