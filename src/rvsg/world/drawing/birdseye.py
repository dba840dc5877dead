"""The bird's-eye view of a world: objects with their heights, and named areas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rvsg.core.errors import InputError
from rvsg.world.drawing.layers import is_wall
from rvsg.world.drawing.sheet import (
    NARROWEST_PX,
    WIDEST_PX,
    Colour,
    Palette,
    Sheet,
    View,
    known_window,
    palette,
    place_beside,
    place_inside,
)
from rvsg.world.passages import line_of, sampled
from rvsg.world.space import frame_of, world_map
from rvsg.world.world import Area, Route, SolidObject, World

Floats = NDArray[np.float64]

AZIMUTH = math.radians(-16)
ELEVATION = math.radians(52)
LIGHT = np.array([-0.45, -0.35, 0.82])  # in the picture's frame: from the lower left and above


@dataclass(frozen=True)
class Oblique:
    """An orthographic view: the map's `up` axis leads away from the viewer, turned by AZIMUTH, seen at ELEVATION.

    `scale` pixels a metre; `left`, `top` pixels shift the world's origin onto the page.
    """

    up: Literal["x", "y"]
    scale: float = 1.0
    left: float = 0.0
    top: float = 0.0

    def turned(self, points: Floats) -> Floats:
        """World points or directions (..., 3) as (across, away, height), metres."""
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        right, away = (x, y) if self.up == "y" else (-y, x)
        c, s = math.cos(AZIMUTH), math.sin(AZIMUTH)
        return np.stack([c * right - s * away, s * right + c * away, z], axis=-1)

    def project(self, points: Floats) -> Floats:
        """World points (..., 3) as (across, down, nearness): pixels, pixels, metres (larger is nearer)."""
        across, away, height = np.moveaxis(self.turned(np.asarray(points, np.float64)), -1, 0)
        sin, cos = math.sin(ELEVATION), math.cos(ELEVATION)
        down = -(away * sin + height * cos)
        return np.stack(
            [self.left + across * self.scale, self.top + down * self.scale, height * sin - away * cos], axis=-1
        )

    def floor_at(self, pixels: Floats) -> Floats:
        """Return the floor points (..., 2) that lie under page pixels (..., 2)."""
        across = (pixels[..., 0] - self.left) / self.scale
        away = -(pixels[..., 1] - self.top) / self.scale / math.sin(ELEVATION)
        c, s = math.cos(AZIMUTH), math.sin(AZIMUTH)
        right, far = c * across + s * away, c * away - s * across
        return np.stack([right, far] if self.up == "y" else [far, -right], axis=-1)

    def fitted(self, points: Floats, width: int, margins: tuple[int, int, int, int]) -> tuple[Oblique, int]:
        """The view in which the points (N, 3) fill a page of this width within margins (left, top, right, bottom),
        and the height of that page; at most 1.2 times as high as wide."""
        seen = Oblique(self.up).project(points)
        low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
        left, top, right, bottom = margins
        wide, tall = (high - low).clip(1e-6)
        scale = min((width - left - right) / wide, (1.2 * width - top - bottom) / tall)
        shift = (width - left - right - wide * scale) / 2
        view = Oblique(self.up, float(scale), float(left + shift - low[0] * scale), float(top - low[1] * scale))
        return view, round(float(tall * scale)) + top + bottom


class Canvas:
    """A page of pixels with a depth buffer: faces in front hide those behind."""

    def __init__(self, view: Oblique, pixels: NDArray[np.uint8]) -> None:
        self.view = view
        self.pixels = pixels
        rows, columns = pixels.shape[:2]
        down = (np.arange(rows) + 0.5 - view.top) / view.scale
        nearness = down / math.tan(ELEVATION)  # of the floor: -away * cos, away = -down / sin
        self.nearest = np.repeat(nearness[:, None], columns, axis=1)

    def face(
        self,
        corners: Floats,
        colour: Colour,
        *,
        edge: Colour | None = None,
        holes: Sequence[Floats] = (),
        wide: int = 2,
    ) -> None:
        """Draw a flat polygon (N, 3) in world metres, with its outline inside it."""
        seen = self.view.project(corners)
        plane = _plane(seen)
        if plane is None:
            return
        x0, y0 = np.floor(seen[:, :2].min(axis=0)).astype(int) - 1
        x1, y1 = np.ceil(seen[:, :2].max(axis=0)).astype(int) + 2
        rows, columns = self.nearest.shape
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, columns), min(y1, rows)
        if x1 <= x0 or y1 <= y0:
            return
        mask = Image.new("L", (x1 - x0, y1 - y0))
        draw = ImageDraw.Draw(mask)
        draw.polygon(_shifted(seen, x0, y0), fill=1)
        rings = [seen, *(self.view.project(hole) for hole in holes)]
        for ring in rings[1:]:
            draw.polygon(_shifted(ring, x0, y0), fill=0)
        if edge is not None:
            for ring in rings:
                points = _shifted(ring, x0, y0)
                draw.line([*points, points[0]], fill=2, width=wide)
        chosen = np.asarray(mask)
        a, b, c = plane
        near = a * (np.arange(x0, x1) + 0.5)[None, :] + b * (np.arange(y0, y1) + 0.5)[:, None] + c
        window = self.nearest[y0:y1, x0:x1]
        # An outline lies slightly nearer than its face, so that neighbouring faces do not hide half of it.
        shown = (chosen > 0) & (near + np.where(chosen == 2, 0.02, 0.0) > window + 1e-6)
        window[shown] = near[shown]
        target = self.pixels[y0:y1, x0:x1]
        target[shown & (chosen == 1)] = colour
        target[shown & (chosen == 2)] = edge or colour


def _shifted(points: Floats, x0: int, y0: int) -> list[tuple[float, float]]:
    return [(float(x) - x0, float(y) - y0) for x, y in points[:, :2]]


def _plane(seen: Floats) -> tuple[float, float, float] | None:
    """Return the depth as an affine function of the pixel; None for a face seen edge on."""
    middle = seen.mean(axis=0)
    rest = seen - middle
    across, down = rest[:, 0], rest[:, 1]
    area = float(np.abs(across[:-1] * down[1:] - across[1:] * down[:-1]).max(initial=0.0))
    if area < 0.5:
        return None
    (a, b), *_ = np.linalg.lstsq(rest[:, :2], rest[:, 2], rcond=None)
    return float(a), float(b), float(middle[2] - a * middle[0] - b * middle[1])


def shade(colour: Colour, normal: Floats) -> Colour:
    """Return the colour of a face by its angle to the light; `normal` (3,) in the picture's frame."""
    light = float(np.dot(normal, LIGHT) / (np.linalg.norm(normal) * np.linalg.norm(LIGHT)))
    factor = 0.62 + 0.42 * max(light, 0.0)
    r, g, b = (min(255, round(channel * factor)) for channel in colour)
    return (r, g, b)


