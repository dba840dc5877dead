"""Layers of a floor plan: floor, objects, areas, waypoints and a route."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.core.records import Pose
from rvsg.robots.polygons import rectangle
from rvsg.world.drawing.sheet import (
    FINE,
    LIGHT,
    SMALLEST_TEXT,
    Colour,
    PageView,
    Sheet,
    Word,
    place_beside,
    place_inside,
    text_size,
)
from rvsg.world.passages import line_of
from rvsg.world.space import Frame, frame_of, solid_cells, world_map
from rvsg.world.world import FREE, OCCUPIED, Area, Route, SolidObject, World

Floats = NDArray[np.float64]

THICK_WALL_M = 0.3  # parts of the map thicker than this are drawn as objects with an edge


def draw_floor(sheet: Sheet, world: World, guides: tuple[list[float], list[float]], *, hidden: bool) -> None:
    """Draw the occupancy map with faint lines, unknown cells like the outside; `hidden`: without objects' cells."""
    from scipy.ndimage import binary_dilation, binary_erosion

    occupancy = world_map(world)
    frame = frame_of(occupancy)
    ink = sheet.palette
    colours = np.array([ink.outside, ink.floor, ink.wall, ink.guide, ink.thing], np.uint8)
    kind = np.zeros(frame.shape, np.uint8)
    kind[occupancy.cells == FREE] = 1
    kind[occupancy.cells == OCCUPIED] = 2
    thick = max(1, round(THICK_WALL_M / 2 / frame.resolution))
    kind[binary_erosion(kind == 2, iterations=thick)] = 4
    if hidden and world.solids:
        kind[binary_dilation(solid_cells(world.solids, frame), np.ones((5, 5), bool)) & (kind == 2)] = 1
    left, top, right, bottom = sheet.view.plan
    across = left + (np.arange((right - left) * FINE) + 0.5) / FINE
    all_down = top + (np.arange((bottom - top) * FINE) + 0.5) / FINE
    on_row, on_column = _lines(all_down, guides[0]), _lines(across, guides[1])
    bands = []
    for first in range(0, len(all_down), 256):  # in bands, to save memory on large pages
        down = all_down[first : first + 256]
        shown = _shown(kind, frame, sheet.view, across, down)
        shown[(shown == 1) & (on_row[first : first + 256, None] | on_column)] = 3
        bands.append(colours[shown])
    sheet.paste(np.concatenate(bands), left, top)


def _shown(kind: NDArray[np.uint8], frame: Frame, view: PageView, across: Floats, down: Floats) -> NDArray[np.uint8]:
    """Return the kinds of the cells under the pixels of a band (down, across); 0 off the map."""
    if frame.origin.yaw:
        return frame.looked_up(kind, view.metres(np.stack(np.meshgrid(across, down), axis=-1)))
    # Rows and columns of cells lie along those of pixels: one index for each of them, not for each pixel.
    along = frame.to_cells(view.metres(np.stack([across, np.full_like(across, down[0])], axis=-1)))
    below = frame.to_cells(view.metres(np.stack([np.full_like(down, across[0]), down], axis=-1)))
    column, row = (along[None, :, 0], below[:, None, 1]) if view.up == "y" else (below[:, None, 0], along[None, :, 1])
    edged = np.pad(kind, 1)
    rows, columns = (
        np.clip(np.floor(at + 1e-9), -1, most).astype(int) + 1
        for at, most in zip((row, column), kind.shape, strict=True)
    )
    return np.asarray(edged[rows, columns])


def _lines(pixels: Floats, at: list[float]) -> NDArray[np.bool_]:
    """Return which of the pixels along one side belong to lines one pixel wide."""
    return np.asarray((np.abs(pixels[:, None] - np.array(at)) <= 0.5).any(axis=1))


def is_wall(thing: SolidObject) -> bool:
    """Return whether an object is drawn as part of the building."""
    return bool(thing.holes) or "wall" in thing.kind.lower()


