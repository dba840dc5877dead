"""Nav2's parameter files for a running system: written for a robot, and scaled for a faster clock.

`rvsg.simulation.stacks.nav2_params` reads such files; what this module writes, it reads back without a loss, but for
what the release decides: recoveries pass the velocity smoother from Jazzy on.

Nav2 up to Kilted runs its loops on wall time, also with `use_sim_time`: controller server, costmap updates, behaviours,
behaviour tree and velocity smoother. At R times real time every frequency of theirs must be R times higher, and so must
the limits that they multiply with one over that frequency. What counts simulated time already (publish_frequency,
time-outs of the progress checker, velocity_timeout, tolerances of transforms) stays. From Lyrical on the loops follow
the simulated clock, and only the RateController of the behaviour tree still counts wall time.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from rvsg.core.documents import read_yaml
from rvsg.core.errors import FileError, InputError
from rvsg.robots.robot import DEFAULT_ROBOT, MonitorPolygon, Robot, load_robot
from rvsg.simulation.embedded.robot_parameters import planned_range, speeds
from rvsg.simulation.stacks.mppi import Mppi
from rvsg.simulation.stacks.nav2_params import MONITORED, PLANNING
from rvsg.simulation.stacks.nav2_stack import Configured, Nav2Dwb, Nav2Settings
from rvsg.simulation.stacks.protocol import NavigationStack
from rvsg.simulation.stacks.pure_pursuit import PurePursuit
from rvsg.simulation.stacks.registry import StackChoice, StackLike
from rvsg_ros2.interfaces import Release
from rvsg_ros2.options import Ros2Options, scan_topic

LOCAL_LAYER, GLOBAL_LAYER = "nav2_costmap_2d::VoxelLayer", "nav2_costmap_2d::ObstacleLayer"
SERVER_TIMEOUT_MS = 1000
"""A goal that a server does not acknowledge in this time fails the run at once. Nav2's own 20 ms run out on a busy
machine."""
_CRITICS = ("RotateToGoal", "Oscillation", "BaseObstacle", "GoalAlign", "PathAlign", "PathDist", "GoalDist")
_FOOTPRINT = "ObstacleFootprint"


def nav2_text(robot: Robot, driver: NavigationStack, release: Release, options: Ros2Options | None = None) -> str:
    """Return the parameter file as text; see `nav2_file`."""
    head = f"# Nav2 ({release.capitalize()}) for the robot {robot.name}, as RVSG's {_name(driver)} drives it.\n"
    return head + yaml.safe_dump(nav2_file(robot, driver, release, options), sort_keys=False, width=120)


def nav2_file(
    robot: Robot, driver: NavigationStack, release: Release, options: Ros2Options | None = None
) -> dict[str, Any]:
    """Return Nav2's parameters for a robot, with the names and frames that the stack `ros2` uses.

    Args:
        driver: a built-in stack, whose controller and changes of the robot's parameters are taken over.
        options: names and frames; None: Nav2's defaults.

    Raises:
        InputError: the stack has no controller of Nav2.
    """
    options = options or Ros2Options()
    controller = _controller(driver, robot)
    assert isinstance(driver, Configured)
    return _Writer(driver.adapt(robot), controller, release, options).sections()


def _name(driver: NavigationStack) -> str:
    return str(getattr(driver, "name", type(driver).__name__))


def _controller(driver: NavigationStack, robot: Robot) -> dict[str, Any]:
    """Return the section of the controller, without what the robot adds to it."""
    if type(driver) is PurePursuit:
        plugin = "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
        return {"plugin": plugin, "transform_tolerance": 0.1, **_own(driver)}
    if type(driver) is Mppi:
        return {"plugin": "nav2_mppi_controller::MPPIController", "motion_model": "DiffDrive", **_mppi(driver)}
    if type(driver) is Nav2Dwb:
        return {"plugin": "dwb_core::DWBLocalPlanner", **_dwb(driver.adapt(robot))}
    raise InputError(
        f"The stack {_name(driver)} has no controller of Nav2. Those that have one: nav2-dwb, nav2-rpp, nav2-mppi.",
        code="stack-not-nav2",
    )


def _own(driver: Configured) -> dict[str, Any]:
    """Return the options of the controller alone; their names are Nav2's."""
    dumped: dict[str, Any] = driver.settings.model_dump(mode="json")
    return {key: value for key, value in dumped.items() if key not in Nav2Settings.model_fields}


