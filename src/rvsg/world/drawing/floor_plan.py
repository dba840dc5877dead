"""The floor plan, layer by layer: floor, objects, areas, grid, route, rulers, scale and legend."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from PIL import Image

from rvsg.core.errors import InputError, UnknownName
from rvsg.world.drawing.layers import (
    Way,
    areas_in_sight,
    draw_areas,
    draw_dots,
    draw_floor,
    draw_objects,
    draw_route,
    usual_spacing,
    write_areas,
    write_ends,
    write_times,
    write_waypoints,
)
from rvsg.world.drawing.sheet import (
    SMALLEST_TEXT,
    Colour,
    PageView,
    Palette,
    Sheet,
    Window,
    Word,
    known_window,
    palette,
    text_size,
    view_of,
)
from rvsg.world.world import Route, World

Sign = Callable[[float, float], None]

BAR_LENGTHS_M = (0.5, 1, 2, 5, 10, 20, 50, 100)


def draw_title(sheet: Sheet, title: str) -> None:
    """Draw the title above the plan, shortened if it is too long."""
    left, _, right, _ = sheet.view.plan
    size = round(24 * sheet.unit)
    text = " ".join(title.split())
    while text_size(text, size)[0] > right - left and len(text) > 8:
        text = text[:-4].rstrip() + "..."
    sheet.write_at(text, left, 26 * sheet.unit, size, sheet.palette.ink, anchor="l", bold=True)


def draw_rulers(sheet: Sheet, world: World) -> tuple[list[float], list[float]]:
    """Draw the names of rows and columns; return where faint lines belong, in pixels down and across the page."""
    plan, size, away = sheet.view.plan, round(19 * sheet.unit), 20 * sheet.unit
    guides: tuple[list[float], list[float]] = ([], [])
    places = sheet.view.pixels(np.array([[w.x, w.y] for w in world.grid.waypoints]).reshape(-1, 2))
    for guide, axis, names in ((guides[0], 1, world.grid.rows), (guides[1], 0, world.grid.columns)):
        line = np.array([w.row if axis else w.column for w in world.grid.waypoints])
        at = [float(np.median(places[line == index, axis])) for index in range(len(names))]
        halves = [text_size(name, size)[axis] / 2 for name in names]
        for step in (1, 2, 5, 10, 20, 50, 100):  # all of them, or every 2nd, 5th and so on
            shown = range(0, len(names), step)
            if all(at[b] - halves[b] > at[a] + halves[a] + 4 for a, b in pairwise(shown)):
                break
        low, high = plan[axis], plan[axis + 2]
        for index in shown:
            if low < at[index] < high:
                guide.append(at[index])
                for beside in (plan[1 - axis] - away, plan[3 - axis] + away):
                    x, y = (beside, at[index]) if axis else (at[index], beside)
                    sheet.write_at(names[index], x, y, size, sheet.palette.ink, bold=True)
    return guides


def draw_footer(
    sheet: Sheet, world: World, show: frozenset[str], kinds: dict[str, Colour], route: Route | None
) -> float:
    """Draw scale bar, compass, legend and orientation; return where the page ends, in pixels from its top."""
    unit = sheet.unit
    left, _, right, bottom = sheet.view.plan
    first = bottom + (44 if "rulers" in show else 16) * unit + 14 * unit
    x = _scale_bar(sheet, left + 4 * unit, first)
    x = _compass(sheet, x + 50 * unit, first)
    if "legend" not in show:
        return first + 24 * unit
    size = max(SMALLEST_TEXT + 1, round(17 * unit))
    x += 40 * unit
    line = first
    for draw, text in _legend(sheet, world, show, kinds, route):
        width = text_size(text, size)[0] + 30 * unit
        if x + width > right:
            x, line = left + 4 * unit, line + 30 * unit
        draw(x + 9 * unit, line)
        sheet.write_at(text, x + 24 * unit, line, size, sheet.palette.ink, anchor="l")
        x += width + 16 * unit
    return _sentences(sheet, world, show, left + 4 * unit, line + 32 * unit, size) + 18 * unit


def _scale_bar(sheet: Sheet, x: float, y: float) -> float:
    scale, unit, ink = sheet.view.scale, sheet.unit, sheet.palette.ink
    length = max((m for m in BAR_LENGTHS_M if m * scale <= 200 * unit), default=BAR_LENGTHS_M[0])
    end = x + length * scale
    sheet.line(np.array([[x, y], [end, y]]), ink, 2.5)
    for at in (x, end):
        sheet.line(np.array([[at, y - 6 * unit], [at, y + 6 * unit]]), ink, 2.5)
    word = sheet.write_at(f"{length:g} m", end + 10 * unit, y, round(17 * unit), ink, anchor="l")
    return word.box[2]


def _compass(sheet: Sheet, x: float, y: float) -> float:
    """Draw two arrows in the directions of x and y."""
    unit, ink = sheet.unit, sheet.palette.ink
    length, size = 24 * unit, round(17 * unit)
    up = sheet.view.up
    origin = np.array([x + (length if up == "x" else 0), y + 10 * unit])
    sideways, sign = ("y", -1.0) if up == "x" else ("x", 1.0)
    for name, way in ((up, np.array([0.0, -1.0])), (sideways, np.array([sign, 0.0]))):
        tip = origin + way * length
        across, back = np.array([-way[1], way[0]]) * 5 * unit, tip - way * 6 * unit
        sheet.line(np.array([origin, tip]), ink, 2.0)
        sheet.polygon(np.array([tip + way * 4 * unit, back + across, back - across]), fill=ink)
        beside = tip + (np.array([12.0, 0.0]) * unit if way[0] == 0 else way * 14 * unit)
        sheet.write_at(name, float(beside[0]), float(beside[1]), size, ink)
    return x + length + 20 * unit


def _legend(
    sheet: Sheet, world: World, show: frozenset[str], kinds: dict[str, Colour], route: Route | None
) -> list[tuple[Sign, str]]:
    """Return the entries of the legend: how to draw each symbol, and its meaning."""
    unit, ink = sheet.unit, sheet.palette

    def dot(fill: Colour, edge: Colour | None = None) -> Sign:
        return lambda x, y: sheet.dot(x, y, 5 * unit, fill=fill, edge=edge)

    def swatch(colour: Colour) -> Sign:
        corners = 8 * unit * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return lambda x, y: sheet.polygon(np.array([x, y]) + corners, fill=ink.tinted(colour), edge=colour, width=1.8)

    entries: list[tuple[Sign, str]] = []
    if "waypoints" in show:
        entries.append((dot(ink.dot), "waypoint"))
        if any(w.human and not w.robot for w in world.grid.waypoints):
            entries.append((dot(ink.floor, ink.dot), "waypoint too narrow for the robot"))
    if len(kinds) <= 8 and len(set(kinds.values())) == len(kinds):
        entries += [(swatch(colour), kind) for kind, colour in kinds.items()]
    if route is not None:
        ends = 10 * unit * np.array([[-1, 0], [1, 0]])
        entries.append((lambda x, y: sheet.line(np.array([x, y]) + ends, ink.route, 4.0), route.name))
    return entries


def _sentences(sheet: Sheet, world: World, show: frozenset[str], x: float, y: float, size: int) -> float:
    """Write how the plan is oriented, how the grid is numbered and what is not shown; return the last line's y."""
    x0, y0, x1, y1 = sheet.view.window
    towards = ("up", "left") if sheet.view.up == "x" else ("right", "up")
    said = [f"{x1 - x0:.0f} m along x ({towards[0]}), {y1 - y0:.0f} m along y ({towards[1]})."]
    rows, columns, spec = world.grid.rows, world.grid.columns, world.grid_spec
    if "rulers" in show and rows:
        first, last = world.grid.waypoints[0], world.grid.waypoints[-1]
        (left, top), (right, bottom) = sheet.view.pixels(np.array([[first.x, first.y], [last.x, last.y]]))
        # explicit coordinates may count from the bottom or the right
        down = "top to bottom" if top <= bottom else "bottom to top"
        across = "left to right" if left <= right else "right to left"
        said.append(f"Rows {rows[0]} to {rows[-1]} from {down}, columns {columns[0]} to {columns[-1]} from {across}.")
        if spec is not None and spec.rows is None and world.grid.spacing_m:
            said.append(f"Waypoints {world.grid.spacing_m:g} m apart.")
    said += [note[0].upper() + note[1:] + "." for note in sheet.notes[:2]]
    lines = [""]
    for word in " ".join(said).split():
        longer = f"{lines[-1]} {word}".strip()
        if text_size(longer, size)[0] > sheet.view.plan[2] - x:
            lines.append(word)
        else:
            lines[-1] = longer
    lines = lines[:5]
    for i, line in enumerate(lines):
        sheet.write_at(line, x, y + i * 1.4 * size, size, sheet.palette.faint_ink, anchor="l")
    return y + (len(lines) - 1) * 1.4 * size


