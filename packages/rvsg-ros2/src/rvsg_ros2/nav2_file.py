"""A Nav2 parameter file for a robot of RVSG: the same parameters that a built-in stack drives it with.

`rvsg.simulation.stacks.nav2_params` reads such files; what this module writes, it reads back without a loss, but for
what the release decides: recoveries pass the velocity smoother from Jazzy on.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import yaml

from rvsg.core.errors import InputError
from rvsg.robots.navigation import MonitorPolygon
from rvsg.robots.robot import Robot
from rvsg.simulation.embedded.stack import planned_range, speeds
from rvsg.simulation.stacks.configured import Configured, Nav2Settings
from rvsg.simulation.stacks.mppi import Mppi
from rvsg.simulation.stacks.nav2_dwb import Nav2Dwb
from rvsg.simulation.stacks.nav2_keys import MONITORED, PLANNING
from rvsg.simulation.stacks.protocol import NavigationStack
from rvsg.simulation.stacks.pure_pursuit import PurePursuit
from rvsg_ros2.interfaces import Release
from rvsg_ros2.options import Ros2Options
from rvsg_ros2.robot_side import scan_topic

LOCAL_LAYER, GLOBAL_LAYER = "nav2_costmap_2d::VoxelLayer", "nav2_costmap_2d::ObstacleLayer"
PLANNERS = {
    "navfn": ("nav2_navfn_planner", "NavfnPlanner"),
    "smac_2d": ("nav2_smac_planner", "SmacPlanner2D"),
    "theta_star": ("nav2_theta_star_planner", "ThetaStarPlanner"),
}
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
        planner = self.robot.navigation.planner
        package, name = PLANNERS[planner.kind]
        chosen: dict[str, dict[str, Any]] = {
            "navfn": {"tolerance": self.robot.navigation.behaviours.planner_tolerance_m},
            "smac_2d": {"tolerance": planner.tolerance, "cost_travel_multiplier": planner.cost_travel_multiplier},
            "theta_star": {"w_euc_cost": planner.w_euc_cost, "w_traversal_cost": planner.w_traversal_cost},
        }
        return {"plugin": f"{package}{self.separator}{name}", **chosen[planner.kind], **PLANNING[planner.kind]}

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
