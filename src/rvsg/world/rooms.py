"""Floor inside a building, as opposed to the floor around it and in its courtyards."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.world.space import Bools, Frame, Space, frame_of, human_space_of, main_floor
from rvsg.world.world import FREE, OCCUPIED, UNKNOWN, Area, OccupancyMap, Polygon, SolidObject

GATE_M = 3.0
"""An opening this wide is no door."""
MOUTH = 0.5
"""A court is open by this share of its width at least; a hall with a gate is not."""
BACKED = 0.5
"""Behind this share of a court's walls is closed floor of the building; behind those of an open hall is nothing."""
WALL_M = 1.0
LEAST_M2 = 8.0
SLIVER_M2 = 3.0


def open_courts(free: Bools, inside: Bools, closed: Bools, resolution: float) -> list[Bools]:
    """Return the parts of the inside that are courts: wide open to the outside, with rooms of the building behind.

    Args:
        free: The floor that hangs together with the outside, at the edges of the map.
        inside: The part of it that lies between walls.
        closed: Other floor, in closed walls.
        resolution: Metres per cell.
    """
    from scipy.ndimage import distance_transform_edt, label

    clear = distance_transform_edt(free) * resolution
    found = []
    parts, count = label(inside & _reached(clear, GATE_M / 2, resolution))
    sizes = np.bincount(parts.ravel(), minlength=count + 1) * resolution**2
    for number in np.flatnonzero(sizes[1:] >= LEAST_M2) + 1:
        court = parts == number
        mouth = MOUTH * float(clear[court].max())
        if np.count_nonzero(court & _reached(clear, mouth, resolution)) < MOUTH * np.count_nonzero(court):
            continue
        whole = _with_slivers(court, inside, resolution)
        rooms = closed | (inside & ~whole)
        if _share_backed(whole, rooms, free & ~inside, resolution) >= BACKED:
            found.append(whole)
    return found


def widely_open(parts: NDArray[np.int32], resolution: float) -> set[int]:
    """Return the numbers of the parts that meet an edge of the map in an opening that is no door."""
    wide = set()
    for edge in (parts[0], parts[-1], parts[:, 0], parts[:, -1]):
        starts = np.flatnonzero(np.diff(edge, prepend=-1))
        lengths = np.diff([*starts, len(edge)]) * resolution
        wide |= set(edge[starts[lengths > GATE_M]].tolist())
    return wide - {0}


def _reached(clear: NDArray[np.float64], radius: float, resolution: float) -> Bools:
    """Return where a disc of this radius comes from the edges of the map without meeting a wall."""
    from scipy.ndimage import distance_transform_edt, label

    cores, _ = label(clear > radius)
    edges = np.unique(np.concatenate([cores[0], cores[-1], cores[:, 0], cores[:, -1]]))
    outer = np.isin(cores, edges[edges > 0])
    if not outer.any():
        return np.zeros_like(outer)
    # the disc covers every cell that is nearer to its middle than the wall is
    return np.asarray(distance_transform_edt(~outer) * resolution < radius + resolution) & (clear > 0)


def _with_slivers(court: Bools, inside: Bools, resolution: float) -> Bools:
    """Return a court with its corners, which no disc reaches, and strips along its walls."""
    from scipy.ndimage import binary_dilation, label

    rest, count = label(inside & ~court)
    sizes = np.bincount(rest.ravel(), minlength=count + 1) * resolution**2
    touching = np.unique(rest[binary_dilation(court)])
    small = [n for n in touching if n and sizes[n] < SLIVER_M2]
    return np.asarray(court | np.isin(rest, small))


def _share_backed(court: Bools, rooms: Bools, outside: Bools, resolution: float) -> float:
    """Return the share of the walls round a court behind which is floor of the building, not the outside."""
    from scipy.ndimage import binary_dilation, distance_transform_edt

    walls = binary_dilation(court, np.ones((3, 3), bool), 2) & ~court & ~rooms & ~outside
    count = np.count_nonzero(walls)
    if not count or not rooms.any():
        return 0.0
    near = math.ceil(WALL_M / resolution)
    return float(np.count_nonzero(distance_transform_edt(~rooms)[walls] <= near) / count)


