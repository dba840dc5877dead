"""Draw the waypoints of a floor plan: a dot for each where a person can stand, and its name if that is readable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rvsg.world.drawing.placing import SMALLEST_TEXT, Word, text_size
from rvsg.world.drawing.sheet import Sheet
from rvsg.world.world import World

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Dot:
    """A waypoint on the page: its position and radius, and the distance between waypoints, in pixels."""

    name: str
    x: float
    y: float
    radius: float
    apart: float


def draw_dots(sheet: Sheet, world: World) -> list[Dot]:
    """Draw a dot for every valid waypoint in the window, a ring where the robot does not fit."""
    view, ink = sheet.view, sheet.palette
    left, top, right, bottom = view.plan
    valid = [w for w in world.grid.waypoints if w.human]
    places = view.pixels(np.array([[w.x, w.y] for w in valid]))
    seen = [(w, float(x), float(y)) for w, (x, y) in zip(valid, places, strict=True)]
    seen = [(w, x, y) for w, x, y in seen if left < x < right and top < y < bottom]
    apart = usual_spacing(np.array([(x, y) for _, x, y in seen]).reshape(-1, 2))
    radius = float(np.clip(apart * 0.075, 1.6, 5.0 * sheet.unit))
    dense = apart < text_size("A10", SMALLEST_TEXT)[0]  # with this many dots, names of areas may cover some
    for waypoint, x, y in seen:
        if not dense:
            sheet.taken.add_dot(x, y, radius)
        if waypoint.robot:
            sheet.dot(x, y, radius, fill=ink.dot)
        else:
            sheet.dot(x, y, radius, fill=ink.floor, edge=ink.dot, width=1.6)
    return [Dot(waypoint.name, x, y, radius, apart) for waypoint, x, y in seen]


def write_waypoints(sheet: Sheet, dots: list[Dot]) -> None:
    """Write the names of waypoints below the dots where there is room; none if they would be unreadable."""
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


def usual_spacing(places: Floats) -> float:
    """Return the typical distance from a waypoint (n, 2) to the nearest other: a low quantile, so most names fit."""
    if len(places) < 2:
        return 100.0
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(places).query(places, k=2)
    return float(np.quantile(distance[:, 1], 0.1))