def _mppi(driver: Configured) -> dict[str, Any]:
    found = _own(driver)
    critics = [name for name in found if name.endswith("Critic") and found[name]["enabled"]]
    for name in critics:
        found[name]["cost_power"] = 1
    return {**found, "visualize": False, "critics": critics}


def _dwb(robot: Robot) -> dict[str, Any]:
    dwb, planned = robot.navigation.dwb, planned_range(robot)
    side = planned.side
    critics = [_FOOTPRINT if dwb.check_footprint and name == "BaseObstacle" else name for name in _CRITICS]
    return {
        "debug_trajectory_details": False,
        "min_vel_x": planned.low, "min_vel_y": -side, "max_vel_x": planned.high, "max_vel_y": side,
        "max_vel_theta": planned.turn, "min_speed_xy": 0.0, "max_speed_xy": planned.high, "min_speed_theta": 0.0,
        "acc_lim_x": planned.acceleration, "acc_lim_y": planned.acceleration if side else 0.0,
        "acc_lim_theta": planned.yaw_acceleration,
        "decel_lim_x": -planned.deceleration, "decel_lim_y": -planned.acceleration if side else 0.0,
        "decel_lim_theta": -planned.yaw_acceleration,
        "vx_samples": dwb.speed_samples, "vy_samples": dwb.lateral_samples if side else 1,
        "vtheta_samples": dwb.yaw_rate_samples,
        "sim_time": dwb.sim_time_s, "linear_granularity": dwb.linear_granularity_m,
        "angular_granularity": dwb.angular_granularity_rad, "transform_tolerance": 0.2,
        "xy_goal_tolerance": robot.navigation.behaviours.goal_tolerance_m,
        "prune_distance": dwb.prune_distance_m, "forward_prune_distance": dwb.prune_distance_m,
        "trans_stopped_velocity": dwb.stopped_m_s, "short_circuit_trajectory_evaluation": True, "stateful": True,
        "critics": critics,
        ("ObstacleFootprint.scale" if dwb.check_footprint else "BaseObstacle.scale"): dwb.obstacle_scale,
        "PathAlign.scale": dwb.path_align_scale, "PathAlign.forward_point_distance": dwb.forward_point_m,
        "GoalAlign.scale": dwb.goal_align_scale, "GoalAlign.forward_point_distance": dwb.forward_point_m,
        "PathDist.scale": dwb.path_distance_scale, "GoalDist.scale": dwb.goal_distance_scale,
        "RotateToGoal.scale": dwb.rotate_to_goal_scale, "RotateToGoal.slowing_factor": dwb.slowing_factor,
        "RotateToGoal.lookahead_time": -1.0,
        "Oscillation.x_only_threshold": dwb.oscillation_speed_m_s,
        "Oscillation.oscillation_reset_dist": dwb.oscillation_reset_m,
        "Oscillation.oscillation_reset_angle": dwb.oscillation_reset_rad,
    }  # fmt: skip


