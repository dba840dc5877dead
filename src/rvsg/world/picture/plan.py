"""Draws the floor plan: floor, objects, areas, grid, route, rulers, scale and legend, layer by layer."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rvsg.errors import InputError, UnknownName
from rvsg.world.picture.furniture import draw_footer, draw_rulers, draw_title
from rvsg.world.picture.palette import Palette, palette
from rvsg.world.picture.placing import Word, place_beside, place_inside, text_size
from rvsg.world.picture.sheet import FINE, Sheet
from rvsg.world.picture.view import View, Window, view_of
from rvsg.world.records import Pose
from rvsg.world.space import frame_of, solid_cells, world_map
from rvsg.world.world import Area, Route, SolidObject, World

Floats = NDArray[np.float64]

LAYERS = frozenset({"objects", "lidar", "areas", "rulers", "waypoints", "names", "hops", "title", "legend"})
LABELLED = frozenset({"objects", "areas", "title", "legend"})
GRID = frozenset({"objects", "areas", "rulers", "waypoints", "names", "title", "legend"})


SMALLEST_TEXT = 10
THICK_WALL_M = 0.3  # what the map shows thicker than this is drawn as a thing with an edge


@dataclass(frozen=True)
class Dot:
    """A waypoint on the page: its place and radius, and how far the waypoints are apart, in pixels."""

    name: str
    x: float
    y: float
    radius: float
    apart: float


@dataclass(frozen=True)
class Picture:
    """A drawn floor plan: the image, every word on it with its box, the view, and what could not be shown."""

    image: Image.Image
    words: tuple[Word, ...]
    view: View
    notes: tuple[str, ...]


def draw_plan(
    world: World,
    *,
    show: frozenset[str],
    width_px: int = 1600,
    route: Route | None = None,
    colours: str | Palette = "light",
    window: Window | None = None,
    title: str = "",
) -> Picture:
    """Draw what `show` names of LAYERS; `window` (x_min, y_min, x_max, y_max) in metres shows a part of the world."""
    for layer in sorted(show - LAYERS):
        raise UnknownName("layer", layer, LAYERS)
    ink = palette(colours)
    unit = width_px / 1600
    rulers = round(40 * unit) if "rulers" in show else round(14 * unit)
    top = rulers + (round(44 * unit) if "title" in show else 0)
    bottom = rulers + (round(112 * unit) if "legend" in show else round(50 * unit))
    view = view_of(world, width_px=width_px, window=window, margins=(rulers, top, rulers, bottom))
    sheet = Sheet(view, ink)
    guides = draw_rulers(sheet, world) if "rulers" in show else ([], [])
    _draw_floor(sheet, world, guides, hidden="objects" in show)
    if "objects" in show:
        _draw_objects(sheet, world.objects)
    if "lidar" in show:
        for thing in world.objects:
            for cut in thing.slices:
                sheet.polygon(view.pixels(np.array(cut)), fill=None, edge=ink.wall, width=1.5)
    kinds = ink.kind_colours(area.kind for area in world.areas)
    areas = [area for area in world.areas if _in_window(area.outline, view)] if "areas" in show else []
    for area in areas:
        ring = view.pixels(np.array(area.outline))
        sheet.tint(ring, kinds[area.kind], ink.tint)
        sheet.polygon(ring, fill=None, edge=kinds[area.kind], width=1.8)
    if "hops" in show:
        for a, b in world.grid.hops:
            ends = view.pixels(np.array([world.grid.position(a), world.grid.position(b)]))
            sheet.line(ends, ink.tinted(ink.dot, share=0.3), 0.8)
    if route is not None:
        _draw_route(sheet, world, route)
    dots = _draw_dots(sheet, world) if "waypoints" in show else []
    if route is not None:
        _write_ends(sheet, route)
    if "names" in show:
        _write_waypoints(sheet, dots)
    _write_areas(sheet, areas, kinds, largest=26 if "waypoints" not in show else 19)
    if "title" in show:
        draw_title(sheet, title or world.title)
    end = draw_footer(sheet, world, show, kinds if areas else {}, route)
    return Picture(sheet.finished(end), tuple(sheet.words), view, tuple(sheet.notes))


def _in_window(outline: tuple[tuple[float, float], ...], view: View) -> bool:
    x0, y0, x1, y1 = view.window
    xs, ys = [p[0] for p in outline], [p[1] for p in outline]
    return max(xs) > x0 and min(xs) < x1 and max(ys) > y0 and min(ys) < y1


def _draw_floor(sheet: Sheet, world: World, guides: tuple[list[float], list[float]], *, hidden: bool) -> None:
    """The occupancy map as coloured floor with faint lines; what is unknown looks like outside.

    `hidden`: without the cells that belong to objects, as these are drawn themselves.
    """
    from scipy.ndimage import binary_dilation, binary_erosion

    occupancy = world_map(world)
    frame = frame_of(occupancy)
    ink = sheet.palette
    colours = np.array([ink.outside, ink.floor, ink.wall, ink.guide, ink.thing], np.uint8)
    kind = np.zeros(frame.shape, np.uint8)
    kind[occupancy.cells == 0] = 1
    kind[occupancy.cells == 100] = 2
    thick = max(1, round(THICK_WALL_M / 2 / frame.resolution))
    kind[binary_erosion(kind == 2, iterations=thick)] = 4
    if hidden and world.objects:
        kind[binary_dilation(solid_cells(world.objects, frame), np.ones((5, 5), bool)) & (kind == 2)] = 1
    left, top, right, bottom = sheet.view.plan
    across = left + (np.arange((right - left) * FINE) + 0.5) / FINE
    all_down = top + (np.arange((bottom - top) * FINE) + 0.5) / FINE
    on_row, on_column = _lines(all_down, guides[0]), _lines(across, guides[1])
    bands = []
    for first in range(0, len(all_down), 256):  # in bands, so that a large page needs little memory
        down = all_down[first : first + 256]
        found = frame.looked_up(kind, sheet.view.metres(np.stack(np.meshgrid(across, down), axis=-1)))
        found[(found == 1) & (on_row[first : first + 256, None] | on_column)] = 3
        bands.append(colours[found])
    sheet.paste(np.concatenate(bands), left, top)


def _lines(pixels: Floats, at: list[float]) -> NDArray[np.bool_]:
    """Which of the pixels along one side belong to lines one pixel wide."""
    lines = np.zeros(len(pixels), bool)
    for place in at:
        lines |= np.abs(pixels - place) <= 0.5
    return lines


def is_wall(thing: SolidObject) -> bool:
    """Whether an object is drawn as part of the building."""
    return bool(thing.holes) or "wall" in thing.kind.lower()


def _draw_objects(sheet: Sheet, objects: tuple[SolidObject, ...]) -> None:
    """Walls first, then things, by their footprints."""
    for thing in sorted(objects, key=lambda o: (not is_wall(o), o.box.size[2], o.name)):
        ring = sheet.view.pixels(np.array(thing.footprint))
        fill = sheet.palette.wall if is_wall(thing) else sheet.palette.thing
        if thing.holes:
            sheet.holed(ring, [sheet.view.pixels(np.array(hole)) for hole in thing.holes], fill)
        else:
            edge = sheet.palette.wall if is_wall(thing) else sheet.palette.thing_edge
            sheet.polygon(ring, fill=fill, edge=edge, width=1.0)


def _write_areas(sheet: Sheet, areas: list[Area], kinds: dict[str, tuple[int, int, int]], *, largest: int) -> None:
    """The areas' names: inside where they fit, else beside with a line that leads there."""
    rings = {area.name: sheet.view.pixels(np.array(area.outline)) for area in areas}
    order = sorted(areas, key=lambda a: (np.ptp(rings[a.name], axis=0).prod(), a.name))  # small ones have least choice
    left, top, right, bottom = sheet.view.plan
    page = (left + 2.0, top + 2.0, right - 2.0, bottom - 2.0)

    def sizes(first: int, last: int) -> list[int]:
        return [max(SMALLEST_TEXT, round(size * sheet.unit)) for size in range(first, last - 1, -2)]

    def beside(text: str, ring: Floats) -> Word | None:
        return place_beside(text, ring, sheet.taken, sizes(16, 14), page)

    def small(text: str, ring: Floats) -> Word | None:
        return place_inside(text, ring, sheet.taken, sizes(12, 12))

    def large(text: str, ring: Floats) -> Word | None:
        return place_inside(text, ring, sheet.taken, sizes(largest, 14))

    for place in (large, beside, small):
        missing = []
        for area in order:
            ring = rings[area.name]
            word = place(area.name, ring)
            if word is None:
                missing.append(area)
                continue
            if place is beside:
                middle = (ring.min(axis=0) + ring.max(axis=0)) / 2
                sheet.line(np.array([word.centre, middle]), kinds[area.kind], 1.0)
                sheet.dot(float(middle[0]), float(middle[1]), 3 * sheet.unit, fill=kinds[area.kind])
            _write_name(sheet, word, kinds[area.kind])
        order = missing
    if order:
        sheet.notes.append(f"no room for the names of {len(order)} areas: {', '.join(sorted(a.name for a in order))}")


