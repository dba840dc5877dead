"""A robot and its navigation parameters as numbers that the kernels read by reference."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.robots.polygons import distance, inside, padded, reach, rectangle
from rvsg.robots.robot import Robot

Floats = NDArray[np.float64]


TICKS_PER_S = 100
ACTIONS = ("stop", "slowdown", "limit", "approach")
# Columns of the table of lidars: place in the base, bearing of the middle ray, field of view, number of rays, ranges,
# period in ticks of 10 ms, standard deviation of a range, share of rays without a return.
(LIDAR_X, LIDAR_Y, LIDAR_YAW, LIDAR_VIEW, LIDAR_RAYS, LIDAR_MIN, LIDAR_MAX, LIDAR_TICKS, LIDAR_NOISE,
 LIDAR_DROPOUT) = range(10)  # fmt: skip


class Stack(NamedTuple):
    """What of a robot the kernels read; SI units. `dwb_*`: of the local planner, the others of the whole stack."""

    footprint: Floats
    """(K, 2) corners with padding."""
    outline: Floats
    """(K, 2) corners of the body."""
    lidars: Floats
    """(L, 10), see the names of its columns."""
    radius: float
    imu_behind: float
    enforced: bool
    """The base keeps to the limits below; else it takes on every velocity at once."""
    base_v: float
    base_reverse: float
    base_w: float
    base_side: float
    """How fast it moves sideways; 0: it does not."""
    base_acc: float
    base_dec: float
    base_acc_w: float
    base_jerk: float
    """0: no limit."""
    latency_ticks: int
    bumper_s: float
    """How long contact stops the drive."""
    wheelbase: float
    """0: the robot turns on the spot."""
    max_steering: float
    steering_rate: float
    """rad/s; 0: no limit."""
    curvature: float
    """Largest curvature of the path, 1/m."""
    zones: Floats
    """(Z, 6) safety zones: highest speed, watched from which speed, release time, first and end row of `zone_corners`,
    and whether it lies ahead of the base (1), behind it (-1) or around it (0)."""
    zone_corners: Floats
    """(K, 2) corners of the safety zones in the base frame."""
    monitor: Floats
    """(M, 9) polygons of the collision monitor, see `perception`."""
    monitor_corners: Floats
    """(K, 2) corners of these polygons in the base frame."""
    monitor_reach: float
    """How far from the base frame anything may concern a polygon, m."""
    smoother_period: float
    max_v: float
    min_v: float
    max_w: float
    step_v: float
    step_down_v: float
    step_w: float
    command_timeout: float
    cells: int
    resolution: float
    local_period: float
    global_period: float
    obstacle_range: float
    clearing_range: float
    margin: float
    """How far the global costmap is merged beyond the clearing range: 1.5 m, or the farthest lidar and one metre."""
    scan_reach: float
    """How far a scan is cast: nothing beyond concerns a costmap."""
    control_period: float
    patience: float
    progress_m: float
    progress_s: float
    xy_tolerance: float
    yaw_tolerance: float
    plan_tolerance: float
    spin_rad: float
    max_spin: float
    min_spin: float
    spin_acc: float
    back_up_m: float
    back_up_v: float
    wait_s: float
    look_ahead_s: float
    recoveries: int
    recoveries_direct: bool
    """They drive past the velocity smoother."""
    waits_for_maps: bool
    """A cleared costmap is updated when its next update is due, not at once."""
    gives_up_without_plan: bool
    """The navigation fails where the next plan on the way cannot be made."""
    dwb_acc_v: float
    dwb_dec_v: float
    dwb_acc_w: float
    dwb_min_v: float
    dwb_max_v: float
    dwb_max_w: float
    dwb_v_samples: int
    dwb_w_samples: int
    dwb_max_side: float
    dwb_side_samples: int
    dwb_sim_time: float
    dwb_linear: float
    dwb_angular: float
    dwb_whole_range: bool
    """The dynamic window always holds the whole range of velocities, so the table of samples is fixed."""
    dwb_footprint: bool
    dwb_window: float
    dwb_prune: float
    dwb_forward_point: float
    dwb_stopped: float
    dwb_slowing: float
    dwb_rotate: float
    dwb_obstacle: float
    dwb_goal_dist: float
    dwb_goal_align: float
    dwb_path_dist: float
    dwb_path_align: float
    dwb_oscillation_v: float
    dwb_oscillation_m: float
    dwb_oscillation_rad: float


def padded_footprint(robot: Robot) -> Floats:
    """Return the corners of the footprint with Nav2's padding, (K, 2)."""
    return np.array(padded(robot.footprint, robot.padding_m), np.float64)


