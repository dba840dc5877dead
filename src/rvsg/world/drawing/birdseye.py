"""The bird's-eye view of a world: objects with their heights, and named areas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rvsg.world.drawing.layers import is_wall
from rvsg.world.drawing.sheet import (
    FINE,
    Colour,
    PageView,
    Palette,
    Sheet,
    check_width,
    known_window,
    palette,
    place_beside,
    place_inside,
)
from rvsg.world.passages import line_of
from rvsg.world.space import Bools, frame_of, world_map
from rvsg.world.world import FREE, OCCUPIED, Area, Route, SolidObject, World

Floats = NDArray[np.float64]

AZIMUTH, ELEVATION = math.radians(-16), math.radians(52)
SUN = np.array([-0.45, -0.35, 0.82])  # (across, away, up): from the lower left and above
WALL_CUT_M = 0.8
TALLEST_M = 3.0
MAP_HEIGHT_M = 0.8  # drawn height of the obstacles of a map without objects
TALLEST_PAGE = 1.2  # times its width


def birdseye(
    world: World, *, width_px: int = 1600, colours: str | Palette = "light", route: Route | None = None
) -> Image.Image:
    """Return an oblique view of the world from above, about `width_px` wide; the same world gives the same picture.

    Walls are cut at 0.8 m to show the rooms, objects higher than 3 m are drawn 3 m high, and the obstacles of a map
    without objects 0.8 m high. Up on the floor plan is away from the viewer.
    """
    import shapely

    check_width(width_px)
    scene = _Scene(world, palette(colours), width_px)
    scene.draw_floor()
    way = None
    if route is not None:
        line = shapely.segmentize(shapely.LineString(line_of(world, route)), 0.15)
        way = scene.pixels(shapely.get_coordinates(line))
    if way is not None:
        scene.sheet.line(way, scene.ink.route, 4.0)
    scene.draw_objects()
    if route is not None and way is not None:
        scene.draw_route(route, way)
    return scene.written(dashed=route is not None and bool(world.solids))


class _Scene:
    """A page with a world seen obliquely: a point (x, y, z) in metres lies at `matrix @ point + shift` pixels.

    The map's `up` axis leads away from the viewer, turned by AZIMUTH, seen at ELEVATION. What is higher at a pixel is
    nearer to the viewer, so everything is drawn in layers from the floor up.
    """

    def __init__(self, world: World, ink: Palette, width: int) -> None:
        self.world, self.ink, self.unit = world, ink, width / 1600
        c, s = math.cos(AZIMUTH), math.sin(AZIMUTH)
        right_far = np.array([[1, 0, 0], [0, 1, 0]] if world.grid.up == "y" else [[0, -1, 0], [1, 0, 0]])
        self.turn = np.vstack([np.array([[c, -s], [s, c]]) @ right_far, [0, 0, 1]])  # to across, away and up
        seen = np.array([[1.0, 0.0, 0.0], [0.0, -math.sin(ELEVATION), -math.cos(ELEVATION)]]) @ self.turn
        x0, y0, x1, y1 = known_window(world, 0.3)
        self.window = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        tops = [(*point, _top(thing)) for thing in world.drawn for point in thing.footprint]
        points = np.array(tops + [(*corner, z) for corner in self.window for z in (0.0, WALL_CUT_M)]) @ seen.T
        low, (wide, tall) = points.min(axis=0), np.ptp(points, axis=0).clip(1e-6)
        side, top, bottom = (round(margin * self.unit) for margin in (20, 56, 24))
        scale = min((width - 2 * side) / wide, (TALLEST_PAGE * width - top - bottom) / tall)
        self.matrix = scale * seen
        self.shift = np.array([(width - wide * scale) / 2, top]) - low * scale
        height = round(float(tall * scale)) + top + bottom
        self.sheet = Sheet(PageView((0.0, 0.0, 1.0, 1.0), "y", 1.0, 0, 0, width, height), ink)
        self.kinds = ink.kind_colours(area.kind for area in world.areas)

    def pixels(self, points: Floats | Sequence[tuple[float, float]], z: float = 0.0) -> Floats:
        """Return where points (N, 2) in metres at a height lie on the page."""
        return np.asarray(np.asarray(points) @ self.matrix[:, :2].T + z * self.matrix[:, 2] + self.shift)

    def draw_floor(self) -> None:
        """Draw the map and tint the areas; raise the obstacles of a map without objects."""
        cells = world_map(self.world).cells
        bare = not self.world.solids
        self.sheet.polygon(self.pixels(self.window), fill=self.ink.outside)
        self.sheet.stamp(self._on_page((cells == FREE) | (cells == OCCUPIED) & (not bare)), self.ink.floor)
        for area in self.world.areas:
            ring = self.pixels(area.outline)
            self.sheet.tint(ring, self.kinds[area.kind], 1.3 * self.ink.tint)
            self.sheet.polygon(ring, fill=None, edge=self.kinds[area.kind], width=1.5)
        if bare:
            solid = self._on_page(cells == OCCUPIED)
            lift = max(2, round(-FINE * MAP_HEIGHT_M * self.matrix[1, 2]))
            body, done = solid.copy(), 1
            while done < lift:  # steps that double, each shifting what is there already
                step = min(done, lift - done)
                body[:-step] |= body[step:]
                done += step
            self.sheet.stamp(body, self.ink.tinted(self.ink.wall, share=0.75))
            self.sheet.stamp(np.roll(solid, -lift, axis=0), self.ink.tinted(self.ink.wall, share=0.5))

    def _on_page(self, cells: Bools) -> Bools:
        """Return cells of the map as pixels of the fine page."""
        size = (self.sheet.view.width * FINE, self.sheet.view.height * FINE)
        corners = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]) / FINE
        metres = (corners - self.shift) @ np.linalg.inv(self.matrix[:, :2]).T
        origin, across, down = frame_of(world_map(self.world)).to_cells(metres)
        affine = np.column_stack([across - origin, down - origin, origin]).ravel().tolist()
        return np.array(Image.fromarray(cells.astype(np.uint8)).transform(size, Image.Transform.AFFINE, affine), bool)

    def draw_objects(self) -> None:
        """Draw the prism over every footprint, all of them in layers one pixel high."""
        layer_m = -1.0 / self.matrix[1, 2]
        prisms = []
        for thing in self.world.drawn if self.world.solids else ():
            bottom = max(thing.box.center[2] - thing.box.size[2] / 2, 0.0)
            if _top(thing) > bottom:
                levels = range(round(bottom / layer_m), max(round(_top(thing) / layer_m), 1))
                colour = self._colour_of(thing)
                prisms.append((levels, self._sides(thing, colour), colour, thing))
        for level in range(max((prism[0].stop for prism in prisms), default=-1) + 1):
            for levels, sides, colour, thing in prisms:
                edge = self.ink.tinted(self.ink.ink, colour, 0.55)
                if level in levels:
                    for side, shade, outlined in sides:
                        low, high = (self.pixels(side, z * layer_m) for z in (level, level + 1))
                        self.sheet.polygon(np.vstack([low, high[::-1]]), fill=shade)
                        for line in (*zip(low, high, strict=True), low)[: 3 if level == levels.start else 2]:
                            if outlined:
                                self.sheet.line(np.array(line), edge, 1.0)
                elif level == levels.stop:
                    rings = [self.pixels(ring, level * layer_m) for ring in (thing.footprint, *thing.holes)]
                    self.sheet.holed(rings[0], rings[1:], _shade(colour, np.array([0.0, 0.0, 1.0])))
                    for ring in rings:
                        self.sheet.polygon(ring, fill=None, edge=edge, width=1.0)

    def _sides(self, thing: SolidObject, colour: Colour) -> list[tuple[Floats, Colour, bool]]:
        """Return the sides of a prism that look towards the viewer: ends (2, 2) in metres, colour, whether outlined."""
        from shapely import Polygon, get_coordinates, get_rings, orient_polygons

        marks = []
        for ring in get_rings(orient_polygons(Polygon(thing.footprint, thing.holes))):
            corners = get_coordinates(ring)
            for a, b in pairwise(corners):
                outwards = self.turn @ np.array([b[1] - a[1], a[0] - b[0], 0.0])
                if outwards[1] < 0.0:
                    marks.append((np.array([a, b]), _shade(colour, outwards), len(corners) <= 13))
        return marks

    def _colour_of(self, thing: SolidObject) -> Colour:
        """Return a pale form of the colour of the area that a thing stands in, as on the labelled map."""
        from shapely import Point, Polygon

        if is_wall(thing):
            return self.ink.tinted(self.ink.wall, share=0.45)
        middle = Point(thing.box.center[:2])
        holding = [area for area in self.world.areas if Polygon(area.outline).buffer(0.05).covers(middle)]
        if not holding:
            return self.ink.thing
        smallest = min(holding, key=lambda area: (Polygon(area.outline).area, area.name))
        return self.ink.tinted(self.kinds[smallest.kind], self.ink.thing, 0.38)

    def draw_route(self, route: Route, way: Floats) -> None:
        """Draw a way (N, 2) in pixels thin and dashed, which shows where things hide it, and its ends."""
        for i in range(1, len(way) - 1, 2):
            self.sheet.line(way[i : i + 2], self.ink.route, 1.5)
        self.sheet.taken.add_line(way[:: max(1, len(way) // 60)], 3.0)
        for word, pose, colour in (("START", route.start, self.ink.start), ("GOAL", route.goal, self.ink.goal)):
            ((x, y),) = self.pixels([(pose.x, pose.y)]).tolist()
            self.sheet.dot(x, y, 9 * self.unit, fill=colour, edge=self.ink.page)
            self.sheet.taken.add_dot(x, y, 11 * self.unit)
            self.sheet.write_at(word, x, y + 22 * self.unit, round(18 * self.unit), colour, bold=True)

    def written(self, *, dashed: bool) -> Image.Image:
        """Return the page with the title, the names of the areas and a line that says how to read it."""
        sheet, unit, ink = self.sheet, self.unit, self.ink
        left, below = 20 * unit, sheet.view.height + 4 * unit
        title = f"{self.world.title} from above"
        sheet.write_at(title, left, 28 * unit, round(26 * unit), ink.ink, anchor="l", bold=True)
        self._write_areas()
        said = (
            f"Seen from below the floor plan, slightly from the right. Walls are cut at {WALL_CUT_M:g} m; what is "
            f"higher than {TALLEST_M:g} m is drawn {TALLEST_M:g} m high."
            if self.world.solids
            else f"Obstacles of the map are drawn {MAP_HEIGHT_M:g} m high: their true heights are not known."
        )
        said += " The route is dashed where things hide it." if dashed else ""
        sheet.write_at(said, left, below, round(17 * unit), ink.faint_ink, anchor="l")
        return sheet.finished(sheet.view.height + 24 * unit)

    def _write_areas(self) -> None:
        """Write every area's name on top of what stands in it, else beside it with a line."""
        sheet = self.sheet
        sizes = [max(9, round(size * self.unit)) for size in (24, 21, 18, 16, 14, 12)]
        page = (4.0, 50.0 * self.unit, float(sheet.view.width - 4), float(sheet.view.height - 4))
        rings = {area.name: self.pixels(area.outline, _height_in(area, self.world)) for area in self.world.areas}
        waiting = sorted(self.world.areas, key=lambda a: (np.ptp(rings[a.name], axis=0).prod(), a.name))
        for inside in (True, False):
            missing = []
            for area in waiting:
                ring, colour = rings[area.name], self.kinds[area.kind]
                word = (
                    place_inside(area.name, ring, sheet.taken, sizes)
                    if inside
                    else place_beside(area.name, ring, sheet.taken, sizes[2:], page)
                )
                if word is None:
                    missing.append(area)
                    continue
                if not inside:
                    sheet.line(np.array([word.centre, ring.mean(axis=0)]), colour, 1.2)
                sheet.write(word, self.ink.tinted(self.ink.ink, colour, 0.45), halo=self.ink.floor, bold=True)
            waiting = missing


def _top(thing: SolidObject) -> float:
    top = thing.box.center[2] + thing.box.size[2] / 2
    return min(top, WALL_CUT_M if is_wall(thing) else TALLEST_M)


def _shade(colour: Colour, normal: Floats) -> Colour:
    """Return the colour of a face by the angle of its normal (across, away, up) to the light."""
    light = float(np.dot(normal, SUN) / (np.linalg.norm(normal) * np.linalg.norm(SUN)))
    r, g, b = (min(255, round(channel * (0.62 + 0.42 * max(light, 0.0)))) for channel in colour)
    return (r, g, b)


def _height_in(area: Area, world: World) -> float:
    """Return how high the things in an area are as drawn, else those that it stands on; 0 for open floor."""
    from shapely import Point, Polygon

    shape = Polygon(area.outline)
    things = [thing for thing in world.solids if not is_wall(thing)]
    tops = [_top(t) for t in things if shape.buffer(0.05).covers(Point(t.box.center[:2]))]
    return max(tops or [_top(t) for t in things if Polygon(t.footprint).buffer(0.1).covers(shape)], default=0.0)