WALL_CUT_M = 0.8
TALLEST_M = 3.0
MAP_HEIGHT_M = 0.8  # drawn height of the obstacles of a map without objects
FINE = 2


def birdseye(
    world: World, *, width_px: int = 1600, colours: str | Palette = "light", route: Route | None = None
) -> Image.Image:
    """Return an oblique view of the world from above; the same world gives the same picture.

    Walls are cut at 0.8 m to show the rooms. Objects higher than 3 m are drawn 3 m high. The obstacles of a map without
    objects, whose heights are unknown, are drawn 0.8 m high. Up on the floor plan is away from the viewer.

    Args:
        width_px: The width of the picture, about.
        route: A route to draw.
    """
    if not NARROWEST_PX <= width_px <= WIDEST_PX:
        raise InputError(
            f"a picture is {NARROWEST_PX} to {WIDEST_PX} pixels wide; {width_px} were asked for", code="picture-width"
        )
    ink = palette(colours)
    unit = width_px / 1600
    margins = (round(20 * unit), round(56 * unit), round(20 * unit), round(24 * unit))
    x0, y0, x1, y1 = known_window(world, 0.3)
    corners = np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (0.0, WALL_CUT_M)])
    tops = [(*point, _top(thing)) for thing in world.drawn for point in thing.footprint]
    points = np.concatenate([corners, np.array(tops).reshape(-1, 3)])
    view, height = Oblique(world.grid.up).fitted(points, width_px, margins)
    fine = Oblique(view.up, view.scale * FINE, view.left * FINE, view.top * FINE)
    pixels, solid = _floor(world, ink, fine, width_px * FINE, height * FINE)
    kinds = ink.kind_colours(area.kind for area in world.areas)
    _tint_areas(pixels, world, fine, ink, kinds)
    canvas = Canvas(fine, pixels)
    if world.solids:
        for thing in world.drawn:
            _draw_object(canvas, thing, ink, _colour_of(thing, world.areas, kinds, ink))
    else:
        _raise_map(pixels, solid, ink, fine)
    page = Image.fromarray(pixels).reduce(FINE)
    return _written(page, world, view, canvas, ink, kinds, route, unit)