def inscribed_radius(robot: Robot) -> float:
    """Return the distance of the padded footprint's nearest side from the base frame.

    Nav2 computes it a little short (0.24999999977 for 0.25), so cells at exactly that distance are not inscribed.
    """
    return distance(padded(robot.footprint, robot.padding_m), 0.0, 0.0) - 2.3e-10


def scan_reach(robot: Robot) -> float:
    """Return how far a scan is cast for costmaps and safety zones, m."""
    zones = max((reach(zone.polygon) for zone in robot.safety_zones), default=0.0)
    return max(robot.navigation.costmaps.clearing_range_m, zones, monitor_reach(robot)) + 0.5


def monitor_reach(robot: Robot) -> float:
    """Return how far from the base frame anything may concern the collision monitor, m; 0 without one."""
    found = 0.0
    for polygon in robot.navigation.collision_monitor:
        moves = polygon.time_before_collision if polygon.action_type == "approach" else 0.0
        fastest = max(robot.limits.speed_m_s, robot.limits.reverse_m_s, robot.limits.lateral_m_s)
        corners = polygon.points or padded(robot.footprint, robot.padding_m)
        # A scan is a tenth of a second old at most, but for slow lidars.
        found = max(found, reach(corners) + fastest * (moves + polygon.simulation_time_step + 0.5))
    return found


def speeds(robot: Robot) -> tuple[float, float, float]:
    """Return the highest forward speed (m/s), reverse speed (m/s) and yaw rate (rad/s) that the smoother lets pass."""
    smoother, limits = robot.navigation.smoother, robot.limits
    return (
        _first(smoother.max_speed_m_s, limits.speed_m_s),
        _first(smoother.max_reverse_m_s, limits.reverse_m_s),
        _first(smoother.max_yaw_rate_rad_s, limits.yaw_rate_rad_s),
    )


class PlannedRange(NamedTuple):
    """The velocities and accelerations that the local planner plans with, SI units."""

    low: float
    high: float
    turn: float
    side: float
    """To the left and to the right; 0: no lateral motion is planned."""
    acceleration: float
    deceleration: float
    yaw_acceleration: float

    def whole_range(self, sim_time_s: float) -> bool:
        """Whether the planner samples v and w alone, each within reach of every other while a rollout lasts."""
        if self.side > 0.0:
            return False
        reach = min(self.acceleration, self.deceleration) * sim_time_s
        return reach >= self.high - self.low and self.yaw_acceleration * sim_time_s >= 2.0 * self.turn


def planned_range(robot: Robot) -> PlannedRange:
    """Return the velocities that the local planner of a robot samples."""
    dwb, limits = robot.navigation.dwb, robot.limits
    return PlannedRange(
        low=dwb.min_speed_m_s,
        high=_first(dwb.max_speed_m_s, limits.speed_m_s),
        turn=_first(dwb.max_yaw_rate_rad_s, limits.yaw_rate_rad_s),
        side=min(dwb.max_lateral_m_s, limits.lateral_m_s),
        acceleration=_first(dwb.acceleration_m_s2, limits.acceleration_m_s2),
        deceleration=_first(dwb.deceleration_m_s2, limits.deceleration_m_s2),
        yaw_acceleration=_first(dwb.yaw_acceleration_rad_s2, limits.yaw_acceleration_rad_s2),
    )