def _write_name(sheet: Sheet, word: Word, colour: tuple[int, int, int]) -> None:
    dark = sheet.palette.tinted(sheet.palette.ink, colour, 0.35)
    sheet.write(word, dark, halo=sheet.palette.floor, bold=True)


def _draw_dots(sheet: Sheet, world: World) -> list[Dot]:
    """A dot for every valid waypoint in sight, a ring where the robot does not fit."""
    view, ink = sheet.view, sheet.palette
    left, top, right, bottom = view.plan
    valid = [w for w in world.grid.waypoints if w.human]
    places = view.pixels(np.array([[w.x, w.y] for w in valid]))
    seen = [(w, float(x), float(y)) for w, (x, y) in zip(valid, places, strict=True)]
    seen = [(w, x, y) for w, x, y in seen if left < x < right and top < y < bottom]
    apart = _spacing(np.array([(x, y) for _, x, y in seen]).reshape(-1, 2))
    radius = float(np.clip(apart * 0.075, 1.6, 5.0 * sheet.unit))
    dense = apart < text_size("A10", SMALLEST_TEXT)[0]  # names of areas may then cover some of so many dots
    for waypoint, x, y in seen:
        if not dense:
            sheet.taken.add_dot(x, y, radius)
        if waypoint.robot:
            sheet.dot(x, y, radius, fill=ink.dot)
        else:
            sheet.dot(x, y, radius, fill=ink.floor, edge=ink.dot, width=1.6)
    return [Dot(waypoint.name, x, y, radius, apart) for waypoint, x, y in seen]


