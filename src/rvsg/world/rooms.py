"""Floor inside a building, as opposed to the floor around it and in its courtyards."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.world.space import Bools, Frame, Space, coarser, frame_of, human_space_of, main_floor
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

    `free` is the floor that hangs together with the edges of the map, `inside` its part between walls, `closed` other
    floor, in closed walls; `resolution` in metres per cell.
    """
    from scipy.ndimage import binary_dilation, distance_transform_edt, label

    clear = distance_transform_edt(free) * resolution
    found = []
    parts, count = label(inside & _reached(clear, GATE_M / 2, resolution))
    sizes = np.bincount(parts.ravel(), minlength=count + 1) * resolution**2
    for number in np.flatnonzero(sizes[1:] >= LEAST_M2) + 1:
        court = parts == number
        mouth = MOUTH * float(clear[court].max())
        if np.count_nonzero(court & _reached(clear, mouth, resolution)) < MOUTH * np.count_nonzero(court):
            continue
        # with its corners, which no disc reaches, and strips along its walls
        rest, others = label(inside & ~court)
        small = np.bincount(rest.ravel(), minlength=others + 1) * resolution**2 < SLIVER_M2
        small[0] = False
        touching = np.unique(rest[binary_dilation(court)])
        whole = court | np.isin(rest, touching[small[touching]])
        rooms, outside = closed | (inside & ~whole), free & ~inside
        walls = binary_dilation(whole, np.ones((3, 3), bool), 2) & ~whole & ~rooms & ~outside
        if walls.any() and rooms.any():
            near = distance_transform_edt(~rooms)[walls] <= math.ceil(WALL_M / resolution)
            if np.count_nonzero(near) / np.count_nonzero(walls) >= BACKED:
                found.append(np.asarray(whole))
    return found


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
    """Return the free cells (rows, columns) with a wall in at least six of eight directions."""
    from scipy.ndimage import uniform_filter

    walls = occupancy.cells == OCCUPIED
    seen = np.zeros(walls.shape, np.uint8)
    for turned, hits in ((walls, seen), (walls[::-1], seen[::-1])):  # downwards and upwards
        hits += np.maximum.accumulate(turned, axis=0)
        hits += _diagonal(turned)
        hits += _diagonal(turned[:, ::-1])[:, ::-1]
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
    """Divide the floor at narrowings of at most DOOR_M: each cell belongs to the core from which it is reached first.

    Returns the number of every cell's room (0: none), the frame of these cells and the rooms, the largest first.
    """
    from scipy.ndimage import find_objects, label

    step = max(1, round(CELL_M / space.frame.resolution), math.ceil(math.sqrt(floor.size / MOST_CELLS)))
    cells, frame = coarser(floor, space.frame, step, np.any)
    field, _ = coarser(space.field, space.frame, step, np.max)
    cores, _ = label(cells & (field > DOOR_M / 2), np.ones((3, 3)))
    large = np.bincount(cores.ravel()) >= ROOM_LEAST_M2 / 12 / frame.resolution**2
    large[0] = False
    labels = _grown(np.where(large[cores], cores, 0).astype(np.int32), cells)
    left, count = label(cells & (labels == 0), np.ones((3, 3)))  # parts without a core: narrow corridors and closets
    labels = np.where(left > 0, left + labels.max(), labels) if count else labels
    labels = _joined(labels, ROOM_LEAST_M2 / frame.resolution**2)
    found = [_room(labels, field, frame, n, w) for n, w in enumerate(find_objects(labels), start=1) if w is not None]
    rooms = sorted(found, key=lambda room: (-room.area_m2, room.middle))
    return labels, frame, tuple(rooms)


def areas_of_rooms(space: Space, floor: Bools) -> tuple[Area, ...]:
    """Return rooms, corridors and halls as areas, named by kind and, if there are few of a kind, by place."""
    from scipy.ndimage import find_objects

    labels, frame, rooms = rooms_of(space, floor)
    windows = find_objects(labels)
    chosen = [room for room in rooms if room.area_m2 >= ROOM_LEAST_M2][:MOST_ROOMS]
    areas: list[Area] = []
    for kind in ("hall", "corridor", "room"):
        members = [room for room in chosen if room.kind == kind]
        members.sort(key=lambda room: (-round(room.middle[1] / 3.0), room.middle[0]))
        outlined = []
        for room in members:
            window = windows[room.number - 1]
            x, y = frame.to_metres(np.array([window[1].start, window[0].start], float)).tolist()
            cells = labels[window] == room.number
            origin = frame.origin.model_copy(update={"x": x, "y": y})
            outline = outline_of(cells, Frame(origin, frame.resolution, (len(cells), cells.shape[1])))
            if outline is not None:
                outlined.append((room, outline))
        names = _names(kind.capitalize(), [room for room, _ in outlined])
        for name, (_, outline) in zip(names, outlined, strict=True):
            areas.append(Area(name=name, kind=kind, region=None, outline=outline, waypoints=()))
    return tuple(areas)


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
    numbers: dict[int, int] = {}
    for shift in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        touched = np.roll(mine, shift, (0, 1))[1:-1, 1:-1] & (labels != number) & (labels > 0)
        for other, count in zip(*np.unique(labels[touched], return_counts=True), strict=True):
            numbers[int(other)] = numbers.get(int(other), 0) + int(count)
    return numbers


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


