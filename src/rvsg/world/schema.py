"""Records of the files in a world folder. They refuse unknown keys."""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import yaml
from pydantic import Field, ValidationError, field_validator, model_validator

from rvsg.core.errors import FileError, InputError
from rvsg.core.records import Pose, Record
from rvsg.world.grid import GridSpec
from rvsg.world.occupancy import write_map
from rvsg.world.world import Area, Description, Door, OrientedBox, Point, Polygon, SolidObject, World

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
        from shapely import MultiPoint

        if self.box is None and (self.footprint is None or self.height is None):
            raise ValueError("give a box, or a footprint with a height")
        if self.box is not None and not (
            _near(self.box.center) and all(0 < size <= LARGEST_M for size in self.box.size)
        ):
            raise ValueError(f"the box's sizes must be over 0 and at most {LARGEST_M:g} m, its centre within 100 km")
        if self.box is None and MultiPoint(self.footprint or ()).convex_hull.area < SMALLEST_AREA_M2 / 2:
            raise ValueError("the footprint has no area: its points lie on a line, or at one place")
        if self.box is not None and self.height is not None:
            raise ValueError("the box already has a height; leave height out")
        return self

    def solid(self, lidar_height_m: float) -> SolidObject:
        """Return the object with all that follows from what is given."""
        box, height = self.box, self.height or 0.0
        if box is None:
            xs, ys = zip(*self.footprint or (), strict=True)
            middle = ((min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2, height / 2)
            box = OrientedBox(center=middle, size=(max(xs) - min(xs), max(ys) - min(ys), height))
        footprint: Polygon = self.footprint or box_corners(box)
        bottom, top = box.center[2] - box.size[2] / 2, box.center[2] + box.size[2] / 2
        cut = (footprint, *self.holes) if bottom <= lidar_height_m <= top else ()
        return SolidObject(
            name=self.name,
            kind=self.kind,
            origin=self.origin or (box.center[0], box.center[1], bottom),
            box=box,
            footprint=footprint,
            slices=cut if self.slices is None else self.slices,
            holes=self.holes,
        )

    @classmethod
    def of(cls, thing: SolidObject) -> Self:
        """Return the entry that gives exactly this object."""
        footprint = thing.footprint if thing.footprint != box_corners(thing.box) else None
        return cls.model_validate(thing.model_dump() | {"footprint": footprint})


def _near(point: tuple[float, ...]) -> bool:
    return all(abs(value) <= FARTHEST_M for value in point)


def box_corners(box: OrientedBox) -> Polygon:
    """Return the four corners of a box seen from above, counter-clockwise, metres rounded to 0.1 mm."""
    c, s = math.cos(box.yaw), math.sin(box.yaw)
    half_x, half_y = box.size[0] / 2, box.size[1] / 2
    corners = [(-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y)]
    return tuple((round(box.center[0] + c * x - s * y, 4), round(box.center[1] + s * x + c * y, 4)) for x, y in corners)


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
        values = self.model_dump(exclude={"rectangle"})
        return Area.model_validate(values | {"outline": outline, "waypoints": self.waypoints or ()})

    @classmethod
    def of(cls, area: Area) -> Self:
        """Return the entry that gives exactly this area."""
        xs, ys = zip(*area.outline, strict=True)
        rectangle = (min(xs), min(ys), max(xs), max(ys))
        fits = area.outline == rectangle_outline(rectangle)
        shape = {"rectangle": rectangle, "outline": None} if fits else {}
        return cls.model_validate(area.model_dump() | shape)


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


WIDE = 116


def save_world(world: World, folder: str | Path) -> None:
    """Write world.yaml, map.yaml with map.png, objects.yaml, labels.yaml and routes.yaml into a folder, all or none.

    Raises FileError where it cannot be written, InputError for a world without the specification of its grid.
    """
    if world.grid_spec is None:
        raise InputError(f'the world "{world.name}" does not hold the specification of its grid, so it cannot be saved')
    folder = Path(folder)
    try:
        files = world_files(world)  # all of them before the first is written
    except ValidationError as error:
        wrong = error.errors(include_url=False)[0]
        value, place = wrong["input"], ".".join(str(part) for part in wrong["loc"])
        thing = str(value.get("name", "") if isinstance(value, dict) else value)[:60]
        said = f"{error.title} {thing!r}{f', {place}' if place else ''}: {wrong['msg'].removeprefix('Value error, ')}"
        raise InputError(f'the world "{world.name}" cannot be saved: {said}') from None
    try:
        at = folder if folder.is_dir() else folder.parent
        at.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=at) as draft:
            write_map(world.occupancy, Path(draft))
            for name, text in files.items():
                Path(draft, name).write_text(text, encoding="utf-8")
            folder.mkdir(exist_ok=True)
            for path in sorted(Path(draft).iterdir()):
                path.replace(folder / path.name)
    except OSError as error:
        raise FileError(
            folder, f"the world cannot be written here: {error.strerror}", code="world-not-written"
        ) from None


