"""What surrounds a floor plan: title, rulers with row letters and column numbers, scale bar, compass and legend."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rvsg.world.grid import Waypoint
from rvsg.world.picture.palette import Colour
from rvsg.world.picture.placing import text_size
from rvsg.world.picture.sheet import Sheet
from rvsg.world.world import Route, World

Sign = Callable[[float, float], None]

BAR_LENGTHS_M = (0.5, 1, 2, 5, 10, 20, 50, 100)


def draw_title(sheet: Sheet, title: str) -> None:
    """The title above the plan, shortened where it is too long."""
    left, _, right, _ = sheet.view.plan
    size = round(24 * sheet.unit)
    text = " ".join(title.split())
    while text_size(text, size)[0] > right - left and len(text) > 8:
        text = text[:-4].rstrip() + "..."
    sheet.write_at(text, left, 26 * sheet.unit, size, sheet.palette.ink, anchor="l", bold=True)


def draw_rulers(sheet: Sheet, world: World) -> None:
    """Letters of the rows at the left and right, numbers of the columns above and below, faint lines through them."""
    view, ink = sheet.view, sheet.palette
    left, top, right, bottom = view.plan
    away = 20 * sheet.unit
    size = round(19 * sheet.unit)
    rows: dict[int, list[Waypoint]] = {}
    columns: dict[int, list[Waypoint]] = {}
    for waypoint in world.grid.waypoints:
        rows.setdefault(waypoint.row, []).append(waypoint)
        columns.setdefault(waypoint.column, []).append(waypoint)
    for index, at in _readable(sheet, world.grid.rows, rows, axis=1, size=size):
        if top < at < bottom:
            sheet.line(np.array([[left, at], [right, at]]), ink.guide, 1.0)
            for x in (left - away, right + away):
                sheet.write_at(world.grid.rows[index], x, at, size, ink.ink, bold=True)
    for index, at in _readable(sheet, world.grid.columns, columns, axis=0, size=size):
        if left < at < right:
            sheet.line(np.array([[at, top], [at, bottom]]), ink.guide, 1.0)
            for y in (top - away, bottom + away):
                sheet.write_at(world.grid.columns[index], at, y, size, ink.ink, bold=True)


def _readable(
    sheet: Sheet, names: tuple[str, ...], lines: dict[int, list[Waypoint]], *, axis: int, size: int
) -> list[tuple[int, float]]:
    """The index of each row or column whose name fits beside the one before, with its place along the ruler."""
    found: list[tuple[int, float]] = []
    end = -np.inf
    for index in sorted(lines):
        places = sheet.view.pixels(np.array([[w.x, w.y] for w in lines[index]]))
        at = float(np.median(places[:, axis]))
        half = text_size(names[index], size)[axis] / 2
        if at - half > end + 4:
            found.append((index, at))
            end = at + half
    return found


def draw_footer(
    sheet: Sheet, world: World, show: frozenset[str], kinds: dict[str, Colour], route: Route | None
) -> float:
    """Scale bar and compass, and with the legend in words what the signs mean and how the plan lies.

    Returns where the page ends, in pixels from its top.
    """
    unit = sheet.unit
    left, _, right, bottom = sheet.view.plan
    first = bottom + (44 if "rulers" in show else 16) * unit + 14 * unit
    x = _scale_bar(sheet, left + 4 * unit, first)
    x = _compass(sheet, x + 50 * unit, first)
    if "legend" not in show:
        return first + 24 * unit
    size = round(17 * unit)
    x += 40 * unit
    line = first
    for draw, text in _legend(sheet, world, show, kinds, route):
        width = text_size(text, size)[0] + 30 * unit
        if x + width > right:
            x, line = left + 4 * unit, line + 30 * unit
        draw(x + 9 * unit, line)
        sheet.write_at(text, x + 24 * unit, line, size, sheet.palette.ink, anchor="l")
        x += width + 16 * unit
    _sentence(sheet, world, show, left + 4 * unit, line + 32 * unit, size)
    return line + 50 * unit


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
    """Two arrows that say where x and y point."""
    unit, ink = sheet.unit, sheet.palette.ink
    length, size = 24 * unit, round(17 * unit)
    origin = np.array([x + (length if sheet.view.up == "x" else 0), y + 10 * unit])
    upwards = "x" if sheet.view.up == "x" else "y"
    sideways, sign = ("y", -1.0) if sheet.view.up == "x" else ("x", 1.0)
    for name, way in ((upwards, np.array([0.0, -1.0])), (sideways, np.array([sign, 0.0]))):
        tip = origin + way * length
        across = np.array([-way[1], way[0]])
        sheet.line(np.array([origin, tip]), ink, 2.0)
        head = np.array(
            [tip + way * 4 * unit, tip - way * 6 * unit + across * 5 * unit, tip - way * 6 * unit - across * 5 * unit]
        )
        sheet.polygon(head, fill=ink)
        beside = tip + (np.array([12.0, 0.0]) * unit if way[0] == 0 else way * 14 * unit)
        sheet.write_at(name, float(beside[0]), float(beside[1]), size, ink)
    return x + length + 20 * unit


def _legend(
    sheet: Sheet, world: World, show: frozenset[str], kinds: dict[str, Colour], route: Route | None
) -> list[tuple[Sign, str]]:
    """What is in the legend: how to draw each sign, and its meaning."""
    unit, ink = sheet.unit, sheet.palette

    def swatch(colour: Colour) -> Sign:
        def draw(x: float, y: float) -> None:
            half = 8 * unit
            ring = np.array([[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]])
            sheet.polygon(ring, fill=ink.tinted(colour), edge=colour, width=1.8)

        return draw

    entries: list[tuple[Sign, str]] = []
    if "waypoints" in show:
        entries.append((lambda x, y: sheet.dot(x, y, 5 * unit, fill=ink.dot), "waypoint"))
        if any(w.human and not w.robot for w in world.grid.waypoints):
            entries.append(
                (
                    lambda x, y: sheet.dot(x, y, 5 * unit, fill=ink.floor, edge=ink.dot),
                    "waypoint too narrow for the robot",
                )
            )
    if len(kinds) <= 8:
        entries += [(swatch(colour), kind) for kind, colour in kinds.items()]
    if route is not None:
        entries.append(
            (lambda x, y: sheet.line(np.array([[x - 10 * unit, y], [x + 10 * unit, y]]), ink.route, 4.0), route.name)
        )
    return entries


def _sentence(sheet: Sheet, world: World, show: frozenset[str], x: float, y: float, size: int) -> None:
    """How the plan lies and how the grid is numbered, in words, and what could not be shown."""
    x0, y0, x1, y1 = sheet.view.window
    towards = ("up", "left") if sheet.view.up == "x" else ("right", "up")
    parts = [f"{x1 - x0:.0f} m along x ({towards[0]}), {y1 - y0:.0f} m along y ({towards[1]})."]
    rows, columns = world.grid.rows, world.grid.columns
    if "rulers" in show and rows:
        parts.append(f"Rows {rows[0]} to {rows[-1]} from top to bottom,")
        parts.append(f"columns {columns[0]} to {columns[-1]} from left to right.")
    parts += [note[0].upper() + note[1:] + "." for note in sheet.notes[:1]]
    sheet.write_at(" ".join(parts), x, y, size, sheet.palette.faint_ink, anchor="l")