class _Writer:
    def __init__(self, robot: Robot, controller: dict[str, Any], release: Release, options: Ros2Options) -> None:
        self.robot, self.controller, self.release, self.options = robot, controller, release, options
        self.separator = "/" if release == "humble" else "::"

    def sections(self) -> dict[str, Any]:
        """Return the parameters of all nodes."""
        options = self.options
        nodes: dict[str, Any] = {
            "amcl": {
                "base_frame_id": options.footprint_frame, "odom_frame_id": options.odom_frame,
                "global_frame_id": options.map_frame, "scan_topic": options.scan.strip("/"),
                "robot_model_type": "nav2_amcl::DifferentialMotionModel",
            },
            "bt_navigator": {
                "global_frame": options.map_frame, "robot_base_frame": options.base_frame, "odom_topic": options.odom,
                "bt_loop_duration": 10, "default_server_timeout": SERVER_TIMEOUT_MS,
            },
            "controller_server": self._controller_server(),
            "planner_server": {"planner_plugins": ["GridBased"], "GridBased": self._planner()},
            "behavior_server": self._behaviours(),
            "velocity_smoother": self._smoother(),
        }  # fmt: skip
        if self.robot.navigation.collision_monitor:
            nodes["collision_monitor"] = self._monitor()
        elif self.release != "humble":
            nodes["collision_monitor"] = self._idle_monitor()
        if self.release != "humble":
            nodes["docking_server"] = self._docking()
        found = {name: {"ros__parameters": {"use_sim_time": True, **values}} for name, values in nodes.items()}
        for name, values in (("local_costmap", self._local()), ("global_costmap", self._global())):
            found[name] = {name: {"ros__parameters": {"use_sim_time": True, **values}}}
        return found

    def _controller_server(self) -> dict[str, Any]:
        behaviours = self.robot.navigation.behaviours
        return {
            "controller_frequency": behaviours.controller_hz,
            "min_x_velocity_threshold": 0.001,
            "min_y_velocity_threshold": 0.5,
            "min_theta_velocity_threshold": 0.001,
            "failure_tolerance": behaviours.failure_tolerance_s,
            "odom_topic": self.options.odom,
            "progress_checker_plugins": ["progress_checker"],
            "goal_checker_plugins": ["goal_checker"],
            "controller_plugins": ["FollowPath"],
            "progress_checker": {
                "plugin": "nav2_controller::SimpleProgressChecker",
                "required_movement_radius": behaviours.progress_m,
                "movement_time_allowance": behaviours.progress_s,
            },
            "goal_checker": {
                "plugin": "nav2_controller::SimpleGoalChecker",
                "stateful": True,
                "xy_goal_tolerance": behaviours.goal_tolerance_m,
                "yaw_goal_tolerance": behaviours.goal_tolerance_rad,
            },
            "FollowPath": self.controller,
        }

    def _planner(self) -> dict[str, Any]:
        tolerance = self.robot.navigation.behaviours.planner_tolerance_m
        return {"plugin": f"nav2_navfn_planner{self.separator}NavfnPlanner", "tolerance": tolerance, **PLANNING}

    def _monitor(self) -> dict[str, Any]:
        polygons = {each.name: self._polygon(each) for each in self.robot.navigation.collision_monitor}
        return self._monitored(polygons, enabled=True)

    def _idle_monitor(self) -> dict[str, Any]:
        """Return a monitor that changes no command.

        Since Jazzy, Nav2's launch file starts one between the velocity smoother and the robot, and without polygons
        and sources it refuses to be configured.
        """
        polygon = {"type": "polygon", "action_type": "stop", "points": _corners(self.robot.footprint), "enabled": False}
        return self._monitored({"Unused": polygon}, enabled=False)

    def _monitored(self, polygons: dict[str, Any], enabled: bool) -> dict[str, Any]:
        sources = {
            lidar.name: {"type": "scan", "topic": scan_topic(self.options, self.robot.lidars, k), "enabled": enabled}
            for k, lidar in enumerate(self.robot.lidars)
        }
        return {
            "base_frame_id": self.options.footprint_frame,
            "odom_frame_id": self.options.odom_frame,
            "cmd_vel_in_topic": "cmd_vel_smoothed",
            "cmd_vel_out_topic": self.options.cmd_vel.strip("/"),
            "transform_tolerance": 0.2,
            "source_timeout": 1.0,
            "observation_sources": list(sources),
            **sources,
            "polygons": list(polygons),
            **polygons,
        }

    def _docking(self) -> dict[str, Any]:
        """Return what the docking server, which has no part in a run, needs to be configured."""
        return {
            "base_frame": self.options.base_frame,
            "fixed_frame": self.options.odom_frame,
            "dock_plugins": ["simple_charging_dock"],
            "simple_charging_dock": {"plugin": "opennav_docking::SimpleChargingDock"},
        }

    def _polygon(self, polygon: MonitorPolygon) -> dict[str, Any]:
        found: dict[str, Any] = {"type": "polygon", "action_type": polygon.action_type, "enabled": True}
        found |= {key: getattr(polygon, key) for key in MONITORED if key != "min_points"}
        if polygon.points is None:
            found["footprint_topic"] = "/local_costmap/published_footprint"
        elif self.separator == "/":
            found["points"] = [float(number) for point in polygon.points for number in point]
        else:
            found["points"] = _corners(polygon.points)
        return found | (
            {"max_points": polygon.min_points - 1} if self.separator == "/" else {"min_points": polygon.min_points}
        )

    def _behaviours(self) -> dict[str, Any]:
        behaviours, options = self.robot.navigation.behaviours, self.options
        plugins = {"spin": "Spin", "backup": "BackUp", "drive_on_heading": "DriveOnHeading", "wait": "Wait"}
        return {
            "local_frame": options.odom_frame,
            "global_frame": options.odom_frame if self.separator == "/" else options.map_frame,
            "robot_base_frame": options.base_frame,
            "cycle_frequency": 10.0,
            "behavior_plugins": list(plugins),
            **{key: {"plugin": f"nav2_behaviors{self.separator}{name}"} for key, name in plugins.items()},
            "simulate_ahead_time": behaviours.look_ahead_s,
            "max_rotational_vel": behaviours.spin_max_rad_s,
            "min_rotational_vel": behaviours.spin_min_rad_s,
            "rotational_acc_lim": behaviours.spin_acceleration_rad_s2,
        }

    def _smoother(self) -> dict[str, Any]:
        smoother, limits = self.robot.navigation.smoother, self.robot.limits
        forward, reverse, turn = speeds(self.robot)
        up = smoother.acceleration_m_s2 or limits.acceleration_m_s2
        down = smoother.deceleration_m_s2 or limits.deceleration_m_s2
        yaw = smoother.yaw_acceleration_rad_s2 or limits.yaw_acceleration_rad_s2
        side = limits.lateral_m_s
        return {
            "smoothing_frequency": smoother.frequency_hz,
            "feedback": "OPEN_LOOP",
            "scale_velocities": False,
            "max_velocity": [forward, side, turn],
            "min_velocity": [-reverse, -side, -turn],
            "max_accel": [up, up if side else 0.0, yaw],
            "max_decel": [-down, -down if side else 0.0, -yaw],
            "deadband_velocity": [0.0, 0.0, 0.0],
            "velocity_timeout": smoother.timeout_s,
            "odom_topic": self.options.odom.strip("/"),
        }

    def _local(self) -> dict[str, Any]:
        maps = self.robot.navigation.costmaps
        return {
            "global_frame": self.options.odom_frame,
            "rolling_window": True,
            "width": _whole(maps.local_size_m),
            "height": _whole(maps.local_size_m),
            "update_frequency": maps.local_update_hz,
            "publish_frequency": 2.0,
            **self._costmap(LOCAL_LAYER, maps.local_inflation_m, maps.local_cost_scaling, maps.local_resolution_m, ()),
        }

    def _global(self) -> dict[str, Any]:
        maps = self.robot.navigation.costmaps
        static = {"plugin": "nav2_costmap_2d::StaticLayer", "map_subscribe_transient_local": True}
        return {
            "global_frame": self.options.map_frame,
            "track_unknown_space": True,
            "update_frequency": maps.global_update_hz,
            "publish_frequency": 1.0,
            **self._costmap(
                GLOBAL_LAYER, maps.global_inflation_m, maps.global_cost_scaling, 0.05, (("static_layer", static),)
            ),
        }

    def _costmap(
        self, kind: str, inflation_m: float, scaling: float, resolution: float, first: tuple[tuple[str, Any], ...]
    ) -> dict[str, Any]:
        """Return what both costmaps have; one obstacle layer per lidar, as the built-in stacks keep them."""
        layers = [*first, *((f"{lidar}_layer", self._layer(k, kind)) for k, lidar in enumerate(self._lidars()))]
        inflation = {
            "plugin": "nav2_costmap_2d::InflationLayer",
            "inflation_radius": inflation_m,
            "cost_scaling_factor": scaling,
        }
        layers.append(("inflation_layer", inflation))
        return {
            "robot_base_frame": self.options.base_frame,
            "resolution": resolution,
            "footprint": _corners(self.robot.footprint),
            "footprint_padding": self.robot.padding_m,
            "plugins": [name for name, _ in layers],
            **dict(layers),
        }

    def _lidars(self) -> list[str]:
        return [lidar.name for lidar in self.robot.lidars]

    def _layer(self, index: int, kind: str) -> dict[str, Any]:
        maps, lidar = self.robot.navigation.costmaps, self.robot.lidars[index]
        source = {
            "topic": scan_topic(self.options, self.robot.lidars, index), "data_type": "LaserScan",
            "marking": True, "clearing": True, "min_obstacle_height": 0.0, "max_obstacle_height": 2.0,
            "obstacle_max_range": maps.obstacle_range_m, "obstacle_min_range": 0.0,
            "raytrace_max_range": maps.clearing_range_m, "raytrace_min_range": 0.0,
        }  # fmt: skip
        voxels = {"origin_z": 0.0, "z_resolution": 0.05, "z_voxels": 16, "publish_voxel_map": False}
        return {
            "plugin": kind,
            "enabled": True,
            "max_obstacle_height": 2.0,
            **(voxels if kind == LOCAL_LAYER else {}),
            "observation_sources": lidar.name,
            lidar.name: source,
        }


