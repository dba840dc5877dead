"""A route on a floor plan: the way the robot roughly takes, with arrows, from START to GOAL."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.core.records import Pose
from rvsg.world.drawing.placing import place_beside
from rvsg.world.drawing.sheet import Sheet
from rvsg.world.route_words import line_of
from rvsg.world.world import Route, World

Floats = NDArray[np.float64]
Way = Sequence[tuple[float, float, float]]
MARK_EVERY_S = 5.0


def draw_route(sheet: Sheet, world: World, route: Route, way: Way | None = None) -> None:
    """Draw the way the robot drives, with arrows, from START to GOAL.

    Args:
        way: The drive as (time in s, x, y), such as a run without people. Without it, the rough way through the
            route's waypoints is drawn.
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
            _arrow(sheet, (a + b) / 2, b - a, 9 * unit)
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
        found = place_beside(word, ring, sheet.taken, sizes, (left, top, right, bottom))
        if found is not None:
            sheet.write(found, colour, halo=sheet.palette.floor, bold=True)


def _arrow(sheet: Sheet, at: Floats, direction: Floats, size: float) -> None:
    along = direction / np.hypot(*direction)
    across = np.array([-along[1], along[0]])
    tip, back = at + along * size * 0.7, at - along * size * 0.7
    sheet.polygon(np.array([tip, back + across * size * 0.75, back - across * size * 0.75]), fill=sheet.palette.route)


def time_marks(way: Way, every_s: float = MARK_EVERY_S) -> tuple[tuple[float, float, float], ...]:
    """Return where the robot is every `every_s` seconds of a drive, as (time, x, y), without its start."""
    t, x, y = np.array(way, float).T
    times = np.arange(every_s, t[-1] + 1e-9, every_s)
    return tuple(zip(times.tolist(), np.interp(times, t, x).tolist(), np.interp(times, t, y).tolist(), strict=True))


def write_times(sheet: Sheet, way: Way) -> None:
    """Mark on a drive where the robot is every 5 seconds; a mark without room for its number stays a dot."""
    unit = sheet.unit
    for time, x, y in time_marks(way):
        at = sheet.view.pixels(np.array([x, y]))
        sheet.dot(float(at[0]), float(at[1]), 6 * unit, fill=sheet.palette.floor, edge=sheet.palette.route, width=2.5)
        ring = np.array([at - 7 * unit, at + 7 * unit])
        sizes = [round(size * unit) for size in (16, 13)]
        found = place_beside(f"{time:g} s", ring, sheet.taken, sizes, sheet.view.plan)
        if found is not None:
            sheet.write(found, sheet.palette.route, halo=sheet.palette.floor, bold=True)
