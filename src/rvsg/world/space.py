"""Free space: the distance of every place to the nearest obstacle, for a person and for the robot.

People keep clear of the objects' footprints and of what the map shows, the robot of what its own map shows. Unknown
cells are not free.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Pose
from rvsg.world.world import FREE, OccupancyMap, SolidObject, World

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

MOST_CROSSINGS = 1_000_000
"""Pairs of a row and an edge that are compared in one step, which bounds the memory."""


@dataclass(frozen=True)
class Frame:
    """Where a raster lies: `origin` is the pose of the lower left corner of cell (0, 0), `resolution` metres a cell.

    `shape` is (rows, columns); a row is a step along the frame's y axis, a column one along its x axis.
    """

    origin: Pose
    resolution: float
    shape: tuple[int, int]

    def to_cells(self, points: Floats) -> Floats:
        """Points (..., 2) in metres as fractional (column, row); cell (r, c) covers [c, c + 1) x [r, r + 1)."""
        moved = points - np.array([self.origin.x, self.origin.y])
        if self.origin.yaw:
            c, s = np.cos(self.origin.yaw), np.sin(self.origin.yaw)
            moved = moved @ np.array([[c, -s], [s, c]])
        return np.asarray(moved / self.resolution)

    def to_metres(self, cells: Floats) -> Floats:
        """Fractional (column, row) (..., 2) as points in metres; the inverse of `to_cells`."""
        scaled = cells * self.resolution
        if self.origin.yaw:
            c, s = np.cos(self.origin.yaw), np.sin(self.origin.yaw)
            scaled = scaled @ np.array([[c, s], [-s, c]])
        return np.asarray(scaled + np.array([self.origin.x, self.origin.y]))

    def looked_up(self, cells: NDArray[Any], points: Floats) -> NDArray[Any]:
        """Return the values of the cells in which the points (..., 2) in metres lie; 0 off the raster."""
        at = np.floor(self.to_cells(np.asarray(points, float)) + 1e-9).astype(int)
        column, row = at[..., 0], at[..., 1]
        on_map = (column >= 0) & (column < self.shape[1]) & (row >= 0) & (row < self.shape[0])
        if on_map.all():
            return np.asarray(cells[row, column])
        values = cells[np.where(on_map, row, 0), np.where(on_map, column, 0)]
        return np.asarray(np.where(on_map, values, np.zeros((), cells.dtype)))

    def looked_up_at(self, cells: NDArray[Any], x: float, y: float) -> Any:
        """Return the value of the cell in which one point in metres lies; 0 off the raster."""
        if self.origin.yaw:
            return self.looked_up(cells, np.array([x, y]))
        column = math.floor((x - self.origin.x) / self.resolution + 1e-9)
        row = math.floor((y - self.origin.y) / self.resolution + 1e-9)
        rows, columns = self.shape
        return cells[row, column] if 0 <= column < columns and 0 <= row < rows else cells.dtype.type(0)

    @property
    def corners(self) -> Floats:
        """The four corners of the raster in metres, (4, 2), counter-clockwise from the origin."""
        rows, columns = self.shape
        return self.to_metres(np.array([[0.0, 0.0], [columns, 0.0], [columns, rows], [0.0, rows]]))


def covering(points: Floats, resolution: float, margin: float = 0.0) -> Frame:
    """Return the smallest frame on multiples of `resolution` that holds the points (n, 2) and a margin in metres."""
    low = np.floor((points.min(axis=0) - margin) / resolution + 1e-9)
    high = np.ceil((points.max(axis=0) + margin) / resolution - 1e-9)
    columns, rows = (int(n) for n in np.maximum(high - low, 1))
    x, y = (round(float(v), 9) for v in low * resolution)
    return Frame(Pose(x=x, y=y), resolution, (rows, columns))


def coarser(cells: NDArray[Any], frame: Frame, step: int, merge: Callable[..., Any]) -> tuple[NDArray[Any], Frame]:
    """Return a raster with blocks of `step` x `step` cells merged (such as by np.max), and its frame."""
    high, wide = (n // step for n in frame.shape)
    if step == 1 or not (high and wide):
        return cells, frame
    blocks = cells[: high * step, : wide * step].reshape(high, step, wide, step)
    return np.asarray(merge(blocks, axis=(1, 3))), Frame(frame.origin, frame.resolution * step, (high, wide))


def outermost(cells: Bools) -> NDArray[np.int_]:
    """Return the first and last marked cell of every row that has one, as (n, 2) of column and row."""
    rows = np.flatnonzero(cells.any(axis=1))
    first = cells[rows].argmax(axis=1)
    last = cells.shape[1] - 1 - cells[rows, ::-1].argmax(axis=1)
    return np.column_stack([np.concatenate([first, last]), np.concatenate([rows, rows])])


def outline_cells(polygons: Iterable[Sequence[tuple[float, float]]], frame: Frame) -> Bools:
    """Return every cell that an edge of a closed polygon crosses; (rows, columns)."""
    cells = np.zeros(frame.shape, bool)
    for polygon in polygons:
        corners = frame.to_cells(np.asarray(polygon, float))
        ends = np.roll(corners, -1, axis=0)
        for a, b in zip(corners, ends, strict=True):
            steps = max(1, int(np.ceil(np.hypot(*(b - a)) * 10)))
            at = np.floor(a + (b - a) * np.linspace(0.0, 1.0, steps + 1)[:, None] + 1e-9).astype(int)
            at = at[((at >= 0) & (at < frame.shape[::-1])).all(axis=1)]
            cells[at[:, 1], at[:, 0]] = True
    return cells


def inside_cells(polygons: Iterable[Sequence[tuple[float, float]]], frame: Frame) -> Bools:
    """Return every cell whose centre is inside an odd number of the polygons (a ring is its outline and its hole)."""
    cells = np.zeros(frame.shape, bool)
    for polygon in polygons:
        corners = frame.to_cells(np.asarray(polygon, float)) - 0.5  # cell centres have whole numbers
        _toggle(cells, corners)
    return cells


def covered_cells(polygons: NDArray[np.float64], frame: Frame) -> Bools:
    """Every cell that one of many small polygons (n, corners, 2) covers or touches."""
    from PIL import Image, ImageDraw

    rows, columns = frame.shape
    image = Image.new("1", (columns, rows))
    draw = ImageDraw.Draw(image)
    for corners in frame.to_cells(polygons) - 0.5:
        draw.polygon(corners.ravel().tolist(), fill=1, outline=1)
    return np.array(image, bool)


def inside_window(polygon: Sequence[tuple[float, float]], frame: Frame) -> tuple[tuple[slice, slice], Bools]:
    """Return the part of a raster that a polygon covers, and which of its cells have their centre in the polygon."""
    corners = frame.to_cells(np.asarray(polygon, float))
    limits = (frame.shape[1], frame.shape[0])
    low = np.clip(np.floor(corners.min(axis=0)).astype(int) - 1, 0, limits)
    high = np.clip(np.ceil(corners.max(axis=0)).astype(int) + 1, 0, limits)
    cells = np.zeros((int(high[1] - low[1]), int(high[0] - low[0])), bool)
    if cells.size:
        _toggle(cells, corners - low - 0.5)
    return (slice(int(low[1]), int(high[1])), slice(int(low[0]), int(high[0]))), cells


def _toggle(cells: Bools, corners: Floats) -> None:
    """Invert the cells inside a closed polygon; `corners` (n, 2) are (column, row), cell centres whole numbers."""
    ends = np.roll(corners, -1, axis=0)
    low = max(0, int(np.ceil(corners[:, 1].min())))
    high = min(len(cells) - 1, int(np.floor(corners[:, 1].max())))
    step = max(1, MOST_CROSSINGS // len(corners))
    for start in range(low, high + 1, step):
        lines = np.arange(start, min(start + step, high + 1))
        line, edge = np.nonzero((corners[:, 1] <= lines[:, None]) != (ends[:, 1] <= lines[:, None]))
        a, b = corners[edge], ends[edge]
        at = a[:, 0] + (lines[line] - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
        order = np.lexsort((at, line))
        first, last = np.ceil(at[order][0::2]).clip(0).astype(int), np.floor(at[order][1::2]).clip(-1).astype(int)
        for row, left, right in zip(lines[line[order][0::2]].tolist(), first.tolist(), last.tolist(), strict=True):
            cells[row, left : right + 1] ^= True


MOST_SEGMENTS = 1000
"""The number of segments checked in one step, which bounds the memory."""


@dataclass(frozen=True, eq=False)
class Space:
    """A field of clearances. `field` (rows, columns) is the distance in metres from a cell's centre to the nearest
    obstacle's border (0 inside obstacles); outside the map nothing is free. Exact to half a cell's diagonal.
    """

    frame: Frame
    field: NDArray[np.float32]
    _parts: dict[float, NDArray[np.int32]] = dataclass_field(default_factory=dict, init=False, repr=False)

    def clearances(self, points: Floats) -> Floats:
        """Distance in metres from each of the points (..., 2) to the nearest obstacle; 0 in one or off the map."""
        return self.frame.looked_up(self.field, points).astype(float)

    def clearance(self, x: float, y: float) -> float:
        """Distance in metres from a point to the nearest obstacle; 0 inside one or off the map."""
        return float(self.frame.looked_up_at(self.field, x, y))

    def is_free(self, x: float, y: float, radius: float = 0.0) -> bool:
        """Return whether a disc of this radius (metres) fits here; radius 0 asks whether the point itself is free."""
        clear = self.clearance(x, y)
        return clear > 0.0 and clear >= radius

    def parts(self, radius: float) -> NDArray[np.int32]:
        """Return the connected part of the free space of every cell for a disc of this radius: 0 none, 1 largest."""
        if radius not in self._parts:
            from scipy.ndimage import label

            parts, count = label((self.field > 0) & (self.field >= radius))
            sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
            rank = np.zeros(count + 1, np.int32)
            rank[1 + np.argsort(-sizes, kind="stable")] = np.arange(1, count + 1)
            ranked = np.asarray(rank[parts])
            ranked.setflags(write=False)
            self._parts.clear()
            self._parts[radius] = ranked
        return self._parts[radius]

    def segments_free(self, starts: Floats, ends: Floats, radius: float = 0.0) -> Bools:
        """For n segments (n, 2) to (n, 2): whether a disc of this radius can move straight from end to end; (n,)."""
        starts, ends = np.atleast_2d(starts).astype(float), np.atleast_2d(ends).astype(float)
        if len(starts) == 0:
            return np.zeros(0, bool)
        longest = float(np.hypot(*(ends - starts).T).max())
        samples = max(2, int(np.ceil(longest / (self.frame.resolution / 2))) + 1)
        shares = np.linspace(0.0, 1.0, samples)
        free = np.ones(len(starts), bool)
        for first in range(0, len(starts), MOST_SEGMENTS):
            some = slice(first, first + MOST_SEGMENTS)
            way = (ends[some] - starts[some])[:, None] * shares[:, None]
            clear = self.clearances(starts[some, None] + way)
            free[some] = ((clear > 0.0) & (clear >= radius)).all(axis=1)
        return free

    def segment_free(self, a: tuple[float, float], b: tuple[float, float], radius: float = 0.0) -> bool:
        """Return whether a disc of this radius (metres) can move straight from `a` to `b`."""
        return bool(self.segments_free(np.array([a]), np.array([b]), radius)[0])


def frame_of(occupancy: OccupancyMap) -> Frame:
    """Return where the cells of an occupancy map lie."""
    rows, columns = occupancy.cells.shape
    return Frame(occupancy.origin, occupancy.resolution, (rows, columns))


def space_of(blocked: Bools, frame: Frame) -> Space:
    """The clearances around the blocked cells (rows, columns)."""
    from scipy.ndimage import distance_transform_edt

    padded = np.pad(~blocked, 1, constant_values=False)  # the world ends at the border of its map
    cells = distance_transform_edt(padded)[1:-1, 1:-1]
    metres = np.maximum(cells - 0.5, 0.0) * frame.resolution
    return Space(frame, metres.astype(np.float32))


def solid_cells(objects: Sequence[SolidObject], frame: Frame) -> Bools:
    """The cells that the objects' footprints cover (their holes left open), borders included."""
    cells = np.zeros(frame.shape, bool)
    for thing in objects:
        rings = (thing.footprint, *thing.holes)
        cells |= inside_cells(rings, frame) | outline_cells(rings, frame)
    return cells