def _corners(points: Iterable[tuple[float, float]]) -> str:
    """Return corners as Nav2 reads them: a text."""
    return f"[{', '.join(f'[{x:g}, {y:g}]' for x, y in points)}]"


def _whole(metres: float) -> int:
    """Return the size of a costmap; Nav2 takes whole metres."""
    if metres != round(metres):
        raise InputError(f"costmaps.local_size_m is {metres:g}; Nav2 takes whole metres.", code="nav2-whole-metres")
    return round(metres)


def new_nav2_params(
    robot: Robot | str | Path = DEFAULT_ROBOT,
    stack: StackLike = "nav2-dwb",
    options: Mapping[str, Any] | None = None,
    *,
    release: Release = "jazzy",
) -> str:
    """Return the Nav2 parameter file of a robot, with the parameters that a built-in stack drives it with.

    Args:
        stack: nav2-dwb, nav2-rpp or nav2-mppi.
        options: of that stack.

    Raises:
        InputError: the stack has no controller of Nav2.
    """
    given = robot if isinstance(robot, Robot) else load_robot(robot)
    return nav2_text(given, StackChoice.of(stack, options).driver, release)


# (node, parameter, Nav2's default where the file has none): wall-clock frequencies, times R.
FREQUENCIES: tuple[tuple[str, str, Any], ...] = (
    ("controller_server", "controller_frequency", 20.0),
    ("local_costmap", "update_frequency", 5.0),
    ("global_costmap", "update_frequency", 5.0),
    ("behavior_server", "cycle_frequency", 10.0),
    ("recoveries_server", "cycle_frequency", 10.0),
    ("velocity_smoother", "smoothing_frequency", 20.0),
    ("waypoint_follower", "loop_rate", 20),
)
# Limits that these loops multiply with one over their frequency, times R.
STEPS: tuple[tuple[str, str, Any], ...] = (
    ("velocity_smoother", "max_accel", [2.5, 0.0, 3.2]),
    ("velocity_smoother", "max_decel", [-2.5, 0.0, -3.2]),
)
# Limits on the wall time of work that takes as long at any speed, but is counted in simulated time, times R.
ALLOWANCES: tuple[tuple[str, str, Any], ...] = (
    ("controller_server", "costmap_update_timeout", 0.30),
    ("planner_server", "costmap_update_timeout", 1.0),
    ("bt_navigator", "default_server_timeout", 20),
)
BEHAVIOUR_LIMITS = ("acceleration_limit", "deceleration_limit")
TREES = {
    "default_nav_to_pose_bt_xml": "navigate_to_pose_w_replanning_and_recovery.xml",
    "default_nav_through_poses_bt_xml": "navigate_through_poses_w_replanning_and_recovery.xml",
}
"""The parameters of bt_navigator that name a tree, and the trees that Nav2 takes without them."""
CONTROL_HZ = 20.0
"""Nav2's default rate of velocity commands."""
BY_THE_CLOCK: tuple[Release, ...] = ("lyrical",)
"""Releases whose loops follow the simulated clock."""
NOT_SCALED = ("docking_server", "route_server", "collision_monitor")
_RATE = re.compile(r'(<RateController\b[^>]*?\bhz\s*=\s*")([^"]+)(")')