def _write_waypoints(sheet: Sheet, dots: list[Dot]) -> None:
    """The waypoints' names, below the dots where there is room; none at all where they could not be read."""
    if not dots:
        return
    longest = max((dot.name for dot in dots), key=len)
    size = int(np.clip(dots[0].apart * 0.36, 0, 20 * sheet.unit))
    while size > SMALLEST_TEXT and text_size(longest, size)[0] + 3 > dots[0].apart:
        size -= 1
    if size < SMALLEST_TEXT or text_size(longest, size)[0] + 3 > dots[0].apart:
        sheet.notes.append("the waypoints are too dense for their names: read row and column, or draw tiles")
        return
    for dot in dots:
        _write_waypoint(sheet, dot, size)


def _write_waypoint(sheet: Sheet, dot: Dot, size: int) -> None:
    width, height = text_size(dot.name, size)
    for away in (1.0, 9.0 * sheet.unit):
        side, drop = dot.radius + width / 2 + 2 + away, dot.radius + height / 2 + away
        for dx, dy in (
            (0, drop),
            (0, -drop),
            (side, 0),
            (-side, 0),
            (side, -drop),
            (side, drop),
            (-side, drop),
            (-side, -drop),
        ):
            x, y = dot.x + dx, dot.y + dy
            box = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
            if sheet.taken.free(box, gap=0.0):
                sheet.write(Word(dot.name, box, size), sheet.palette.ink, halo=sheet.palette.floor)
                return
    sheet.notes.append(f"no room for the name of waypoint {dot.name}")