def draw_metres(sheet: Sheet) -> None:
    """Write coordinates in metres along the lower and the left edge of the plan, inside it."""
    left, top, right, bottom = sheet.view.plan
    x0, y0, x1, y1 = sheet.view.window
    size = max(9, round(13 * sheet.unit))
    step = next(s for s in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 500.0) if s * sheet.view.scale >= 9 * size)
    for axis, low, high in (("x", x0, x1), ("y", y0, y1)):
        for value in np.arange(np.ceil(low / step) * step, high, step).tolist():
            point = (value, y0) if axis == "x" else (x0, value)
            across, down = sheet.view.pixels(np.array(point)).tolist()
            upright = axis == sheet.view.up
            at = (left, down) if upright else (across, bottom)
            if min(abs(at[0] - right), abs(at[1] - top)) < 2 * size:
                continue
            inner = (at[0] + size * 0.6, at[1]) if upright else (at[0], at[1] - size * 0.6)
            sheet.line(np.array([at, inner]), sheet.palette.ink, 1.5)
            text = f"{axis} {value:g}"
            wide, tall = text_size(text, size)
            x = inner[0] + 3 if upright else at[0] - wide / 2
            y = at[1] - tall / 2 if upright else inner[1] - tall - 3
            sheet.write(Word(text, (x, y, x + wide, y + tall), size), sheet.palette.ink, halo=sheet.palette.floor)


