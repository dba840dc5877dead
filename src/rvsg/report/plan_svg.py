"""The floor plan as SVG for the report: a few hundred shapes that take their colours from the page.

Coordinates are metres with y turned over (SVG's y points down): world (x, y) is drawn at (x, -y).
"""

from __future__ import annotations

import html
from collections.abc import Iterable

import numpy as np

from rvsg.simulation.run import Run
from rvsg.world.world import Area, World

Box = tuple[float, float, float, float]


def view_box(world: World, runs: Iterable[Run], *, margin_m: float = 0.6) -> Box:
    """Left, top, width, height of the part of the floor that is shown: what is known of it, and every trajectory."""
    x = [p[0] for thing in world.objects for p in thing.footprint]
    y = [p[1] for thing in world.objects for p in thing.footprint]
    for run in runs:
        path = run.trajectory
        x += [float(path.x.min()), float(path.x.max()), *_ends(path.human_x)]
        y += [float(path.y.min()), float(path.y.max()), *_ends(path.human_y)]
    for area in world.areas:
        x += [p[0] for p in area.outline]
        y += [p[1] for p in area.outline]
    left, right, low, high = min(x) - margin_m, max(x) + margin_m, min(y) - margin_m, max(y) + margin_m
    return (round(left, 2), round(-high, 2), round(right - left, 2), round(high - low, 2))


def floor_plan(world: World) -> str:
    """The shapes of the plan, to stand inside an `svg` element: areas, obstacles, names of the areas."""
    parts = [f'<polygon class="area" points="{_points(area.outline)}"/>' for area in world.areas]
    if world.objects:
        parts += [
            f'<polygon class="thing" points="{_points(thing.footprint)}">'
            f"<title>{html.escape(thing.name)}</title></polygon>"
            for thing in world.objects
        ]
    else:
        parts.append(f'<path class="thing" d="{_occupied(world)}"/>')
    parts += [_name(area) for area in world.areas]
    return "\n".join(parts)


def _name(area: Area) -> str:
    x = [p[0] for p in area.outline]
    y = [p[1] for p in area.outline]
    width, height = max(x) - min(x), max(y) - min(y)
    upright = height > 1.3 * width
    room = height if upright else width
    size = min(0.42, max(0.16, 1.5 * room / max(len(area.name), 1)))
    at = f"{(min(x) + max(x)) / 2:.2f} {-(min(y) + max(y)) / 2:.2f}"
    turn = f' transform="rotate(-90 {at})"' if upright else ""
    place = at.split()
    return (
        f'<text class="name" x="{place[0]}" y="{place[1]}" font-size="{size:.2f}"{turn}>{html.escape(area.name)}</text>'
    )


def _points(outline: Iterable[tuple[float, float]]) -> str:
    return " ".join(f"{x:.2f},{-y:.2f}" for x, y in outline)


def _occupied(world: World) -> str:
    """The occupied cells as one path of runs of cells (for a world that is only a map)."""
    cells, size = world.occupancy.cells == 100, world.occupancy.resolution
    origin_x = world.occupancy.origin.x + world.map_offset[0]
    origin_y = world.occupancy.origin.y + world.map_offset[1]
    parts = []
    for row in range(cells.shape[0]):
        edges = np.flatnonzero(np.diff(cells[row].astype(np.int8), prepend=0, append=0))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            x, y = origin_x + begin * size, -(origin_y + (row + 1) * size)
            parts.append(f"M{x:.2f} {y:.2f}h{(end - begin) * size:.2f}v{size:.2f}h{-(end - begin) * size:.2f}z")
    return "".join(parts)


def _ends(values: np.ndarray) -> list[float]:
    return [float(values.min()), float(values.max())] if values.size else []
