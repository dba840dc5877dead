"""The Robot record: body, drive, limits, sensors and navigation parameters. Metres, radians, base frame (x forward)."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rvsg.core.documents import WrongValue
from rvsg.core.records import Record
from rvsg.robots.navigation import Navigation
from rvsg.robots.polygons import crosses_itself, distance, inside, reach, rectangle

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Point = tuple[Annotated[float, Field(ge=-10, le=10)], Annotated[float, Field(ge=-10, le=10)]]
Polygon = Annotated[tuple[Point, ...], Field(min_length=3, max_length=64)]
Name = Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[A-Za-z0-9][A-Za-z0-9_. -]*$")]

HIDDEN_M = 0.15
"""A lidar deeper inside the body than this, and lower than its top, is hidden by it."""
FAR_M = 2.0
"""A lidar is mounted at most this far outside of the body."""


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
    yaw: float = 0.0
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
    def driving_speed_m_s(self) -> float:
        """Forward speed on a free way: what the limits, the planner and the velocity smoother allow."""
        asked = (self.navigation.smoother.max_speed_m_s, self.navigation.dwb.max_speed_m_s)
        return min([self.limits.speed_m_s, *(speed for speed in asked if speed is not None)])

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

    @model_validator(mode="after")
    def _sound(self) -> Self:
        for name, polygon in (("footprint", self.footprint), ("body", self.body)):
            if polygon is None:
                continue
            if crosses_itself(polygon):
                raise WrongValue("the outline crosses itself or has no area; list its corners in order", name)
            if not inside(polygon, 0.0, 0.0):
                raise WrongValue("the base frame's origin (0, 0) must lie inside the outline", name)
        for number, zone in enumerate(self.safety_zones):
            if crosses_itself(zone.polygon):
                message = f"the outline of {zone.name} crosses itself or has no area"
                raise WrongValue(message, "safety_zones", number, "polygon")
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
        if not inside(self.outline, lidar.x, lidar.y):
            if away > FAR_M:
                raise WrongValue(
                    f"{lidar.name} at ({lidar.x:g}, {lidar.y:g}) lies {away:.1f} m outside of the body, "
                    f"expected at most {FAR_M:g} m; give x and y in metres from the base frame's origin",
                    "lidars",
                    number,
                )
        elif away > HIDDEN_M and lidar.height_m is not None and lidar.height_m < self.body_height_m:
            raise WrongValue(
                f"{lidar.name} lies inside the body, more than {HIDDEN_M:g} m from its outline and below "
                "its top, so it sees nothing but the body",
                "lidars",
                number,
            )