def stack_of(robot: Robot) -> Stack:
    """Return a robot's numbers for the kernels."""
    navigation, limits = robot.navigation, robot.limits
    smoother, dwb, maps, behaviours = navigation.smoother, navigation.dwb, navigation.costmaps, navigation.behaviours
    forward, reverse, turn = speeds(robot)
    planned = planned_range(robot)
    zones, corners = _zones(robot)
    polygons, polygon_corners = _monitor(robot)
    return Stack(
        footprint=padded_footprint(robot),
        outline=np.array(robot.outline, np.float64),
        lidars=_lidars(robot),
        radius=robot.radius_m,
        imu_behind=-robot.imu.x,
        monitor=polygons,
        monitor_corners=polygon_corners,
        monitor_reach=monitor_reach(robot),
        smoother_period=1.0 / smoother.frequency_hz,
        max_v=forward,
        min_v=-reverse,
        max_w=turn,
        step_v=_first(smoother.acceleration_m_s2, limits.acceleration_m_s2) / smoother.frequency_hz,
        step_down_v=_first(smoother.deceleration_m_s2, limits.deceleration_m_s2) / smoother.frequency_hz,
        step_w=_first(smoother.yaw_acceleration_rad_s2, limits.yaw_acceleration_rad_s2) / smoother.frequency_hz,
        command_timeout=smoother.timeout_s,
        cells=round(maps.local_size_m / maps.local_resolution_m),
        resolution=maps.local_resolution_m,
        local_period=1.0 / maps.local_update_hz,
        global_period=1.0 / maps.global_update_hz,
        obstacle_range=maps.obstacle_range_m,
        clearing_range=maps.clearing_range_m,
        margin=max(1.5, 1.0 + max(math.hypot(q.x, q.y) for q in robot.lidars)),
        scan_reach=scan_reach(robot),
        control_period=1.0 / behaviours.controller_hz,
        patience=behaviours.failure_tolerance_s,
        progress_m=behaviours.progress_m,
        progress_s=behaviours.progress_s,
        xy_tolerance=behaviours.goal_tolerance_m,
        yaw_tolerance=behaviours.goal_tolerance_rad,
        plan_tolerance=behaviours.planner_tolerance_m,
        spin_rad=behaviours.spin_rad,
        max_spin=behaviours.spin_max_rad_s,
        min_spin=behaviours.spin_min_rad_s,
        spin_acc=behaviours.spin_acceleration_rad_s2,
        back_up_m=behaviours.back_up_m,
        back_up_v=behaviours.back_up_m_s,
        wait_s=behaviours.wait_s,
        look_ahead_s=behaviours.look_ahead_s,
        recoveries=behaviours.recoveries,
        recoveries_direct=not behaviours.smoothed,
        waits_for_maps=behaviours.waits_for_costmaps,
        gives_up_without_plan=behaviours.gives_up_without_plan,
        enforced=limits.enforced,
        base_v=limits.speed_m_s,
        base_reverse=limits.reverse_m_s,
        base_w=limits.yaw_rate_rad_s,
        base_side=limits.lateral_m_s,
        base_acc=limits.acceleration_m_s2,
        base_dec=limits.deceleration_m_s2,
        base_acc_w=limits.yaw_acceleration_rad_s2,
        base_jerk=limits.jerk_m_s3 or 0.0,
        latency_ticks=round(robot.latency_s * TICKS_PER_S),
        bumper_s=robot.bumper.release_s if robot.bumper else 0.0,
        wheelbase=robot.drive.wheelbase_m or 0.0,
        max_steering=robot.drive.max_steering_rad or 0.0,
        steering_rate=robot.drive.steering_rate_rad_s or 0.0,
        curvature=min(1e9, robot.drive.max_curvature),
        zones=zones,
        zone_corners=corners,
        dwb_acc_v=planned.acceleration,
        dwb_dec_v=planned.deceleration,
        dwb_acc_w=planned.yaw_acceleration,
        dwb_min_v=planned.low,
        dwb_max_v=planned.high,
        dwb_max_w=planned.turn,
        dwb_v_samples=dwb.speed_samples,
        dwb_w_samples=dwb.yaw_rate_samples,
        dwb_max_side=planned.side,
        dwb_side_samples=dwb.lateral_samples,
        dwb_sim_time=dwb.sim_time_s,
        dwb_linear=dwb.linear_granularity_m,
        dwb_angular=dwb.angular_granularity_rad,
        dwb_whole_range=planned.whole_range(dwb.sim_time_s)
        and math.isinf(robot.drive.max_curvature)
        and all(each.kind == "keepout" for each in navigation.costmap_filters),
        dwb_footprint=dwb.check_footprint,
        dwb_window=0.5 * maps.local_size_m,
        dwb_prune=dwb.prune_distance_m,
        dwb_forward_point=dwb.forward_point_m,
        dwb_stopped=dwb.stopped_m_s,
        dwb_slowing=dwb.slowing_factor,
        dwb_rotate=dwb.rotate_to_goal_scale,
        dwb_obstacle=dwb.obstacle_scale,
        dwb_goal_dist=dwb.goal_distance_scale * maps.local_resolution_m / 2.0,
        dwb_goal_align=dwb.goal_align_scale * maps.local_resolution_m / 2.0,
        dwb_path_dist=dwb.path_distance_scale * maps.local_resolution_m / 2.0,
        dwb_path_align=dwb.path_align_scale * maps.local_resolution_m / 2.0,
        dwb_oscillation_v=dwb.oscillation_speed_m_s,
        dwb_oscillation_m=dwb.oscillation_reset_m,
        dwb_oscillation_rad=dwb.oscillation_reset_rad,
    )


