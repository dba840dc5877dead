"""The floor plan as SVG in metres, for pages that draw trajectories over it.

The plan lies as in the pictures. Its user units are metres; `FloorPlan.matrix` turns world coordinates into them::

    <svg viewBox="{plan.view_box}">{plan.shapes}{plan.names}<g transform="{plan.matrix}"> ... metres ... </g></svg>

Shapes carry classes and no colours (`floor`, `wall`, `thing`, `area`, `area-name`, `waypoint`, `waypoint narrow`), so
that a page gives them its own; `floor_plan_svg` adds the colours of a palette and stands alone.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rvsg.world.drawing.layers import area_words, is_wall
from rvsg.world.drawing.sheet import Colour, PageView, Palette, Word, palette, view_of
from rvsg.world.space import frame_of, solid_cells, world_map
from rvsg.world.world import AUTOMATIC, FREE, OCCUPIED, World

Floats = NDArray[np.float64]
SHOWN_PX = 800


T = TypeVar("T", float, Floats)


class PlanTransform(NamedTuple):
    """World coordinates (m) to those of the floor plan, in the order of SVG's `matrix(a b c d e f)`."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float

    def point(self, x: T, y: T) -> tuple[T, T]:
        """Return the plan's coordinates of one world point, or of arrays of them."""
        return self.a * x + self.c * y + self.e, self.b * x + self.d * y + self.f

    def placed(self, x: float, y: float, yaw: float) -> str:
        """Return the `transform` that puts a shape in its own frame (x ahead) at a world pose."""
        px, py = self.point(x, y)
        return f"matrix({self.a:g} {self.b:g} {self.c:g} {self.d:g} {px:.3f} {py:.3f}) rotate({math.degrees(yaw):.1f})"


@dataclass(frozen=True)
class FloorPlan:
    """The parts of an SVG floor plan.

    `view_box` (left, top, width, height in metres) and `matrix` (`transform`, from world to user units) are as SVG's
    attributes are written. `shapes` and `names` stand inside the `svg` element, apart so that a page can draw the
    shapes several times. `words` are the names as placed on a page with this `view`.
    """

    view_box: str
    transform: PlanTransform
    shapes: str
    view: PageView
    words: tuple[Word, ...] = ()

    @property
    def matrix(self) -> str:
        """The transform as SVG writes it."""
        return f"matrix({' '.join(f'{value:g}' for value in self.transform)})"

    @property
    def names(self) -> str:
        """The names of the areas."""
        return "\n".join(self.name(word) for word in self.words)

    def middle(self, word: Word) -> tuple[float, float]:
        """Return the middle of a name in user units."""
        (x0, _, x1, y1), view = self.view.window, self.view
        left, top = (x0, -y1) if view.up == "y" else (-y1, -x1)
        return left + (word.centre[0] - view.left) / view.scale, top + (word.centre[1] - view.top) / view.scale

    def name(self, word: Word, *, kind: str = "area-name", apart_em: float | None = None) -> str:
        """Return a name as text of the class `kind`; with `apart_em` its lines keep apart at every size of letters."""
        (x, y), size = self.middle(word), word.size / self.view.scale
        turn = f' transform="rotate(-90 {x:.2f} {y:.2f})"' if word.turned else ""
        lines = word.text.split("\n")
        spans = ""
        for i, line in enumerate(lines):
            off = i - (len(lines) - 1) / 2
            at = f'y="{y + off * size * 1.14:.2f}"' if apart_em is None else f'y="{y:.2f}" dy="{off * apart_em:.2f}em"'
            spans += f'<tspan x="{x:.2f}" {at}>{html.escape(line)}</tspan>'
        return f'<text class="{kind}" font-size="{size * 0.92:.3f}"{turn}>{spans}</text>'


@lru_cache(maxsize=16)  # of a campaign's page, its overview and its pictures
def floor_plan(
    world: World,
    *,
    areas: bool = True,
    waypoints: bool = False,
    shown_px: int = SHOWN_PX,
    tooltips: bool = True,
) -> FloorPlan:
    """Return the floor plan of a world.

    The areas' names are readable where the plan is shown about `shown_px` pixels wide; `tooltips` names the objects.
    """
    view = view_of(world, width_px=shown_px, window=None, margins=(0, 0, 0, 0))
    x0, y0, x1, y1 = view.window
    if view.up == "y":
        transform, box = PlanTransform(1.0, 0.0, 0.0, -1.0, 0.0, 0.0), (x0, -y1, x1 - x0, y1 - y0)
    else:
        transform, box = PlanTransform(0.0, -1.0, -1.0, 0.0, 0.0, 0.0), (-y1, -x1, y1 - y0, x1 - x0)
    parts = [*_cells(world), *_objects(world, tooltips)]
    if areas:
        kinds = list(dict.fromkeys(area.kind for area in world.areas))
        parts += [
            f'<polygon class="area kind-{kinds.index(area.kind)}" points="{_points(area.outline)}">'
            f"<title>{html.escape(area.name)}</title></polygon>"
            for area in world.areas
        ]
    if waypoints:
        parts += [
            f'<circle class="waypoint{"" if w.robot else " narrow"}" cx="{w.x:g}" cy="{w.y:g}" r="0.06">'
            f"<title>{html.escape(w.name)}</title></circle>"
            for w in world.grid.waypoints
            if w.human
        ]
    words = area_words(world, view) if areas else ()
    plan = FloorPlan(" ".join(_number(v) for v in box), transform, "\n".join([*parts, "</g>"]), view, words)
    return replace(plan, shapes=f'<g class="plan" transform="{plan.matrix}">\n{plan.shapes}')


