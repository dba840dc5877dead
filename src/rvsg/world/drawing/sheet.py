"""A page to draw on: shapes are drawn at twice the size for smooth edges, text at the end at the true size."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cache
from itertools import pairwise
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rvsg.core.errors import InputError, UnknownName
from rvsg.world.space import frame_of, outermost, world_map
from rvsg.world.world import UNKNOWN, World

Colour = tuple[int, int, int]


@dataclass(frozen=True)
class Palette:
    """Colours as (red, green, blue), 0 to 255. Kinds of areas get the colours of `kinds` in order of appearance."""

    page: Colour
    outside: Colour
    floor: Colour
    wall: Colour
    thing: Colour
    thing_edge: Colour
    ink: Colour
    faint_ink: Colour
    guide: Colour
    dot: Colour
    route: Colour
    start: Colour
    goal: Colour
    kinds: tuple[Colour, ...]
    tint: float

    def kind_colours(self, kinds: Iterable[str]) -> dict[str, Colour]:
        """Return a colour for every kind; equal kinds in equal order get equal colours."""
        colours: dict[str, Colour] = {}
        for kind in kinds:
            colours.setdefault(kind, self.kinds[len(colours) % len(self.kinds)])
        return colours

    def tinted(self, colour: Colour, ground: Colour | None = None, share: float | None = None) -> Colour:
        """Return the colour of the floor (or of `ground`) mixed with a share (the palette's `tint`) of a colour."""
        below = ground or self.floor
        part = self.tint if share is None else share
        r, g, b = (round(low + part * (high - low)) for low, high in zip(below, colour, strict=True))
        return (r, g, b)


def _palette(colours: str, kinds: str, tint: float) -> Palette:
    """Return the palette of colours in hexadecimal digits, in the order of the fields."""
    by_colour, of_kinds = ([(*bytes.fromhex(code),) for code in text.split()] for text in (colours, kinds))
    named: dict[str, Any] = dict(zip((field.name for field in fields(Palette)), by_colour, strict=False))
    return Palette(**named, kinds=cast(tuple[Colour, ...], tuple(of_kinds)), tint=tint)


LIGHT = _palette(
    "ffffff e2e5ea ffffff 343a46 ddd7cc 8e8474 181c24 68707c dee2e8 1e293b dc2626 15803d dc2626",
    kinds="2563eb c2580c 0d806e 7e22ce be185d 4d7c0f 784818 0369a1 52526e",
    tint=0.16,
)
GREY = _palette(
    "ffffff d6d6d6 ffffff 1e1e1e cdcdcd 6e6e6e 000000 5a5a5a e2e2e2 000000 000000 000000 000000",
    kinds="3c3c3c",
    tint=0.08,
)
DARK = _palette(
    "161b22 0d1117 212832 bec6d2 464e5a 788291 ecf0f6 a0aab6 323a46 e2e8f0 ff6b6b 4ade80 ff6b6b",
    kinds="60a5fa fb923c 2dd4bf c084fc f472b6 a3e635 d9a066 38bdf8 b0b0d2",
    tint=0.22,
)
PALETTES = {"light": LIGHT, "grey": GREY, "dark": DARK}


def palette(name: str | Palette) -> Palette:
    """Return the palette of that name, or UnknownName."""
    if isinstance(name, Palette):
        return name
    if name not in PALETTES:
        raise UnknownName("palette", name, PALETTES)
    return PALETTES[name]


Floats = NDArray[np.float64]
Box = tuple[float, float, float, float]

WORTH_TURNING = 0.65  # turn a label if the horizontal text would be smaller than this share of the turned text
MOST_STEPS = 1000
SPOTS = 41  # places tried along each side of a polygon
SMALLEST_TEXT = 10  # pixels; smaller cannot be read


@cache
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return Pillow's default font at a size in pixels."""
    return ImageFont.load_default(size)


@dataclass(frozen=True)
class Word:
    """A label on the page: `box` is left, top, right, bottom in pixels; turned text reads upwards."""

    text: str
    box: Box
    size: int
    turned: bool = False

    @property
    def centre(self) -> tuple[float, float]:
        """The middle of the box."""
        return ((self.box[0] + self.box[2]) / 2, (self.box[1] + self.box[3]) / 2)


def text_size(text: str, size: int) -> tuple[int, int]:
    """Return width and height in pixels of a text of one or more lines."""
    lines = text.split("\n")
    width = max(font(size).getlength(line) for line in lines)
    return (int(np.ceil(width)), round(len(lines) * size * 1.14))


class Taken:
    """The rectangles of the page that labels must not cover."""

    def __init__(self) -> None:
        self._boxes = np.empty((64, 4))
        self._count = 0

    def add(self, box: Box) -> None:
        """Add a rectangle."""
        if self._count == len(self._boxes):
            self._boxes = np.concatenate([self._boxes, np.empty_like(self._boxes)])
        self._boxes[self._count] = box
        self._count += 1

    def add_dot(self, x: float, y: float, radius: float) -> None:
        """Add the square around a dot."""
        self.add((x - radius, y - radius, x + radius, y + radius))

    def add_line(self, points: Floats, half_width: float) -> None:
        """Add a band around the line through points (n, 2)."""
        for a, b in pairwise(points):
            count = min(MOST_STEPS, max(1, int(np.hypot(*(b - a)) / 10.0)))  # a line may extend far beyond the page
            for share in np.linspace(0.0, 1.0, count + 1):
                x, y = a + (b - a) * share
                self.add_dot(x, y, half_width)

    def free(self, box: Box, gap: float = 2.0) -> bool:
        """Return whether a rectangle, with a gap in pixels around it, covers none of them."""
        return bool(self.which_free(np.array([box]), gap)[0])

    def which_free(self, boxes: Floats, gap: float = 2.0) -> NDArray[np.bool_]:
        """Return which of the rectangles (n, 4) cover nothing that is taken, with a gap in pixels around them; (n,)."""
        taken = self._boxes[: self._count]
        low, high = boxes[:, :2].min(axis=0) - gap, boxes[:, 2:].max(axis=0) + gap
        taken = taken[((taken[:, :2] < high) & (taken[:, 2:] > low)).all(axis=1)]
        left, top, right, bottom = (boxes[:, i, None] for i in range(4))
        covered = (taken[:, 0] < right + gap) & (taken[:, 2] > left - gap)
        covered &= (taken[:, 1] < bottom + gap) & (taken[:, 3] > top - gap)
        return np.asarray(~covered.any(axis=1))


def wrapped(text: str) -> Iterator[str]:
    """Yield a name on one line, then on two lines of about equal length, then one word a line."""
    yield text
    words = text.split()
    if len(words) > 2:
        cuts = range(1, len(words))
        best = min(cuts, key=lambda c: max(len(" ".join(words[:c])), len(" ".join(words[c:]))))
        yield " ".join(words[:best]) + "\n" + " ".join(words[best:])
    if len(words) > 1:
        yield "\n".join(words)


def place_inside(text: str, ring: Floats, taken: Taken, sizes: Sequence[int]) -> Word | None:
    """Return the largest readable place of a name inside a polygon (n, 2) in pixels that covers nothing, or None."""
    import shapely

    shape = shapely.Polygon(ring).buffer(0)
    shapely.prepare(shape)
    at = shape.centroid if shape.contains(shape.centroid) else shape.representative_point()
    centre = np.array([at.x, at.y])
    level = next((word for size in sizes for word in [_inside(text, size, False, shape, centre, taken)] if word), None)
    worth_turning = [size for size in sizes if level is None or level.size < WORTH_TURNING * size]
    turned = (_inside(text, size, True, shape, centre, taken) for size in worth_turning)
    return next((word for word in turned if word), level)


def _inside(text: str, size: int, turned: bool, shape: Any, centre: Floats, taken: Taken) -> Word | None:
    """Return the place nearest to the middle where the name fits in this size, on one line if it can."""
    import shapely

    x0, y0, x1, y1 = shape.bounds
    for lines in (text,) if turned else wrapped(text):
        half = np.array(text_size(lines, size)[:: -1 if turned else 1]) / 2
        if 2 * half[0] + 4 > x1 - x0 or 2 * half[1] + 4 > y1 - y0:
            continue
        xs = np.unique(np.append(np.linspace(x0 + half[0] + 2, x1 - half[0] - 2, SPOTS), centre[0]))
        ys = np.unique(np.append(np.linspace(y0 + half[1] + 2, y1 - half[1] - 2, SPOTS), centre[1]))
        centres = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        boxes = np.concatenate([centres - half, centres + half], axis=1)
        good = taken.which_free(boxes)
        good[good] = shapely.contains(shape, shapely.box(*boxes[good].T))
        if good.any():
            away = np.hypot(*(centres - centre).T)
            left, top, right, bottom = boxes[np.flatnonzero(good)[np.argmin(away[good])]].tolist()
            return Word(lines, (left, top, right, bottom), size, turned)
    return None


def place_beside(text: str, ring: Floats, taken: Taken, sizes: Iterable[int], page: Box) -> Word | None:
    """Return a place near a polygon for a name that does not fit into it; None where all is taken."""
    low, high = ring.min(axis=0), ring.max(axis=0)
    middle = (low + high) / 2
    for size in sizes:
        for lines in wrapped(text):
            half = np.array(text_size(lines, size)) / 2
            for away in (3, 10, 20, 35, 55, 80):
                reach = (high + away - (low - away)) / 2
                for side in np.array([(0, -1), (0, 1), (1, 0), (-1, 0)]):
                    for share in (0.0, -0.35, 0.35, -0.7, 0.7, -1.0, 1.0):
                        at = middle + np.where(side, side * (reach + half), share * reach)
                        left, top, right, bottom = spot = (*(at - half).tolist(), *(at + half).tolist())
                        on_page = left >= page[0] and top >= page[1] and right <= page[2] and bottom <= page[3]
                        if on_page and taken.free(spot):
                            return Word(lines, spot, size)
    return None


Window = tuple[float, float, float, float]

NARROWEST_PX, WIDEST_PX = 400, 6000
LONGEST = 60
BESIDE_MAP_M = 1.0  # objects up to this far beyond the map are drawn
TALLEST = 1.3  # a page is at most this many times as tall as it may be wide


@dataclass(frozen=True)
class PageView:
    """The plan on a page: `window` (x_min, y_min, x_max, y_max) in metres is drawn at `scale` pixels a metre with
    its upper left corner at (`left`, `top`) pixels; `up` is the axis that points up. The page is `width` x `height`.
    """

    window: Window
    up: Literal["x", "y"]
    scale: float
    left: int
    top: int
    width: int
    height: int

    def pixels(self, points: Floats) -> Floats:
        """Points (..., 2) in metres as (across, down) pixels."""
        x0, _, x1, y1 = self.window
        points = np.asarray(points, float)
        if self.up == "y":
            across, down = points[..., 0] - x0, y1 - points[..., 1]
        else:
            across, down = y1 - points[..., 1], x1 - points[..., 0]
        return np.stack([self.left + across * self.scale, self.top + down * self.scale], axis=-1)

    def metres(self, pixels: Floats) -> Floats:
        """Return the inverse of `pixels`."""
        x0, _, x1, y1 = self.window
        across = (np.asarray(pixels, float)[..., 0] - self.left) / self.scale
        down = (np.asarray(pixels, float)[..., 1] - self.top) / self.scale
        if self.up == "y":
            return np.stack([x0 + across, y1 - down], axis=-1)
        return np.stack([x1 - down, y1 - across], axis=-1)

    @property
    def plan(self) -> tuple[int, int, int, int]:
        """The plan's rectangle on the page: left, top, right, bottom in pixels."""
        (x0, y0), (x1, y1) = self.pixels(np.array([self.window[:2], self.window[2:]]))
        return (round(min(x0, x1)), round(min(y0, y1)), round(max(x0, x1)), round(max(y0, y1)))


def check_width(width_px: int) -> None:
    """Raise InputError for the width of a picture that is absurd."""
    if not NARROWEST_PX <= width_px <= WIDEST_PX:
        raise InputError(
            f"a picture is {NARROWEST_PX} to {WIDEST_PX} pixels wide; {width_px} were asked for", code="picture-width"
        )


def view_of(world: World, *, width_px: int, window: Window | None, margins: tuple[int, int, int, int]) -> PageView:
    """The view that shows a window of the world (None: all that is known of it) on a page at most `width_px` wide.

    `margins` are pixels left, top, right and bottom of the plan. Raises InputError for absurd sizes.
    """
    check_width(width_px)
    shown = window or known_window(world)
    x0, y0, x1, y1 = shown
    if not (x1 > x0 and y1 > y0):
        raise InputError(f"the window [x_min, y_min, x_max, y_max] is empty: {list(shown)}", code="window-empty")
    left, low, right, high = known_window(world)
    if x0 >= right or x1 <= left or y0 >= high or y1 <= low:
        raise InputError(
            f"the window {list(shown)} shows nothing of the world, which spans x {left:.1f} to {right:.1f} "
            f"and y {low:.1f} to {high:.1f}",
            code="window-outside",
        )
    across, down = (x1 - x0, y1 - y0) if world.grid.up == "y" else (y1 - y0, x1 - x0)
    if max(across, down) > LONGEST * min(across, down):
        raise InputError(
            f"a part of {across:.1f} x {down:.1f} m is too long and narrow for one picture "
            f"(at most {LONGEST} times as long as wide): draw windows of it"
        )
    left, top, right, bottom = margins
    scale = min((width_px - left - right) / across, (TALLEST * width_px - top - bottom) / down)
    width = max(round(across * scale) + left + right, min(width_px, 900))
    moved = (width - (round(across * scale) + left + right)) // 2
    height = round(down * scale) + top + bottom
    return PageView(shown, world.grid.up, scale, left + moved, top, width, height)


def known_window(world: World, margin_m: float = 0.15) -> Window:
    """Return the known part of the world: free or occupied cells, waypoints, and objects near the map."""
    occupancy = world_map(world)
    frame = frame_of(occupancy)
    extent = outermost(occupancy.cells != UNKNOWN)
    parts = [np.array([[w.x, w.y] for w in world.grid.waypoints if w.human]).reshape(-1, 2)]
    if len(extent):
        (c0, r0), (c1, r1) = extent.min(axis=0), extent.max(axis=0) + 1
        parts.append(frame.to_metres(np.array([[c0, r0], [c1, r0], [c1, r1], [c0, r1]], float)))
    low, high = frame.corners.min(axis=0) - BESIDE_MAP_M, frame.corners.max(axis=0) + BESIDE_MAP_M
    for thing in world.solids:
        corners = np.array(thing.footprint)
        if (corners.max(axis=0) > low).all() and (corners.min(axis=0) < high).all():
            parts.append(np.clip(corners, low, high))
    points = np.concatenate(parts)
    (x0, y0), (x1, y1) = points.min(axis=0) - margin_m, points.max(axis=0) + margin_m
    return (float(x0), float(y0), float(x1), float(y1))


FINE = 2
ROOM_BELOW = 200


class Sheet:
    """A page with its view, its colours, its labels and the rectangles that these occupy."""

    def __init__(self, view: PageView, palette: Palette) -> None:
        self.view = view
        self.palette = palette
        self.taken = Taken()
        self.words: list[Word] = []
        self.notes: list[str] = []
        self._late: list[tuple[Word, Colour, Colour | None, bool]] = []
        self._image = Image.new("RGB", (view.width * FINE, (view.height + ROOM_BELOW) * FINE), palette.page)
        self._draw = ImageDraw.Draw(self._image)

    @property
    def unit(self) -> float:
        """The size of one unit on this page in pixels; 1.0 on a page 1600 pixels wide."""
        return max(self.view.width, self.view.height * 0.8) / 1600

    def paste(self, pixels: NDArray[np.uint8], left: int, top: int) -> None:
        """Paste colours (rows, columns, 3) of the fine image with the upper left corner at page pixels."""
        self._image.paste(Image.fromarray(pixels), (left * FINE, top * FINE))

    def polygon(self, ring: Floats, *, fill: Colour | None, edge: Colour | None = None, width: float = 1.5) -> None:
        """Draw a filled and outlined polygon (n, 2) in page pixels."""
        points = self._fine(ring)
        if fill is not None:
            self._draw.polygon(points, fill=fill)
        if edge is not None:
            self._draw.line([*points, points[0], points[1]], fill=edge, width=self._width(width), joint="curve")

    def stamp(self, cells: NDArray[np.bool_], colour: Colour) -> None:
        """Colour the marked pixels of the fine image, from its upper left corner."""
        self._image.paste(colour, (0, 0), Image.fromarray(cells))

    def holed(self, ring: Floats, holes: Sequence[Floats], fill: Colour) -> None:
        """Draw a filled polygon with holes in page pixels."""
        if not holes:
            self.polygon(ring, fill=fill)
            return
        mask = Image.new("1", self._image.size)
        draw = ImageDraw.Draw(mask)
        draw.polygon(self._fine(ring), fill=1)
        for hole in holes:
            draw.polygon(self._fine(hole), fill=0)
        self._image.paste(fill, (0, 0), mask)

    def tint(self, ring: Floats, colour: Colour, share: float) -> None:
        """Blend a share of a colour into the area of a polygon."""
        points = self._fine(ring)
        x0, y0 = (max(0, int(min(p[i] for p in points))) for i in (0, 1))
        x1 = min(self._image.width, int(max(p[0] for p in points)) + 2)
        y1 = min(self._image.height, int(max(p[1] for p in points)) + 2)
        if x1 <= x0 or y1 <= y0:
            return
        mask = Image.new("L", (x1 - x0, y1 - y0))
        ImageDraw.Draw(mask).polygon([(x - x0, y - y0) for x, y in points], fill=round(255 * share))
        self._image.paste(colour, (x0, y0, x1, y1), mask)

    def line(self, points: Floats, colour: Colour, width: float) -> None:
        """Draw a line through points (n, 2) in page pixels."""
        self._draw.line(self._fine(points), fill=colour, width=self._width(width), joint="curve")

    def dot(
        self, x: float, y: float, radius: float, *, fill: Colour, edge: Colour | None = None, width: float = 1.5
    ) -> None:
        """Draw a disc at page pixels."""
        box = [(x - radius) * FINE, (y - radius) * FINE, (x + radius) * FINE, (y + radius) * FINE]
        self._draw.ellipse(box, fill=fill, outline=edge, width=self._width(width) if edge else 0)

    def clear_margins(self) -> None:
        """Erase everything outside the plan."""
        left, top, right, bottom = (v * FINE for v in self.view.plan)
        width, height = self._image.size
        for box in ((0, 0, width, top), (0, bottom, width, height), (0, 0, left, height), (right, 0, width, height)):
            self._image.paste(self.palette.page, box)

    def write(self, word: Word, colour: Colour, *, halo: Colour | None = None, bold: bool = False) -> None:
        """Write a placed label and reserve its rectangle."""
        self.words.append(word)
        self.taken.add(word.box)
        self._late.append((word, colour, halo, bold))

    def write_at(
        self, text: str, x: float, y: float, size: int, colour: Colour, *, anchor: str = "m", bold: bool = False
    ) -> Word:
        """Write a text whose box begins (anchor l), is centred (m) or ends (r) at x, vertically centred at y."""
        width, height = text_size(text, size)
        left = {"l": x, "m": x - width / 2, "r": x - width}[anchor]
        word = Word(text, (left, y - height / 2, left + width, y + height / 2), size)
        self.write(word, colour, bold=bold)
        return word

    def finished(self, end: float) -> Image.Image:
        """Return the page at its true size with all labels, cropped below `end` pixels."""
        page = self._image.reduce(FINE).crop((0, 0, self.view.width, round(end)))
        draw = ImageDraw.Draw(page)
        for word, colour, halo, bold in self._late:
            _write(page, draw, word, colour, halo, bold)
        return page

    def _fine(self, points: Floats) -> list[tuple[float, float]]:
        return [(float(x) * FINE, float(y) * FINE) for x, y in points]

    def _width(self, width: float) -> int:
        return max(1, round(width * FINE * max(self.unit, 0.6)))


def _write(
    page: Image.Image, draw: ImageDraw.ImageDraw, word: Word, colour: Colour, halo: Colour | None, bold: bool
) -> None:
    """Write centred lines. Pillow has one font, so bold text is drawn with a stroke of half a pixel."""
    lines, step = word.text.split("\n"), word.size * 1.14

    def text(draw: ImageDraw.ImageDraw, centre: tuple[float, float], fill: Colour | int, stroke: int) -> None:
        for i, line in enumerate(lines):
            at = (round(centre[0]), round(centre[1] + (i - (len(lines) - 1) / 2) * step))
            width = stroke + (0.4 if bold else 0)
            draw.text(at, line, fill=fill, font=font(word.size), anchor="mm", stroke_width=width)

    stroke = max(1, word.size // 9)
    if word.turned:
        width, height = text_size(word.text, word.size)
        corner = (round(word.box[0]) - 4, round(word.box[1]) - 4)
        for ink, extra in ((halo, stroke), (colour, 0)):
            if ink is not None:
                mask = Image.new("L", (width + 8, height + 8))
                text(ImageDraw.Draw(mask), (width / 2 + 4, height / 2 + 4), 255, extra)
                page.paste(ink, corner, mask.transpose(Image.Transpose.ROTATE_90))
        return
    if halo is not None:
        text(draw, word.centre, halo, stroke + 1)
    text(draw, word.centre, colour, 0)
