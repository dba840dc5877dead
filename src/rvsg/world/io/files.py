"""What stands in the files of a world folder, as records that refuse what does not belong there."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from rvsg.core.records import Pose, Record
from rvsg.world.doors import Door
from rvsg.world.grid import GridSpec
from rvsg.world.world import Area, Description, OrientedBox, Point, Polygon, Route, SolidObject

Name = Annotated[str, Field(min_length=1, max_length=120)]
SMALLEST_AREA_M2 = 1e-4
FARTHEST_M, LARGEST_M = 100_000.0, 10_000.0
FINEST_M, COARSEST_M = 0.01, 1.0  # of a map drawn from objects
HIGHEST_LIDAR_M = 5.0
MOST_YAW_RAD = 100.0
Metres = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M)]
Ring = Annotated[tuple[tuple[Metres, Metres], ...], Field(min_length=3)]


class ObjectEntry(Record):
    """One solid object. Give `box`, or `footprint` with `height`; what is not given follows from the rest.

    `slices` are the outlines the lidar plane cuts (an empty list: the lidar does not see it; not given: the
    footprint, if the object is as high as the lidar plane).
    """

    name: Name
    kind: str = "object"
    origin: tuple[Metres, Metres, Metres] | None = None
    box: OrientedBox | None = None
    footprint: Ring | None = None
    height: Annotated[float, Field(gt=0, le=1000)] | None = None
    holes: tuple[Ring, ...] = ()
    slices: tuple[Ring, ...] | None = None

    @model_validator(mode="after")
    def _has_a_shape(self) -> Self:
        if self.box is None and (self.footprint is None or self.height is None):
            raise ValueError("give a box, or a footprint with a height")
        if self.box is not None and not (
            _near(self.box.center) and all(0 < size <= LARGEST_M for size in self.box.size)
        ):
            raise ValueError(f"the box's sizes must be over 0 and at most {LARGEST_M:g} m, its centre within 100 km")
        if self.box is None and self.footprint is not None and not _has_area(self.footprint):
            raise ValueError("the footprint has no area: its points lie on a line, or at one place")
        if self.box is not None and self.height is not None:
            raise ValueError("the box already has a height; leave height out")
        return self

    def solid(self, lidar_height_m: float) -> SolidObject:
        """Return the object with all that follows from what is given."""
        box = self.box or _box_around(self.footprint or (), self.height or 0.0)
        footprint: Polygon = self.footprint or box_corners(box)
        bottom, top = box.center[2] - box.size[2] / 2, box.center[2] + box.size[2] / 2
        cut = bottom <= lidar_height_m <= top
        slices = self.slices if self.slices is not None else ((footprint, *self.holes) if cut else ())
        origin = self.origin or (box.center[0], box.center[1], bottom)
        return SolidObject(
            name=self.name,
            kind=self.kind,
            origin=origin,
            box=box,
            footprint=footprint,
            slices=slices,
            holes=self.holes,
        )

    @classmethod
    def of(cls, thing: SolidObject) -> Self:
        """Return the entry that gives exactly this object."""
        return cls(
            name=thing.name,
            kind=thing.kind,
            origin=thing.origin,
            box=thing.box,
            footprint=thing.footprint if thing.footprint != box_corners(thing.box) else None,
            holes=thing.holes,
            slices=thing.slices,
        )


def _has_area(ring: Polygon) -> bool:
    """Return whether the points of a ring do not all lie on one line."""
    (x0, y0), *others = ring
    cross = [(x - x0) * (b - y0) - (y - y0) * (a - x0) for (x, y), (a, b) in pairwise(others)]
    return any(abs(value) > SMALLEST_AREA_M2 for value in cross)


def _near(point: tuple[float, ...]) -> bool:
    return all(abs(value) <= FARTHEST_M for value in point)


def box_corners(box: OrientedBox) -> Polygon:
    """Return the four corners of a box seen from above, counter-clockwise, metres rounded to 0.1 mm."""
    c, s = math.cos(box.yaw), math.sin(box.yaw)
    half_x, half_y = box.size[0] / 2, box.size[1] / 2
    corners = [(-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y)]
    return tuple((round(box.center[0] + c * x - s * y, 4), round(box.center[1] + s * x + c * y, 4)) for x, y in corners)


def _box_around(footprint: Polygon, height: float) -> OrientedBox:
    xs, ys = [p[0] for p in footprint], [p[1] for p in footprint]
    return OrientedBox(
        center=((min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2, height / 2),
        size=(max(xs) - min(xs), max(ys) - min(ys), height),
    )


class ObjectsFile(Record):
    """objects.yaml: the solid objects. Metres, world frame."""

    objects: tuple[ObjectEntry, ...]


class AreaEntry(Record):
    """One labelled area: a `rectangle` or an `outline`. Without `waypoints` they are proposed from the grid."""

    name: Name
    kind: str = "area"
    region: str | None = None
    note: str | None = None
    rectangle: tuple[Metres, Metres, Metres, Metres] | None = None
    outline: Ring | None = None
    waypoints: tuple[str, ...] | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.rectangle is None) == (self.outline is None):
            raise ValueError("give either a rectangle [x_min, y_min, x_max, y_max] or an outline [[x, y], ...]")
        if self.outline is not None:
            from shapely import Polygon

            shape = Polygon(self.outline)
            if not shape.is_valid or shape.area < SMALLEST_AREA_M2:
                raise ValueError("the outline crosses itself or encloses nothing; list its corners in order around it")
        if self.rectangle is not None:
            x0, y0, x1, y1 = self.rectangle
            if x0 >= x1 or y0 >= y1:
                raise ValueError(f"the rectangle [x_min, y_min, x_max, y_max] is empty: {list(self.rectangle)}")
        return self

    def area(self) -> Area:
        """Return the area; its waypoints are empty where none are given."""
        outline = self.outline or rectangle_outline(self.rectangle or (0, 0, 0, 0))
        return Area(
            name=self.name,
            kind=self.kind,
            region=self.region,
            note=self.note,
            outline=outline,
            waypoints=self.waypoints or (),
        )

    @classmethod
    def of(cls, area: Area) -> Self:
        """Return the entry that gives exactly this area."""
        xs, ys = [p[0] for p in area.outline], [p[1] for p in area.outline]
        rectangle = (min(xs), min(ys), max(xs), max(ys))
        is_rectangle = area.outline == rectangle_outline(rectangle)
        return cls(
            name=area.name,
            kind=area.kind,
            region=area.region,
            note=area.note,
            rectangle=rectangle if is_rectangle else None,
            outline=None if is_rectangle else area.outline,
            waypoints=area.waypoints,
        )


def rectangle_outline(rectangle: tuple[float, float, float, float]) -> Polygon:
    """[x_min, y_min, x_max, y_max] as a polygon, counter-clockwise from the lower left corner."""
    x0, y0, x1, y1 = rectangle
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1))


class LabelsFile(Record):
    """labels.yaml: the labelled areas. Metres, world frame."""

    areas: tuple[AreaEntry, ...]


class RouteEntry(Record):
    """One route of the robot. `start` and `goal` are poses, or names of waypoints (yaw 0)."""

    name: Name
    start: Pose | str
    goal: Pose | str
    time_limit_s: Annotated[float, Field(gt=0, le=36_000)]
    via: tuple[str, ...] = ()
    through: tuple[Pose | str, ...] = ()
    purpose: str = ""
    description: str | None = None

    @field_validator("start", "goal", "through", mode="after")
    @classmethod
    def _within_reach(cls, places: Pose | str | tuple[Pose | str, ...]) -> Pose | str | tuple[Pose | str, ...]:
        for place in places if isinstance(places, tuple) else (places,):
            if not isinstance(place, Pose):
                continue
            pose = f"the pose ({place.x:g}, {place.y:g}, {place.yaw:g})"
            if not _near((place.x, place.y)):
                raise ValueError(f"{pose} is not in metres: x and y must be within 100 km")
            if abs(place.yaw) > MOST_YAW_RAD:
                radians = f"{math.radians(place.yaw):.4f}"
                raise ValueError(f"{pose} is not in radians; if degrees are meant, write yaw: {radians}")
        return places

    @classmethod
    def of(cls, route: Route) -> Self:
        """Return the entry that gives exactly this route."""
        return cls.model_validate(route.model_dump())


class RoutesFile(Record):
    """routes.yaml: what the robot is asked to drive."""

    routes: tuple[RouteEntry, ...]


class DoorsFile(Record):
    """doors.yaml: the leaves of doors. Metres, world frame."""

    doors: tuple[Door, ...]


class DerivedMap(Record):
    """`map: {from: objects}`: the occupancy map is drawn from the objects' slices, as a lidar would see them."""

    source: Annotated[Literal["objects"], Field(alias="from")]
    resolution_m: Annotated[float, Field(ge=FINEST_M, le=COARSEST_M)] = 0.05


class ActivityEntry(Record):
    """What people do here, where more is said than the words: `trolley` whether they push one."""

    text: str
    trolley: bool


class WorldFile(Record):
    """world.yaml: what the world is and where its parts stand. `map` names a Nav2 map file beside it."""

    format: Literal[1] = 1
    name: Name
    title: str = ""
    map: DerivedMap | str
    objects: str | None = None
    labels: str = "labels.yaml"
    routes: str = "routes.yaml"
    doors: str | None = None
    lidar_height_m: Annotated[float, Field(gt=0, le=HIGHEST_LIDAR_M)] = 0.21
    map_offset: Point = (0.0, 0.0)
    grid: GridSpec = GridSpec()
    activities: tuple[str | ActivityEntry, ...] = ()
    actors: tuple[Literal["trolley", "child", "wheelchair", "moved_object"], ...] = ()
    description: Description | None = None

    @field_validator("format", mode="before")
    @classmethod
    def _known_format(cls, given: object) -> object:
        if given != 1:
            raise ValueError(f"this version of RVSG reads world folders of format 1, not {given!r}; update RVSG")
        return given
