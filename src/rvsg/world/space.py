"""Free space: how far every place is from the nearest obstacle, for a person and for the robot.

A person cannot walk through a shelf although the lidar plane only cuts its legs: people keep clear of the objects'
footprints and of what the map shows; the robot keeps clear of what its own map shows. Unknown cells are not free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rvsg.world.raster import Frame, inside_cells, outline_cells
from rvsg.world.world import FREE, OccupancyMap, SolidObject, World

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

MOST_SEGMENTS = 1000
"""The number of segments checked in one step, which bounds the memory."""


@dataclass(frozen=True, eq=False)
class Space:
    """A field of clearances. `field` (rows, columns) is the distance in metres from a cell's centre to the nearest
    obstacle's border (0 inside obstacles); outside the map nothing is free. Exact to half a cell's diagonal.
    """

    frame: Frame
    field: NDArray[np.float32]

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
        """Which connected part of the free space every cell belongs to for a disc of this radius; (rows, columns).

        0 where the disc does not fit, else 1 and up, the larger part first.
        """
        known = _parts.setdefault(self, {})
        if radius not in known:
            known.clear()  # large arrays: only the last radius is kept
            known[radius] = self._labelled(radius)
        return known[radius]

    def _labelled(self, radius: float) -> NDArray[np.int32]:
        from scipy.ndimage import label

        parts, count = label((self.field > 0) & (self.field >= radius))
        sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
        rank = np.zeros(count + 1, np.int32)
        rank[1 + np.argsort(-sizes, kind="stable")] = np.arange(1, count + 1)
        ranked = np.asarray(rank[parts])
        ranked.setflags(write=False)
        return ranked

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


_parts: WeakKeyDictionary[Space, dict[float, NDArray[np.int32]]] = WeakKeyDictionary()


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


def human_space_of(objects: Sequence[SolidObject], occupancy: OccupancyMap) -> Space:
    """Return where a person can be: clear of every footprint and of all that the map does not show free.

    The last answer for a map is kept, as a world is made and checked from the same objects.
    """
    if not objects:
        return robot_space_of(occupancy)
    among, known = _solid_spaces.get(occupancy, ((), None))
    if known is None or among != tuple(objects):
        frame = frame_of(occupancy)
        known = space_of((occupancy.cells != FREE) | solid_cells(objects, frame), frame)
        _solid_spaces[occupancy] = tuple(objects), known
    return known


_solid_spaces: WeakKeyDictionary[OccupancyMap, tuple[tuple[SolidObject, ...], Space]] = WeakKeyDictionary()


def robot_space_of(occupancy: OccupancyMap) -> Space:
    """Return where the robot can be as far as its own map tells; computed once per map."""
    if occupancy not in _map_spaces:
        _map_spaces[occupancy] = space_of(occupancy.cells != FREE, frame_of(occupancy))
    return _map_spaces[occupancy]


_map_spaces: WeakKeyDictionary[OccupancyMap, Space] = WeakKeyDictionary()


def main_floor(space: Space, clearance_m: float = 0.3) -> Bools:
    """The largest connected part of the floor on which a person has `clearance_m`; (rows, columns)."""
    return np.asarray(space.parts(clearance_m) == 1)


_human_spaces: WeakKeyDictionary[World, Space] = WeakKeyDictionary()
_robot_spaces: WeakKeyDictionary[World, Space] = WeakKeyDictionary()
_driving_spaces: WeakKeyDictionary[World, Space] = WeakKeyDictionary()


def human_space(world: World) -> Space:
    """Return where a person can be in this world, in the world frame; computed once per world."""
    if world not in _human_spaces:
        _human_spaces[world] = human_space_of(world.solids, world_map(world))
    return _human_spaces[world]


def robot_space(world: World) -> Space:
    """Where the robot can be in this world as far as its map tells, in the world frame; computed once per world."""
    if world not in _robot_spaces:
        bare = not world.solids  # then people and robot go by the same map
        _robot_spaces[world] = human_space(world) if bare else robot_space_of(world_map(world))
    return _robot_spaces[world]


def driving_space(world: World) -> Space:
    """Return where the robot really can be: clear of what its map shows, moved objects and doors that stand still."""
    unseen = world.still_doors + world.moved
    if not unseen:
        return robot_space(world)
    if world not in _driving_spaces:
        occupancy = world_map(world)
        frame = frame_of(occupancy)
        _driving_spaces[world] = space_of((occupancy.cells != FREE) | solid_cells(unseen, frame), frame)
    return _driving_spaces[world]


def in_same_space(changed: World, world: World) -> World:
    """The changed copy of a world whose map and objects are the same: what is computed of its space is kept."""
    for spaces in (_human_spaces, _robot_spaces, _driving_spaces):
        if world in spaces:
            spaces[changed] = spaces[world]
    return changed


def world_map(world: World) -> OccupancyMap:
    """The occupancy map moved from the map frame to the world frame by the world's `map_offset`."""
    dx, dy = world.map_offset
    if not (dx or dy):
        return world.occupancy
    origin = world.occupancy.origin
    moved = origin.model_copy(update={"x": origin.x + dx, "y": origin.y + dy})
    return OccupancyMap(cells=world.occupancy.cells, resolution=world.occupancy.resolution, origin=moved)