def _top(thing: SolidObject) -> float:
    top = thing.box.center[2] + thing.box.size[2] / 2
    return min(top, WALL_CUT_M if is_wall(thing) else TALLEST_M)


def _floor(
    world: World, ink: Palette, view: Oblique, width: int, height: int
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """The floor of the map under every pixel (page colour outside, floor where free), and where it is occupied."""
    occupancy = world_map(world)
    frame = frame_of(occupancy)
    rows, columns = frame.shape
    colours = np.array([ink.page, ink.outside, ink.floor, ink.tinted(ink.wall, share=0.35)], np.uint8)
    kind = np.full((rows, columns), 1, np.uint8)
    kind[occupancy.cells == 0] = 2
    kind[occupancy.cells == 100] = 2 if world.solids else 3
    x0, y0, x1, y1 = known_window(world, 0.3)
    bands = []
    solid = []
    for first in range(0, height, 256):
        down = np.arange(first, min(first + 256, height)) + 0.5
        metres = view.floor_at(np.stack(np.meshgrid(np.arange(width) + 0.5, down), axis=-1))
        cells = np.floor(frame.to_cells(metres)).astype(np.int32)
        inside = (cells[..., 0] >= 0) & (cells[..., 0] < columns) & (cells[..., 1] >= 0) & (cells[..., 1] < rows)
        shown = (metres[..., 0] > x0) & (metres[..., 0] < x1) & (metres[..., 1] > y0) & (metres[..., 1] < y1)
        found = kind[np.clip(cells[..., 1], 0, rows - 1), np.clip(cells[..., 0], 0, columns - 1)]
        bands.append(colours[np.where(shown, np.where(inside, found, 1), 0)])
        solid.append(shown & inside & (found == 3))
    return np.concatenate(bands), np.concatenate(solid)


def _tint_areas(pixels: NDArray[np.uint8], world: World, view: Oblique, ink: Palette, kinds: dict[str, Colour]) -> None:
    """Tint the floor of every area and draw its border."""
    from PIL import ImageDraw

    image = Image.fromarray(pixels)
    for area in world.areas:
        ring = view.project(_raised(area.outline, 0.0))[:, :2]
        corners = [(float(x), float(y)) for x, y in ring]
        left, top = np.floor(ring.min(axis=0)).astype(int).clip(0)
        right, bottom = np.ceil(ring.max(axis=0)).astype(int) + 1
        mask = Image.new("L", (max(1, int(right - left)), max(1, int(bottom - top))))
        shifted = [(x - left, y - top) for x, y in corners]
        ImageDraw.Draw(mask).polygon(shifted, fill=round(255 * ink.tint * 1.3))
        image.paste(kinds[area.kind], (int(left), int(top)), mask)
        ImageDraw.Draw(image).line([*corners, corners[0]], fill=kinds[area.kind], width=3)
    pixels[:] = np.asarray(image)


def _raised(outline: Sequence[tuple[float, float]], z: float) -> Floats:
    return np.array([(x, y, z) for x, y in outline], np.float64)


def _colour_of(thing: SolidObject, areas: Sequence[Area], kinds: dict[str, Colour], ink: Palette) -> Colour:
    """Things in a labelled area wear a pale form of its colour, as on the labelled map."""
    from shapely import Point, Polygon

    if is_wall(thing):
        return ink.tinted(ink.wall, share=0.45)
    middle = Point(thing.box.center[0], thing.box.center[1])
    holding = [a for a in areas if Polygon(a.outline).buffer(0.05).covers(middle)]
    if not holding:
        return ink.thing
    smallest = min(holding, key=lambda a: (float(Polygon(a.outline).area), a.name))
    return ink.tinted(kinds[smallest.kind], ink.thing, 0.38)


def _draw_object(canvas: Canvas, thing: SolidObject, ink: Palette, colour: Colour) -> None:
    """The prism over a footprint: the sides that look towards the viewer and the top."""
    bottom = max(thing.box.center[2] - thing.box.size[2] / 2, 0.0)
    top = _top(thing)
    if top <= bottom:
        return
    edge = ink.tinted(ink.ink, colour, 0.55)
    rings = [np.array(thing.footprint), *(np.array(hole) for hole in thing.holes)]
    for number, ring in enumerate(rings):
        ring = _anticlockwise(ring) if number == 0 else _anticlockwise(ring)[::-1]
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            side = np.array([(*a, bottom), (*b, bottom), (*b, top), (*a, top)])
            outwards = canvas.view.turned(np.array([b[1] - a[1], a[0] - b[0], 0.0]))
            if outwards[1] < 0.0:
                canvas.face(side, shade(colour, outwards), edge=edge if len(ring) <= 12 else None)
    lid = [_raised([(float(x), float(y)) for x, y in ring], top) for ring in rings]
    canvas.face(lid[0], shade(colour, np.array([0.0, 0.0, 1.0])), edge=edge, holes=lid[1:])


def _anticlockwise(ring: Floats) -> Floats:
    x, y = ring[:, 0], ring[:, 1]
    return ring if float(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y)) > 0 else ring[::-1]