def draw_objects(sheet: Sheet, objects: tuple[SolidObject, ...]) -> None:
    """Draw the footprints of objects, walls first."""
    for thing in sorted(objects, key=lambda o: (not is_wall(o), o.box.size[2], o.name)):
        ring = sheet.view.pixels(np.array(thing.footprint))
        fill = sheet.palette.wall if is_wall(thing) else sheet.palette.thing
        if thing.holes:
            sheet.holed(ring, [sheet.view.pixels(np.array(hole)) for hole in thing.holes], fill)
        else:
            edge = sheet.palette.wall if is_wall(thing) else sheet.palette.thing_edge
            sheet.polygon(ring, fill=fill, edge=edge, width=1.0)


LARGEST_ON_PAGES = 17  # pixels: the size of text around it


def draw_areas(sheet: Sheet, areas: list[Area], kinds: dict[str, Colour]) -> None:
    """Tint every area in the colour of its kind and draw its outline."""
    for area in areas:
        ring = sheet.view.pixels(np.array(area.outline))
        sheet.tint(ring, kinds[area.kind], sheet.palette.tint)
        sheet.polygon(ring, fill=None, edge=kinds[area.kind], width=1.8)


def areas_in_sight(world: World, view: PageView) -> list[Area]:
    """Return the areas that lie at least partly in the window of the view."""
    x0, y0, x1, y1 = view.window
    boxes = [(area, rectangle(area.outline)) for area in world.areas]
    return [area for area, (low, high) in boxes if high[0] > x0 and low[0] < x1 and high[1] > y0 and low[1] < y1]


def area_words(world: World, view: PageView) -> tuple[Word, ...]:
    """Return where the names of the areas stand on a plan of the view's size with nothing else on it."""
    sheet = Sheet(view, LIGHT)
    areas = areas_in_sight(world, view)
    kinds = LIGHT.kind_colours(area.kind for area in world.areas)
    write_areas(sheet, areas, kinds, largest=round(LARGEST_ON_PAGES / sheet.unit))
    return tuple(sheet.words)


def write_areas(sheet: Sheet, areas: list[Area], kinds: dict[str, Colour], *, largest: int) -> None:
    """Write the names of areas: inside if they fit, otherwise beside with a leader line."""
    rings = {area.name: _clipped(sheet.view.pixels(np.array(area.outline)), sheet.view) for area in areas}
    order = sorted(areas, key=lambda a: (np.ptp(rings[a.name], axis=0).prod(), a.name))  # small first
    left, top, right, bottom = sheet.view.plan
    page = (left + 2.0, top + 2.0, right - 2.0, bottom - 2.0)

    def sizes(first: int, last: int) -> list[int]:
        return [max(SMALLEST_TEXT, round(size * sheet.unit)) for size in range(first, last - 1, -2)]

    for beside, tried in ((False, sizes(largest, 14)), (True, sizes(16, 14)), (False, sizes(12, 12))):
        missing = []
        for area in order:
            ring, colour = rings[area.name], kinds[area.kind]
            word = (
                place_beside(area.name, ring, sheet.taken, tried, page)
                if beside
                else place_inside(area.name, ring, sheet.taken, tried)
            )
            if word is None:
                missing.append(area)
                continue
            if beside:
                x, y = middle = (ring.min(axis=0) + ring.max(axis=0)) / 2
                sheet.line(np.array([word.centre, middle]), colour, 1.0)
                sheet.dot(float(x), float(y), 3 * sheet.unit, fill=colour)
            ink = sheet.palette
            sheet.write(word, ink.tinted(ink.ink, colour, 0.35), halo=ink.floor, bold=True)
        order = missing
    if order:
        sheet.notes.append(f"no room for the names of {len(order)} areas: {', '.join(sorted(a.name for a in order))}")


