"""Draws the floor plan layer by layer: floor, objects, areas, grid, route, rulers, scale and legend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PIL import Image

from rvsg.core.errors import UnknownName
from rvsg.world.drawing.areas import areas_in_sight, draw_areas, write_areas
from rvsg.world.drawing.floor import draw_floor, draw_objects
from rvsg.world.drawing.furniture import draw_footer, draw_metres, draw_rulers, draw_title
from rvsg.world.drawing.palette import Palette, palette
from rvsg.world.drawing.placing import Word
from rvsg.world.drawing.route import Way, draw_route, write_ends, write_times
from rvsg.world.drawing.sheet import Sheet
from rvsg.world.drawing.view import View, Window, view_of
from rvsg.world.drawing.waypoints import draw_dots, write_waypoints
from rvsg.world.world import Route, World

LAYERS = frozenset({"objects", "lidar", "areas", "rulers", "waypoints", "names", "hops", "title", "legend", "metres"})
LABELLED = frozenset({"objects", "areas", "title", "legend"})
GRID = frozenset({"objects", "areas", "rulers", "waypoints", "names", "title", "legend"})


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
    way: Way | None = None,
) -> Picture:
    """Draw a floor plan.

    Args:
        show: Which of LAYERS to draw. "metres" puts coordinates along the left and lower edge.
        window: The part of the world to show: x_min, y_min, x_max, y_max in metres.
        way: With a route, the drive to draw as (time in s, x, y), with a mark every 5 s.
    """
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
    dots = draw_dots(sheet, world) if "waypoints" in show else []
    if route is not None:
        write_ends(sheet, route)
        if way is not None:
            write_times(sheet, way)
    if "names" in show:
        write_waypoints(sheet, dots)
    write_areas(sheet, areas, kinds, largest=26 if "waypoints" not in show else 19)
    sheet.clear_margins()
    if "metres" in show:
        draw_metres(sheet)
    if "title" in show:
        draw_title(sheet, title or world.title)
    end = draw_footer(sheet, world, show, kinds if areas else {}, route)
    return Picture(sheet.finished(end), tuple(sheet.words), view, tuple(sheet.notes))