@dataclass(frozen=True)
class Change:
    """One parameter that was scaled."""

    name: str
    """`node.parameter`, or the file of a behaviour tree."""
    before: Any
    """None: not given, so Nav2's default was scaled."""
    after: Any

    def __str__(self) -> str:
        """Return the change in words."""
        before = "Nav2's default" if self.before is None else self.before
        return f"{self.name}: {before} becomes {self.after}"


@dataclass
class Scaled:
    """Parameters for a speed, what was changed, and what could not be."""

    values: dict[str, Any]
    changes: list[Change] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    trees: dict[str, str] = field(default_factory=dict)
    """Texts of scaled behaviour trees, by the parameter that names the file."""
    control_hz: float = CONTROL_HZ
    """The rate at which velocity commands come, in simulated time."""

    def text(self) -> str:
        """Return the parameter file."""
        return yaml.safe_dump(self.values, sort_keys=False, allow_unicode=True, width=120)

    def write(self, folder: Path) -> Path:
        """Write parameter file and trees; return the path of the first."""
        for name, text in self.trees.items():
            tree = folder / f"{name}.xml"
            tree.write_text(text)
            for values in _sections(self.values, "bt_navigator"):
                values[name] = str(tree)
        path = folder / "params.yaml"
        path.write_text(self.text())
        return path


