"""Pictures of a world for people and vision language models: a labelled map and the grid of waypoints.

The same world gives the same bytes. Colours, size and what is shown can be chosen; a route can be drawn on them.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from PIL import Image

from rvsg.core.errors import FileError
from rvsg.core.outputs import make_folder
from rvsg.world.drawing.birdseye import birdseye
from rvsg.world.drawing.floor_plan import GRID, LABELLED, LAYERS, Picture, Tile, draw_plan, tiles
from rvsg.world.drawing.layers import Way
from rvsg.world.drawing.sheet import PALETTES, Window
from rvsg.world.drawing.svg import floor_plan_svg
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
    "draw_world",
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


def draw_world(
    world: World,
    folder: Path,
    *,
    what: Literal["all", "labels", "grid", "birdseye", "svg"] = "all",
    route: str | None = None,
    width: int = 1600,
    colours: str = "light",
    window: Window | None = None,
) -> list[tuple[Path, tuple[str, ...]]]:
    """Draw pictures of a world into a folder; return each file with what it could not show.

    Args:
        route: The name of a route to draw.
        width: Width of the pictures in pixels.
        window: x0, y0, x1, y1 of the part to show, in metres.
    """
    shown = world.route(route) if route else None
    made: list[tuple[str, bytes, tuple[str, ...]]] = []
    whole = ("shows the whole world: --window is for the labelled map and the grid",) if window else ()
    if what == "svg":
        made.append(("plan.svg", floor_plan_svg(world, colours=colours).encode(), whole))
    for name, image, notes in _pictures(world, what, shown, width, colours, window):
        remarks = (*notes, *whole) if name == "birdseye" else notes
        made.append((f"{name}_{shown.name}.png" if shown else f"{name}.png", png_bytes(image), remarks))
    written = []
    try:
        make_folder(folder)
        for file, content, notes in made:
            (folder / file).write_bytes(content)
            written.append((folder / file, notes))
    except OSError as error:
        raise FileError(folder, f"the pictures cannot be written here: {error.strerror}") from None
    return written


def _pictures(
    world: World, what: str, route: Route | None, width: int, colours: str, window: Window | None
) -> Iterator[tuple[str, Image.Image, tuple[str, ...]]]:
    """Yield the name, image and notes of every picture asked for."""
    for name, layers, said in (("labels", LABELLED, "labelled areas"), ("grid", GRID, "grid of waypoints")):
        if what in ("all", name):
            title = f"{world.title}: {said}" + (f" and {route.name}" if route else "")
            plan = draw_plan(
                world, show=layers, width_px=width, route=route, colours=colours, window=window, title=title
            )
            yield name, plan.image, plan.notes
    if what in ("all", "grid") and window is None:
        parts = tiles(world, width_px=width, route=route, colours=colours)
        for part in parts if len(parts) > 1 else ():
            yield f"grid_part_{part.row + 1}_{part.column + 1}", part.picture.image, part.picture.notes
    if what in ("all", "birdseye"):
        yield "birdseye", birdseye(world, width_px=width, colours=colours, route=route), ()
