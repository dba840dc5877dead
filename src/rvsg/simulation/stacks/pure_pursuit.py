"""Regulated pure pursuit, after nav2_regulated_pure_pursuit_controller of Nav2 Jazzy, and two stacks built on it.

Parameters have Nav2's names and defaults; speeds in m/s, distances in m. Not built: reversing at cusps (NavFn plans
none), `use_dynamic_window` and slowing down when a goal is cancelled.
"""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rvsg.core.kernels import kernel
from rvsg.robots.polygons import distance, padded, reach, rectangle
from rvsg.robots.robot import Robot
from rvsg.simulation.costmap import FREE, UNKNOWN, outline_hits
from rvsg.simulation.stacks.nav2_stack import AS_JAZZY, Configured, Nav2Settings
from rvsg.simulation.stacks.parameters import Parameter, around, between, of_pure_pursuit
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


OPTIONS = [name for name in PurePursuitSettings.model_fields if name not in Nav2Settings.model_fields]
Numbers = cast(Any, namedtuple("Numbers", [*OPTIONS, "inscribed", "circumscribed", "goal_m", "period_s", "footprint"]))
"""The options, by their names, and the robot as the kernels read them."""


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
def turn_towards(angle: float, w0: float, p: Any) -> float:
    """Return the yaw rate that turns on the spot by an angle, within the acceleration, and stops there."""
    sign = 1.0 if angle > 0.0 else -1.0
    step = p.max_angular_accel * p.period_s
    w = min(w0 + step, max(w0 - step, sign * p.rotate_to_heading_angular_vel))
    stopping = math.sqrt(2.0 * p.max_angular_accel * abs(angle))
    return sign * stopping if abs(w) > stopping else w


@kernel
def hits(cells: Bytes, ox: float, oy: float, side: float, x: float, y: float, yaw: float, p: Any) -> bool:
    """Whether the outline of the footprint at a pose is in collision; not where the pose is off the costmap."""
    column, row = (x - ox) / side, (y - oy) / side
    if not (0.0 <= column < cells.shape[1] and 0.0 <= row < cells.shape[0]):
        return False
    return bool(outline_hits(cells, p.footprint, column, row, yaw, side))