def world_files(world: World) -> dict[str, str]:
    """Return the text of every file of the world's folder but the map, by file name."""
    files = {
        "world.yaml": _world_text(world),
        "labels.yaml": _entries_text(
            "areas",
            (AreaEntry.of(area) for area in world.areas),
            f"Labelled areas of {world.title}. rectangle: [x_min, y_min, x_max, y_max] in metres, world frame.\n"
            "waypoints: from where people work the area; leave them out, and they are proposed from the grid.",
        ),
        "routes.yaml": _entries_text(
            "routes",
            (RouteEntry.model_validate(route.model_dump()) for route in world.routes),
            f"What the robot is asked to drive in {world.title}. Poses in metres and radians, world frame; a pose may\n"
            "also be the name of a waypoint. via: waypoints it roughly passes; through: poses it must pass, in order.",
        ),
    }
    if world.doors:
        files["doors.yaml"] = _entries_text(
            "doors",
            world.doors,
            f"Doors of {world.title}. hinge and end: the ends of the closed leaf, metres, world frame. state: open,\n"
            "closed or automatic.",
        )
    if world.objects:
        files["objects.yaml"] = _entries_text(
            "objects",
            (ObjectEntry.of(thing) for thing in world.objects),
            f"Solid objects of {world.title}: metres and radians, world frame, z up. box: the oriented bounding box;\n"
            "footprint (not given: the box seen from above): what a person cannot walk through; slices: what the\n"
            "lidar plane cuts.",
        )
    return files


def _world_text(world: World) -> str:
    head: dict[str, Any] = {
        "format": 1,
        "name": world.name,
        "title": world.title,
        "map": "map.yaml",
        "objects": "objects.yaml" if world.objects else None,
        "doors": "doors.yaml" if world.doors else None,
        "labels": "labels.yaml",
        "routes": "routes.yaml",
        "lidar_height_m": world.lidar_height_m,
        "map_offset": world.map_offset if world.map_offset != (0.0, 0.0) else None,
        "actors": world.actors or None,
    }
    lines = [f"# {one_line(world.title)}. Metres and radians, world frame."]
    lines += [f"{key}: {_flow(value)}" for key, value in head.items() if value is not None]
    if world.grid_spec is not None:
        grid = world.grid_spec.model_dump(mode="json", exclude_defaults=True)
        lines += ["grid:", *(_block(key, value, "  ") for key, value in grid.items())] if grid else ["grid: {}"]
    if world.activities:
        trolley = world.trolley_work
        entries = ({"text": a, "trolley": trolley[a]} if a in trolley else a for a in world.activities)
        lines += ["activities:", *(f"  - {_flow(entry)}" for entry in entries)]
    if world.description is not None:
        values = world.description.model_dump(mode="json")
        text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=WIDE)
        lines += ["description:", *(f"  {line}" if line else "" for line in text.splitlines())]
    return "\n".join(lines) + "\n"


def _entries_text(key: str, entries: Iterable[Record], comment: str) -> str:
    lines = [f"# {line}" for line in comment.splitlines()]
    body = []
    for entry in entries:
        shown = entry.model_dump(exclude_defaults=True)  # without the defaults inside of its values
        items = [_block(k, v, "    ") for k, v in entry.model_dump(mode="json").items() if k in shown]
        body.append("  - " + "\n".join(items)[4:])
    lines += [f"{key}:", *body] if body else [f"{key}: []"]
    return "\n".join(lines) + "\n"


def _block(key: str, value: Any, indent: str) -> str:
    """`key: value` in flow style, broken after commas where the line is long."""
    line = f"{indent}{key}: {_flow(value)}"
    if len(line) <= WIDE or line[-1:] not in "]}":
        return line
    first, *pieces = re.split(r"(?<=[\]}\w\"],) ", line)
    lines = [first]
    for piece in pieces:
        if len(lines[-1]) + 1 + len(piece) <= WIDE:
            lines[-1] += " " + piece
        else:
            lines.append(f"{indent}  {piece}")
    return "\n".join(lines)


def _flow(value: Any) -> str:
    """Return a value in YAML's flow style on one line, strings quoted where they must be."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_flow(k)}: {_flow(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(item) for item in value) + "]"
    if isinstance(value, str):
        plain = re.fullmatch(r"[A-Za-z][A-Za-z0-9_ ./()-]*[A-Za-z0-9_.)]|[A-Za-z]", value)
        return value if plain and yaml.safe_load(value) == value else json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    return repr(value)


def one_line(text: str) -> str:
    """Return the text without line breaks, fit for a comment."""
    return " ".join(text.split())