def _raise_map(pixels: NDArray[np.uint8], solid: NDArray[np.bool_], ink: Palette, view: Oblique) -> None:
    """Raise the floor where it is solid: what is higher at a pixel is nearer to the viewer, so layers go on bottom up.

    A run of layers in one colour is drawn in steps that double, each shifting what is there already.
    """
    lift = max(2, round(float(view.project(np.zeros(3))[1] - view.project(np.array([0.0, 0.0, MAP_HEIGHT_M]))[1])))
    body = solid.copy()
    done = 1
    while done < lift:
        step = min(done, lift - done)
        body[:-step] |= body[step:]
        done += step
    pixels[body] = ink.tinted(ink.wall, share=0.75)
    pixels[:-lift][solid[lift:]] = ink.tinted(ink.wall, share=0.5)


def _written(
    page: Image.Image,
    world: World,
    view: Oblique,
    canvas: Canvas,
    ink: Palette,
    kinds: dict[str, Colour],
    route: Route | None,
    unit: float,
) -> Image.Image:
    """Return the page with title, names of areas, the route and a line that says how to read it."""
    width, height = page.size
    sheet = Sheet(View((0.0, 0.0, 1.0, 1.0), "y", 1.0, 0, 0, width, height), ink)
    sheet.paste(np.asarray(page.resize((width * 2, height * 2), Image.Resampling.NEAREST)), 0, 0)
    if route is not None:
        _draw_route(sheet, canvas, line_of(world, route), ink)
        for word, pose, colour in (("START", route.start, ink.start), ("GOAL", route.goal, ink.goal)):
            x, y, _ = view.project(np.array([pose.x, pose.y, 0.02]))
            sheet.dot(float(x), float(y), 9 * unit, fill=colour, edge=ink.page)
            sheet.taken.add_dot(float(x), float(y), 11 * unit)
            sheet.write_at(word, float(x), float(y) + 22 * unit, round(18 * unit), colour, bold=True)
    sheet.write_at(f"{world.title} from above", 20 * unit, 28 * unit, round(26 * unit), ink.ink, anchor="l", bold=True)
    _write_areas(sheet, world, view, kinds, unit)
    said = (
        f"Seen from below the floor plan, slightly from the right. Walls are cut at {WALL_CUT_M:g} m; what is higher "
        f"than {TALLEST_M:g} m is drawn {TALLEST_M:g} m high."
        if world.solids
        else f"Obstacles of the map are drawn {MAP_HEIGHT_M:g} m high: their true heights are not known."
    )
    if route is not None and world.solids:
        said += " The route is dashed where things hide it."
    sheet.write_at(said, 20 * unit, height + 4 * unit, round(17 * unit), ink.faint_ink, anchor="l")
    return sheet.finished(height + 24 * unit)


