"""Parameter files of Nav2: what is honoured, what is not, and what is refused."""

from __future__ import annotations

import contextlib
import functools
import json
import operator
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.simulation.parts import TIAGO

from rvsg.cli import main
from rvsg.core.documents import DocumentError
from rvsg.core.errors import FileError, InputError
from rvsg.simulation.embedded.simulator import EmbeddedSimulator
from rvsg.simulation.stacks.nav2_params import leaves_of, read_nav2_params, read_nav2_text
from rvsg.stacks import StackChoice

COSTMAPS = """
local_costmap:
  local_costmap:
    ros__parameters:
      update_frequency: 8.0
      rolling_window: true
      width: 4
      height: 4
      resolution: 0.04
      robot_radius: 0.3
      plugins: [obstacles, inflation]
      obstacles:
        plugin: "nav2_costmap_2d::VoxelLayer"
        observation_sources: front rear
        z_voxels: 16
        front: {topic: /front, obstacle_max_range: 2.2, raytrace_max_range: 2.8, marking: true}
        rear: {topic: /rear, obstacle_max_range: 9.0}
      inflation: {plugin: "nav2_costmap_2d::InflationLayer", cost_scaling_factor: 4.5, inflation_radius: 0.6}
global_costmap:
  global_costmap:
    ros__parameters:
      update_frequency: 2.0
      resolution: 0.05
      plugins: [static]
      static: {plugin: "nav2_costmap_2d::StaticLayer", map_subscribe_transient_local: true}
      filters: [keepout]
      keepout: {plugin: "nav2_costmap_2d::KeepoutFilter", enabled: true}
velocity_smoother:
  ros__parameters:
    smoothing_frequency: 25.0
    max_velocity: [0.4, 0.0, 1.2]
    min_velocity: [-0.2, 0.0, -1.2]
    max_accel: [1.5, 0.0, 2.0]
    max_decel: [-1.8, 0.0, -2.0]
    deadband_velocity: [0.0, 0.0, 0.0]
amcl:
  ros__parameters: {alpha1: 0.2, max_beams: 60}
"""
HUMBLE = """
controller_server:
  ros__parameters:
    use_sim_time: true
    controller_frequency: 10.0
    failure_tolerance: 0.5
    progress_checker_plugin: "progress_checker"
    goal_checker_plugins: ["goal"]
    controller_plugins: ["FollowPath"]
    progress_checker:
      plugin: "nav2_controller::SimpleProgressChecker"
      required_movement_radius: 0.4
      movement_time_allowance: 12.0
    goal:
      plugin: "nav2_controller::SimpleGoalChecker"
      xy_goal_tolerance: 0.15
      yaw_goal_tolerance: 0.2
      stateful: true
    FollowPath:
      plugin: "dwb_core::DWBLocalPlanner"
      max_vel_x: 0.45
      max_vel_y: 0.0
      acc_lim_x: 1.5
      decel_lim_x: -1.6
      sim_time: 2.0
      critics: ["RotateToGoal", "Oscillation", "BaseObstacle", "PathAlign", "PathDist", "GoalDist"]
      BaseObstacle.scale: 0.03
      PathAlign.scale: 30.0
      PathAlign.forward_point_distance: 0.2
planner_server:
  ros__parameters:
    planner_plugins: ["GridBased"]
    GridBased: {plugin: "nav2_navfn_planner/NavfnPlanner", tolerance: 0.3, use_astar: true}
"""
MPPI = """
controller_server:
  ros__parameters:
    controller_frequency: 20.0
    controller_plugins: ["FollowPath"]
    FollowPath:
      plugin: "nav2_mppi_controller::MPPIController"
      motion_model: "DiffDrive"
      batch_size: 500
      vx_max: 0.6
      critics: ["ConstraintCritic", "CostCritic", "GoalCritic"]
      CostCritic: {enabled: true, cost_power: 1, cost_weight: 3.0, consider_footprint: true}
collision_monitor:
  ros__parameters:
    polygons: ["Stop", "Slow", "Approach", "Speed"]
    Stop: {type: polygon, points: "[[0.5, 0.3], [0.5, -0.3], [0.0, -0.3], [0.0, 0.3]]", action_type: stop}
    Slow: {type: circle, radius: 0.8, action_type: slowdown, slowdown_ratio: 0.4, max_points: 8}
    Approach: {type: polygon, action_type: approach, time_before_collision: 1.2}
    Speed: {type: velocity_polygon, action_type: stop}
"""
RPP = """
controller_server:
  ros__parameters:
    controller_plugins: ["Follow"]
    Follow: {plugin: "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController", desired_linear_vel: 0.35,
             lookahead_dist: 0.5, use_dynamic_window: true}
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "nav2_params.yaml"
    path.write_text(text)
    return path


def test_a_file_of_humble_sets_robot_and_planner(tmp_path: Path) -> None:
    choice = StackChoice.of(str(written(tmp_path, HUMBLE + COSTMAPS)))
    assert choice.record.name == "nav2-dwb"
    robot = choice.driver.adapt(TIAGO)
    n = robot.navigation
    assert (n.behaviours.controller_hz, n.behaviours.failure_tolerance_s, n.behaviours.progress_m) == (10.0, 0.5, 0.4)
    assert (n.behaviours.goal_tolerance_m, n.behaviours.planner_tolerance_m) == (0.15, 0.3)
    assert (n.dwb.max_speed_m_s, n.dwb.deceleration_m_s2, n.dwb.forward_point_m) == (0.45, 1.6, 0.2)
    assert (n.dwb.obstacle_scale, n.dwb.goal_align_scale, n.dwb.path_align_scale) == (0.03, 0.0, 30.0)
    assert (n.costmaps.local_size_m, n.costmaps.local_resolution_m, n.costmaps.obstacle_range_m) == (4, 0.04, 2.2)
    assert (n.costmaps.local_inflation_m, n.costmaps.local_cost_scaling, n.costmaps.global_update_hz) == (0.6, 4.5, 2.0)
    assert (n.smoother.max_speed_m_s, n.smoother.max_reverse_m_s, n.smoother.deceleration_m_s2) == (0.4, 0.2, 1.8)
    assert len(robot.footprint) == 16 and robot.outline == TIAGO.outline


def test_every_key_is_listed_with_what_becomes_of_it(tmp_path: Path) -> None:
    text = HUMBLE + COSTMAPS
    read = read_nav2_params(written(tmp_path, text))
    found = {entry.key: entry for entry in read.entries}

    def count(value: Any) -> int:
        return sum(map(count, value.values())) if isinstance(value, dict) else 1

    assert len(read.entries) == len(found) == count(yaml.safe_load(text)) == sum(read.counts().values())
    state = {key: entry.state for key, entry in found.items()}
    assert state["controller_server.FollowPath.sim_time"] == "honoured"
    assert state["controller_server.FollowPath.BaseObstacle.scale"] == "honoured"
    assert state["controller_server.use_sim_time"] == "no effect"
    assert state["amcl.alpha1"] == "no effect"
    assert state["local_costmap.local_costmap.obstacles.z_voxels"] == "no effect"
    for key in (
        "planner_server.GridBased.use_astar",
        "local_costmap.local_costmap.obstacles.observation_sources",
        "local_costmap.local_costmap.obstacles.rear.obstacle_max_range",
        "global_costmap.global_costmap.filters",
        "global_costmap.global_costmap.keepout.enabled",
    ):
        assert state[key] == "not supported" and found[key].note


def test_mppi_and_a_collision_monitor(tmp_path: Path) -> None:
    path = written(tmp_path, MPPI + COSTMAPS)
    choice = StackChoice.of(path)
    options = choice.record.options
    assert choice.record.name == "nav2-mppi" and options["batch_size"] == 500 and options["vx_max"] == 0.6
    assert options["CostCritic"]["cost_weight"] == 3.0 and not options["PathAlignCritic"]["enabled"]
    navigation = choice.driver.adapt(TIAGO).navigation
    stop, slow, approach = navigation.collision_monitor
    assert (stop.action_type, stop.points[0], stop.min_points) == ("stop", (0.5, 0.3), 4)
    assert (slow.action_type, len(slow.points), slow.slowdown_ratio, slow.min_points) == ("slowdown", 16, 0.4, 9)
    assert (approach.action_type, approach.points, approach.time_before_collision) == ("approach", None, 1.2)
    state = {entry.key: entry.state for entry in read_nav2_params(path).entries}
    assert state["collision_monitor.Approach.time_before_collision"] == "honoured"
    assert state["collision_monitor.Speed.type"] == "not supported"


@pytest.mark.parametrize(("dots", "smoothed"), [("::", True), ("/", False)])
def test_the_release_decides_how_recoveries_drive(tmp_path: Path, dots: str, smoothed: bool) -> None:
    spin = f'{{behavior_plugins: [spin], spin: {{plugin: "nav2_behaviors{dots}Spin"}}}}'
    path = written(tmp_path, f"{RPP}behavior_server:\n  ros__parameters: {spin}\n")
    assert StackChoice.of(path).driver.adapt(TIAGO).navigation.behaviours.smoothed is smoothed
    for name, built_in in (("nav2-dwb-humble", False), ("nav2-dwb", True), ("nav2-rpp", True)):
        assert StackChoice.of(name).driver.adapt(TIAGO).navigation.behaviours.smoothed is built_in


def test_a_value_that_is_simulated_in_any_case_counts_as_honoured_and_oscillation_is_read(tmp_path: Path) -> None:
    same = "sum_scores: false}\n      prune_plan: true\n      Oscillation: {oscillation_reset_dist: 0.1}\n"
    path = written(
        tmp_path,
        "controller_server:\n  ros__parameters:\n    controller_plugins: [FollowPath]\n    FollowPath:\n"
        f"      plugin: dwb_core::DWBLocalPlanner\n      BaseObstacle: {{{same}",
    )
    state = {entry.key.rpartition(".")[2]: entry.state for entry in read_nav2_params(path).entries}
    assert state["sum_scores"] == state["prune_plan"] == state["oscillation_reset_dist"] == "honoured"
    assert StackChoice.of(path).driver.adapt(TIAGO).navigation.dwb.oscillation_reset_m == 0.1
    path.write_text(path.read_text().replace("false", "true"))
    assert "not supported" in [entry.state for entry in read_nav2_params(path).entries]


def test_the_resolution_of_a_global_costmap_is_that_of_the_map_as_in_nav2(tmp_path: Path) -> None:
    state = {entry.key: entry.state for entry in read_nav2_params(written(tmp_path, HUMBLE + COSTMAPS)).entries}
    assert state["local_costmap.local_costmap.resolution"] == "honoured"
    assert state["global_costmap.global_costmap.resolution"] == "no effect"


def test_what_makes_mppi_crawl_is_told_first_and_open_loop_is_honoured(tmp_path: Path) -> None:
    unequal = MPPI.replace("vx_max: 0.6", "vx_max: 0.6\n      ax_max: 0.8\n      ax_min: -1.2\n      open_loop: true")
    path = written(tmp_path, unequal)
    choice = StackChoice.of(path)
    assert "crawl" in choice.messages[0] and choice.record.options["open_loop"] is True
    state = {entry.key: entry.state for entry in read_nav2_params(path).entries}
    assert state["controller_server.FollowPath.open_loop"] == "honoured"
    assert not any("crawl" in text for text in StackChoice.of("nav2-mppi", {"ax_max": 0.8, "ax_min": -0.8}).messages)


def test_pure_pursuit_and_options_on_top_of_a_file(tmp_path: Path) -> None:
    path = written(tmp_path, RPP)
    record = StackChoice.of(path, {"lookahead_dist": 0.9}).record
    assert record.options["desired_linear_vel"] == 0.35 and record.options["lookahead_dist"] == 0.9
    assert any("dynamic window" in message for message in StackChoice.of(path).messages)


def test_names_of_dwb_that_went_are_told_with_those_of_nav2() -> None:
    with pytest.raises(InputError, match=r"dwb\.obstacle_scale is BaseObstacle\.scale") as refused:
        StackChoice.of("nav2-dwb", {"dwb": {"obstacle_scale": 0.1}})
    assert refused.value.code == "options"


def test_what_is_not_supported_is_always_told(tmp_path: Path) -> None:
    told: list[str] = []
    simulator = EmbeddedSimulator(stack=written(tmp_path, HUMBLE + COSTMAPS))
    simulator.prepare(told.append)
    assert any("not supported" in text for text in told)


PLANNERS = ("nav2_smac_planner::SmacPlanner2D", "nav2_theta_star_planner/ThetaStarPlanner", "acme/HybridPlanner")


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        *(("nav2_navfn_planner/NavfnPlanner", planner, "plugin") for planner in PLANNERS),
        ("dwb_core::DWBLocalPlanner", "nav2_graceful_controller::GracefulController", "plugin"),
        ("nav2_costmap_2d::VoxelLayer", "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer", "plugin"),
        ('"PathDist"', '"PathHugging"', "critics"),
        ("[0.4, 0.0, 1.2]", "[0.4, fast]", "max_velocity"),
        ("max_vel_x: 0.45", "max_vel_x: quick", "max_vel_x"),
        ("filters: [keepout]", "filters: 3.5", "filters"),
        ("max_vel_x: 0.45", "max_vel_x: -1", "max_vel_x"),
        ("use_astar: true", "use_astar: fast", "use_astar"),
        ("deadband_velocity: [0.0, 0.0, 0.0]", "deadband_velocity: 0.01", "deadband_velocity"),
    ],
)
def test_a_plug_in_or_a_value_that_is_not_simulated_is_refused(tmp_path: Path, old: str, new: str, key: str) -> None:
    text = HUMBLE + COSTMAPS
    assert old in text
    with pytest.raises(FileError) as refused:
        StackChoice.of(written(tmp_path, text.replace(old, new)))
    assert isinstance(refused.value, DocumentError)
    assert refused.value.problems[0].key[-1] == key and refused.value.line is not None
    if key == "plugin":
        assert refused.value.code == "not-simulated"
        assert re.search(f"{new} is not simulated.*nearest that is: .*--stack ros2", str(refused.value))


@pytest.mark.parametrize("text", ["", "a: 1\n", "- 1\n", "move_base:\n  DWAPlannerROS: {max_vel_x: 1}\n", "a: [\n"])
def test_a_file_of_another_program_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(FileError):
        StackChoice.of(written(tmp_path, text))
    with pytest.raises(FileError):
        StackChoice.of(str(tmp_path / "missing.yaml"))


def test_the_table_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, MPPI + COSTMAPS)
    assert main(["stacks", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["stack"]["name"] == "nav2-mppi" and sum(told["counts"].values()) == len(told["keys"])
    assert main(["stacks", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == list(StackChoice.of(path).messages)
    place = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if "keepout:" in text)
    assert any(text.startswith("not supported: ") and f"keepout.plugin (line {place})" in text for text in lines)
    assert main(["stacks", str(path), "--verbose"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(lines) + len(told["keys"])


def test_no_value_of_any_key_ends_in_an_error_of_python(tmp_path: Path) -> None:
    tree = yaml.safe_load(HUMBLE + COSTMAPS)
    tree["collision_monitor"] = {"ros__parameters": {"observation_sources": ["scan"], "polygons": ["stop"]}}
    for key, _ in leaves_of(tree, ()):
        *around, last = key
        inner = functools.reduce(operator.getitem, around, tree)
        whole = inner[last]
        for value in (None, "text", 3.5, [1.0], {"a": 1}):
            inner[last] = value
            with contextlib.suppress(InputError):
                read_nav2_text(yaml.safe_dump(tree), tmp_path / "nav2.yaml")
        inner[last] = whole


INFLATED = "{plugin: 'nav2_costmap_2d::InflationLayer', inflation_radius: 1.0e+6}"
COSTMAP = f"local_costmap: {{local_costmap: {{ros__parameters: {{plugins: [i], i: {INFLATED}}}}}}}\n"


@pytest.mark.parametrize("damage", ["turtle: 3\n", COSTMAP])
def test_a_damaged_file_is_told_or_read(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "nav2_params.yaml"
    path.write_text(
        "controller_server: {ros__parameters: {controller_plugins: [FollowPath], "
        "FollowPath: {plugin: 'dwb_core::DWBLocalPlanner'}}}\n" + damage
    )
    try:
        list(read_nav2_params(path).entries)
        StackChoice.of(path).driver.adapt(TIAGO)
    except InputError as error:
        assert "inflation" in str(error)