LAYERS = frozenset({"objects", "lidar", "areas", "rulers", "waypoints", "names", "hops", "title", "legend", "metres"})
LABELLED = frozenset({"objects", "areas", "title", "legend"})
GRID = frozenset({"objects", "areas", "rulers", "waypoints", "names", "title", "legend"})


@dataclass(frozen=True)
class DrawnPlan:
    """A drawn floor plan: the image, every word on it with its box, the view, and what could not be shown."""

    image: Image.Image
    words: tuple[Word, ...]
    view: PageView
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
    way: Way | None = None,
) -> DrawnPlan:
    """Draw the LAYERS to `show` of a floor plan, or of a window of it (x_min, y_min, x_max, y_max in metres).

    `way` is, with a route, the drive to draw as (time in s, x, y), with a mark every 5 s.
    """
    if show - LAYERS:
        raise UnknownName("layer", min(show - LAYERS), LAYERS)
    ink = palette(colours)
    unit = width_px / 1600
    rulers = round(40 * unit) if "rulers" in show else round(14 * unit)
    top = rulers + (round(44 * unit) if "title" in show else 0)
    bottom = rulers + (round(112 * unit) if "legend" in show else round(50 * unit))
    view = view_of(world, width_px=width_px, window=window, margins=(rulers, top, rulers, bottom))
    sheet = Sheet(view, ink)
    guides = draw_rulers(sheet, world) if "rulers" in show else ([], [])
    draw_floor(sheet, world, guides, hidden="objects" in show)
    if "objects" in show:
        draw_objects(sheet, world.drawn)
    if "lidar" in show:
        for thing in world.solids:
            for cut in thing.slices:
                sheet.polygon(view.pixels(np.array(cut)), fill=None, edge=ink.wall, width=1.5)
    kinds = ink.kind_colours(area.kind for area in world.areas)
    areas = areas_in_sight(world, view) if "areas" in show else []
    draw_areas(sheet, areas, kinds)
    if "hops" in show:
        for a, b in world.grid.hops:
            ends = view.pixels(np.array([world.grid.position(a), world.grid.position(b)]))
            sheet.line(ends, ink.tinted(ink.dot, share=0.3), 0.8)
    if route is not None:
        draw_route(sheet, world, route, way)
    dots = draw_dots(sheet, world) if "waypoints" in show else None
    if route is not None:
        write_ends(sheet, route)
        if way is not None:
            write_times(sheet, way)
    if "names" in show and dots is not None:
        write_waypoints(sheet, *dots)
    write_areas(sheet, areas, kinds, largest=26 if "waypoints" not in show else 19)
    sheet.clear_margins()
    if "metres" in show:
        draw_metres(sheet)
    if "title" in show:
        draw_title(sheet, title or world.title)
    end = draw_footer(sheet, world, show, kinds if areas else {}, route)
    return DrawnPlan(sheet.finished(end), tuple(sheet.words), view, tuple(sheet.notes))