def floor_plan_svg(world: World, *, waypoints: bool = False, colours: str | Palette = "light") -> str:
    """Return the floor plan as an SVG document that stands alone, 1000 CSS pixels wide."""
    plan = floor_plan(world, waypoints=waypoints, shown_px=1000)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{plan.view_box}" width="1000" role="img" '
        f'aria-label="Floor plan of {html.escape(world.title, quote=True)}">\n'
        f"<style>{style(world, palette(colours))}</style>\n{plan.shapes}\n{plan.names}\n</svg>\n"
    )


def style(world: World, ink: Palette) -> str:
    """Return the style sheet that gives the shapes of a floor plan the colours of a palette."""
    rules = [
        f".plan .floor{{fill:{_css(ink.floor)}}}",
        f".plan .wall{{fill:{_css(ink.wall)}}}",
        f".plan .thing{{fill:{_css(ink.thing)};stroke:{_css(ink.thing_edge)};stroke-width:.02}}",
        f".plan .waypoint{{fill:{_css(ink.dot)}}}",
        f".plan .narrow{{fill:{_css(ink.floor)};stroke:{_css(ink.dot)};stroke-width:.02}}",
        f".area-name{{font-family:sans-serif;font-weight:600;text-anchor:middle;dominant-baseline:central;"
        f"fill:{_css(ink.ink)};paint-order:stroke;stroke:{_css(ink.floor)};stroke-width:.06;stroke-linejoin:round}}",
    ]
    for i, colour in enumerate(ink.kind_colours(area.kind for area in world.areas).values()):
        tint = f"fill:{_css(colour)};fill-opacity:{ink.tint};stroke:{_css(colour)};stroke-width:.03"
        rules.append(f".plan .kind-{i}{{{tint}}}")
    return "".join(rules)


def _objects(world: World, tooltips: bool) -> list[str]:
    """Walls first, then things; a hole is a part of the same path."""
    parts = []
    for thing in sorted(world.drawn, key=lambda o: (not is_wall(o), o.box.size[2], o.name)):
        rings = "".join(f"M{_points(ring)}z" for ring in (thing.footprint, *thing.holes))
        kind = "wall" if is_wall(thing) else "thing leaf" if thing.kind == AUTOMATIC else "thing"
        title = f"<title>{html.escape(thing.name)}</title>" if tooltips else ""
        parts.append(f'<path class="{kind}" fill-rule="evenodd" d="{rings}">{title}</path>')
    return parts


def _cells(world: World) -> list[str]:
    """Return the free floor, and what the map shows occupied without an object standing there, as merged rectangles."""
    occupancy = world_map(world)
    frame = frame_of(occupancy)
    occupied = occupancy.cells == OCCUPIED
    if world.solids:
        from scipy.ndimage import binary_dilation

        occupied &= ~binary_dilation(solid_cells(world.solids, frame), np.ones((5, 5), bool))
    floor = (occupancy.cells == FREE) | ((occupancy.cells == OCCUPIED) & ~occupied)
    paths = []
    for kind, cells in (("floor", floor | occupied), ("wall", occupied)):
        rings = []
        for left, bottom, right, top in rectangles(cells):
            corners = frame.to_metres(np.array([[left, bottom], [right, bottom], [right, top], [left, top]], float))
            rings.append(f"M{_points(corners)}z")
        if rings:
            paths.append(f'<path class="{kind}" d="{"".join(rings)}"/>')
    return paths


def rectangles(cells: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """Rectangles (first column, first row, end column, end row) that cover exactly the true cells, without overlap."""
    found = []
    open_runs: dict[tuple[int, int], int] = {}  # run of columns -> row where it began
    for row in range(cells.shape[0] + 1):
        runs: set[tuple[int, int]] = set()
        if row < cells.shape[0]:
            edges = np.flatnonzero(np.diff(cells[row].astype(np.int8), prepend=0, append=0))
            runs = {(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)}
        ended = sorted(set(open_runs) - runs)
        found += [(left, open_runs.pop((left, right)), right, row) for left, right in ended]
        for run in runs:
            open_runs.setdefault(run, row)
    return found


def _points(ring: Iterable[Sequence[float]] | Floats) -> str:
    return " ".join(f"{_number(x)},{_number(y)}" for x, y in ring)


def _number(value: float) -> str:
    """To the millimetre, without needless zeros."""
    return f"{round(value, 3) + 0.0:.3f}".rstrip("0").rstrip(".")


def _css(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
