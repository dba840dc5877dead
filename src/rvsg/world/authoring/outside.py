"""Tell the floor inside a building from the floor outside: around it, and in its courtyards."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.world.authoring.rooms import Labels, Room, indoors, rooms_of
from rvsg.world.authoring.yards import open_courts, widely_open
from rvsg.world.raster import Bools, Frame
from rvsg.world.space import frame_of, human_space_of, main_floor
from rvsg.world.world import FREE, OCCUPIED, UNKNOWN, OccupancyMap, SolidObject

Point = tuple[float, float]

BUILDING_SHARE = 0.5
"""A model that spans this share of the map is the building itself."""
INDOOR_SHARE = 0.3
"""With less of the floor between walls the place is a yard with things in it."""
CLOSED_M2, CLOSED_SHARE = 25.0, 0.03
"""A floor within closed walls has at least this size, and this share of the map; else it is a box in a yard."""
CEILING_SHARE = 0.5
"""Ceilings tell what is outside where they cover at least this share of the floor; with less they are lamps."""
OPEN_SKY_M2 = 8.0
"""A smaller part of the floor without a ceiling is a skylight or a hole in the mesh."""
SKYLIGHT_M = 1.0
COURTYARD_M2 = 80.0
COURTYARD_WIDTH_M = 7.0
ENCLOSED = 0.9
"""Of an enclosed part this share lies within the ring of the other floor."""
RIM_M = 0.5
"""Nobody stands so near to walls, which belong to the room all the same."""
MANY_DOORS = 4
"""What is entered through so many doors is a hall, and ways lead through it."""
HUB = 0.9
"""The other floor hangs together without a courtyard: its largest part is at least this share of it."""
OUTDOORS = frozenset(
    {"tree", "trees", "bush", "hedge", "grass", "lawn", "garden", "courtyard", "patio", "yard", "terrace", "street"}
)
"""Words in the names of things that stand outdoors."""


@dataclass(frozen=True)
class Choices:
    """Points (x, y) in metres about which a person has decided that the floor is inside, or outside."""

    indoors: tuple[Point, ...] = ()
    outdoors: tuple[Point, ...] = ()


@dataclass(frozen=True)
class _Part:
    """A part of the floor as cells of the map, with where it is and why it is taken as outside."""

    cells: Bools
    at: Point
    why: str


def main_part(parts: NDArray[np.int32], sizes: NDArray[np.int64], frame: Frame, ceilings: Bools | None) -> int:
    """Return the number of the open part of the map that is the floor of the building.

    It is the one with most ceiling, if there are ceilings; the largest one within walls, if the largest of all lies
    around the building; a part that encloses the largest one, which is then a courtyard without a door; else the
    largest one.
    """
    from scipy.ndimage import binary_fill_holes

    largest = int(sizes.argmax())
    around = widely_open(parts, frame.resolution)
    if ceilings is not None:
        covered = np.bincount(parts[ceilings], minlength=len(sizes))
        covered[0] = 0
        if covered.max() >= CEILING_SHARE * sizes[covered.argmax()]:
            return int(covered.argmax())
    if largest in around:
        closed = sizes.copy()
        closed[sorted(around)] = 0
        least = max(CLOSED_M2 / frame.resolution**2, CLOSED_SHARE * parts.size)
        return int(closed.argmax()) if closed.max() >= least and _is_around(parts, largest, frame) else largest
    for other in np.argsort(-sizes, kind="stable")[1:4]:
        if sizes[other] < 0.25 * sizes[largest] or not other:
            break
        filled = binary_fill_holes(parts == other)
        if np.count_nonzero(filled & (parts == largest)) >= ENCLOSED * sizes[largest]:
            return int(other)
    return largest


def _is_around(parts: NDArray[np.int32], number: int, frame: Frame) -> bool:
    """Return whether few places of an open part lie between walls."""
    cells = np.where(parts == 0, OCCUPIED, np.where(parts == number, FREE, UNKNOWN)).astype(np.uint8)
    inside = indoors(OccupancyMap(cells=cells, resolution=frame.resolution, origin=frame.origin))
    free = parts == number
    for court in open_courts(free, inside, (parts > 0) & ~free, frame.resolution):
        inside &= ~court
    return bool(inside.sum() < INDOOR_SHARE * np.count_nonzero(free))


def within(
    occupancy: OccupancyMap, objects: Sequence[SolidObject], ceilings: Bools | None, choices: Choices, notes: list[str]
) -> OccupancyMap | None:
    """Return the map with the floor outside the building as unknown; None where the place is a yard with things in it.

    What is decided goes into `notes`, with a point that names the part of the floor.

    Args:
        ceilings: Which cells of the map have something overhead; None where nothing is.
    """
    free = occupancy.cells == FREE
    for at in choices.indoors:
        if not frame_of(occupancy).looked_up_at(free, *at):
            raise InputError(f"--indoors {at[0]:g},{at[1]:g}: no open floor is there, in metres.", code="no-floor")
    edges = (free[0], free[-1], free[:, 0], free[:, -1])
    told = ceilings is not None and np.count_nonzero(free & ceilings) >= CEILING_SHARE * np.count_nonzero(free)
    outside = np.zeros_like(free)
    courts: list[_Part] = []
    if any(edge.any() for edge in edges) and not told:
        inside = indoors(occupancy)
        if inside.sum() < INDOOR_SHARE * np.count_nonzero(free):
            return None
        outside = free & ~inside
        why = "it lies wide open to the outside, between rooms of the building"
        courts = [
            _Part(cells, _middle(cells, frame_of(occupancy)), why)
            for cells in open_courts(free, inside, np.zeros_like(free), occupancy.resolution)
        ]
        notes.append("the building has openings to the outside; the floor outside of it is taken as unknown.")
    floor = _map_of(occupancy, free & ~outside)
    labels, frame, rooms = _rooms(objects, floor)
    parts = _open_sky(floor, ceilings) if told and ceilings is not None else []
    if not told:
        parts = [*courts, *_courtyards(floor, objects, labels, frame, rooms)]
    parts = [part for part in parts if not _chosen(part, choices.indoors, frame_of(occupancy))]
    for x, y in choices.outdoors:
        parts.append(_about((x, y), floor, labels, frame))
    for part in parts:
        outside |= part.cells
        size = np.count_nonzero(part.cells) * occupancy.resolution**2
        x, y = part.at
        notes.append(
            f"{size:.0f} m² of floor about ({x:.1f}, {y:.1f}) are taken as outside: {part.why}. "
            + ("" if (x, y) in choices.outdoors else f"--indoors {x:.1f},{y:.1f} makes them floor of the building.")
        )
    for at in choices.indoors:
        if frame_of(occupancy).looked_up_at(outside, *at):
            raise InputError(
                f"--indoors {at[0]:g},{at[1]:g}: too few walls stand about it; it lies outside.", code="no-floor"
            )
    if not told and not choices.outdoors and len(without_building(objects, floor)) < len(objects):
        notes += _doubtful(rooms, parts, labels, frame)
    return _map_of(occupancy, free & ~outside) if outside.any() else occupancy


def _map_of(occupancy: OccupancyMap, free: Bools) -> OccupancyMap:
    """Return the map with this free floor and no other."""
    cells = np.where((occupancy.cells == FREE) & ~free, UNKNOWN, occupancy.cells).astype(np.uint8)
    cells.setflags(write=False)
    return OccupancyMap(cells=cells, resolution=occupancy.resolution, origin=occupancy.origin)


def _rooms(objects: Sequence[SolidObject], floor: OccupancyMap) -> tuple[Labels, Frame, tuple[Room, ...]]:
    space = human_space_of(objects, floor)
    return rooms_of(space, main_floor(space))


def _open_sky(floor: OccupancyMap, ceilings: Bools) -> list[_Part]:
    """Return the parts of the floor without anything overhead."""
    from scipy.ndimage import binary_dilation, binary_erosion, label

    free = floor.cells == FREE
    bare = free & ~ceilings
    reach = max(1, round(SKYLIGHT_M / 2 / floor.resolution))
    cross = np.ones((3, 3), bool)
    cores = binary_erosion(bare | (floor.cells == UNKNOWN), cross, reach) & bare
    grown = binary_dilation(cores, cross, reach, mask=bare)
    parts, count = label(grown)
    found = []
    for number in range(1, count + 1):
        cells = parts == number
        if np.count_nonzero(cells) * floor.resolution**2 >= OPEN_SKY_M2:
            found.append(_Part(cells, _middle(cells, frame_of(floor)), "nothing is overhead there"))
    return found


def _courtyards(
    floor: OccupancyMap, objects: Sequence[SolidObject], labels: Labels, frame: Frame, rooms: Sequence[Room]
) -> list[_Part]:
    """Return the rooms that are courtyards, told by enclosure, size and what stands in them."""
    inner = without_building(objects, floor)
    one_mesh = len(inner) < len(objects)
    found = []
    for room in rooms:
        cells = labels == room.number
        named, others = _standing_in(inner, cells, frame)
        if named and not others:
            why = f"{', '.join(named[:3])} {'stands' if len(named) == 1 else 'stand'} there"
        elif one_mesh and not others and _is_courtyard(room, rooms, labels):
            why = "the building is around it, it is large and empty, and no way leads through it"
        else:
            continue
        found.append(_Part(_on_map(cells, labels, frame, floor), room.middle, why))
    return found


def without_building(objects: Sequence[SolidObject], occupancy: OccupancyMap) -> list[SolidObject]:
    """Return the objects that stand in the building; without the model whose parts together span the map."""
    spans: dict[tuple[object, ...], list[NDArray[np.float64]]] = {}
    for thing in objects:
        spans.setdefault((thing.kind, thing.origin), []).append(np.array(thing.footprint))
    size = float(occupancy.cells.size) * occupancy.resolution**2
    building = {
        key
        for key, outlines in spans.items()
        if float(np.prod(np.ptp(np.concatenate(outlines), axis=0))) >= BUILDING_SHARE * size
    }
    return [thing for thing in objects if (thing.kind, thing.origin) not in building]


def _is_courtyard(room: Room, rooms: Sequence[Room], labels: Labels) -> bool:
    """Return whether a room is large, enclosed by the other floor, and not what joins the others."""
    from scipy.ndimage import binary_dilation, binary_fill_holes, label

    if room.area_m2 < COURTYARD_M2 or room.width_m < COURTYARD_WIDTH_M or len(rooms) < 4:
        return False
    mine = labels == room.number
    rest = (labels > 0) & ~mine
    if label(rest & binary_dilation(mine, np.ones((3, 3))), np.ones((3, 3)))[1] >= MANY_DOORS:
        return False
    parts, count = label(rest, np.ones((3, 3)))
    sizes = np.bincount(parts.ravel())[1:]
    if not count or sizes.max() < HUB * sizes.sum():
        return False
    around = binary_fill_holes(parts == int(sizes.argmax()) + 1)
    return bool(np.count_nonzero(around & mine) >= ENCLOSED * np.count_nonzero(mine))


def _standing_in(things: Sequence[SolidObject], cells: Bools, frame: Frame) -> tuple[list[str], list[str]]:
    """Return the names of the things about whose middle a part of the floor lies: those of outdoors, and others."""
    named: list[str] = []
    others: list[str] = []
    for thing in things:
        corners = np.array(thing.footprint)
        near = np.concatenate([corners, 1.3 * corners - 0.3 * corners.mean(axis=0)])
        if frame.looked_up(cells, near).mean() < 0.4:
            continue
        words = set(re.findall(r"[a-z]+", f"{thing.name} {thing.kind}".lower()))
        (named if words & OUTDOORS else others).append(thing.name)
    return named, others


def _doubtful(rooms: Sequence[Room], parts: Sequence[_Part], labels: Labels, frame: Frame) -> list[str]:
    """Return a note on every large empty room that a person may know to be outside."""
    known = {part.at for part in parts}
    large = [
        room for room in rooms if room.area_m2 >= COURTYARD_M2 and room.kind == "hall" and room.middle not in known
    ]
    if not large or len(rooms) < 3:
        return []
    listed = ", ".join(f"{r.area_m2:.0f} m² about ({r.middle[0]:.1f}, {r.middle[1]:.1f})" for r in large[:3])
    return [f"if a hall is a courtyard ({listed}), leave it out with --outdoors X,Y: the file has no ceilings to tell."]


def _about(at: Point, floor: OccupancyMap, labels: Labels, frame: Frame) -> _Part:
    """Return the room about a point that a person has chosen as outside."""
    number = int(frame.looked_up_at(labels, *at))
    if not number:
        raise InputError(
            f"--outdoors {at[0]:g},{at[1]:g}: no open floor of the building is there, in metres.",
            code="no-floor",
        )
    return _Part(_on_map(labels == number, labels, frame, floor), at, "you said so")


def _chosen(part: _Part, points: Sequence[Point], frame: Frame) -> bool:
    return any(bool(frame.looked_up_at(part.cells, x, y)) for x, y in points)


def _on_map(cells: Bools, labels: Labels, frame: Frame, floor: OccupancyMap) -> Bools:
    """Return a room of a coarser frame as free cells of the map, up to its walls but not into other rooms."""
    from scipy.ndimage import binary_dilation

    reach = math.ceil(RIM_M / frame.resolution)
    whole = binary_dilation(cells, np.ones((3, 3), bool), reach, mask=cells | (labels == 0))
    step = round(frame.resolution / floor.resolution)
    fine = np.repeat(np.repeat(whole, step, axis=0), step, axis=1)
    rows, columns = floor.cells.shape
    padded = np.pad(fine, ((0, max(0, rows - len(fine))), (0, max(0, columns - fine.shape[1]))), mode="edge")
    on_floor: Bools = _connected(padded[:rows, :columns] & (floor.cells == FREE), frame_of(floor), cells, frame)
    return on_floor


def _connected(free: Bools, fine: Frame, cells: Bools, coarse: Frame) -> Bools:
    """Return the parts of some free cells that hold a cell of the room, so that none lies behind a wall."""
    from scipy.ndimage import label

    parts, _ = label(free)
    rows, columns = np.nonzero(cells)
    inside = coarse.to_metres(np.column_stack([columns + 0.5, rows + 0.5]))
    numbers = np.unique(fine.looked_up(parts, inside))
    return np.isin(parts, numbers[numbers > 0])


def _middle(cells: Bools, frame: Frame) -> Point:
    """Return a point in the middle of a part, and on it."""
    rows, columns = np.nonzero(cells)
    nearest = int(np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2))
    x, y = frame.to_metres(np.array([columns[nearest] + 0.5, rows[nearest] + 0.5]))
    return (round(float(x), 1), round(float(y), 1))