MOST_TILES = 100
RULERS_PX = 100


def tile_windows(world: World, *, width_px: int = 1600) -> dict[tuple[int, int], Window]:
    """Return the window of every tile by row and column; one if one picture can name all. Neighbours share a strip.

    Raises InputError where more than MOST_TILES would be needed.
    """
    x0, y0, x1, y1 = window = known_window(world)
    points = np.array([[w.x, w.y] for w in world.grid.waypoints if w.human])
    names = [w.name for w in world.grid.waypoints if w.human]
    if len(points) < 2:
        return {(0, 0): window}
    spacing = usual_spacing(points)
    needed = (text_size(max(names, key=len), SMALLEST_TEXT + 2)[0] + 6) / spacing  # pixels a metre
    side = (width_px - RULERS_PX) / needed
    across, down = (x1 - x0, y1 - y0) if world.grid.up == "y" else (y1 - y0, x1 - x0)
    columns, rows = max(1, math.ceil(across / side)), max(1, math.ceil(down / side))
    if rows * columns > MOST_TILES:
        raise InputError(
            f"{rows * columns} pictures would be needed to name every waypoint (at most {MOST_TILES} are drawn): "
            f"use a spacing_m over {spacing:g} or a larger width",
            code="tiles-too-many",
        )
    strip = spacing if rows * columns > 1 else 0.0
    windows = {}
    for row, column in itertools.product(range(rows), range(columns)):
        left, right = column * across / columns - strip / 2, (column + 1) * across / columns + strip / 2
        top, bottom = row * down / rows - strip / 2, (row + 1) * down / rows + strip / 2
        upright = world.grid.up == "y"
        windows[row, column] = (
            (x0 + left, y1 - bottom, x0 + right, y1 - top)
            if upright
            else (x1 - bottom, y1 - right, x1 - top, y1 - left)
        )
    return windows


def tiles(
    world: World, *, width_px: int = 1600, route: Route | None = None, colours: str | Palette = "light"
) -> dict[tuple[int, int], DrawnPlan]:
    """Draw all tiles of a world by row and column, each with the names of all its waypoints."""
    windows = tile_windows(world, width_px=width_px)
    drawn = {}
    for number, (place, window) in enumerate(windows.items(), start=1):
        part = f" (part {number} of {len(windows)}, from the upper left)" if len(windows) > 1 else ""
        title = f"{world.title}: grid of waypoints{part}"
        drawn[place] = draw_plan(
            world, show=GRID, width_px=width_px, route=route, colours=colours, window=window, title=title
        )
    return drawn
