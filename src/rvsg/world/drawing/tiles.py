"""Draw a large or dense world as several pictures, so that the name of every waypoint is readable."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rvsg.core.errors import InputError
from rvsg.world.drawing.palette import Palette
from rvsg.world.drawing.placing import SMALLEST_TEXT, text_size
from rvsg.world.drawing.plan import GRID, Picture, draw_plan
from rvsg.world.drawing.view import Window, known_window
from rvsg.world.drawing.waypoints import usual_spacing
from rvsg.world.world import Route, World

MOST_TILES = 100
RULERS_PX = 100


@dataclass(frozen=True)
class Tile:
    """One part of a world: `row` and `column` count from 0 at the upper left, `window` is in metres."""

    row: int
    column: int
    window: Window
    picture: Picture


def tile_windows(world: World, *, width_px: int = 1600) -> list[tuple[int, int, Window]]:
    """Return row, column and window of every tile; one tile if all names are readable on one picture.

    Neighbouring tiles share a strip one spacing wide. Raises InputError where more than MOST_TILES would be needed.
    """
    x0, y0, x1, y1 = window = known_window(world)
    points = np.array([[w.x, w.y] for w in world.grid.waypoints if w.human])
    names = [w.name for w in world.grid.waypoints if w.human]
    if len(points) < 2:
        return [(0, 0, window)]
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
    found = []
    for row in range(rows):
        for column in range(columns):
            left, right = column * across / columns - strip / 2, (column + 1) * across / columns + strip / 2
            top, bottom = row * down / rows - strip / 2, (row + 1) * down / rows + strip / 2
            part = (x0 + left, y1 - bottom, x0 + right, y1 - top)
            if world.grid.up == "x":
                part = (x1 - bottom, y1 - right, x1 - top, y1 - left)
            found.append((row, column, part))
    return found


def tiles(
    world: World,
    *,
    width_px: int = 1600,
    route: Route | None = None,
    colours: str | Palette = "light",
    show: frozenset[str] = GRID,
) -> tuple[Tile, ...]:
    """Draw all tiles of a world, each with the names of all its waypoints."""
    windows = tile_windows(world, width_px=width_px)
    drawn = []
    for index, (row, column, window) in enumerate(windows):
        part = f" (part {index + 1} of {len(windows)}, from the upper left)" if len(windows) > 1 else ""
        picture = draw_plan(
            world,
            show=show,
            width_px=width_px,
            route=route,
            colours=colours,
            window=window,
            title=f"{world.title}: grid of waypoints{part}",
        )
        drawn.append(Tile(row, column, window, picture))
    return tuple(drawn)
