"""Divide the floor of a building into rooms, corridors and halls, at its doorways."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.world.raster import Frame
from rvsg.world.space import Space
from rvsg.world.world import FREE, OCCUPIED, Area, OccupancyMap, Polygon

Bools = NDArray[np.bool_]
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