def scale_file(path: Path, speed: float, release: Release) -> Scaled:
    """Read a Nav2 parameter file and return it for `speed` times real time.

    Raises:
        FileError: the file holds no parameters of Nav2 nodes.
    """
    document = read_yaml(path)
    values = document.value
    if not isinstance(values, dict) or not any(True for _ in _sections(values, "controller_server")):
        raise FileError(
            path,
            "this is no Nav2 parameter file: expected a controller_server with ros__parameters.",
            code="nav2-params",
        )
    return scale(values, speed, release)


def scale(values: dict[str, Any], speed: float, release: Release) -> Scaled:
    """Scale parameters in place; see the module."""
    made = Scaled(values)
    made.control_hz = _control_hz(values)
    if speed == 1.0:
        return made
    if release in BY_THE_CLOCK:
        _scale_trees(made, speed)
        return made
    for node, name, default in (*FREQUENCIES, *STEPS, *ALLOWANCES):
        for section in _sections(values, node):
            if name != "costmap_update_timeout" or release != "humble":
                _set(made, section, node, name, _times(section.get(name, default), speed))
    for node in ("behavior_server", "recoveries_server"):
        for section in _sections(values, node):
            _scale_behaviours(made, section, node, speed, release)
    for section in _sections(values, "bt_navigator"):
        period = section.get("bt_loop_duration", 10)
        _set(made, section, "bt_navigator", "bt_loop_duration", max(1, round(period / speed)))
        if round(period / speed) < 1:
            made.notes.append("bt_navigator.bt_loop_duration: 1 ms is the least; the tree ticks less often than at 1x")
    for section in _sections(values, "controller_server"):
        _scale_controllers(made, section, speed)
    for section in _sections(values, "velocity_smoother"):
        _fit_timer(made, section, speed)
    _scale_trees(made, speed)
    made.notes += [f"{node}: not scaled" for node in NOT_SCALED if any(map(_works, _sections(values, node)))]
    return made


def _sections(values: Any, node: str) -> Iterator[dict[str, Any]]:
    """Yield the parameters of a node, under whichever namespaces they stand."""
    if not isinstance(values, dict):
        return
    for key, inner in values.items():
        if not isinstance(inner, dict):
            continue
        if str(key).rstrip("/").rpartition("/")[2] == node and isinstance(inner.get("ros__parameters"), dict):
            yield inner["ros__parameters"]
        if key != "ros__parameters":
            yield from _sections(inner, node)


def _works(section: dict[str, Any]) -> bool:
    """Return whether a node has anything to do: a collision monitor whose polygons are all off has not."""
    polygons = section.get("polygons")
    if not isinstance(polygons, list):
        return True
    named = [section.get(name) for name in polygons]
    return any(not isinstance(each, dict) or each.get("enabled", True) for each in named)


