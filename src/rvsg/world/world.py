"""The World: solid objects, occupancy map, grid of named waypoints, labelled areas and routes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rvsg.core.errors import UnknownName
from rvsg.core.records import Pose, Record, content_id
from rvsg.world.grid import Grid, GridSpec, nearest_rows

Point = tuple[float, float]
Who = Literal["people", "robot"]
State = Literal["open", "closed", "automatic"]

HEIGHT_M = 2.0
WIDTHS_M = (0.4, 8.0)


class Door(Record):
    """One leaf. `hinge` and `end` are the ends of the closed leaf in metres, world frame; a double door is two leaves.

    A swing door turns about its hinge by 90°, seen from the hinge to the `left` or `right`. A sliding door moves beyond
    its hinge by its own width, into the wall. Maps are made with the doors open.
    """

    name: Annotated[str, Field(min_length=1, max_length=120)]
    hinge: Point
    end: Point
    kind: Literal["swing", "sliding"] = "swing"
    state: State = "automatic"
    turns: Literal["left", "right"] = "left"
    thickness_m: Annotated[float, Field(ge=0.01, le=0.5)] = 0.05
    range_m: Annotated[float, Field(gt=0, le=10)] = 2.5
    """An automatic door opens when somebody is this near to the middle of the closed leaf."""
    opening_s: Annotated[float, Field(ge=0.2, le=30)] = 1.5
    """How long the leaf moves from closed to open, and back."""
    hold_s: Annotated[float, Field(ge=0, le=600)] = 3.0
    """How long it stays open after the last one is out of range."""
    opens_for: Annotated[tuple[Who, ...], Field(min_length=1)] = ("people", "robot")

    @model_validator(mode="after")
    def _has_a_leaf(self) -> Self:
        if not all(math.isfinite(v) for v in (*self.hinge, *self.end)):
            raise ValueError("hinge and end must be finite numbers")
        low, high = WIDTHS_M
        if not low <= self.width_m <= high:
            raise ValueError(f"the leaf is {self.width_m:.2f} m wide, expected {low:g} to {high:g} m from hinge to end")
        return self

    @property
    def width_m(self) -> float:
        """Return the width of the leaf."""
        return math.dist(self.hinge, self.end)

    @property
    def middle(self) -> Point:
        """Return the middle of the closed leaf."""
        return (0.5 * (self.hinge[0] + self.end[0]), 0.5 * (self.hinge[1] + self.end[1]))

    def leaf(self, share: float) -> tuple[Point, ...]:
        """Return the four corners of the leaf, opened by this share of its way: 0 closed, 1 open."""
        (x, y), (ex, ey) = self.hinge, self.end
        dx, dy = ex - x, ey - y
        if self.kind == "sliding":
            x, y = x - share * dx, y - share * dy
        else:
            angle = share * math.pi / 2 * (1 if self.turns == "left" else -1)
            cos, sin = math.cos(angle), math.sin(angle)
            dx, dy = cos * dx - sin * dy, sin * dx + cos * dy
        half = 0.5 * self.thickness_m / self.width_m
        ax, ay = -half * dy, half * dx
        return ((x - ax, y - ay), (x + dx - ax, y + dy - ay), (x + dx + ax, y + dy + ay), (x + ax, y + ay))

    @property
    def still(self) -> tuple[Point, ...] | None:
        """Return the leaf of a door that never moves; None where it moves, or is in the wall."""
        if self.state == "automatic" or (self.state == "open" and self.kind == "sliding"):
            return None
        return tuple((round(px, 4), round(py, 4)) for px, py in self.leaf(1.0 if self.state == "open" else 0.0))


FREE, OCCUPIED, UNKNOWN = 0, 100, 255  # the values of an occupancy map's cells

TROLLEY_WORDS = ("trolley", "cart", "bed", "pallet jack", "push")
"""Words of an activity that is done with a trolley, where the world does not say it."""

AUTOMATIC = "automatic door"
"""The kind of the leaves that move, in pictures."""

Polygon = tuple[Point, ...]


class OrientedBox(Record):
    """A box turned about the vertical axis: centre and size in metres, yaw in radians."""

    center: tuple[float, float, float]
    size: tuple[float, float, float]
    yaw: float = 0.0


class SolidObject(Record):
    """A solid thing that stands still.

    `origin` is the model's own origin (HuNavSim aims at it when it looks for the nearest obstacle),
    `box` its oriented bounding box, `footprint` the outline of what a person cannot walk through, seen from above,
    `holes` open floor inside the footprint (the room inside its walls), and `slices` the outlines the lidar plane
    cuts (a shelf shows only its legs), solid where inside an odd number of them. Metres, world frame.
    """

    name: str
    kind: str
    origin: tuple[float, float, float]
    box: OrientedBox
    footprint: Polygon
    slices: tuple[Polygon, ...]
    holes: tuple[Polygon, ...] = ()


class Area(Record):
    """A labelled part of the floor plan: `outline` in metres, the waypoints from which people work it."""

    name: str
    kind: str = "area"
    region: str | None = None
    note: str | None = None
    outline: Polygon
    waypoints: tuple[str, ...]


class Route(Record):
    """A navigation task: drive from `start` to `goal` before `time_limit_s` has passed.

    `via` names the waypoints the robot roughly passes; `through` are poses it must pass, in order.
    """

    name: str
    start: Pose
    goal: Pose
    time_limit_s: Annotated[float, Field(gt=0, le=36_000)]
    via: tuple[str, ...] = ()
    through: tuple[Pose, ...] = ()
    purpose: str = ""
    description: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class OccupancyMap:
    """A trinary occupancy map as Nav2's map server holds it.

    `cells` is uint8 (rows, columns), 0 free, 100 occupied, 255 unknown; row 0 is the lowest y.
    `origin` is the pose of the lower left corner of cell (0, 0) in the map frame; metres.
    """

    cells: NDArray[np.uint8]
    resolution: float
    origin: Pose


class Description(Record):
    """The environment in words, written by a VLM or a person; `reviewed` says a person has accepted it."""

    layout: str
    grid: str
    reviewed: bool = False
    reviewer: str | None = None
    reviewed_on: str | None = None


class WorldParts(Record):
    """What a saved scenario needs to know of its world to tell whether a change of the world matters to it.

    `floor` is the content id of everything solid; `rows` and `columns` hold the coordinate of every line of waypoints
    in metres, rows along the axis `up`; `moved` the waypoints that lie elsewhere.
    """

    floor: str
    up: Literal["x", "y"]
    rows: dict[str, float]
    columns: dict[str, float]
    moved: dict[str, Point] = Field(default_factory=dict)

    def position(self, waypoint: str) -> Point | None:
        """Return where a waypoint was (x, y) in metres; None if there was none of that name."""
        if waypoint in self.moved:
            return self.moved[waypoint]
        split = len(waypoint) - len(waypoint.lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ"))
        along, across = self.rows.get(waypoint[:split]), self.columns.get(waypoint[split:])
        if along is None or across is None:
            return None
        return (along, across) if self.up == "x" else (across, along)


Named = TypeVar("Named", Route, Area)


@dataclass(frozen=True, kw_only=True, eq=False)
class World:
    """Everything known of an environment.

    `map_offset` is the translation world - map (metres): zero unless the occupancy map the robot localises in
    is shifted against the world, as in the published study.
    """

    name: str
    title: str
    objects: tuple[SolidObject, ...]
    occupancy: OccupancyMap
    lidar_height_m: float
    grid: Grid
    areas: tuple[Area, ...]
    routes: tuple[Route, ...]
    activities: tuple[str, ...] = ()
    description: Description | None = None
    map_offset: Point = (0.0, 0.0)
    grid_spec: GridSpec | None = None
    doors: tuple[Door, ...] = ()
    actors: tuple[str, ...] = ()
    """What generators may use besides people on foot: `trolley`, `child`, `wheelchair`, `moved_object`."""
    trolley_work: Mapping[str, bool] = field(default_factory=dict)
    """Which activities are done with a trolley, by their text; of the others their words tell."""
    moved: tuple[SolidObject, ...] = ()
    """Objects that a scenario puts into the world. They are solid, but the robot's map does not show them, and they
    are no part of the world's id."""
    door_states: Mapping[str, State] = field(default_factory=dict)
    """The states that a scenario gives to doors, by name. They are no part of the world's id; `doors` are as the world
    has them."""

    @property
    def solids(self) -> tuple[SolidObject, ...]:
        """Everything solid: the world's own objects, doors that never move, then what was moved there."""
        return self.objects + self.still_doors + self.moved

    @cached_property
    def still_doors(self) -> tuple[SolidObject, ...]:
        """The leaves of the doors that are open or closed all the time."""
        return tuple(_leaf(door, outline) for door in self.staged_doors if (outline := door.still) is not None)

    @cached_property
    def staged_doors(self) -> tuple[Door, ...]:
        """The doors in the states of the scenario."""
        states = self.door_states
        return tuple(d.model_copy(update={"state": states.get(d.name, d.state)}) for d in self.doors)

    @cached_property
    def drawn(self) -> tuple[SolidObject, ...]:
        """What pictures show: everything solid, and the automatic doors as they are when they are closed."""
        return (*self.solids, *(_leaf(door, door.leaf(0.0), kind=AUTOMATIC) for door in self.moving_doors))

    @property
    def moving_doors(self) -> tuple[Door, ...]:
        """The automatic doors."""
        return tuple(door for door in self.staged_doors if door.state == "automatic")

    def _ground(self) -> dict[str, object]:
        """Return the part of an id that map and doors make up; a world without doors keeps the id it had."""
        doors = {"doors": [d.model_dump(mode="json") for d in self.doors]} if self.doors else {}
        return {
            "resolution": self.occupancy.resolution,
            "origin": self.occupancy.origin.model_dump(mode="json"),
            "lidar_height_m": self.lidar_height_m,
            "map_offset": list(self.map_offset),
            **doors,
        }

    @cached_property
    def floor_id(self) -> str:
        """The content id of everything solid: map, objects and lidar height, without the names of things."""
        cells = self.occupancy.cells
        objects = [o.model_dump(mode="json", exclude={"name", "kind"}) for o in self.objects]
        held = {"objects": objects, "map": sha256(cells.tobytes()).hexdigest(), "shape": list(cells.shape)}
        return content_id("floor", held | self._ground())

    @cached_property
    def parts(self) -> WorldParts:
        """What a scenario made in this world keeps of it."""
        grid = self.grid
        lines = WorldParts(
            floor=self.floor_id, up=grid.up, rows=grid.row_positions, columns=grid.column_positions, moved={}
        )
        moved = {w.name: (w.x, w.y) for w in grid.waypoints if lines.position(w.name) != (w.x, w.y)}
        return lines.model_copy(update={"moved": moved})

    @cached_property
    def id(self) -> str:
        """Content id of everything but title, activities and description, which are words."""
        held: dict[str, object] = {
            "objects": [o.model_dump(mode="json") for o in self.objects],
            "map": self.occupancy.cells.tobytes().hex(),
            "grid": self.grid.model_dump(mode="json"),
            "areas": [a.model_dump(mode="json") for a in self.areas],
            "routes": [r.model_dump(mode="json") for r in self.routes],
        }
        return content_id("world", held | self._ground())

    @cached_property
    def place_id(self) -> str:
        """The content id of the world together with the objects that were moved there and the states of its doors."""
        staged: dict[str, object] = {}
        if self.moved:
            staged["moved"] = [o.model_dump(mode="json") for o in self.moved]
        if self.door_states:
            staged["doors"] = dict(self.door_states)
        return content_id("place", {"world": self.id, **staged}) if staged else self.id

    def with_moved(self, moved: tuple[SolidObject, ...]) -> World:
        """Return the world with these objects moved into it, and no others; its id stays the same."""
        return self if moved == self.moved else self.staged(moved=moved)

    def staged(self, **changes: Any) -> World:
        """Return a copy as a scenario finds it: with other objects in it, door states, or hops; its ids stay."""
        changed = replace(self, **changes)
        for name in ("id", "floor_id", "parts"):
            if name in self.__dict__ or "grid" in changes:
                changed.__dict__[name] = getattr(self, name)  # they do not depend on what is staged
        return changed

    def needs_trolley(self, activity: str) -> bool:
        """Return whether an activity is done with a trolley: what the world says of it, else what its words tell."""
        text = activity.lower()
        return self.trolley_work.get(activity, any(word in text for word in TROLLEY_WORDS))

    @cached_property
    def _standing(self) -> tuple[list[str], NDArray[np.float64]]:
        """Names and positions (K, 2) of the waypoints a person can stand on."""
        valid = [w for w in self.grid.waypoints if w.human]
        return [w.name for w in valid], np.array([(w.x, w.y) for w in valid]).reshape(-1, 2)

    def nearest_waypoints(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> list[str]:
        """Return the name of the valid waypoint nearest to each of the points x (K,), y (K,), as `Grid.nearest` does.

        Names are empty where the grid has no waypoint.
        """
        names, at = self._standing
        if not names:
            return [""] * len(x)
        squared = (at[None, :, 0] - x[:, None]) ** 2 + (at[None, :, 1] - y[:, None]) ** 2
        return [names[i] for i in squared.argmin(axis=1)]

    @cached_property
    def _area_points(self) -> tuple[list[str], NDArray[np.float64]]:
        """The area of each labelled waypoint and (K, 2) where it is."""
        grid = self.grid
        points = [(area.name, grid.position(w)) for area in self.areas for w in area.waypoints if w in grid.by_name]
        return [name for name, _ in points], np.array([at for _, at in points]).reshape(-1, 2)

    def place_name(self, x: float, y: float) -> str:
        """Return the name by which findings, failures and maps speak of a position (m).

        It is the labelled area whose waypoints are nearest; where nothing is labelled, the nearest waypoint.
        """
        names, at = self._area_points
        if not names:
            return self.grid.nearest(x, y)
        nearest: str = min((math.dist((x, y), at[k]), names[k]) for k in nearest_rows(at, x, y))[1]
        return nearest

    def route(self, name: str) -> Route:
        """Return the route of that name; raises UnknownName."""
        return self._named("route", name, self.routes)

    def area(self, name: str) -> Area:
        """Return the area of that name; raises UnknownName."""
        return self._named("area", name, self.areas)

    def _named(self, kind: str, name: str, things: Sequence[Named]) -> Named:
        found = next((thing for thing in things if thing.name == name), None)
        if found is None:
            raise UnknownName(kind, name, [thing.name for thing in things], hint=f"World: {self.name}.")
        return found


def _leaf(door: Door, outline: Polygon, kind: str = "door") -> SolidObject:
    """Return a leaf that stands still as a solid object."""
    (ax, ay), (bx, by), (cx, cy), _ = outline
    middle = (0.5 * (ax + cx), 0.5 * (ay + cy), 0.5 * HEIGHT_M)
    size = (door.width_m, door.thickness_m, HEIGHT_M)
    return SolidObject(
        name=door.name,
        kind=kind,
        origin=(*door.hinge, 0.0),
        box=OrientedBox(center=middle, size=size, yaw=math.atan2(by - ay, bx - ax)),
        footprint=outline,
        slices=(outline,),
    )