Labels = NDArray[np.int32]

CELL_M = 0.1
MOST_CELLS = 1_600_000
DOOR_M = 2.0  # a narrowing of at most this width separates two rooms
ROOM_LEAST_M2 = 3.0
CORRIDOR_WIDTH_M = 3.5
CORRIDOR_RATIO = 3.0  # a corridor is at least this many times as long as it is wide
HALL_M2 = 60.0
MOST_ROOMS = 60
SIMPLIFY_M = 0.15
DIRECTIONS = 6
SMOOTH_M = 1.0


@dataclass(frozen=True, kw_only=True)
class Room:
    """A part of the floor: its cells in `labels`, size in m², mean width in metres and middle (x, y)."""

    number: int
    area_m2: float
    width_m: float
    middle: tuple[float, float]

    @property
    def kind(self) -> str:
        """corridor, hall or room."""
        if self.width_m <= CORRIDOR_WIDTH_M and self.area_m2 >= CORRIDOR_RATIO * self.width_m**2:
            return "corridor"
        return "hall" if self.area_m2 >= HALL_M2 else "room"


def indoors(occupancy: OccupancyMap) -> Bools:
    """Return the free cells that lie between walls, also where no wall is closed; (rows, columns).

    A place is indoors if a wall stands in at least six of eight directions. Outdoors at most half of them meet the
    building.
    """
    from scipy.ndimage import uniform_filter

    walls = occupancy.cells == OCCUPIED
    seen = np.zeros(walls.shape, np.uint8)
    for turned in (walls, walls[::-1]):
        flip = turned is not walls
        down = np.maximum.accumulate(turned, axis=0)
        left, right = _diagonal(turned), _diagonal(turned[:, ::-1])[:, ::-1]
        for hit in (down, left, right):
            seen += hit[::-1] if flip else hit
    seen += np.maximum.accumulate(walls, axis=1)
    seen += np.maximum.accumulate(walls[:, ::-1], axis=1)[:, ::-1]
    share = uniform_filter((seen >= DIRECTIONS).astype(np.float32), max(1, round(SMOOTH_M / occupancy.resolution)))
    return np.asarray((occupancy.cells == FREE) & (share > 0.5))


def _diagonal(walls: Bools) -> Bools:
    """Return where a wall stands on the diagonal towards lower rows and lower columns."""
    hit = walls.copy()
    for row in range(1, len(hit)):
        hit[row, 1:] |= hit[row - 1, :-1]
    return hit


def rooms_of(space: Space, floor: Bools) -> tuple[Labels, Frame, tuple[Room, ...]]:
    """Divide the floor at narrowings of at most DOOR_M.

    Cells of the floor that are farther than DOOR_M / 2 from walls form the cores of rooms; the rest of the floor
    belongs to the core from which it is reached first. Returns the number of every cell's room (0: none), the frame
    of these cells and the rooms, the largest first.
    """
    from scipy.ndimage import find_objects, label

    cells, field, frame = _coarse(space, floor)
    cores, _ = label(cells & (field > DOOR_M / 2), np.ones((3, 3)))
    cores = _without_small(cores, ROOM_LEAST_M2 / 12 / frame.resolution**2)
    labels = _grown(cores, cells)
    left, count = label(cells & (labels == 0), np.ones((3, 3)))  # parts without a core: narrow corridors and closets
    labels = np.where(left > 0, left + labels.max(), labels) if count else labels
    labels = _joined(labels, ROOM_LEAST_M2 / frame.resolution**2)
    found = [_room(labels, field, frame, n, w) for n, w in enumerate(find_objects(labels), start=1) if w is not None]
    rooms = sorted(found, key=lambda room: (-room.area_m2, room.middle))
    return labels, frame, tuple(rooms)


