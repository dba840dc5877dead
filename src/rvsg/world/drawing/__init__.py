"""Pictures of a world for people and vision language models: a labelled map and the grid of waypoints.

The same world gives the same bytes. Colours, size and what is shown can be chosen; a route can be drawn on them.
"""

from __future__ import annotations

import io

from PIL import Image

from rvsg.world.drawing.floor_plan import GRID, LABELLED, LAYERS, Picture, Tile, draw_plan, tiles
from rvsg.world.drawing.layers import Way
from rvsg.world.drawing.sheet import PALETTES
from rvsg.world.world import Route, World

__all__ = [
    "GRID",
    "LABELLED",
    "LAYERS",
    "PALETTES",
    "Picture",
    "Tile",
    "Way",
    "draw_plan",
    "grid_picture",
    "labelled_map",
    "png_bytes",
    "tiles",
]


def labelled_map(
    world: World,
    *,
    width_px: int = 1600,
    route: Route | None = None,
    way: Way | None = None,
) -> Image.Image:
    """Return the floor plan with its labelled areas, seen from above, about `width_px` pixels wide."""
    title = f"{world.title}: labelled areas" + (f" and {route.name}" if route else "")
    return draw_plan(world, show=LABELLED, width_px=width_px, route=route, title=title, way=way).image


def grid_picture(world: World, *, width_px: int = 1600) -> Image.Image:
    """Return the floor plan with the grid of waypoints where people can stand, about `width_px` pixels wide."""
    return draw_plan(world, show=GRID, width_px=width_px, title=f"{world.title}: grid of waypoints").image


def png_bytes(image: Image.Image) -> bytes:
    """Return the picture as PNG; the same picture gives the same bytes."""
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=False, compress_level=6)
    return buffer.getvalue()
