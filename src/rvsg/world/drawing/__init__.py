"""Pictures of a world for people and vision language models: a labelled map and the grid of waypoints.

The same world gives the same bytes. Colours, size and what is shown can be chosen; a route can be drawn on them.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Literal

from PIL import Image

from rvsg.core.errors import FileError
from rvsg.core.files import make_folder
from rvsg.world.drawing.birdseye import birdseye
from rvsg.world.drawing.floor_plan import GRID, LABELLED, draw_plan, tiles
from rvsg.world.drawing.layers import Way
from rvsg.world.drawing.sheet import Window
from rvsg.world.drawing.svg import floor_plan_svg
from rvsg.world.world import Route, World


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
    """Draw pictures of a world, `width` pixels wide, into a folder; return each file with what it could not show.

    `route` names one to draw; `window` is the part to show, x0, y0, x1, y1 in metres.
    """
    shown = world.route(route) if route else None
    whole = ("shows the whole world: --window is for the labelled map and the grid",) if window else ()
    made: list[tuple[str, bytes, tuple[str, ...]]] = []
    if what == "svg":
        made.append(("plan.svg", floor_plan_svg(world, colours=colours).encode(), whole))
    pictures = []
    for name, layers, said in (("labels", LABELLED, "labelled areas"), ("grid", GRID, "grid of waypoints")):
        if what in ("all", name):
            title = f"{world.title}: {said}" + (f" and {shown.name}" if shown else "")
            plan = draw_plan(
                world, show=layers, width_px=width, route=shown, colours=colours, window=window, title=title
            )
            pictures.append((name, plan.image, plan.notes))
    if what in ("all", "grid") and window is None:
        parts = tiles(world, width_px=width, route=shown, colours=colours)
        for (row, column), part in parts.items() if len(parts) > 1 else ():
            pictures.append((f"grid_part_{row + 1}_{column + 1}", part.image, part.notes))
    if what in ("all", "birdseye"):
        pictures.append(("birdseye", birdseye(world, width_px=width, colours=colours, route=shown), whole))
    for name, image, notes in pictures:
        made.append((f"{name}_{shown.name}.png" if shown else f"{name}.png", png_bytes(image), notes))
    try:
        make_folder(folder)
        for file, content, _ in made:
            (folder / file).write_bytes(content)
    except OSError as error:
        raise FileError(folder, f"the pictures cannot be written here: {error.strerror}") from None
    return [(folder / file, notes) for file, _, notes in made]
