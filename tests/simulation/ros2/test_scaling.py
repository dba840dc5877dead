"""Nav2 parameters for several times real time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.coded import coded

from rvsg.core.errors import FileError, InputError
from rvsg.core.plugins import ignore
from rvsg_ros2.nav2_file import scale, scale_nav2_params
from rvsg_ros2.options import read_options
from rvsg_ros2.session import Session

TEXT = """
bt_navigator:
  ros__parameters: {bt_loop_duration: 10, default_nav_to_pose_bt_xml: TREE, default_server_timeout: 20}
controller_server:
  ros__parameters:
    controller_frequency: 20.0
    failure_tolerance: 0.3
    controller_plugins: [FollowPath]
    FollowPath: {plugin: "dwb_core::DWBLocalPlanner", trajectory_generator_name: "dwb_plugins::LimitedAccelGenerator",
                 acc_lim_x: 2.5}
local_costmap:
  local_costmap:
    ros__parameters: {update_frequency: 5.0, publish_frequency: 2.0}
/robot1/global_costmap:
  global_costmap:
    ros__parameters: {publish_frequency: 1.0}
behavior_server:
  ros__parameters: {cycle_frequency: 10.0, behavior_plugins: [backup], rotational_acc_lim: 3.2,
                    backup: {plugin: nav2_behaviors/BackUp, acceleration_limit: 0.5}}
velocity_smoother:
  ros__parameters: {smoothing_frequency: 25.0, max_accel: [2.5, 0.0, 3.2], velocity_timeout: 1.0}
"""
TREE = '<root><RateController hz="1.0"><A/></RateController><RateController name="x" hz="{rate}"/></root>'


@pytest.fixture
def values(tmp_path: Path) -> dict[str, Any]:
    (tmp_path / "tree.xml").write_text(TREE)
    found: dict[str, Any] = yaml.safe_load(TEXT.replace("TREE", str(tmp_path / "tree.xml")))
    return found


def of(values: dict[str, Any], *path: str) -> Any:
    for key in path:
        values = values[key]
    return values["ros__parameters"]


def test_wall_clock_rates_and_their_steps_are_scaled_and_nothing_else(values: dict[str, Any]) -> None:
    made = scale(values, 4.0, "jazzy")
    controller = of(values, "controller_server")
    assert controller["controller_frequency"] == 80.0
    assert controller["failure_tolerance"] == 0.3
    assert controller["costmap_update_timeout"] == pytest.approx(1.2)
    assert controller["FollowPath"]["acc_lim_x"] == 2.5
    assert controller["FollowPath"]["sim_period"] == 0.05
    assert of(values, "local_costmap", "local_costmap") == {"update_frequency": 20.0, "publish_frequency": 2.0}
    assert of(values, "/robot1/global_costmap", "global_costmap")["update_frequency"] == 20.0  # Nav2's default, 5 Hz
    behaviours = of(values, "behavior_server")
    assert (behaviours["cycle_frequency"], behaviours["rotational_acc_lim"]) == (40.0, 3.2)
    assert behaviours["backup"]["acceleration_limit"] == 2.0
    smoother = of(values, "velocity_smoother")
    assert smoother["smoothing_frequency"] == 100.0
    assert smoother["max_accel"] == [10.0, 0.0, 12.8]
    assert smoother["max_decel"] == [-10.0, 0.0, -12.8]
    assert smoother["velocity_timeout"] == 1.0
    assert of(values, "bt_navigator")["bt_loop_duration"] == 2
    assert of(values, "bt_navigator")["default_server_timeout"] == 80  # simulated time, for an answer in wall time
    assert made.control_hz == 25.0
    assert {change.name for change in made.changes} >= {"velocity_smoother.max_accel", "bt_navigator.bt_loop_duration"}


def test_the_smoother_gets_a_rate_whose_period_is_whole_milliseconds(values: dict[str, Any]) -> None:
    smoother = of(values, "velocity_smoother")
    smoother["smoothing_frequency"] = 20.0
    made = scale(values, 8.0, "jazzy")
    assert smoother["smoothing_frequency"] == 166.66  # 160 Hz are 6.25 ms, of which the timer takes 6
    assert int(1000.0 / smoother["smoothing_frequency"]) == 6
    assert smoother["max_accel"][0] == 20.0
    assert made.control_hz == pytest.approx(20.83, abs=0.01)


def test_the_rates_of_the_tree_are_scaled_but_not_its_variables(values: dict[str, Any], tmp_path: Path) -> None:
    made = scale(values, 4.0, "humble")
    path = made.write(tmp_path)
    written = yaml.safe_load(path.read_text())
    tree = Path(of(written, "bt_navigator")["default_nav_to_pose_bt_xml"]).read_text()
    assert 'hz="4"' in tree
    assert 'hz="{rate}"' in tree
    assert sum("default_nav_through_poses_bt_xml" in note for note in made.notes) == 1  # not installed here


def test_a_tree_that_is_not_found_stops_a_fast_run_before_anything_starts(
    values: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    file = tmp_path / "params.yaml"
    file.write_text(yaml.safe_dump(values))
    fast = read_options({"params": str(file), "launch": "bash -c 'source setup.bash; nav2 {params}'", "speed": 4.0})
    with pytest.raises(InputError, match="through_poses_w_replanning_and_recovery", check=coded("ros2-tree")):
        Session(fast, 4.0, ignore)


def test_from_lyrical_on_only_the_tree_counts_wall_time(values: dict[str, Any]) -> None:
    before = of(values, "velocity_smoother").copy()
    scale(values, 4.0, "lyrical")
    assert of(values, "velocity_smoother") == before
    assert of(values, "controller_server")["controller_frequency"] == 20.0


def test_at_real_time_nothing_changes(values: dict[str, Any]) -> None:
    assert scale(values, 1.0, "humble").changes == []


def test_what_cannot_be_scaled_is_told(values: dict[str, Any]) -> None:
    values["docking_server"] = {"ros__parameters": {}}
    of(values, "controller_server")["FollowPath"]["plugin"] = "nav2_mppi_controller::MPPIController"
    notes = " ".join(scale(values, 4.0, "jazzy").notes)
    assert "docking_server" in notes
    assert "MPPI" in notes


def test_a_file_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "slam.yaml"
    path.write_text("slam_toolbox: {ros__parameters: {a: 1}}\n")
    with pytest.raises(FileError, check=coded("nav2-params")):
        scale_nav2_params(path, 2.0, "humble")