Part = tuple[Bools, Point, str]
"""A part of the floor as cells of the map, a point on it, and why it is taken as outside."""


def main_part(parts: NDArray[np.int32], sizes: NDArray[np.int64], frame: Frame, ceilings: Bools | None) -> int:
    """Return the number of the open part of the map that is the floor of the building.

    It is the one with most ceiling; the largest one within walls, if the largest of all lies around the building; a
    part that encloses the largest one, which is then a courtyard without a door; else the largest one.
    """
    from scipy.ndimage import binary_fill_holes

    largest = int(sizes.argmax())
    if ceilings is not None:
        covered = np.bincount(parts[ceilings], minlength=len(sizes))
        covered[0] = 0
        if covered.max() >= CEILING_SHARE * sizes[covered.argmax()]:
            return int(covered.argmax())
    around = {0}  # the parts that meet an edge of the map in an opening that is no door
    for edge in (parts[0], parts[-1], parts[:, 0], parts[:, -1]):
        starts = np.flatnonzero(np.diff(edge, prepend=-1))
        lengths = np.diff([*starts, len(edge)]) * frame.resolution
        around |= set(edge[starts[lengths > GATE_M]].tolist())
    if largest in around:
        closed = sizes.copy()
        closed[sorted(around)] = 0
        least = max(CLOSED_M2 / frame.resolution**2, CLOSED_SHARE * parts.size)
        return int(closed.argmax()) if closed.max() >= least and _is_yard(parts, largest, frame) else largest
    for other in np.argsort(-sizes, kind="stable")[1:4]:
        if sizes[other] < 0.25 * sizes[largest] or not other:
            break
        filled = binary_fill_holes(parts == other)
        if np.count_nonzero(filled & (parts == largest)) >= ENCLOSED * sizes[largest]:
            return int(other)
    return largest


def _is_yard(parts: NDArray[np.int32], number: int, frame: Frame) -> bool:
    """Return whether few places of an open part lie between walls."""
    free = parts == number
    cells = np.where(parts == 0, OCCUPIED, np.where(free, FREE, UNKNOWN)).astype(np.uint8)
    inside = indoors(OccupancyMap(cells=cells, resolution=frame.resolution, origin=frame.origin))
    for court in open_courts(free, inside, (parts > 0) & ~free, frame.resolution):
        inside &= ~court
    return bool(inside.sum() < INDOOR_SHARE * np.count_nonzero(free))


def within(
    occupancy: OccupancyMap,
    objects: Sequence[SolidObject],
    ceilings: Bools | None,
    inside: Sequence[Point],
    outside: Sequence[Point],
    notes: list[str],
) -> OccupancyMap | None:
    """Return the map with the floor outside the building as unknown; None where the place is a yard with things in it.

    `ceilings` are cells with something overhead, None where nothing is; about points `inside` and `outside` (metres) a
    person has decided. What is decided goes into `notes`, with a point that names the part of the floor.
    """
    frame, free = frame_of(occupancy), occupancy.cells == FREE
    for x, y in inside:
        if not frame.looked_up_at(free, x, y):
            raise InputError(f"--indoors {x:g},{y:g}: no open floor is there, in metres.", code="no-floor")
    if ceilings is not None and np.count_nonzero(free & ceilings) < CEILING_SHARE * np.count_nonzero(free):
        ceilings = None
    left_out = np.zeros_like(free)
    parts: list[Part] = []
    if ceilings is None and any(edge.any() for edge in (free[0], free[-1], free[:, 0], free[:, -1])):
        between_walls = indoors(occupancy)
        if between_walls.sum() < INDOOR_SHARE * np.count_nonzero(free):
            return None
        left_out = free & ~between_walls
        why = "it lies wide open to the outside, between rooms of the building"
        courts = open_courts(free, between_walls, np.zeros_like(free), occupancy.resolution)
        parts = [(cells, _middle(cells, frame), why) for cells in courts]
        notes.append("the building has openings to the outside; the floor outside of it is taken as unknown.")
    floor = _map_of(occupancy, free & ~left_out)
    space = human_space_of(objects, floor)
    labels, coarse, rooms = rooms_of(space, main_floor(space))
    inner = without_building(objects, floor)
    one_mesh = len(inner) < len(objects)
    if ceilings is None:
        parts += _courtyards(floor, inner, one_mesh, labels, coarse, rooms)
    else:
        parts = _open_sky(floor, ceilings)
    parts = [part for part in parts if not any(frame.looked_up_at(part[0], x, y) for x, y in inside)]
    for x, y in outside:
        number = int(coarse.looked_up_at(labels, x, y))
        if not number:
            message = f"--outdoors {x:g},{y:g}: no open floor of the building is there, in metres."
            raise InputError(message, code="no-floor")
        parts.append((_on_map(labels == number, labels, coarse, floor), (x, y), "you said so"))
    for cells, (x, y), why in parts:
        left_out |= cells
        size = np.count_nonzero(cells) * occupancy.resolution**2
        notes.append(
            f"{size:.0f} m² of floor about ({x:.1f}, {y:.1f}) are taken as outside: {why}. "
            + ("" if (x, y) in outside else f"--indoors {x:.1f},{y:.1f} makes them floor of the building.")
        )
    for x, y in inside:
        if frame.looked_up_at(left_out, x, y):
            message = f"--indoors {x:g},{y:g}: too few walls stand about it; it lies outside."
            raise InputError(message, code="no-floor")
    if ceilings is None and not outside and one_mesh and len(rooms) >= 3:
        places = {at for _, at, _ in parts}
        halls = [r for r in rooms if r.area_m2 >= COURTYARD_M2 and r.kind == "hall" and r.middle not in places]
        if halls:
            listed = ", ".join(f"{r.area_m2:.0f} m² about ({r.middle[0]:.1f}, {r.middle[1]:.1f})" for r in halls[:3])
            notes.append(
                f"if a hall is a courtyard ({listed}), leave it out with --outdoors X,Y: the file has no ceilings to "
                "tell."
            )
    return _map_of(occupancy, free & ~left_out) if left_out.any() else occupancy


