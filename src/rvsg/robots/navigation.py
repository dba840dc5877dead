"""Parameters of a Nav2-like navigation stack. The defaults are those of Nav2 (Humble) and its bring-up."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from rvsg.core.records import Record

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class Smoother(Record):
    """nav2_velocity_smoother. A limit that is None is the robot's own."""

    frequency_hz: Annotated[float, Field(gt=0, le=100)] = 20.0
    max_speed_m_s: NotNegative | None = None
    max_reverse_m_s: NotNegative | None = None
    max_yaw_rate_rad_s: Positive | None = None
    acceleration_m_s2: Positive | None = None
    deceleration_m_s2: Positive | None = None
    yaw_acceleration_rad_s2: Positive | None = None
    timeout_s: Positive = 1.0


class Dwb(Record):
    """dwb_core::DWBLocalPlanner with its seven default critics. A limit that is None is the robot's own."""

    min_speed_m_s: float = 0.0
    max_speed_m_s: Positive | None = None
    max_yaw_rate_rad_s: Positive | None = None
    acceleration_m_s2: Positive | None = None
    deceleration_m_s2: Positive | None = None
    yaw_acceleration_rad_s2: Positive | None = None
    speed_samples: Annotated[int, Field(ge=2, le=200)] = 20
    yaw_rate_samples: Annotated[int, Field(ge=2, le=200)] = 20
    sim_time_s: Annotated[float, Field(gt=0, le=10)] = 1.7
    linear_granularity_m: Positive = 0.05
    angular_granularity_rad: Positive = 0.025
    prune_distance_m: Positive = 2.0
    forward_point_m: NotNegative = 0.1
    stopped_m_s: NotNegative = 0.25
    slowing_factor: NotNegative = 5.0
    rotate_to_goal_scale: NotNegative = 32.0
    obstacle_scale: NotNegative = 0.02
    goal_distance_scale: NotNegative = 24.0
    goal_align_scale: NotNegative = 24.0
    path_distance_scale: NotNegative = 32.0
    path_align_scale: NotNegative = 32.0
    oscillation_speed_m_s: NotNegative = 0.05
    oscillation_reset_m: NotNegative = 0.05
    oscillation_reset_rad: NotNegative = 0.2
    check_footprint: bool = False
    """Check the whole footprint along a trajectory (Nav2's ObstacleFootprint), not only its centre (BaseObstacle)."""


class Costmaps(Record):
    """The rolling local and the global costmap."""

    local_size_m: Annotated[float, Field(gt=0, le=20)] = 3.0
    local_resolution_m: Annotated[float, Field(ge=0.01, le=0.5)] = 0.05
    local_update_hz: Annotated[float, Field(gt=0, le=100)] = 5.0
    global_update_hz: Annotated[float, Field(gt=0, le=100)] = 1.0
    local_inflation_m: Positive = 0.55
    local_cost_scaling: Positive = 3.0
    global_inflation_m: Positive = 0.55
    global_cost_scaling: Positive = 3.0
    obstacle_range_m: Positive = 2.5
    clearing_range_m: Positive = 3.0


class Behaviours(Record):
    """Controller server, progress and goal checkers, planner tolerance and recoveries."""

    controller_hz: Annotated[float, Field(gt=0, le=100)] = 20.0
    failure_tolerance_s: NotNegative = 0.3
    progress_m: Positive = 0.5
    progress_s: Positive = 10.0
    goal_tolerance_m: Positive = 0.25
    goal_tolerance_rad: Positive = 0.25
    planner_tolerance_m: NotNegative = 0.5
    spin_rad: Positive = 1.57
    spin_max_rad_s: Positive = 1.0
    spin_min_rad_s: Positive = 0.4
    spin_acceleration_rad_s2: Positive = 3.2
    back_up_m: Positive = 0.30
    back_up_m_s: Positive = 0.05
    wait_s: NotNegative = 5.0
    look_ahead_s: NotNegative = 2.0
    recoveries: Annotated[int, Field(ge=0, le=100)] = 6


class Navigation(Record):
    """All parameters of the stack that drives a robot."""

    smoother: Smoother = Smoother()
    dwb: Dwb = Dwb()
    costmaps: Costmaps = Costmaps()
    behaviours: Behaviours = Behaviours()
