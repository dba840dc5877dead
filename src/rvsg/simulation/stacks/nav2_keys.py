"""The table of Nav2's keys: which a run honours and where it takes them, and which have no effect, and why.

The reader, the editor and the writer of parameter files go by it.
"""

from __future__ import annotations

import re

CONTROLLERS = {
    "DWBLocalPlanner": "nav2-dwb",
    "RegulatedPurePursuitController": "nav2-rpp",
    "MPPIController": "nav2-mppi",
}
OPTIONS: dict[str, dict[str, str]] = {
    "controller_server": {"controller_frequency": "behaviours.controller_hz",
                          "failure_tolerance": "behaviours.failure_tolerance_s"},
    "progress checker": {"required_movement_radius": "behaviours.progress_m",
                         "movement_time_allowance": "behaviours.progress_s"},
    "goal checker": {"xy_goal_tolerance": "behaviours.goal_tolerance_m",
                     "yaw_goal_tolerance": "behaviours.goal_tolerance_rad"},
    "planner": {"tolerance": "behaviours.planner_tolerance_m"},
    "behavior_server": {"max_rotational_vel": "behaviours.spin_max_rad_s",
                        "min_rotational_vel": "behaviours.spin_min_rad_s",
                        "rotational_acc_lim": "behaviours.spin_acceleration_rad_s2",
                        "simulate_ahead_time": "behaviours.look_ahead_s"},
    "velocity_smoother": {"smoothing_frequency": "smoother.frequency_hz", "velocity_timeout": "smoother.timeout_s",
                          "max_velocity.0": "smoother.max_speed_m_s", "max_velocity.2": "smoother.max_yaw_rate_rad_s",
                          "min_velocity.0": "smoother.max_reverse_m_s", "max_accel.0": "smoother.acceleration_m_s2",
                          "max_accel.2": "smoother.yaw_acceleration_rad_s2",
                          "max_decel.0": "smoother.deceleration_m_s2"},
    "local_costmap": {"width": "costmaps.local_size_m", "resolution": "costmaps.local_resolution_m",
                      "update_frequency": "costmaps.local_update_hz"},
    "local InflationLayer": {"inflation_radius": "costmaps.local_inflation_m",
                             "cost_scaling_factor": "costmaps.local_cost_scaling"},
    "local source": {"obstacle_max_range": "costmaps.obstacle_range_m",
                     "raytrace_max_range": "costmaps.clearing_range_m"},
    "global_costmap": {"update_frequency": "costmaps.global_update_hz"},
    "global InflationLayer": {"inflation_radius": "costmaps.global_inflation_m",
                              "cost_scaling_factor": "costmaps.global_cost_scaling"},
}  # fmt: skip
"""By the kind of section: Nav2's keys, and where they are among the options of a stack; `.0` is the first of a list.
Those of controllers and of polygons of the collision monitor are the fields of their records, under Nav2's names."""
ACTIONS = ("stop", "slowdown", "limit", "approach")
"""What polygons of the collision monitor do that are simulated."""
SPEED_FILTERS = {1: "speed_percent", 2: "speed_m_s"}
"""Types of filter infos, beside 0, keepout."""
CHECKERS = ("SimpleProgressChecker", "SimpleGoalChecker", "StoppedGoalChecker")
LAYERS = ("StaticLayer", "ObstacleLayer", "VoxelLayer", "InflationLayer")
CRITICS = ("RotateToGoal", "Oscillation", "BaseObstacle", "ObstacleFootprint", "GoalAlign", "PathAlign", "PathDist",
           "GoalDist")  # fmt: skip
"""DWB's critics."""
SERVERS = ("controller_server", "local_costmap", "global_costmap", "planner_server", "bt_navigator", "behavior_server",
           "recoveries_server", "velocity_smoother", "collision_monitor")  # fmt: skip