def _lidars(robot: Robot) -> Floats:
    rows = [
        (q.x, q.y, q.yaw, q.field_of_view_rad, q.rays, q.min_range_m, q.max_range_m,
         max(1, round(TICKS_PER_S / q.rate_hz)), q.noise_m, q.dropout)
        for q in robot.lidars
    ]  # fmt: skip
    return np.array(rows, np.float64)


def _zones(robot: Robot) -> tuple[Floats, Floats]:
    rows: list[tuple[float, ...]] = []
    corners: list[tuple[float, float]] = []
    for zone in robot.safety_zones:
        begin = len(corners)
        corners += list(zone.polygon)
        (rear, _), (front, _) = rectangle(zone.polygon)
        side = 0.0 if inside(zone.polygon, 0.0, 0.0) else 1.0 if front + rear > 0.0 else -1.0
        rows.append((zone.speed_m_s, zone.from_speed_m_s, zone.release_s, begin, len(corners), side))
    return np.array(rows, np.float64).reshape(-1, 6), np.array(corners, np.float64).reshape(-1, 2)


def _monitor(robot: Robot) -> tuple[Floats, Floats]:
    rows: list[tuple[float, ...]] = []
    corners: list[tuple[float, float]] = []
    for q in robot.navigation.collision_monitor:
        begin = len(corners)
        corners += list(q.points or padded(robot.footprint, robot.padding_m))
        rows.append(
            (ACTIONS.index(q.action_type), q.min_points, q.slowdown_ratio, q.linear_limit, q.angular_limit,
             q.time_before_collision, q.simulation_time_step, begin, len(corners))
        )  # fmt: skip
    return np.array(rows, np.float64).reshape(-1, 9), np.array(corners, np.float64).reshape(-1, 2)


def _first(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


def max_range_m(robot: Robot) -> float:
    """Return the range within which every lidar sees."""
    return min(math.inf, *(lidar.max_range_m for lidar in robot.lidars))
