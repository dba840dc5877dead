"""Message types that no ROS 2 base installation holds: those of HuNavSim and of Nav2's local planner and tree."""

from __future__ import annotations

from typing import Any

from rvsg.core.errors import InputError, how_to_install

HUNAV_TYPES = {
    "hunav_msgs/msg/AgentBehavior": """uint8 type
uint8 state
uint8 configuration
float32 duration
bool once
float32 vel
float32 dist
float32 social_force_factor
float32 goal_force_factor
float32 obstacle_force_factor
float32 other_force_factor
""",
    "hunav_msgs/msg/Agent": """std_msgs/Header header
int32 id
uint8 type
uint8 skin
string name
int8 group_id
geometry_msgs/Pose position
float32 yaw
geometry_msgs/Twist velocity
float32 desired_velocity
float32 radius
float32 linear_vel
float32 angular_vel
hunav_msgs/AgentBehavior behavior
geometry_msgs/Pose[] goals
bool cyclic_goals
float32 goal_radius
geometry_msgs/Point[] closest_obs
""",
    "hunav_msgs/msg/Agents": "std_msgs/Header header\nhunav_msgs/Agent[] agents\n",
}
"""The message definitions of HuNavSim 1.x (hunav_msgs), written from its interface description."""

NAV2_TYPES = {
    "nav_2d_msgs/msg/Twist2D": "float64 x\nfloat64 y\nfloat64 theta\n",
    "dwb_msgs/msg/Trajectory2D": """nav_2d_msgs/Twist2D velocity
builtin_interfaces/Duration[] time_offsets
geometry_msgs/Pose2D[] poses
""",
    "dwb_msgs/msg/CriticScore": "string name\nfloat32 raw_score\nfloat32 scale\n",
    "dwb_msgs/msg/TrajectoryScore": "dwb_msgs/Trajectory2D traj\ndwb_msgs/CriticScore[] scores\nfloat32 total\n",
    "dwb_msgs/msg/LocalPlanEvaluation": """std_msgs/Header header
dwb_msgs/TrajectoryScore[] twists
uint16 best_index
uint16 worst_index
""",
    "nav2_msgs/msg/BehaviorTreeStatusChange": """builtin_interfaces/Time timestamp
string node_name
string previous_status
string current_status
""",
    "nav2_msgs/msg/BehaviorTreeLog": """builtin_interfaces/Time timestamp
nav2_msgs/BehaviorTreeStatusChange[] event_log
""",
}
"""The message definitions of Nav2 (Humble), written from its interface description."""


def rosbags_types() -> Any:
    """Return the ROS 2 message types with those of HuNavSim and Nav2; InputError where rosbags is not installed."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise InputError(f"Bags need rosbags: {how_to_install('bag')}.") from None
    types = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in (HUNAV_TYPES | NAV2_TYPES).items():
        types.register(get_types_from_msg(text, name))
    return types