def _clipped(ring: Floats, view: PageView) -> Floats:
    """The part of a polygon in pixels that lies on the plan: its largest piece, or the polygon where none does."""
    left, top, right, bottom = view.plan
    if (ring >= (left, top)).all() and (ring <= (right, bottom)).all():
        return ring
    from shapely import Polygon, box

    seen = Polygon(ring).buffer(0).intersection(box(left, top, right, bottom))
    pieces = [piece for piece in getattr(seen, "geoms", [seen]) if isinstance(piece, Polygon) and not piece.is_empty]
    return np.array(max(pieces, key=lambda piece: piece.area).exterior.coords) if pieces else ring


def draw_dots(sheet: Sheet, world: World) -> tuple[list[str], Floats, float, float]:
    """Draw a dot for every valid waypoint in the window, a ring where the robot does not fit.

    Returns the names of the waypoints, their places (n, 2), radius and spacing of the dots in pixels.
    """
    ink = sheet.palette
    left, top, right, bottom = sheet.view.plan
    valid = [w for w in world.grid.waypoints if w.human]
    places = sheet.view.pixels(np.array([[w.x, w.y] for w in valid]))
    seen = np.asarray(((places > (left, top)) & (places < (right, bottom))).all(axis=1))
    shown, places = [w for w, on_page in zip(valid, seen, strict=True) if on_page], places[seen]
    apart = usual_spacing(places)
    radius = float(np.clip(apart * 0.075, 1.6, 5.0 * sheet.unit))
    dense = apart < text_size("A10", SMALLEST_TEXT)[0]  # with this many dots, names of areas may cover some
    for waypoint, (x, y) in zip(shown, places.tolist(), strict=True):
        if not dense:
            sheet.taken.add_dot(x, y, radius)
        if waypoint.robot:
            sheet.dot(x, y, radius, fill=ink.dot)
        else:
            sheet.dot(x, y, radius, fill=ink.floor, edge=ink.dot, width=1.6)
    return [waypoint.name for waypoint in shown], places, radius, apart


def write_waypoints(sheet: Sheet, names: list[str], places: Floats, radius: float, apart: float) -> None:
    """Write the names of waypoints below the dots where there is room; none if they would be unreadable."""
    longest = max(names, key=len, default="")
    size = int(np.clip(apart * 0.36, 0, 20 * sheet.unit))
    while size > SMALLEST_TEXT and text_size(longest, size)[0] + 3 > apart:
        size -= 1
    if names and (size < SMALLEST_TEXT or text_size(longest, size)[0] + 3 > apart):
        sheet.notes.append("the waypoints are too dense for their names: read row and column, or draw tiles")
        return
    for name, (x, y) in zip(names, places.tolist(), strict=True):
        width, height = text_size(name, size)
        for away, (across, down) in itertools.product((1.0, 9.0 * sheet.unit), _BESIDE_DOTS):
            cx, cy = x + across * (radius + width / 2 + 2 + away), y + down * (radius + height / 2 + away)
            box = (cx - width / 2, cy - height / 2, cx + width / 2, cy + height / 2)
            if sheet.taken.free(box, gap=0.0):
                sheet.write(Word(name, box, size), sheet.palette.ink, halo=sheet.palette.floor)
                break
        else:
            sheet.notes.append(f"no room for the name of waypoint {name}")


_BESIDE_DOTS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, -1), (1, 1), (-1, 1), (-1, -1))
"""Where the name of a waypoint stands, as steps across and down the page."""


def usual_spacing(places: Floats) -> float:
    """Return the typical distance from a waypoint (n, 2) to the nearest other: a low quantile, so most names fit."""
    if len(places) < 2:
        return 100.0
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(places).query(places, k=2)
    return float(np.quantile(distance[:, 1], 0.1))


Way = Sequence[tuple[float, float, float]]
MARK_EVERY_S = 5.0


