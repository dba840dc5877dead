"""The Robot record: body, drive, limits, sensors and navigation parameters. Metres, radians, base frame (x forward)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import Field, model_validator

from rvsg.core.documents import WrongValue, read_document
from rvsg.core.errors import UnknownName
from rvsg.core.records import Record
from rvsg.robots.polygons import crosses_itself, distance, inside, reach, rectangle

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


LimitedRecord = TypeVar("LimitedRecord", Smoother, Dwb)


class Costmaps(Record):
    """The rolling local and the global costmap."""

    local_size_m: Annotated[float, Field(gt=0, le=20)] = 3.0
    local_resolution_m: Annotated[float, Field(ge=0.01, le=0.5)] = 0.05
    local_update_hz: Annotated[float, Field(gt=0, le=100)] = 5.0
    global_update_hz: Annotated[float, Field(gt=0, le=100)] = 1.0
    local_inflation_m: Annotated[float, Field(gt=0, le=20)] = 0.55
    local_cost_scaling: Positive = 3.0
    global_inflation_m: Annotated[float, Field(gt=0, le=20)] = 0.55
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
    """Whether the navigation fails where the next plan on the way cannot be made, unless the global costmap is updated
    before the controller's next period (Nav2 Jazzy and later, whose default tree has no recovery for the error of an
    empty path); else that is tried again, or the recovery begins (Humble)."""


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


class CostmapFilter(Record):
    """A costmap filter of Nav2, and its mask as a map server publishes it."""

    kind: Literal["keepout", "speed_percent", "speed_m_s"]
    costmaps: Annotated[tuple[Literal["local", "global"], ...], Field(min_length=1)]
    """Those that apply it: a speed limit changes with their updates."""
    x: float
    """Lower left corner of the mask in the map frame, m."""
    y: float
    resolution_m: Positive
    columns: Annotated[int, Field(ge=1)]
    cells: tuple[tuple[Annotated[int, Field(ge=-1, le=100)], Annotated[int, Field(ge=1)]], ...]
    """Row by row, the lowest y first: a value (0 free, 100 occupied, -1 unknown) and how often it follows itself."""
    base: float = 0.0
    """A speed limit is this, and the value of the mask times the multiplier."""
    multiplier: float = 1.0
    full_m_s: Positive | None = None
    """The highest speed of the local planner, of which a limit in m/s is a share; None: that of the robot."""


class Navigation(Record):
    """All parameters of the stack that drives a robot."""

    smoother: Smoother = Smoother()
    dwb: Dwb = Dwb()
    costmaps: Costmaps = Costmaps()
    behaviours: Behaviours = Behaviours()
    collision_monitor: Annotated[tuple[MonitorPolygon, ...], Field(exclude_if=lambda polygons: not polygons)] = ()
    costmap_filters: Annotated[tuple[CostmapFilter, ...], Field(exclude_if=lambda filters: not filters)] = ()


Point = tuple[Annotated[float, Field(ge=-10, le=10)], Annotated[float, Field(ge=-10, le=10)]]
Polygon = Annotated[tuple[Point, ...], Field(min_length=3, max_length=64)]
Name = Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[A-Za-z0-9][A-Za-z0-9_. -]*$")]

HIDDEN_M = 0.15
"""A lidar deeper inside the body than this, and lower than its top, is hidden by it."""
BESIDE_M = 0.05
"""A lidar farther outside of the body than this is doubtful, but may stand on an arm."""
FAR_M = 2.0
"""A lidar is mounted at most this far outside of the body."""


AHEAD_M = 1.8
"""A steered vehicle sees this far beyond its reach, so that it turns early."""
BESIDE_WAY_M = 0.475
"""A steered vehicle prefers ways with this much free floor beside it."""


class Drive(Record):
    """How the wheels let the base move."""

    kind: Literal["differential", "omnidirectional", "ackermann"] = "differential"
    wheelbase_m: Positive | None = None
    """Distance between the axles; required for `ackermann`, whose base frame lies on the fixed axle."""
    max_steering_rad: Annotated[float, Field(gt=0, lt=math.pi / 2)] | None = None
    """Largest angle of the virtual middle wheel; required for `ackermann`."""
    steering_rate_rad_s: Positive | None = None
    """How fast the wheel turns; None: at once."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.kind == "ackermann" and (self.wheelbase_m is None or self.max_steering_rad is None):
            raise ValueError("an ackermann drive needs wheelbase_m and max_steering_rad")
        if self.kind != "ackermann" and (self.wheelbase_m or self.max_steering_rad or self.steering_rate_rad_s):
            raise ValueError(f"wheelbase and steering belong to an ackermann drive, not to a {self.kind} one")
        return self

    @property
    def max_curvature(self) -> float:
        """Largest curvature of the path, 1/m; infinite where the robot turns on the spot."""
        if self.wheelbase_m is None or self.max_steering_rad is None:
            return math.inf
        return math.tan(self.max_steering_rad) / self.wheelbase_m


