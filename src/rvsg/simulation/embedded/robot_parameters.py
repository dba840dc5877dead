"""A robot and its navigation parameters as the kernels read them by reference."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.robots.polygons import distance, inside, padded, reach, rectangle
from rvsg.robots.robot import Behaviours, Costmaps, Robot
from rvsg.simulation.stacks.nav2_keys import ACTIONS

Floats = NDArray[np.float64]


TICKS_PER_S = 100
# Columns of the table of lidars: place in the base, bearing of the middle ray, field of view, number of rays, ranges,
# period in ticks of 10 ms, standard deviation of a range, share of rays without a return.
(LIDAR_X, LIDAR_Y, LIDAR_YAW, LIDAR_VIEW, LIDAR_RAYS, LIDAR_MIN, LIDAR_MAX, LIDAR_TICKS, LIDAR_NOISE,
 LIDAR_DROPOUT) = range(10)  # fmt: skip


class Stack(NamedTuple):
    """What of a robot the kernels read: its records, and what follows from them; SI units.

    `None` in a record is 0 in a kernel. The limits of `smoother` and `dwb` that a robot leaves out are the robot's.
    """

    limits: Any
    drive: Any
    smoother: Any
    dwb: Any
    maps: Costmaps
    behaviours: Behaviours
    footprint: Floats
    """(K, 2) corners with padding."""
    outline: Floats
    """(K, 2) corners of the body."""
    lidars: Floats
    """(L, 10), see the names of its columns."""
    radius: float
    imu_behind: float
    latency_ticks: int
    bumper_s: float
    """How long contact stops the drive."""
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
    resolution: float
    """Of the local costmap, m."""
    cells: int
    """Along a side of it."""
    margin: float
    """How far the global costmap is merged beyond the clearing range: 1.5 m, or the farthest lidar and one metre."""
    scan_reach: float
    """How far a scan is cast: nothing beyond concerns a costmap."""
    whole_range: bool
    """The dynamic window always holds the whole range of velocities, so the table of samples is fixed."""


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


def stack_of(robot: Robot) -> Stack:
    """Return what the kernels read of a robot."""
    maps = robot.navigation.costmaps
    zones, corners = _zones(robot)
    polygons, polygon_corners = _monitor(robot)
    return Stack(
        limits=robot.limits,
        drive=robot.drive,
        smoother=robot.smoother,
        dwb=robot.dwb,
        maps=maps,
        behaviours=robot.navigation.behaviours,
        footprint=padded_footprint(robot),
        outline=np.array(robot.outline, np.float64),
        lidars=_lidars(robot),
        radius=robot.radius_m,
        imu_behind=-robot.imu.x,
        latency_ticks=round(robot.latency_s * TICKS_PER_S),
        bumper_s=robot.bumper.release_s if robot.bumper else 0.0,
        curvature=min(1e9, robot.drive.max_curvature),
        zones=zones,
        zone_corners=corners,
        monitor=polygons,
        monitor_corners=polygon_corners,
        monitor_reach=monitor_reach(robot),
        resolution=maps.local_resolution_m,
        cells=round(maps.local_size_m / maps.local_resolution_m),
        margin=max(1.5, 1.0 + max(math.hypot(q.x, q.y) for q in robot.lidars)),
        scan_reach=scan_reach(robot),
        whole_range=_samples_whole_range(robot),
    )


def _samples_whole_range(robot: Robot) -> bool:
    """Return whether DWB samples v and w alone, each within reach of every other while a rollout lasts."""
    dwb: Any = robot.dwb
    if dwb.max_lateral_m_s > 0.0 or math.isfinite(robot.drive.max_curvature):
        return False
    reach = min(dwb.acceleration_m_s2, dwb.deceleration_m_s2) * dwb.sim_time_s
    whole = reach >= dwb.max_speed_m_s - dwb.min_speed_m_s
    turns = dwb.yaw_acceleration_rad_s2 * dwb.sim_time_s >= 2.0 * dwb.max_yaw_rate_rad_s
    return whole and turns and all(each.kind == "keepout" for each in robot.navigation.costmap_filters)


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


def max_range_m(robot: Robot) -> float:
    """Return the range within which every lidar sees."""
    return min(math.inf, *(lidar.max_range_m for lidar in robot.lidars))