def _map_of(occupancy: OccupancyMap, free: Bools) -> OccupancyMap:
    """Return the map with this free floor and no other."""
    cells = np.where((occupancy.cells == FREE) & ~free, UNKNOWN, occupancy.cells).astype(np.uint8)
    cells.setflags(write=False)
    return OccupancyMap(cells=cells, resolution=occupancy.resolution, origin=occupancy.origin)


def _open_sky(floor: OccupancyMap, ceilings: Bools) -> list[Part]:
    """Return the parts of the floor without anything overhead."""
    from scipy.ndimage import binary_dilation, binary_erosion, label

    free = floor.cells == FREE
    bare = free & ~ceilings
    reach = max(1, round(SKYLIGHT_M / 2 / floor.resolution))
    cross = np.ones((3, 3), bool)
    cores = binary_erosion(bare | (floor.cells == UNKNOWN), cross, reach) & bare
    grown = binary_dilation(cores, cross, reach, mask=bare)
    parts, count = label(grown)
    open_parts = []
    for number in range(1, count + 1):
        cells = parts == number
        if np.count_nonzero(cells) * floor.resolution**2 >= OPEN_SKY_M2:
            open_parts.append((cells, _middle(cells, frame_of(floor)), "nothing is overhead there"))
    return open_parts


def _courtyards(
    floor: OccupancyMap,
    things: Sequence[SolidObject],
    one_mesh: bool,
    labels: Labels,
    frame: Frame,
    rooms: Sequence[Room],
) -> list[Part]:
    """Return the rooms that are courtyards, told by enclosure, size and the things that stand in them."""
    courtyards = []
    for room in rooms:
        cells = labels == room.number
        named, others = _standing_in(things, cells, frame)
        if named and not others:
            why = f"{', '.join(named[:3])} {'stands' if len(named) == 1 else 'stand'} there"
        elif one_mesh and not others and _is_courtyard(room, rooms, labels):
            why = "the building is around it, it is large and empty, and no way leads through it"
        else:
            continue
        courtyards.append((_on_map(cells, labels, frame, floor), room.middle, why))
    return courtyards


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


def _on_map(cells: Bools, labels: Labels, frame: Frame, floor: OccupancyMap) -> Bools:
    """Return a room of a coarser frame as free cells of the map, up to its walls but not into other rooms."""
    from scipy.ndimage import binary_dilation, label

    reach = math.ceil(RIM_M / frame.resolution)
    whole = binary_dilation(cells, np.ones((3, 3), bool), reach, mask=cells | (labels == 0))
    step = round(frame.resolution / floor.resolution)
    fine = np.repeat(np.repeat(whole, step, axis=0), step, axis=1)
    rows, columns = floor.cells.shape
    padded = np.pad(fine, ((0, max(0, rows - len(fine))), (0, max(0, columns - fine.shape[1]))), mode="edge")
    free = padded[:rows, :columns] & (floor.cells == FREE)
    # Only the parts that hold a cell of the room, so that none lies behind a wall
    parts, _ = label(free)
    inside = frame.to_metres(np.argwhere(cells)[:, ::-1].astype(float) + 0.5)
    numbers = np.unique(frame_of(floor).looked_up(parts, inside))
    return np.isin(parts, numbers[numbers > 0])


def _middle(cells: Bools, frame: Frame) -> Point:
    """Return a point in the middle of a part, and on it."""
    rows, columns = np.nonzero(cells)
    nearest = int(np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2))
    x, y = frame.to_metres(np.array([columns[nearest] + 0.5, rows[nearest] + 0.5]))
    return (round(float(x), 1), round(float(y), 1))