def draw_route(sheet: Sheet, world: World, route: Route, way: Way | None = None) -> None:
    """Draw the way the robot drives, with arrows, from START to GOAL.

    `way` is a drive as (time in s, x, y); without it, the rough way through the route's waypoints is drawn.
    """
    ink, unit = sheet.palette, sheet.unit
    points = line_of(world, route) if way is None else np.array([(x, y) for _, x, y in way], float)
    moved = np.append(True, np.any(np.diff(points, axis=0) != 0, axis=1))
    line = sheet.view.pixels(points[moved])
    if len(line) < 2:
        raise InputError(f'the route "{route.name}" ends where it starts')
    sheet.line(line, ink.floor, 8.0)
    sheet.line(line, ink.tinted(ink.route, share=0.75), 4.0)
    for a, b in pairwise(line):
        if np.hypot(*(b - a)) > 34 * unit:
            at, along, size = (a + b) / 2, (b - a) / np.hypot(*(b - a)), 9 * unit
            tip, back = at + along * size * 0.7, at - along * size * 0.7
            across = np.array([-along[1], along[0]]) * size * 0.75
            sheet.polygon(np.array([tip, back + across, back - across]), fill=ink.route)
    sheet.taken.add_line(line, 4 * unit)
    for pose, colour in ((route.start, ink.start), (route.goal, ink.goal)):
        at, tip = _pointer(sheet, pose)
        sheet.line(np.array([at, tip]), colour, 3.5)
        sheet.dot(float(at[0]), float(at[1]), 10 * unit, fill=colour, edge=ink.floor, width=2.0)
        sheet.taken.add_line(np.array([at, tip]), 5 * unit)
        sheet.taken.add_dot(float(at[0]), float(at[1]), 12 * unit)


def _pointer(sheet: Sheet, pose: Pose) -> tuple[Floats, Floats]:
    """Return where a pose lies on the page, and the tip of a short line in its direction."""
    at = sheet.view.pixels(np.array([pose.x, pose.y]))
    ahead = sheet.view.pixels(np.array([pose.x + np.cos(pose.yaw), pose.y + np.sin(pose.yaw)])) - at
    return at, at + ahead / np.hypot(*ahead) * 20 * sheet.unit


def write_ends(sheet: Sheet, route: Route) -> None:
    """Write START and GOAL beside the ends of a route."""
    left, top, right, bottom = sheet.view.plan
    for pose, word, colour in (
        (route.start, "START", sheet.palette.start),
        (route.goal, "GOAL", sheet.palette.goal),
    ):
        (x, y), _ = _pointer(sheet, pose)
        corner = 11 * sheet.unit
        ring = np.array([[x - corner, y - corner], [x + corner, y + corner]])
        sizes = [round(size * sheet.unit) for size in (18, 15)]
        place = place_beside(word, ring, sheet.taken, sizes, (left, top, right, bottom))
        if place is not None:
            sheet.write(place, colour, halo=sheet.palette.floor, bold=True)


def time_marks(way: Way) -> tuple[tuple[float, float, float], ...]:
    """Return where the robot is every 5 seconds of a drive, as (time, x, y), without its start."""
    t, x, y = np.array(way, float).T
    times = np.arange(MARK_EVERY_S, t[-1] + 1e-9, MARK_EVERY_S)
    return tuple(zip(times.tolist(), np.interp(times, t, x).tolist(), np.interp(times, t, y).tolist(), strict=True))


def write_times(sheet: Sheet, way: Way) -> None:
    """Mark on a drive where the robot is every 5 seconds; a mark without room for its number stays a dot."""
    unit = sheet.unit
    for time, x, y in time_marks(way):
        at = sheet.view.pixels(np.array([x, y]))
        sheet.dot(float(at[0]), float(at[1]), 6 * unit, fill=sheet.palette.floor, edge=sheet.palette.route, width=2.5)
        ring = np.array([at - 7 * unit, at + 7 * unit])
        sizes = [round(size * unit) for size in (16, 13)]
        place = place_beside(f"{time:g} s", ring, sheet.taken, sizes, sheet.view.plan)
        if place is not None:
            sheet.write(place, sheet.palette.route, halo=sheet.palette.floor, bold=True)