_solid_spaces: WeakKeyDictionary[OccupancyMap, tuple[tuple[SolidObject, ...], Space]] = WeakKeyDictionary()
"""The last answer for each map, as a world is made and checked from the same objects."""
_map_spaces: WeakKeyDictionary[OccupancyMap, Space] = WeakKeyDictionary()
_spaces: WeakKeyDictionary[World, dict[str, Space]] = WeakKeyDictionary()
"""What was computed of each world, by who moves in it."""


def human_space_of(objects: Sequence[SolidObject], occupancy: OccupancyMap) -> Space:
    """Return where a person can be: clear of every footprint and of all that the map does not show free."""
    if not objects:
        return robot_space_of(occupancy)
    if occupancy not in _solid_spaces or _solid_spaces[occupancy][0] != tuple(objects):
        _solid_spaces[occupancy] = tuple(objects), _blocked_by(objects, occupancy)
    return _solid_spaces[occupancy][1]


def _blocked_by(objects: Sequence[SolidObject], occupancy: OccupancyMap) -> Space:
    frame = frame_of(occupancy)
    return space_of((occupancy.cells != FREE) | solid_cells(objects, frame), frame)


def robot_space_of(occupancy: OccupancyMap) -> Space:
    """Return where the robot can be as far as its own map tells; computed once per map."""
    if occupancy not in _map_spaces:
        _map_spaces[occupancy] = space_of(occupancy.cells != FREE, frame_of(occupancy))
    return _map_spaces[occupancy]