"""Nodes that a parameter file of Nav2 has some of."""
OUTSIDE = (
    "map_server", "map_saver", "amcl", "waypoint_follower", "docking_server", "route_server", "robot_state_publisher",
    "loopback_simulator", "lifecycle_manager", "smoother_server",
    "keepout_filter_mask_server", "speed_filter_mask_server",
    "keepout_costmap_filter_info_server", "speed_costmap_filter_info_server", "costmap_filter_info_server",
    "filter_mask_server", "following_server", "collision_detector",
)  # fmt: skip
"""Nodes that have no part in a run here; `smoother_server` is not called by Nav2's default behaviour tree of Humble."""
WORDS = re.compile(
    r"(topic|frame|frame_id|use_sim_time|publish|visuali[sz]e|debug|groot|bond|introspection|qos|service|transform_tolerance"
    r"|realtime|server_timeout|source_timeout|stop_pub_timeout|terminal_checking_interval|expected_planner_frequency|odom_duration|filter_duration|stamp_smoothed|map_subscribe|result_timeout|update_timeout|navigators|always_send_full|plugin_lib_names|rviz|verbose|tf_broadcast|error_code|blackboard_id|cancel_timeout|stamped_cmd_vel)"
)
PLANAR = re.compile(
    r"(z_|origin_z|obstacle_height|m(in|ax)_height|mark_threshold|unknown_threshold|combination_method)"
)
SIDEWAYS = re.compile(
    r"(_y$|^vy_|^ay_|_xy$|min_y_|AckermannConstraints|short_circuit|TrajectoryVisualizer|regenerate_noises)"
)
SIDEWAYS_NOTE = "sideways motion that is not asked for, or computing time"
IDLE = ((WORDS, "transport, time or display"), (PLANAR, "the lidars are planar"), (SIDEWAYS, SIDEWAYS_NOTE))
"""Keys that change no motion in lock-step without delays, and why."""
FIXED = {
    "use_astar": (False, "False is simulated"),
    "allow_unknown": (True, "True is simulated"),
    "use_final_approach_orientation": (False, "False is simulated"),
    "stateful": (True, "the goal checker keeps that the place was reached"),
    "feedback": ("OPEN_LOOP", "the smoother works in open loop"),
    "scale_velocities": (False, "each velocity is limited by itself"),
    "deadband_velocity": ([0.0, 0.0, 0.0], "there is no dead band"),
    "use_dynamic_window": (False, "the dynamic window of pure pursuit is not simulated"),
    "cost_power": (1, "only the power 1 is simulated"),
}
"""Keys with the value that is simulated in any case, and why another is not supported."""
AS_SIMULATED = {
    "rolling_window": True, "clearing": True, "marking": True, "data_type": "LaserScan",
    "raytrace_min_range": 0.0, "obstacle_min_range": 0.0, "bt_loop_duration": 10, "min_x_velocity_threshold": 0.001,
    "min_theta_velocity_threshold": 0.001, "track_unknown_space": True,
    "open_loop": False, "cycle_frequency": 10.0, "use_path_orientations": False, "mode": 0,
    "symmetric_yaw_tolerance": False, "enforce_path_inversion": False, "enforce_path_rotation": False,
    "base_shift_correction": True, "min_speed_theta": 0.0, "lookahead_time": -1.0,
    "allow_partial_planning": False, "lethal_cost_threshold": 100, "trinary_costmap": True, "inf_is_valid": False,
    "prune_plan": True, "shorten_transformed_plan": True, "split_path": False, "use_dwa": False,
    "discretize_by_time": False, "time_granularity": 0.5, "include_last_point": True, "sum_scores": False,
    "aggregation_type": "last", "oscillation_reset_time": -1.0, "footprint_clearing_enabled": True,
    "observation_persistence": 0.0, "expected_update_rate": 0.0, "inflate_unknown": False,
    "inflate_around_unknown": False, "origin_x": 0.0, "origin_y": 0.0, "use_cancel_deceleration": False,
    "cancel_deceleration": 3.2, "interpolate_curvature_after_goal": False, "min_distance_to_obstacle": -1.0,
    "use_interpolation": True,
}  # fmt: skip
"""As `FIXED`, where nothing but that can be said of another value."""
DWB = {
    "min_vel_x": "min_speed_m_s", "max_vel_x": "max_speed_m_s", "max_vel_theta": "max_yaw_rate_rad_s",
    "acc_lim_x": "acceleration_m_s2", "decel_lim_x": "deceleration_m_s2", "acc_lim_theta": "yaw_acceleration_rad_s2",
    "vx_samples": "speed_samples", "vtheta_samples": "yaw_rate_samples", "max_vel_y": "max_lateral_m_s",
    "vy_samples": "lateral_samples", "sim_time": "sim_time_s", "linear_granularity": "linear_granularity_m",
    "angular_granularity": "angular_granularity_rad", "prune_distance": "prune_distance_m",
    "trans_stopped_velocity": "stopped_m_s", "PathAlign.forward_point_distance": "forward_point_m",
    "RotateToGoal.slowing_factor": "slowing_factor", "RotateToGoal.scale": "rotate_to_goal_scale",
    "BaseObstacle.scale": "obstacle_scale", "GoalDist.scale": "goal_distance_scale",
    "GoalAlign.scale": "goal_align_scale", "PathDist.scale": "path_distance_scale",
    "PathAlign.scale": "path_align_scale", "Oscillation.x_only_threshold": "oscillation_speed_m_s",
    "Oscillation.oscillation_reset_dist": "oscillation_reset_m",
    "Oscillation.oscillation_reset_angle": "oscillation_reset_rad",
}  # fmt: skip
"""DWB's parameters, and what a robot's `navigation.dwb` calls them."""
SAME_AS = {
    "GoalAlign.forward_point_distance": "PathAlign.forward_point_distance", "decel_lim_theta": "acc_lim_theta",
    "acc_lim_y": "acc_lim_x", "decel_lim_y": "acc_lim_x",
}  # fmt: skip
"""DWB's parameters that are simulated as others are."""
NEGATIVE = frozenset({"min_velocity", "max_decel", "decel_lim_x"})
"""Limits that Nav2 gives below zero."""
