"""Keys of Nav2's parameter files: those that RVSG simulates and what it calls them, and those that change nothing."""

from __future__ import annotations

import re

CONTROLLERS = {
    "DWBLocalPlanner": "nav2-dwb",
    "RegulatedPurePursuitController": "nav2-rpp",
    "MPPIController": "nav2-mppi",
}
PLANNING = {"use_astar": False, "allow_unknown": True, "use_final_approach_orientation": False}
"""Options of NavFn that cannot be chosen, with the value that is simulated."""
MONITORED = ("min_points", "slowdown_ratio", "linear_limit", "angular_limit", "time_before_collision",
             "simulation_time_step")  # fmt: skip
"""Options of the polygons of a collision monitor."""
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
AS_SIMULATED = {
    "rolling_window": True, "clearing": True, "marking": True, "data_type": "LaserScan",
    "raytrace_min_range": 0.0, "obstacle_min_range": 0.0, "bt_loop_duration": 10, "min_x_velocity_threshold": 0.001,
    "min_theta_velocity_threshold": 0.001, "track_unknown_space": True, "use_astar": False, "allow_unknown": True,
    "stateful": True,
    "open_loop": False, "cycle_frequency": 10.0, "use_path_orientations": False, "mode": 0,
    "symmetric_yaw_tolerance": False, "enforce_path_inversion": False, "enforce_path_rotation": False,
    "base_shift_correction": True, "min_speed_theta": 0.0, "lookahead_time": -1.0,
    "scale_velocities": False, "deadband_velocity": [0.0, 0.0, 0.0],
    "allow_partial_planning": False, "lethal_cost_threshold": 100, "trinary_costmap": True, "inf_is_valid": False,
    "prune_plan": True, "shorten_transformed_plan": True, "split_path": False, "use_dwa": False,
    "discretize_by_time": False, "time_granularity": 0.5, "include_last_point": True, "sum_scores": False,
    "aggregation_type": "last", "oscillation_reset_time": -1.0, "footprint_clearing_enabled": True,
    "observation_persistence": 0.0, "expected_update_rate": 0.0, "inflate_unknown": False,
    "inflate_around_unknown": False, "origin_x": 0.0, "origin_y": 0.0, "use_cancel_deceleration": False,
    "cancel_deceleration": 3.2, "interpolate_curvature_after_goal": False, "min_distance_to_obstacle": -1.0,
    "use_interpolation": True,
}  # fmt: skip
"""Values of keys that are what is simulated in any case."""
DWB = {
    "min_speed_m_s": "min_vel_x", "max_speed_m_s": "max_vel_x", "max_yaw_rate_rad_s": "max_vel_theta",
    "acceleration_m_s2": "acc_lim_x", "deceleration_m_s2": "decel_lim_x", "yaw_acceleration_rad_s2": "acc_lim_theta",
    "speed_samples": "vx_samples", "yaw_rate_samples": "vtheta_samples", "sim_time_s": "sim_time",
    "linear_granularity_m": "linear_granularity", "angular_granularity_rad": "angular_granularity",
    "prune_distance_m": "prune_distance", "stopped_m_s": "trans_stopped_velocity",
    "forward_point_m": "PathAlign.forward_point_distance", "slowing_factor": "RotateToGoal.slowing_factor",
    "rotate_to_goal_scale": "RotateToGoal.scale", "obstacle_scale": "BaseObstacle.scale",
    "goal_distance_scale": "GoalDist.scale", "goal_align_scale": "GoalAlign.scale",
    "path_distance_scale": "PathDist.scale", "path_align_scale": "PathAlign.scale",
    "oscillation_speed_m_s": "Oscillation.x_only_threshold",
    "oscillation_reset_m": "Oscillation.oscillation_reset_dist",
    "oscillation_reset_rad": "Oscillation.oscillation_reset_angle",
}  # fmt: skip
SCALES = {"RotateToGoal": "rotate_to_goal_scale", "GoalAlign": "goal_align_scale", "PathAlign": "path_align_scale",
          "PathDist": "path_distance_scale", "GoalDist": "goal_distance_scale"}  # fmt: skip
POSITIVE = ("max_speed_m_s", "max_yaw_rate_rad_s", "acceleration_m_s2", "deceleration_m_s2", "yaw_acceleration_rad_s2")
"""Limits for which 0 stands for none in Nav2: the robot's own hold."""
VECTORS = {
    "max_velocity": ("max_speed_m_s", "max_yaw_rate_rad_s"),
    "min_velocity": ("max_reverse_m_s", ""),
    "max_accel": ("acceleration_m_s2", "yaw_acceleration_rad_s2"),
    "max_decel": ("deceleration_m_s2", ""),
}