@kernel
def collides(
    cells: Bytes, ox: float, oy: float, side: float, x: float, y: float, yaw: float, v: float, w: float,
    carrot_m: float, p: Any,
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
    while i * step < p.max_allowed_time_to_collision_up_to_carrot:
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
def regulated(v: float, curvature: float, cost: float, rest_m: float, end_m: float, p: Any) -> float:
    """Return the speed after the constraints of curvature, cost and approach."""
    by_curvature = v
    by_cost = v
    if p.use_regulated_linear_velocity_scaling and curvature != 0.0:
        radius = abs(1.0 / curvature)
        if radius < p.regulated_linear_scaling_min_radius:
            by_curvature = v * (
                1.0 - abs(radius - p.regulated_linear_scaling_min_radius) / p.regulated_linear_scaling_min_radius
            )
    if p.use_cost_regulated_linear_velocity_scaling and cost != FREE and cost != UNKNOWN:
        away = (
            p.inflation_cost_scaling_factor * p.inscribed - math.log(cost) + math.log(253.0)
        ) / p.inflation_cost_scaling_factor
        if away < p.cost_scaling_dist:
            by_cost = v * (p.cost_scaling_gain * away / p.cost_scaling_dist)
    v = max(min(by_curvature, by_cost), p.regulated_linear_scaling_min_speed)
    if rest_m < p.approach_velocity_scaling_dist:
        v = min(v, max(p.min_approach_linear_velocity, v * end_m / p.approach_velocity_scaling_dist))
    return min(abs(v), p.desired_linear_vel)


@kernel
def pursue(
    plan: Floats, cells: Bytes, ox: float, oy: float, side: float, x: float, y: float, yaw: float, v0: float,
    w0: float, goal_yaw: float, p: Any,
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
    ahead = p.lookahead_dist
    if p.use_velocity_scaled_lookahead_dist:
        ahead = min(p.max_lookahead_dist, max(p.min_lookahead_dist, abs(v0) * p.lookahead_time))
    px, py = carrot(local, begin, ahead, x, y)
    cos, sin = math.cos(yaw), math.sin(yaw)
    cx, cy = cos * (px - x) + sin * (py - y), cos * (py - y) - sin * (px - x)
    hx, hy = cx, cy
    if p.use_fixed_curvature_lookahead:
        qx, qy = carrot(local, begin, p.curvature_lookahead_dist, x, y)
        hx, hy = cos * (qx - x) + sin * (qy - y), cos * (qy - y) - sin * (qx - x)
    curvature = curvature_to(hx, hy)
    sign = -1.0 if p.allow_reversing and cx < 0.0 else 1.0
    carrot_m = math.hypot(cx, cy)
    heading = math.atan2(hy, hx)
    if sign < 0.0:
        heading = math.atan2(-hy, -hx)
    v, w = 0.0, 0.0
    if p.use_rotate_to_heading and carrot_m < p.goal_m:
        angle = goal_yaw - yaw
        w = turn_towards(math.atan2(math.sin(angle), math.cos(angle)), w0, p)
    elif p.use_rotate_to_heading and abs(heading) > p.rotate_to_heading_min_angle:
        w = turn_towards(heading, w0, p)
    else:
        row, column = int((y - oy) / side), int((x - ox) / side)
        end_m = math.hypot(local[-1, 0] - x, local[-1, 1] - y)
        v = sign * regulated(p.desired_linear_vel, curvature, float(cells[row, column]), rest, end_m, p)
        w = v * curvature
    if p.use_collision_detection and collides(cells, ox, oy, side, x, y, yaw, v, w, carrot_m, p):
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

    def full_speed(self, robot: Robot) -> float:
        """Return its desired speed."""
        return float(self.settings.desired_linear_vel)

    def planner_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return the distances and speeds of regulated pure pursuit."""
        return of_pure_pursuit(robot)

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Compile or load the kernel."""
        square = np.array([(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)])
        self._numbers = self.numbers(square, 0.2, 0.3, 0.25, 0.05, math.inf)
        plan = np.array([[1.0, 1.0], [1.2, 1.0]])
        pursue(plan, np.zeros((60, 60), np.uint8), 0.0, 0.0, 0.05, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, self._numbers)

    def numbers(
        self, footprint: Floats, inscribed: float, circumscribed: float, goal_m: float, period_s: float, curved: float
    ) -> Any:
        """Return the options with what the robot adds to them; a steered one never turns on the spot."""
        options = self.settings.model_dump(include={*OPTIONS})
        if not math.isinf(curved):
            options["use_rotate_to_heading"] = False
            if "lookahead_dist" not in self.settings.model_fields_set:
                options["lookahead_dist"] = max(self.settings.lookahead_dist, 1.0 / curved)
        return Numbers(**options, inscribed=inscribed, circumscribed=circumscribed, goal_m=goal_m, period_s=period_s,
                       footprint=footprint)  # fmt: skip

    def reset(self, task: Task) -> None:
        """Keep the robot's numbers."""
        outline = padded(task.robot.footprint, task.robot.padding_m)
        corners, goal_m = np.array(outline, np.float64), task.robot.navigation.behaviours.goal_tolerance_m
        curved, inner = task.robot.drive.max_curvature, distance(outline, 0.0, 0.0)
        self._numbers = self.numbers(corners, inner, reach(outline), goal_m, task.period_s, curved)

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Return the command of regulated pure pursuit."""
        return self.pursue(seen, seen.plan)

    def pursue(self, seen: LocalObservation, plan: Floats) -> tuple[float, float] | None:
        """Return the command that follows a plan."""
        cells, x, y, side = seen.costmap
        p = self._numbers
        if seen.speed_share != 1.0:
            p = p._replace(desired_linear_vel=seen.speed_share * p.desired_linear_vel)
        valid, v, w = pursue(plan, cells, x, y, side, *seen.pose, *seen.velocity, seen.goal[2], p)
        return (v, w) if valid else None


TURNS_S = 0.75
"""How long a command that is tried turns the robot before it goes straight on."""


class SocialSettings(PurePursuitSettings):
    """The options of `social`: those of `nav2-rpp` and personal space."""

    personal_space_m: Positive = 1.2
    """Distance between the robot's centre and a person that it keeps (Hall's personal distance)."""
    horizon_s: Annotated[float, Field(gt=0, le=10)] = 4.0
    """How far people are predicted, at constant velocity."""
    swerve_rad: Annotated[float, Field(gt=0, le=1.5)] = 0.9
    """Largest angle by which it turns away from its way."""
    discomfort: Positive = 8.0
    """Weight of coming too close, against progress along the plan."""


class Social(PurePursuit):
    """Choose among headings and speeds around those of pure pursuit the one that disturbs nobody.

    People are tracked perfectly where a lidar sees them and predicted by constant velocity.
    """

    name: ClassVar[str] = "social"
    title: ClassVar[str] = "Pure pursuit that keeps personal space; it predicts people by constant velocity"
    Settings: ClassVar[type[Nav2Settings]] = SocialSettings

    def planner_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return those of pure pursuit and of the personal space."""
        own = (
            between("personal_space_m", 0.6, 2.5, "m", "people", "Hall's personal distance, from near to far"),
            around("horizon_s", 4.0, "s", "people", factor=2.0),
            between("swerve_rad", 0.2, 1.5, "rad", "people", "the largest angle that the stack takes"),
            around("discomfort", 8.0, "", "people"),
        )
        return (*super().planner_parameters(robot), *own)

    def reset(self, task: Task) -> None:
        """Keep the robot's numbers and the commands to choose from."""
        super().reset(task)
        swerves = np.linspace(-self.settings.swerve_rad, self.settings.swerve_rad, 9)
        self._shares, self._swerves = (grid.ravel() for grid in np.meshgrid([1.0, 0.6, 0.3, 0.0], swerves))
        self._times = np.arange(0.25, self.settings.horizon_s + 1e-9, 0.25)
        self._turn = task.robot.limits.yaw_rate_rad_s

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Return the command with the least discomfort and detour."""
        asked = super().command(seen)
        people = seen.people()
        if asked is None or asked[0] <= 0.0 or not len(people):
            return asked
        v, w = asked
        speeds = v * self._shares
        rates = np.clip(w * self._shares + self._swerves, -self._turn, self._turn)
        x, y = self._ways(seen.pose, speeds, rates)
        cost = self.settings.discomfort * self._discomfort(x, y, people)
        cost += 0.5 * (1.0 - self._shares) + 0.3 * np.abs(self._swerves)
        cost[self._blocked(seen, x, y)] = math.inf
        best = int(np.argmin(cost))
        return (float(speeds[best]), float(rates[best])) if math.isfinite(cost[best]) else (0.0, 0.0)

    def _ways(self, pose: tuple[float, float, float], speeds: Floats, rates: Floats) -> tuple[Floats, Floats]:
        """Return where each command leads, (commands, times): it turns, then goes straight on."""
        turned = np.minimum(self._times, TURNS_S)[None, :] * rates[:, None]
        heading = pose[2] + turned
        step = np.diff(self._times, prepend=0.0)[None, :] * speeds[:, None]
        return pose[0] + np.cumsum(step * np.cos(heading), axis=1), pose[1] + np.cumsum(step * np.sin(heading), axis=1)

    def _discomfort(self, x: Floats, y: Floats, people: Floats) -> Floats:
        """Return the largest intrusion into anybody's space, as a share of it; later ones count less."""
        worst = np.zeros(len(x))
        weight = np.exp(-self._times / self.settings.horizon_s)
        for px, py, vx, vy in people:
            away = np.hypot(x - px - vx * self._times, y - py - vy * self._times)
            intrusion = np.clip(1.0 - away / self.settings.personal_space_m, 0.0, 1.0) * weight
            worst = np.maximum(worst, intrusion.max(axis=1))
        return worst

    def _blocked(self, seen: LocalObservation, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Whether a command leads the robot's centre into an inscribed cell within a second."""
        cells, ox, oy, side = seen.costmap
        near = self._times <= 1.0
        columns = np.clip(((x[:, near] - ox) / side).astype(int), 0, cells.shape[1] - 1)
        rows = np.clip(((y[:, near] - oy) / side).astype(int), 0, cells.shape[0] - 1)
        return np.asarray((cells[rows, columns] >= 253).any(axis=1) & (self._shares > 0.0))


WAITS_S = 3600.0
"""Nav2's progress checker leaves it alone for so long."""
SAME_GOAL_M = 0.5
"""Plans that end within this distance lead to the same goal."""
PASSED = 40
"""Of so many points of the kept plan, about a metre, the one that is nearest to the vehicle begins the rest of it."""


class StopAndGoSettings(PurePursuitSettings):
    """The options of `stop-and-go`: those of `nav2-rpp` and the safety field."""

    use_collision_detection: bool = False
    protective_m: Positive = 0.5
    """The vehicle stops for what is nearer ahead of its front than this."""
    warning_m: Positive = 1.5
    """It slows down for what is nearer than this."""
    side_m: Annotated[float, Field(ge=0)] = 0.1
    """How far the field reaches beyond each side of the vehicle."""
    creep: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Least share of the speed in the warning field."""

    @model_validator(mode="after")
    def _in_order(self) -> StopAndGoSettings:
        if self.warning_m <= self.protective_m:
            raise ValueError("warning_m must be larger than protective_m")
        return self


class StopAndGo(PurePursuit):
    """Pure pursuit under a safety field.

    It follows the first plan to each goal and waits as long as it must: replanning and recoveries have no part in it.
    """

    name: ClassVar[str] = "stop-and-go"
    version = "4"
    title: ClassVar[str] = "Pure pursuit under a safety field that slows and stops; it does not drive around people"
    Settings: ClassVar[type[Nav2Settings]] = StopAndGoSettings

    def planner_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return the size of the safety field and the speed of the vehicle; fields that overlap are no setting."""
        own = (
            between("protective_m", 0.2, 1.2, "m", "safety field", "a stopping distance of 0.2 to 1.2 m"),
            between("warning_m", 1.3, 4.0, "m", "safety field", "beyond the protective field"),
            between("side_m", 0.0, 0.6, "m", "safety field", "nothing to a person's width beside the vehicle"),
            between("creep", 0.0, 0.5, "", "safety field", "a share of the speed"),
        )
        return (*super().planner_parameters(robot), *own)

    def adapt(self, robot: Robot) -> Robot:
        """Return the robot without recoveries for lack of progress."""
        robot = super().adapt(robot)
        if "progress_s" in self.settings.behaviours:
            return robot
        behaviours = robot.navigation.behaviours.replace(progress_s=WAITS_S)
        return robot.replace(navigation=robot.navigation.replace(behaviours=behaviours))

    def reset(self, task: Task) -> None:
        """Keep where the field lies."""
        super().reset(task)
        self._plan = np.zeros((0, 2))
        (_, right), (self._front, left) = rectangle(task.robot.outline)
        self._half = max(left, -right) + self.settings.side_m
        self._lidars = len(task.robot.lidars)

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Return the command of pure pursuit, slowed down by what the field sees."""
        if not len(self._plan) or math.dist(self._plan[-1], seen.plan[-1]) > SAME_GOAL_M:
            self._plan = seen.plan.copy()
        x, y, _ = seen.pose
        self._plan = self._plan[np.hypot(*(self._plan[:PASSED] - (x, y)).T).argmin() :]
        v, w = self.pursue(seen, self._plan) or (0.0, 0.0)
        if v <= 0.0:
            return v, w
        gap, s = self._gap(seen), self.settings
        # The field ends at the goal: else a wall behind the goal would keep the vehicle from it.
        rest = np.hypot(*np.diff(self._plan, axis=0).T).sum() + math.dist(self._plan[-1], seen.goal[:2])
        stop, slow = (min(1.0, rest / s.warning_m) * field for field in (s.protective_m, s.warning_m))
        if gap < stop:
            return 0.0, 0.0
        share = min(1.0, max(s.creep, (gap - stop) / max(1e-9, slow - stop)))
        return v * share, w * share

    def _gap(self, seen: LocalObservation) -> float:
        """Return the distance from the front to the nearest return in the field, m."""
        nearest = math.inf
        for lidar in range(self._lidars):
            scan = seen.scan(lidar)
            angle = scan.yaw + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
            found = np.isfinite(scan.ranges) & (scan.ranges >= scan.range_min)
            x = scan.x + scan.ranges[found] * np.cos(angle[found])
            y = scan.y + scan.ranges[found] * np.sin(angle[found])
            ahead = x[(np.abs(y) < self._half) & (x > self._front)]
            nearest = min(nearest, float(ahead.min()) - self._front if ahead.size else math.inf)
        return nearest