def _spacing(places: Floats) -> float:
    """The usual distance in pixels from a waypoint to its nearest other, a low quantile: names must fit nearly all."""
    if len(places) < 2:
        return 100.0
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(places).query(places, k=2)
    return float(np.quantile(distance[:, 1], 0.1))


def _draw_route(sheet: Sheet, world: World, route: Route) -> None:
    """The way the robot roughly takes: through its waypoints, with arrows, from START to GOAL."""
    ink, unit = sheet.palette, sheet.unit
    named = [world.grid.position(name) for name in route.via if name in world.grid.by_name]
    passed = named or [(pose.x, pose.y) for pose in route.through]
    points = [(route.start.x, route.start.y), *passed, (route.goal.x, route.goal.y)]
    line = sheet.view.pixels(np.array([p for i, p in enumerate(points) if i == 0 or p != points[i - 1]]))
    if len(line) < 2:
        raise InputError(f'the route "{route.name}" ends where it starts')
    sheet.line(line, ink.floor, 8.0)
    sheet.line(line, ink.tinted(ink.route, share=0.75), 4.0)
    for a, b in pairwise(line):
        if np.hypot(*(b - a)) > 34 * unit:
            _arrow(sheet, (a + b) / 2, b - a, 9 * unit)
    sheet.taken.add_line(line, 4 * unit)
    for pose, colour in ((route.start, ink.start), (route.goal, ink.goal)):
        at, tip = _pointer(sheet, pose)
        sheet.line(np.array([at, tip]), colour, 3.5)
        sheet.dot(float(at[0]), float(at[1]), 10 * unit, fill=colour, edge=ink.floor, width=2.0)
        sheet.taken.add_line(np.array([at, tip]), 5 * unit)
        sheet.taken.add_dot(float(at[0]), float(at[1]), 12 * unit)


def _pointer(sheet: Sheet, pose: Pose) -> tuple[Floats, Floats]:
    """Where a pose lies on the page, and the tip of a short line in its direction."""
    at = sheet.view.pixels(np.array([pose.x, pose.y]))
    ahead = sheet.view.pixels(np.array([pose.x + np.cos(pose.yaw), pose.y + np.sin(pose.yaw)])) - at
    return at, at + ahead / np.hypot(*ahead) * 20 * sheet.unit


def _write_ends(sheet: Sheet, route: Route) -> None:
    """START and GOAL beside the ends of a route."""
    left, top, right, bottom = sheet.view.plan
    for pose, word, colour in (
        (route.start, "START", sheet.palette.start),
        (route.goal, "GOAL", sheet.palette.goal),
    ):
        (x, y), _ = _pointer(sheet, pose)
        corner = 11 * sheet.unit
        ring = np.array([[x - corner, y - corner], [x + corner, y + corner]])
        sizes = [round(size * sheet.unit) for size in (18, 15)]
        found = place_beside(word, ring, sheet.taken, sizes, (left, top, right, bottom))
        if found is not None:
            sheet.write(found, colour, halo=sheet.palette.floor, bold=True)


def _arrow(sheet: Sheet, at: Floats, direction: Floats, size: float) -> None:
    along = direction / np.hypot(*direction)
    across = np.array([-along[1], along[0]])
    tip, back = at + along * size * 0.7, at - along * size * 0.7
    sheet.polygon(np.array([tip, back + across * size * 0.75, back - across * size * 0.75]), fill=sheet.palette.route)