def main_floor(space: Space, clearance_m: float = 0.3) -> Bools:
    """The largest connected part of the floor on which a person has `clearance_m`; (rows, columns)."""
    return np.asarray(space.parts(clearance_m) == 1)


def human_space(world: World) -> Space:
    """Return where a person can be in this world, in the world frame; computed once per world."""
    return _kept(world, "human", lambda: human_space_of(world.solids, world_map(world)))


def robot_space(world: World) -> Space:
    """Where the robot can be in this world as far as its map tells, in the world frame; computed once per world."""
    bare = not world.solids  # then people and robot go by the same map
    return _kept(world, "robot", lambda: human_space(world) if bare else robot_space_of(world_map(world)))


def driving_space(world: World) -> Space:
    """Return where the robot really can be: clear of what its map shows, moved objects and doors that stand still."""
    unseen = world.still_doors + world.moved
    return _kept(world, "driving", lambda: _blocked_by(unseen, world_map(world))) if unseen else robot_space(world)


def _kept(world: World, kind: str, make: Callable[[], Space]) -> Space:
    spaces = _spaces.setdefault(world, {})
    if kind not in spaces:
        spaces[kind] = make()
    return spaces[kind]


def in_same_space(changed: World, world: World) -> World:
    """The changed copy of a world whose map and objects are the same: what is computed of its space is kept."""
    _spaces[changed] = dict(_spaces.get(world, {}))
    return changed


def world_map(world: World) -> OccupancyMap:
    """The occupancy map moved from the map frame to the world frame by the world's `map_offset`."""
    dx, dy = world.map_offset
    if not (dx or dy):
        return world.occupancy
    origin = world.occupancy.origin
    moved = origin.model_copy(update={"x": origin.x + dx, "y": origin.y + dy})
    return OccupancyMap(cells=world.occupancy.cells, resolution=world.occupancy.resolution, origin=moved)