def _set(made: Scaled, section: dict[str, Any], node: str, name: str, value: Any) -> None:
    before = section.get(name)
    if before != value:
        section[name] = value
        made.changes.append(Change(f"{node}.{name}", before, value))


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, list):
        return [_times(each, factor) for each in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return round(value * factor) if isinstance(value, int) else float(value * factor)


def _control_hz(values: dict[str, Any]) -> float:
    """Return the rate of velocity commands: that of the last node that shapes them."""
    for node, name in (("velocity_smoother", "smoothing_frequency"), ("controller_server", "controller_frequency")):
        for section in _sections(values, node):
            rate = section.get(name, CONTROL_HZ)
            if isinstance(rate, int | float) and rate > 0:
                return float(rate)
    return CONTROL_HZ


def _fit_timer(made: Scaled, section: dict[str, Any], speed: float) -> None:
    """Give the smoother the rate that it keeps: its timer cuts the period to whole milliseconds, its steps do not."""
    period_ms = 1000.0 / section["smoothing_frequency"]
    if period_ms > 1.0 and period_ms != int(period_ms):
        kept = int(100_000.0 / int(period_ms)) / 100.0  # just below, so that the cut gives the same milliseconds
        _set(made, section, "velocity_smoother", "smoothing_frequency", kept)
        made.control_hz = kept / speed
        made.notes.append(
            f"velocity_smoother: its timer takes whole milliseconds, so commands come at {made.control_hz:.4g} Hz"
        )


def _scale_behaviours(made: Scaled, section: dict[str, Any], node: str, speed: float, release: Release) -> None:
    for plugin in section.get("behavior_plugins", ["spin", "backup", "drive_on_heading", "wait"]):
        settings = section.get(plugin)
        if not isinstance(settings, dict):
            continue
        drives = any(word in str(settings.get("plugin", "")) for word in ("BackUp", "DriveOnHeading"))
        defaults = (2.5, -2.5) if release == "kilted" and drives else (None, None)
        for name, default in zip(BEHAVIOUR_LIMITS, defaults, strict=True):
            if (value := settings.get(name, default)) is not None:
                _set(made, settings, f"{node}.{plugin}", name, _times(value, speed))


def _scale_controllers(made: Scaled, section: dict[str, Any], speed: float) -> None:
    frequency = float(section.get("controller_frequency", 20.0 * speed)) / speed
    for name in section.get("controller_plugins", ["FollowPath"]):
        settings = section.get(name)
        if not isinstance(settings, dict):
            continue
        plugins = " ".join(str(settings.get(key, "")) for key in ("plugin", "primary_controller"))
        where = f"controller_server.{name}"
        if "LimitedAccelGenerator" in str(settings.get("trajectory_generator_name", "")):
            _set(made, settings, where, "sim_period", settings.get("sim_period", 1.0 / frequency))
        if any(kind in plugins for kind in ("RotationShim", "RegulatedPurePursuit")):
            _set(made, settings, where, "max_angular_accel", _times(settings.get("max_angular_accel", 3.2), speed))
            made.notes.append(
                f"{where}.max_angular_accel: scaled for its step per cycle; where the controller also computes a "
                "braking angle from it, turns end more abruptly than at 1x"
            )
        if "MPPI" in plugins:
            made.notes.append(
                f"{where}: MPPI moves its control sequence on by model_dt per cycle only where the controller's period "
                "equals it. model_dt is simulated time and stays; the sequence is not moved on. Prefer speed 1, or "
                "compare with a run at 1x."
            )


def _scale_trees(made: Scaled, speed: float) -> None:
    """Scale the RateControllers of the behaviour trees that bt_navigator uses."""
    for section in _sections(made.values, "bt_navigator"):
        for parameter, default in TREES.items():
            given = str(section.get(parameter) or "")
            path = Path(given) if given and "$(" not in given else _installed(Path(given).name if given else default)
            if path is None or not path.is_file():
                made.notes.append(
                    f"bt_navigator.{parameter}: the tree {given or default} was not found, so its RateController keeps "
                    "wall time. Source your ROS 2, or give the path of the file."
                )
                continue
            text = path.read_text()
            rates = [rate for _, rate, _ in _RATE.findall(text)]
            changed = _RATE.sub(lambda found: f"{found[1]}{_scaled_rate(found[2], speed)}{found[3]}", text)
            made.trees[parameter] = changed
            made.changes.append(Change(str(path), rates, [_scaled_rate(rate, speed) for rate in rates]))


def _scaled_rate(rate: str, speed: float) -> str:
    try:
        return f"{float(rate) * speed:.6g}"
    except ValueError:
        return rate  # a variable of the tree


def _installed(name: str) -> Path | None:
    """Return a behaviour tree that the sourced ROS 2 has installed."""
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        path = Path(prefix) / "share" / "nav2_bt_navigator" / "behavior_trees" / name
        if path.is_file():
            return path
    return None


def scale_nav2_params(path: str | Path, speed: float, release: Release = "jazzy") -> Scaled:
    """Return Nav2 parameters for `speed` times real time, with every change and what cannot be scaled."""
    return scale_file(Path(path), speed, release)
