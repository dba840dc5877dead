"""The options of the stack ros2."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.coded import coded
from tests.simulation.ros2.isolated import drive

from rvsg.core.errors import FileError, InputError, InvalidOptions
from rvsg.core.plugins import Spec, make
from rvsg.robots.robot import load_robot
from rvsg.simulation.simulators import described
from rvsg.simulation.stacks.parameters import with_values
from rvsg.simulation.stacks.stack_choice import StackChoice
from rvsg_ros2.launch import Launched, ros_environment
from rvsg_ros2.nav2_file import new_nav2_params
from rvsg_ros2.options import read_options, scan_topic
from rvsg_ros2.stack import Ros2Stack


def test_the_stack_is_registered_and_says_its_options() -> None:
    stack = make("stack", "ros2", {"speed": 2.0})
    assert isinstance(stack, Ros2Stack)
    assert stack.options["speed"] == 2.0
    assert StackChoice.of(stack).record.name == "ros2"


@pytest.mark.parametrize(
    ("wrong", "keys"),
    [
        ({"speed": 0}, ("speed",)),
        ({"sped": 2}, ("sped",)),
        ({"restart": True}, ("",)),  # of options that do not go together
        ({"params": "nav2.yaml"}, ("",)),
        ({"launch": "ros2 launch x", "speed": 4}, ("",)),
        ({"values": {"sim_time": 2.0}}, ("",)),
        ({"domain": 233}, ("domain",)),
        ({"cmd_vel": "two words"}, ("cmd_vel",)),
    ],
)
def test_wrong_options_are_one_error_each(wrong: dict[str, object], keys: tuple[str, ...]) -> None:
    with pytest.raises(InvalidOptions) as refused:
        read_options(wrong)
    assert refused.value.keys == keys


@pytest.mark.parametrize(
    ("made", "code"),
    [
        (lambda: read_options({"launch": "ros2 {params}", "params": "/nowhere.yaml"}), "params-missing"),
        (lambda: read_options({}).first_domain, "ros2-domain"),
        (lambda: ros_environment(0), "ros2-middleware"),
        (lambda: Launched("no-such-command-here --x", {}), "ros2-launch"),
        (lambda: Launched("ros2 'open", {}), "ros2-launch-words"),
    ],
)
def test_what_cannot_be_used_is_one_error(
    made: Callable[[], object], code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "seven")
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
    with pytest.raises(InputError, check=coded(code)):
        made()


def test_the_domain_is_that_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert (read_options({}).first_domain, read_options({"domain": 3}).first_domain) == (7, 3)


def test_a_stack_is_pickled_without_its_connection() -> None:
    copy = pickle.loads(pickle.dumps(Ros2Stack(speed=2.0)))
    assert copy.options == Ros2Stack(speed=2.0).options


def test_the_content_of_the_parameter_file_is_part_of_the_version(tmp_path: Path) -> None:
    path = tmp_path / "nav2.yaml"
    path.write_text("a: 1\n")
    before = Ros2Stack(launch="ros2 {params}", params=str(path)).version
    path.write_text("a: 2\n")
    assert Ros2Stack(launch="ros2 {params}", params=str(path)).version != before


def test_values_of_the_parameter_file_can_be_tuned_and_reach_the_launched_system(tmp_path: Path) -> None:
    path, robot = tmp_path / "nav2.yaml", load_robot("tiago_omni")
    path.write_text(new_nav2_params("tiago_omni", "nav2-dwb", {}))
    launch = "sh -c 'grep -w sim_time: {params}; exit 3'"
    stack = Ros2Stack(launch=launch, params=str(path))
    declared = {each.name: each for each in stack.tunable_parameters(robot)}
    assert declared["values.sim_time"].present == 1.7
    assert {name.partition(".")[0] for name in declared} == {"values"} and Ros2Stack().tunable_parameters(robot) == ()
    for each in declared.values():
        value = each.value(each.at(0.6))
        changed = Ros2Stack(**with_values(stack.options, {each.name: value}))
        files = [str((one.parameter_file() or ("", ""))[1]).splitlines() for one in (stack, changed)]
        assert sum(old != new for old, new in zip(*files, strict=True)) == 1
    with pytest.raises(FileError, check=coded("no-place")):
        Ros2Stack(launch=launch, params=str(path), values={"behaviours": {"wait_s": 1.0}})
    told = drive(options={"launch": launch, "params": str(path), "values": {"sim_time": 2.5}})
    assert "sim_time: 2.5" in told["error"]
    assert path.read_text() == stack.parameter_file()[1]


def test_the_first_lidar_has_nav2s_topic_and_the_others_their_names() -> None:
    lidars = load_robot("tiago_omni").lidars
    topics = [scan_topic(read_options({}), lidars, k) for k in range(2)]
    assert topics == ["/scan", "/scan_rear"]


def test_a_report_says_that_runs_of_a_real_system_cannot_be_repeated() -> None:
    assert described(Spec("embedded")) == "embedded, stack nav2-dwb-humble"  # the only one that is not stored
    assert described(Spec("embedded", {"stack": {"name": "nav2-rpp"}})) == "embedded, stack nav2-rpp"
    assert "not repeatable" in described(Spec("embedded", {"stack": {"name": "ros2"}}))
    assert "not repeatable" in described(Spec("ros2-world", {"repeatable": False}))
