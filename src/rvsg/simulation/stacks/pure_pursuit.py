"""Regulated pure pursuit, after nav2_regulated_pure_pursuit_controller of Nav2 Jazzy.

Parameters have Nav2's names and defaults; speeds in m/s, distances in m. Not built: reversing at cusps (NavFn plans
none), `use_dynamic_window` and slowing down when a goal is cancelled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rvsg.core.compiled import kernel
from rvsg.robots.polygons import distance, padded, reach
from rvsg.simulation.embedded.navigation.costmap import FREE, UNKNOWN, outline_hits
from rvsg.simulation.stacks.configured import AS_JAZZY, Configured, Nav2Settings
from rvsg.simulation.stacks.protocol import LocalObservation, Task

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class PurePursuitSettings(Nav2Settings):
    """The options of `nav2-rpp`."""

    desired_linear_vel: Positive = 0.5
    lookahead_dist: Positive = 0.6
    min_lookahead_dist: Positive = 0.3
    max_lookahead_dist: Positive = 0.9
    lookahead_time: Positive = 1.5
    use_velocity_scaled_lookahead_dist: bool = False
    rotate_to_heading_angular_vel: Positive = 1.8
    max_angular_accel: Positive = 3.2
    use_rotate_to_heading: bool = True
    rotate_to_heading_min_angle: Positive = 0.785
    min_approach_linear_velocity: NotNegative = 0.05
    approach_velocity_scaling_dist: Positive = 0.6
    use_regulated_linear_velocity_scaling: bool = True
    regulated_linear_scaling_min_radius: Positive = 0.90
    regulated_linear_scaling_min_speed: NotNegative = 0.25
    use_cost_regulated_linear_velocity_scaling: bool = True
    cost_scaling_dist: Positive = 0.6
    cost_scaling_gain: Positive = 1.0
    inflation_cost_scaling_factor: Positive = 3.0
    use_fixed_curvature_lookahead: bool = False
    curvature_lookahead_dist: Positive = 0.6
    use_collision_detection: bool = True
    max_allowed_time_to_collision_up_to_carrot: Positive = 1.0
    allow_reversing: bool = False


class Numbers(NamedTuple):
    """The options and the robot as the kernel reads them."""

    speed: float
    lookahead: float
    min_lookahead: float
    max_lookahead: float
    lookahead_time: float
    scaled_lookahead: bool
    turn: float
    turn_acceleration: float
    rotates: bool
    rotate_angle: float
    approach_speed: float
    approach_m: float
    by_curvature: bool
    min_radius: float
    min_speed: float
    by_cost: bool
    cost_m: float
    cost_gain: float
    cost_scaling: float
    fixed_curvature: bool
    curvature_lookahead: float
    checks: bool
    check_s: float
    reverses: bool
    inscribed: float
    circumscribed: float
    goal_m: float
    period_s: float
    footprint: Floats


@kernel
def carrot(plan: Floats, begin: int, ahead: float, x: float, y: float) -> tuple[float, float]:
    """Return the point of the plan at a distance, in the odom frame; between two points on the circle around (x, y)."""
    end = plan.shape[0]
    k = begin
    while k < end and math.hypot(plan[k, 0] - x, plan[k, 1] - y) < ahead:
        k += 1
    if k == end:
        return plan[end - 1, 0], plan[end - 1, 1]
    if k == begin:
        return plan[k, 0], plan[k, 1]
    ax, ay = plan[k - 1, 0] - x, plan[k - 1, 1] - y
    bx, by = plan[k, 0] - x, plan[k, 1] - y
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    if square == 0.0:
        return plan[k, 0], plan[k, 1]
    half = ax * dx + ay * dy
    root = math.sqrt(max(0.0, half * half - square * (ax * ax + ay * ay - ahead * ahead)))
    share = (-half + root) / square
    return x + ax + share * dx, y + ay + share * dy


@kernel
def curvature_to(cx: float, cy: float) -> float:
    """Return the curvature of the arc from the base to a point in the base frame."""
    square = cx * cx + cy * cy
    return 2.0 * cy / square if square > 0.001 else 0.0


@kernel
def turn_towards(angle: float, w0: float, p: Numbers) -> float:
    """Return the yaw rate that turns on the spot by an angle, within the acceleration, and stops there."""
    sign = 1.0 if angle > 0.0 else -1.0
    step = p.turn_acceleration * p.period_s
    w = min(w0 + step, max(w0 - step, sign * p.turn))
    stopping = math.sqrt(2.0 * p.turn_acceleration * abs(angle))
    return sign * stopping if abs(w) > stopping else w


@kernel
def hits(cells: Bytes, ox: float, oy: float, side: float, x: float, y: float, yaw: float, p: Numbers) -> bool:
    """Whether the outline of the footprint at a pose is in collision; not where the pose is off the costmap."""
    column, row = (x - ox) / side, (y - oy) / side
    if not (0.0 <= column < cells.shape[1] and 0.0 <= row < cells.shape[0]):
        return False
    return bool(outline_hits(cells, p.footprint, column, row, yaw, side))


@kernel
def collides(
    cells: Bytes, ox: float, oy: float, side: float, x: float, y: float, yaw: float, v: float, w: float,
    carrot_m: float, p: Numbers,
) -> bool:  # fmt: skip
    """Whether the robot hits something on the arc of (v, w) before it is past the carrot or its time is over."""
    if hits(cells, ox, oy, side, x, y, yaw, p):
        return True
    if abs(v) < 0.01 and abs(w) > 0.01:
        step = 2.0 * math.sin(0.5 * side / p.circumscribed) / abs(w)
    elif v == 0.0:
        return False
    else:
        step = side / abs(v)
    px, py, angle = x, y, yaw
    i = 1
    while i * step < p.check_s:
        i += 1
        px += step * v * math.cos(angle)
        py += step * v * math.sin(angle)
        angle += step * w
        if math.hypot(px - x, py - y) > carrot_m:
            return False
        if hits(cells, ox, oy, side, px, py, angle, p):
            return True
    return False


@kernel
def regulated(v: float, curvature: float, cost: float, rest_m: float, end_m: float, p: Numbers) -> float:
    """Return the speed after the constraints of curvature, cost and approach."""
    by_curvature = v
    by_cost = v
    if p.by_curvature and curvature != 0.0:
        radius = abs(1.0 / curvature)
        if radius < p.min_radius:
            by_curvature = v * (1.0 - abs(radius - p.min_radius) / p.min_radius)
    if p.by_cost and cost != FREE and cost != UNKNOWN:
        away = (p.cost_scaling * p.inscribed - math.log(cost) + math.log(253.0)) / p.cost_scaling
        if away < p.cost_m:
            by_cost = v * (p.cost_gain * away / p.cost_m)
    v = max(min(by_curvature, by_cost), p.min_speed)
    if rest_m < p.approach_m:
        v = min(v, max(p.approach_speed, v * end_m / p.approach_m))
    return min(abs(v), p.speed)


@kernel
def pursue(
    plan: Floats, cells: Bytes, ox: float, oy: float, side: float, x: float, y: float, yaw: float, v0: float,
    w0: float, goal_yaw: float, p: Numbers,
) -> tuple[bool, float, float]:  # fmt: skip
    """Return whether there is a valid command, and forward speed and yaw rate."""
    # The plan as Nav2 transforms it: from the point nearest to the robot, up to the edge of the costmap.
    window = 0.5 * side * max(cells.shape[0], cells.shape[1])
    begin = 0
    nearest = np.inf
    along = 0.0
    for k in range(plan.shape[0]):
        if k > 0:
            along += math.hypot(plan[k, 0] - plan[k - 1, 0], plan[k, 1] - plan[k - 1, 1])
        if along > 2.0 * window:
            break
        away = math.hypot(plan[k, 0] - x, plan[k, 1] - y)
        if away < nearest:
            nearest, begin = away, k
    end = begin
    while end < plan.shape[0] and math.hypot(plan[end, 0] - x, plan[end, 1] - y) <= window:
        end += 1
    local = plan[: max(end, begin + 1)]
    rest = 0.0
    for k in range(begin + 1, local.shape[0]):
        rest += math.hypot(local[k, 0] - local[k - 1, 0], local[k, 1] - local[k - 1, 1])
    ahead = p.lookahead
    if p.scaled_lookahead:
        ahead = min(p.max_lookahead, max(p.min_lookahead, abs(v0) * p.lookahead_time))
    px, py = carrot(local, begin, ahead, x, y)
    cos, sin = math.cos(yaw), math.sin(yaw)
    cx, cy = cos * (px - x) + sin * (py - y), cos * (py - y) - sin * (px - x)
    hx, hy = cx, cy
    if p.fixed_curvature:
        qx, qy = carrot(local, begin, p.curvature_lookahead, x, y)
        hx, hy = cos * (qx - x) + sin * (qy - y), cos * (qy - y) - sin * (qx - x)
    curvature = curvature_to(hx, hy)
    sign = -1.0 if p.reverses and cx < 0.0 else 1.0
    carrot_m = math.hypot(cx, cy)
    heading = math.atan2(hy, hx)
    if sign < 0.0:
        heading = math.atan2(-hy, -hx)
    v, w = 0.0, 0.0
    if p.rotates and carrot_m < p.goal_m:
        angle = goal_yaw - yaw
        w = turn_towards(math.atan2(math.sin(angle), math.cos(angle)), w0, p)
    elif p.rotates and abs(heading) > p.rotate_angle:
        w = turn_towards(heading, w0, p)
    else:
        row, column = int((y - oy) / side), int((x - ox) / side)
        end_m = math.hypot(local[-1, 0] - x, local[-1, 1] - y)
        v = sign * regulated(p.speed, curvature, float(cells[row, column]), rest, end_m, p)
        w = v * curvature
    if p.checks and collides(cells, ox, oy, side, x, y, yaw, v, w, carrot_m, p):
        return False, 0.0, 0.0
    return True, v, w


class PurePursuit(Configured):
    """Nav2 with regulated pure pursuit as local planner."""

    name: ClassVar[str] = "nav2-rpp"
    version = "3"
    own_behaviours: ClassVar[Mapping[str, Any]] = AS_JAZZY
    sideways: ClassVar[bool] = False
    title: ClassVar[str] = "Nav2 (Jazzy) with regulated pure pursuit, NavFn and the default behaviour tree"
    Settings: ClassVar[type[Nav2Settings]] = PurePursuitSettings

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Compile or load the kernel."""
        self._numbers = self.numbers(
            np.array([(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)]), 0.2, 0.3, 0.25, 0.05
        )
        plan = np.array([[1.0, 1.0], [1.2, 1.0]])
        pursue(plan, np.zeros((60, 60), np.uint8), 0.0, 0.0, 0.05, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, self._numbers)

    def numbers(
        self, footprint: Floats, inscribed: float, circumscribed: float, goal_m: float, period_s: float
    ) -> Numbers:
        """Return the options with what the robot adds to them."""
        s = self.settings
        return Numbers(
            speed=s.desired_linear_vel,
            lookahead=s.lookahead_dist,
            min_lookahead=s.min_lookahead_dist,
            max_lookahead=s.max_lookahead_dist,
            lookahead_time=s.lookahead_time,
            scaled_lookahead=s.use_velocity_scaled_lookahead_dist,
            turn=s.rotate_to_heading_angular_vel,
            turn_acceleration=s.max_angular_accel,
            rotates=s.use_rotate_to_heading,
            rotate_angle=s.rotate_to_heading_min_angle,
            approach_speed=s.min_approach_linear_velocity,
            approach_m=s.approach_velocity_scaling_dist,
            by_curvature=s.use_regulated_linear_velocity_scaling,
            min_radius=s.regulated_linear_scaling_min_radius,
            min_speed=s.regulated_linear_scaling_min_speed,
            by_cost=s.use_cost_regulated_linear_velocity_scaling,
            cost_m=s.cost_scaling_dist,
            cost_gain=s.cost_scaling_gain,
            cost_scaling=s.inflation_cost_scaling_factor,
            fixed_curvature=s.use_fixed_curvature_lookahead,
            curvature_lookahead=s.curvature_lookahead_dist,
            checks=s.use_collision_detection,
            check_s=s.max_allowed_time_to_collision_up_to_carrot,
            reverses=s.allow_reversing,
            inscribed=inscribed,
            circumscribed=circumscribed,
            goal_m=goal_m,
            period_s=period_s,
            footprint=footprint,
        )

    def reset(self, task: Task) -> None:
        """Keep the robot's numbers."""
        outline = padded(task.robot.footprint, task.robot.padding_m)
        self._numbers = self.numbers(
            np.array(outline, np.float64), distance(outline, 0.0, 0.0), reach(outline),
            task.robot.navigation.behaviours.goal_tolerance_m, task.period_s,
        )  # fmt: skip

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Return the command of regulated pure pursuit."""
        return self.pursue(seen, seen.plan)

    def pursue(self, seen: LocalObservation, plan: Floats) -> tuple[float, float] | None:
        """Return the command that follows a plan."""
        cells, x, y, side = seen.costmap
        valid, v, w = pursue(plan, cells, x, y, side, *seen.pose, *seen.velocity, seen.goal[2], self._numbers)
        return (v, w) if valid else None
