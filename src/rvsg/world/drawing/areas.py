"""The labelled areas of a floor plan: tinted, outlined and named."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rvsg.world.drawing.palette import LIGHT, Colour
from rvsg.world.drawing.placing import SMALLEST_TEXT, Word, place_beside, place_inside
from rvsg.world.drawing.sheet import Sheet
from rvsg.world.drawing.view import View
from rvsg.world.world import Area, World

Floats = NDArray[np.float64]

LARGEST_ON_PAGES = 17  # pixels: the size of text around it


def draw_areas(sheet: Sheet, areas: list[Area], kinds: dict[str, Colour]) -> None:
    """Tint every area in the colour of its kind and draw its outline."""
    for area in areas:
        ring = sheet.view.pixels(np.array(area.outline))
        sheet.tint(ring, kinds[area.kind], sheet.palette.tint)
        sheet.polygon(ring, fill=None, edge=kinds[area.kind], width=1.8)


def areas_in_sight(world: World, view: View) -> list[Area]:
    """Return the areas that lie at least partly in the window of the view."""
    x0, y0, x1, y1 = view.window
    found = []
    for area in world.areas:
        xs, ys = [p[0] for p in area.outline], [p[1] for p in area.outline]
        if max(xs) > x0 and min(xs) < x1 and max(ys) > y0 and min(ys) < y1:
            found.append(area)
    return found


def area_words(world: World, view: View) -> tuple[Word, ...]:
    """Return where the names of the areas stand on a plan of the view's size with nothing else on it."""
    sheet = Sheet(view, LIGHT)
    areas = areas_in_sight(world, view)
    kinds = LIGHT.kind_colours(area.kind for area in world.areas)
    write_areas(sheet, areas, kinds, largest=round(LARGEST_ON_PAGES / sheet.unit))
    return tuple(sheet.words)


def write_areas(sheet: Sheet, areas: list[Area], kinds: dict[str, Colour], *, largest: int) -> None:
    """Write the names of areas: inside if they fit, otherwise beside with a leader line."""
    rings = {area.name: _clipped(sheet.view.pixels(np.array(area.outline)), sheet.view) for area in areas}
    order = sorted(areas, key=lambda a: (np.ptp(rings[a.name], axis=0).prod(), a.name))  # small first
    left, top, right, bottom = sheet.view.plan
    page = (left + 2.0, top + 2.0, right - 2.0, bottom - 2.0)

    def sizes(first: int, last: int) -> list[int]:
        return [max(SMALLEST_TEXT, round(size * sheet.unit)) for size in range(first, last - 1, -2)]

    def beside(text: str, ring: Floats) -> Word | None:
        return place_beside(text, ring, sheet.taken, sizes(16, 14), page)

    def small(text: str, ring: Floats) -> Word | None:
        return place_inside(text, ring, sheet.taken, sizes(12, 12))

    def large(text: str, ring: Floats) -> Word | None:
        return place_inside(text, ring, sheet.taken, sizes(largest, 14))

    for place in (large, beside, small):
        missing = []
        for area in order:
            ring = rings[area.name]
            word = place(area.name, ring)
            if word is None:
                missing.append(area)
                continue
            if place is beside:
                middle = (ring.min(axis=0) + ring.max(axis=0)) / 2
                sheet.line(np.array([word.centre, middle]), kinds[area.kind], 1.0)
                sheet.dot(float(middle[0]), float(middle[1]), 3 * sheet.unit, fill=kinds[area.kind])
            _write_name(sheet, word, kinds[area.kind])
        order = missing
    if order:
        sheet.notes.append(f"no room for the names of {len(order)} areas: {', '.join(sorted(a.name for a in order))}")


def _clipped(ring: Floats, view: View) -> Floats:
    """The part of a polygon in pixels that lies on the plan: its largest piece, or the polygon where none does."""
    left, top, right, bottom = view.plan
    if (ring >= (left, top)).all() and (ring <= (right, bottom)).all():
        return ring
    from shapely import Polygon, box

    seen = Polygon(ring).buffer(0).intersection(box(left, top, right, bottom))
    pieces = [piece for piece in getattr(seen, "geoms", [seen]) if isinstance(piece, Polygon) and not piece.is_empty]
    return np.array(max(pieces, key=lambda piece: piece.area).exterior.coords) if pieces else ring


def _write_name(sheet: Sheet, word: Word, colour: Colour) -> None:
    dark = sheet.palette.tinted(sheet.palette.ink, colour, 0.35)
    sheet.write(word, dark, halo=sheet.palette.floor, bold=True)