def areas_of_rooms(space: Space, floor: Bools, *, most: int = MOST_ROOMS) -> tuple[Area, ...]:
    """Return rooms, corridors and halls as areas, named by kind and, if there are few of a kind, by place.

    Numbers go from top to bottom and left to right. Rooms below ROOM_LEAST_M2 are part of their neighbour.
    """
    from scipy.ndimage import find_objects

    labels, frame, rooms = rooms_of(space, floor)
    windows = find_objects(labels)
    kept = [room for room in rooms if room.area_m2 >= ROOM_LEAST_M2][:most]
    areas: list[Area] = []
    for kind in ("hall", "corridor", "room"):
        members = [room for room in kept if room.kind == kind]
        members.sort(key=lambda room: (-round(room.middle[1] / 3.0), room.middle[0]))
        outlines = {r.number: _outline_of_room(labels, r.number, windows[r.number - 1], frame) for r in members}
        members = [room for room in members if outlines[room.number]]
        for room, name in zip(members, _names(kind.capitalize(), members), strict=True):
            outline = outlines[room.number]
            assert outline is not None
            areas.append(Area(name=name, kind=kind, region=None, outline=outline, waypoints=()))
    return tuple(areas)


def _outline_of_room(labels: Labels, number: int, window: tuple[slice, slice], frame: Frame) -> Polygon | None:
    rows, columns = window
    corner = frame.to_metres(np.array([columns.start, rows.start], float))
    origin = frame.origin.model_copy(update={"x": float(corner[0]), "y": float(corner[1])})
    cells = labels[window] == number
    return outline_of(cells, Frame(origin, frame.resolution, (cells.shape[0], cells.shape[1])))


