"""A plan view of a robot as SVG: body, footprint, lidars with their fields of view, safety zones."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rvsg.robots.polygons import rectangle
from rvsg.robots.robot import Lidar, Robot

PIXELS_PER_M = 300
MARGIN_M = 0.3
LIDAR_SHOWN_M = 0.25


def draw_robot(robot: Robot) -> str:
    """Return the plan view; the robot looks to the right, one metre is 300 pixels."""
    points = [*robot.outline, *robot.footprint, *(p for zone in robot.safety_zones for p in zone.polygon)]
    (left, low), (right, high) = rectangle(points)
    left, low, right, high = left - MARGIN_M, low - MARGIN_M, right + MARGIN_M, high + MARGIN_M
    width, height = (right - left) * PIXELS_PER_M, (high - low) * PIXELS_PER_M
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'width="{width:.0f}" height="{height:.0f}" role="img" aria-label="Plan view of {robot.name}">',
        "<style>.zone{fill:#c0392b22;stroke:#c0392b}.body{fill:#d5d8dc;stroke:#1c2833;stroke-width:2}"
        ".footprint{fill:none;stroke:#1c2833;stroke-dasharray:6 4}.view{fill:#2471a333;stroke:#2471a3}"
        "text{font:14px sans-serif;fill:#1c2833}line{stroke:#1c2833;stroke-width:2}</style>",
        f'<g transform="translate({-left * PIXELS_PER_M:.1f} {high * PIXELS_PER_M:.1f}) scale({PIXELS_PER_M} '
        f'{-PIXELS_PER_M})" stroke-width="{1.5 / PIXELS_PER_M:.5f}">',
        *(f'<polygon class="zone" points="{_points(zone.polygon)}"{_THIN}/>' for zone in robot.safety_zones),
        f'<polygon class="body" points="{_points(robot.outline)}"{_THIN}/>',
        f'<polygon class="footprint" points="{_points(robot.footprint)}"{_THIN}/>',
        *(_view(lidar) for lidar in robot.lidars),
        f'<path d="M0 0 H{0.15} M0 0 V{0.15}" stroke="#1c2833" fill="none"{_THIN}/>',
        "</g>",
        f'<text x="8" y="20">{robot.name}: {robot.length_m:.2f} x {robot.width_m:.2f} m, {robot.drive.kind}, '
        f"{robot.limits.speed_m_s:g} m/s</text>",
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


_THIN = ' vector-effect="non-scaling-stroke"'


def _points(polygon: Iterable[tuple[float, float]]) -> str:
    return " ".join(f"{x:.4f},{y:.4f}" for x, y in polygon)


def _view(lidar: Lidar) -> str:
    half = 0.5 * min(lidar.field_of_view_rad, 2 * math.pi - 1e-3)
    ends = [
        (lidar.x + LIDAR_SHOWN_M * math.cos(lidar.yaw + turn), lidar.y + LIDAR_SHOWN_M * math.sin(lidar.yaw + turn))
        for turn in (-half, half)
    ]
    large = 1 if half > math.pi / 2 else 0
    return (
        f'<path class="view" d="M{lidar.x:.4f} {lidar.y:.4f} L{ends[0][0]:.4f} {ends[0][1]:.4f} '
        f'A{LIDAR_SHOWN_M} {LIDAR_SHOWN_M} 0 {large} 1 {ends[1][0]:.4f} {ends[1][1]:.4f} Z"{_THIN}/>'
    )