def _draw_route(sheet: Sheet, canvas: Canvas, line: Floats, ink: Palette) -> None:
    """The way on the floor; where things hide it, thin and dashed."""
    way = sampled(line, 0.15)
    seen = canvas.view.project(np.column_stack([way, np.full(len(way), 0.02)]))
    rows, columns = canvas.nearest.shape
    across, down = seen[:, 0].astype(int).clip(0, columns - 1), seen[:, 1].astype(int).clip(0, rows - 1)
    visible = seen[:, 2] + 0.05 >= canvas.nearest[down, across]
    points = seen[:, :2] / FINE
    for i in range(len(points) - 1):
        if visible[i] and visible[i + 1]:
            sheet.line(points[i : i + 2], ink.route, 4.0)
        elif i % 2:
            sheet.line(points[i : i + 2], ink.route, 1.5)
    sheet.taken.add_line(points[:: max(1, len(points) // 60)], 3.0)


def _write_areas(sheet: Sheet, world: World, view: Oblique, kinds: dict[str, Colour], unit: float) -> None:
    """Every area's name on top of what stands in it, else beside it with a line."""
    sizes = [max(9, round(size * unit)) for size in (24, 21, 18, 16, 14, 12)]
    page = (4.0, 50.0 * unit, float(sheet.view.width - 4), float(sheet.view.height - 4))
    rings = {area.name: view.project(_raised(area.outline, _height_in(area, world)))[:, :2] for area in world.areas}
    beside = []
    for area in sorted(world.areas, key=lambda a: (np.ptp(rings[a.name], axis=0).prod(), a.name)):
        word = place_inside(area.name, rings[area.name], sheet.taken, sizes)
        if word is None:
            beside.append(area)
            continue
        sheet.write(
            word, sheet.palette.tinted(sheet.palette.ink, kinds[area.kind], 0.45), halo=sheet.palette.floor, bold=True
        )
    for area in beside:
        word = place_beside(area.name, rings[area.name], sheet.taken, sizes[2:], page)
        if word is not None:
            middle = rings[area.name].mean(axis=0)
            sheet.line(np.array([word.centre, middle]), kinds[area.kind], 1.2)
            dark = sheet.palette.tinted(sheet.palette.ink, kinds[area.kind], 0.45)
            sheet.write(word, dark, halo=sheet.palette.floor, bold=True)


def _height_in(area: Area, world: World) -> float:
    """Return how high the things in an area are as drawn; 0 for open floor."""
    from shapely import Point, Polygon

    shape = Polygon(area.outline).buffer(0.05)
    inside = [t for t in world.solids if not is_wall(t) and shape.covers(Point(t.box.center[0], t.box.center[1]))]
    if not inside:
        things = [t for t in world.solids if not is_wall(t)]
        around = [t for t in things if Polygon(t.footprint).buffer(0.1).covers(Polygon(area.outline))]
        return max((_top(t) for t in around), default=0.0)
    return max(_top(t) for t in inside)