def outline_of(cells: Bools, frame: Frame) -> Polygon | None:
    """Return the outer border of a region of cells as a polygon in metres, simplified to SIMPLIFY_M."""
    import shapely

    if not cells.any():
        return None
    steps = np.diff(np.pad(cells.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, firsts = np.nonzero(steps == 1)  # one rectangle per run of cells in a row
    _, ends = np.nonzero(steps == -1)
    whole = shapely.union_all(shapely.box(firsts, rows, ends, rows + 1))
    largest = max(shapely.get_parts(whole), key=lambda part: part.area)
    ring = shapely.Polygon(largest.exterior).simplify(SIMPLIFY_M / frame.resolution)
    corners = frame.to_metres(shapely.get_coordinates(ring.exterior)[:-1]).round(2)
    return tuple((float(x), float(y)) for x, y in corners)


def _coarse(space: Space, floor: Bools) -> tuple[Bools, NDArray[np.float32], Frame]:
    """Return floor and clearances in cells of about CELL_M."""
    step = max(1, round(CELL_M / space.frame.resolution), math.ceil(math.sqrt(floor.size / MOST_CELLS)))
    rows, columns = (n // step for n in floor.shape)
    if step == 1 or not rows or not columns:
        return floor, space.field, space.frame
    block = (slice(rows * step), slice(columns * step))
    shape = (rows, step, columns, step)
    cells: Bools = np.asarray(floor[block].reshape(shape).any(axis=(1, 3)))
    field: NDArray[np.float32] = np.asarray(space.field[block].reshape(shape).max(axis=(1, 3)))
    return cells, field, Frame(space.frame.origin, space.frame.resolution * step, (rows, columns))


def _without_small(labels: Labels, least_cells: float) -> Labels:
    sizes = np.bincount(labels.ravel())
    keep = sizes >= least_cells
    keep[0] = False
    return np.where(keep[labels], labels, 0).astype(np.int32)


def _grown(cores: Labels, cells: Bools) -> Labels:
    """Grow the cores over the cells, each step by one cell to every side, at most half a door's width and more."""
    from scipy.ndimage import maximum_filter

    labels = cores.copy()
    cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)
    for step in range(4 * math.ceil(DOOR_M / CELL_M)):
        around = maximum_filter(labels, footprint=cross if step % 2 else np.ones((3, 3), bool))
        fresh = cells & (labels == 0) & (around > 0)
        if not fresh.any():
            break
        labels[fresh] = around[fresh]
    return labels


def _joined(labels: Labels, least_cells: float) -> Labels:
    """Join regions that are too small to the neighbour with the longest common border; drop those without one."""
    from scipy.ndimage import find_objects

    labels = labels.copy()
    sizes = np.bincount(labels.ravel())
    windows = dict(enumerate(find_objects(labels), start=1))
    for number in sorted((n for n in windows if windows[n] is not None), key=lambda n: (sizes[n], n)):
        if not 0 < sizes[number] < least_cells:
            continue  # others may have joined it meanwhile
        rows, columns = windows[number]
        window = (slice(max(rows.start - 1, 0), rows.stop + 1), slice(max(columns.start - 1, 0), columns.stop + 1))
        near = labels[window]
        borders = _borders(near, number)
        into = max(borders, key=lambda n: (borders[n], -n)) if borders else 0
        near[near == number] = into
        if into:
            sizes[into] += sizes[number]
            windows[into] = tuple(
                slice(min(a.start, b.start), max(a.stop, b.stop))
                for a, b in zip(windows[into], windows[number], strict=True)
            )
    return labels


def _borders(labels: Labels, number: int) -> dict[int, int]:
    """Return how many cell sides each neighbouring region shares with a region."""
    mine = np.pad(labels == number, 1)
    found: dict[int, int] = {}
    for shift in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        touched = np.roll(mine, shift, (0, 1))[1:-1, 1:-1] & (labels != number) & (labels > 0)
        for other, count in zip(*np.unique(labels[touched], return_counts=True), strict=True):
            found[int(other)] = found.get(int(other), 0) + int(count)
    return found


def _room(labels: Labels, field: NDArray[np.float32], frame: Frame, number: int, window: tuple[slice, slice]) -> Room:
    rows, columns = np.nonzero(labels[window] == number)
    rows, columns = rows + window[0].start, columns + window[1].start
    area = len(rows) * frame.resolution**2
    ridge = np.sort(field[rows, columns])[-max(1, len(rows) // 10) :]  # the tenth of its cells farthest from walls
    at = frame.to_metres(np.array([columns.mean() + 0.5, rows.mean() + 0.5]))
    return Room(
        number=number,
        area_m2=float(area),
        width_m=float(2.0 * ridge.mean()),
        middle=(round(float(at[0]), 2), round(float(at[1]), 2)),
    )


def _names(word: str, rooms: Sequence[Room]) -> list[str]:
    """Return "Corridor", "Corridor west" and "Corridor east", or "Room 1", "Room 2", ..., in the order given."""
    if len(rooms) == 1:
        return [word]
    if len(rooms) <= 4 and word != "Room":
        places = [_place(room, rooms) for room in rooms]
        if len(set(places)) == len(places) and all(places):
            return [f"{word} {place}" for place in places]
    return [f"{word} {number}" for number in range(1, len(rooms) + 1)]


def _place(room: Room, rooms: Sequence[Room]) -> str:
    """Return where a room lies among others: north is +y, east is +x."""
    xs, ys = [r.middle[0] for r in rooms], [r.middle[1] for r in rooms]
    dx, dy = room.middle[0] - (min(xs) + max(xs)) / 2, room.middle[1] - (min(ys) + max(ys)) / 2
    if max(abs(dx), abs(dy)) < 0.2 * max(np.ptp(xs), np.ptp(ys)):
        return "centre"
    if abs(dx) >= abs(dy):
        return "east" if dx > 0 else "west"
    return "north" if dy > 0 else "south"


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