class Limits(Record):
    """What the base can do."""

    speed_m_s: Annotated[float, Field(gt=0, le=5)]
    reverse_m_s: Annotated[float, Field(ge=0, le=5)]
    yaw_rate_rad_s: Annotated[float, Field(gt=0, le=20)]
    lateral_m_s: Annotated[float, Field(ge=0, le=5, exclude_if=lambda speed: speed == 0.0)] = 0.0
    """Highest speed to either side; over 0 only for an omnidirectional drive. It keeps to the accelerations below."""
    acceleration_m_s2: Annotated[float, Field(gt=0, le=50)]
    deceleration_m_s2: Annotated[float, Field(gt=0, le=50)]
    yaw_acceleration_rad_s2: Annotated[float, Field(gt=0, le=100)]
    jerk_m_s3: Annotated[float, Field(gt=0, le=1000)] | None = None
    """None: the acceleration may change at once."""
    enforced: bool = True
    """False: the base takes on every velocity at once, and only the velocity smoother keeps to the limits."""


class Lidar(Record):
    """A planar lidar."""

    name: Name
    x: float
    y: float
    yaw: Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)] = 0.0
    """Bearing of the middle ray."""
    height_m: Positive | None = None
    """Height of its plane above the floor; None: not known."""
    field_of_view_rad: Annotated[float, Field(gt=0, le=2 * math.pi)]
    rays: Annotated[int, Field(ge=11, le=4000)]
    min_range_m: NotNegative = 0.05
    max_range_m: Annotated[float, Field(ge=1, le=100)]
    rate_hz: Annotated[float, Field(ge=1, le=100)] = 10.0
    noise_m: Annotated[float, Field(ge=0, le=1)] = 0.01
    """Standard deviation of a range."""
    dropout: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Share of the rays that return nothing although they hit something."""


class SafetyZone(Record):
    """A field of the safety scanners: whatever a lidar sees in it limits the speed."""

    name: Name
    polygon: Polygon
    speed_m_s: NotNegative
    """Highest speed while something is in the zone; 0 stops the robot."""
    from_speed_m_s: NotNegative = 0.0
    """The zone is watched at this speed and above."""
    release_s: NotNegative = 2.0
    """How long the zone must be clear before the limit ends."""


class Bumper(Record):
    """A contact edge around the whole footprint: contact stops the drive."""

    release_s: NotNegative = 2.0
    """How long the drive stays stopped after the last contact."""


class Imu(Record):
    """The inertial sensor's place on the robot's middle line."""

    x: float = 0.0


class Robot(Record):
    """A robot under test."""

    name: Name
    title: str = ""
    source: str = ""
    """Where the numbers come from."""
    calibrated: bool = False
    """Whether simulated runs were compared with published runs of this robot."""
    footprint: Polygon
    """Outline for navigation, without padding."""
    body: Polygon | None = None
    """Outline of the physical body, where it differs from the footprint: it touches walls and people."""
    padding_m: Annotated[float, Field(ge=0, le=0.5)] = 0.01
    body_height_m: Positive
    social_radius_m: Positive | None = None
    """Radius of the disc that people keep away from; None: half of the footprint's longer side."""
    drive: Drive = Drive()
    limits: Limits
    latency_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    """From a velocity command to the motion of the base."""
    lidars: Annotated[tuple[Lidar, ...], Field(min_length=1, max_length=8)]
    safety_zones: Annotated[tuple[SafetyZone, ...], Field(max_length=8)] = ()
    bumper: Bumper | None = None
    imu: Imu = Imu()
    navigation: Navigation = Navigation()

    @property
    def outline(self) -> Polygon:
        """The body, counter-clockwise or not, as given."""
        return self.body or self.footprint

    @property
    def radius_m(self) -> float:
        """Radius of the disc that people keep away from."""
        if self.social_radius_m is not None:
            return self.social_radius_m
        (left, low), (right, high) = rectangle(self.footprint)
        return 0.5 * max(right - left, high - low)

    @property
    def smoother(self) -> Smoother:
        """The velocity smoother, with the robot's limits where it has none of its own."""
        return self._limited(self.navigation.smoother)

    @property
    def dwb(self) -> Dwb:
        """DWB, with the robot's limits where it has none of its own."""
        dwb = self._limited(self.navigation.dwb)
        return dwb.replace(max_lateral_m_s=min(dwb.max_lateral_m_s, self.limits.lateral_m_s))

    def _limited(self, own: LimitedRecord) -> LimitedRecord:
        """Return a record whose limits that are None are the robot's: `max_speed_m_s` is `speed_m_s`."""
        missing = [name for name, value in own if value is None]
        return own.replace(**{name: getattr(self.limits, name.removeprefix("max_")) for name in missing})

    @property
    def driving_speed_m_s(self) -> float:
        """Forward speed on a free way: what the limits, the planner and the velocity smoother allow."""
        return min(self.limits.speed_m_s, self.smoother.max_speed_m_s or 0.0, self.dwb.max_speed_m_s or 0.0)

    @property
    def width_m(self) -> float:
        """Width of the body across its direction of motion."""
        (_, low), (_, high) = rectangle(self.outline)
        return high - low

    @property
    def length_m(self) -> float:
        """Length of the body along its direction of motion."""
        (left, _), (right, _) = rectangle(self.outline)
        return right - left

    @property
    def turning_radius_m(self) -> float:
        """Radius of the disc around the base frame that holds the whole body."""
        return reach(self.outline)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is possible but looks like a mistake, in sentences."""
        away = [(q, distance(self.outline, q.x, q.y)) for q in self.lidars if not inside(self.outline, q.x, q.y)]
        problems = [
            f"{self.name}: the lidar {lidar.name} lies {off:.2f} m outside of the body. Check its x and y, in metres."
            for lidar, off in away
            if off > BESIDE_M
        ]
        near = distance(self.footprint, 0.0, 0.0) + self.padding_m
        if near < 0.5 * self.width_m and not self.navigation.dwb.check_footprint:
            problems.append(
                f"{self.name}: DWB keeps the base frame {near:.2f} m from obstacles, but half of the body is "
                f"{0.5 * self.width_m:.2f} m wide, so the robot gets stuck at corners. Set "
                "navigation.dwb.check_footprint: true, or a footprint that holds the body as it turns."
            )
        return tuple(problems)

    @property
    def turning_note(self) -> str:
        """Why a way may not fit a robot that cannot turn on the spot; empty for others."""
        if math.isinf(self.drive.max_curvature):
            return ""
        return (
            f"{self.name} turns in circles of at least {1.0 / self.drive.max_curvature:.1f} m radius, which its global "
            "planner does not allow for: a way with tighter turns does not fit it. "
        )

    @model_validator(mode="after")
    def _fit_navigation(self) -> Self:
        """Derive from a steered vehicle what its navigation leaves open: Nav2's defaults are for small round robots."""
        if math.isinf(self.drive.max_curvature):
            return self
        front = rectangle(self.outline)[1][0] - 0.15  # it keeps to the path, not the fixed axle
        seen = min(10.0, math.ceil(2.0 * (self.turning_radius_m + AHEAD_M)) / 2.0)
        beside = 0.5 * self.width_m + BESIDE_WAY_M
        maps = {"local_size_m": 2.0 * seen, "obstacle_range_m": seen, "clearing_range_m": seen + 0.5}
        derived: dict[str, dict[str, Any]] = {
            "dwb": {"check_footprint": True, "rotate_to_goal_scale": 0.0, "forward_point_m": round(max(0.1, front), 3)},
            "costmaps": {**maps, "local_inflation_m": beside, "global_inflation_m": beside},
            "behaviours": {"goal_tolerance_m": max(0.25, 0.25 * self.length_m), "goal_tolerance_rad": 3.2},
        }
        sections = {}
        for name, values in derived.items():
            part = getattr(self.navigation, name)
            sections[name] = part.replace(**{key: values[key] for key in values.keys() - part.model_fields_set})
        object.__setattr__(self, "navigation", self.navigation.replace(**sections))
        return self

    @model_validator(mode="after")
    def _sound(self) -> Self:
        outlines: list[tuple[str, Polygon, tuple[str | int, ...]]] = [("the outline", self.footprint, ("footprint",))]
        outlines += [("the outline", self.body, ("body",))] if self.body else []
        zones = enumerate(self.safety_zones)
        outlines += [(f"the outline of {z.name}", z.polygon, ("safety_zones", n, "polygon")) for n, z in zones]
        for what, polygon, key in outlines:
            if crosses_itself(polygon):
                raise WrongValue(f"{what} crosses itself or has no area; list its corners in order", *key)
            if len(key) == 1 and not inside(polygon, 0.0, 0.0):
                raise WrongValue("the base frame's origin (0, 0) must lie inside the outline", *key)
        names = [lidar.name for lidar in self.lidars]
        for number, lidar in enumerate(self.lidars):
            self._check_place(number, lidar)
            if lidar.name in names[:number]:
                raise WrongValue(f"two lidars have the name {lidar.name}", "lidars", number, "name")
        if self.limits.lateral_m_s > 0.0 and self.drive.kind != "omnidirectional":
            message = f"a {self.drive.kind} drive does not move sideways; leave it out"
            raise WrongValue(message, "limits", "lateral_m_s")
        if self.navigation.dwb.max_lateral_m_s > 0.0 and self.limits.lateral_m_s == 0.0:
            raise WrongValue("needs limits.lateral_m_s over 0", "navigation", "dwb", "max_lateral_m_s")
        return self

    def _check_place(self, number: int, lidar: Lidar) -> None:
        """Refuse a lidar that the body hides, or that is nowhere near it."""
        away = distance(self.outline, lidar.x, lidar.y)
        within = inside(self.outline, lidar.x, lidar.y)
        if not within and away > FAR_M:
            message = (
                f"{lidar.name} at ({lidar.x:g}, {lidar.y:g}) lies {away:.1f} m outside of the body, expected at most "
                f"{FAR_M:g} m; give x and y in metres from the base frame's origin"
            )
            raise WrongValue(message, "lidars", number)
        low = lidar.height_m is not None and lidar.height_m < self.body_height_m
        if within and away > HIDDEN_M and low:
            message = (
                f"{lidar.name} lies inside the body, more than {HIDDEN_M:g} m from its outline and below its top, so "
                "it sees nothing but the body"
            )
            raise WrongValue(message, "lidars", number)


DEFAULT_ROBOT = "tiago_omni"
"""The robot of a scenario that names none."""


@cache
def _shipped() -> dict[str, Robot]:
    folder = Path(__file__).parent / "data"
    robots = [read_document(path, Robot)[0] for path in sorted(folder.glob("*.yaml"))]
    return {robot.name: robot for robot in robots}


def shipped_robots() -> dict[str, Robot]:
    """Return the robots that come with RVSG, by name."""
    return dict(_shipped())


def load_robot(name_or_file: str | Path) -> Robot:
    """Load a shipped robot by its name, or a robot from a YAML file.

    Raises:
        UnknownName: there is neither a shipped robot nor a file of this name.
        FileError: the file cannot be read, or with the line of every mistake in it.
    """
    text = str(name_or_file)
    if text in _shipped():
        return _shipped()[text]
    if not (text.endswith((".yaml", ".yml")) or Path(text).exists()):
        raise UnknownName("robot", text, _shipped(), hint="Or give a file: robot.yaml.")
    return read_document(Path(text), Robot)[0]


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
