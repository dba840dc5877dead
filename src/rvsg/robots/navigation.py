"""Parameters of a Nav2-like navigation stack. The defaults are those of Nav2 (Humble) and its bring-up."""

from __future__ import annotations

from typing import Annotated, Literal

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
    max_lateral_m_s: Annotated[float, Field(ge=0, exclude_if=lambda speed: speed == 0.0)] = 0.0
    """How fast the planner moves to either side; 0: it samples no lateral speed."""
    lateral_samples: Annotated[int, Field(ge=2, le=50, exclude_if=lambda count: count == 5)] = 5
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
    smoothed: Annotated[bool, Field(exclude_if=lambda smoothed: not smoothed)] = False
    """Whether recoveries drive through the velocity smoother (Nav2 Jazzy and later) or past it (Humble, Iron)."""
    waits_for_costmaps: Annotated[bool, Field(exclude_if=lambda waits: not waits)] = False
    """Whether planner and controller wait for the next regular update of a costmap that was cleared, as in Nav2; else
    it is updated at once. With it, the robot also does not go on with a plan where the next one cannot be made."""
    gives_up_without_plan: Annotated[bool, Field(exclude_if=lambda gives_up: not gives_up)] = False
    """Whether the navigation fails where the next plan on the way cannot be made (Nav2 Jazzy and later, whose default
    tree has no recovery for the error of an empty path); else that is tried again, or the recovery begins (Humble)."""


class Planner(Record):
    """The plug-in of the planner server, with Nav2's names and defaults."""

    kind: Literal["navfn", "smac_2d", "theta_star"] = "navfn"
    """`navfn` takes its tolerance from the behaviours."""
    tolerance: NotNegative = 0.125
    """Of Smac 2D: how far from the goal a path may end, m."""
    cost_travel_multiplier: NotNegative = 1.0
    """Of Smac 2D."""
    w_euc_cost: Positive = 1.0
    """Of Theta*."""
    w_traversal_cost: NotNegative = 2.0
    """Of Theta*."""


class MonitorPolygon(Record):
    """A polygon of nav2_collision_monitor, with Nav2's names and defaults; it scales every command, recoveries too."""

    name: str
    action_type: Literal["stop", "slowdown", "limit", "approach"]
    points: Annotated[tuple[tuple[float, float], ...], Field(min_length=3, max_length=100)] | None = None
    """Corners in the base frame, m; None: the robot's padded footprint."""
    min_points: Annotated[int, Field(ge=1)] = 4
    slowdown_ratio: Annotated[float, Field(ge=0, le=1)] = 0.5
    linear_limit: NotNegative = 0.5
    angular_limit: NotNegative = 0.5
    time_before_collision: Annotated[float, Field(gt=0, le=20)] = 2.0
    simulation_time_step: Annotated[float, Field(ge=0.01, le=5)] = 0.1


class Navigation(Record):
    """All parameters of the stack that drives a robot."""

    smoother: Smoother = Smoother()
    dwb: Dwb = Dwb()
    costmaps: Costmaps = Costmaps()
    behaviours: Behaviours = Behaviours()
    planner: Annotated[Planner, Field(exclude_if=lambda planner: planner == Planner())] = Planner()
    collision_monitor: Annotated[tuple[MonitorPolygon, ...], Field(exclude_if=lambda polygons: not polygons)] = ()
