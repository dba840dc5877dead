"""A page to draw on: shapes are drawn at twice the size for smooth edges, text at the end at the true size."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rvsg.core.errors import InputError, UnknownName
from rvsg.world.space import frame_of, outermost, world_map
from rvsg.world.world import UNKNOWN, World

Colour = tuple[int, int, int]


@dataclass(frozen=True, kw_only=True)
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


LIGHT = Palette(
    page=(255, 255, 255),
    outside=(226, 229, 234),
    floor=(255, 255, 255),
    wall=(52, 58, 70),
    thing=(221, 215, 204),
    thing_edge=(142, 132, 116),
    ink=(24, 28, 36),
    faint_ink=(104, 112, 124),
    guide=(222, 226, 232),
    dot=(30, 41, 59),
    route=(220, 38, 38),
    start=(21, 128, 61),
    goal=(220, 38, 38),
    kinds=(
        (37, 99, 235),
        (194, 88, 12),
        (13, 128, 110),
        (126, 34, 206),
        (190, 24, 93),
        (77, 124, 15),
        (120, 72, 24),
        (3, 105, 161),
        (82, 82, 110),
    ),
    tint=0.16,
)

GREY = Palette(
    page=(255, 255, 255),
    outside=(214, 214, 214),
    floor=(255, 255, 255),
    wall=(30, 30, 30),
    thing=(205, 205, 205),
    thing_edge=(110, 110, 110),
    ink=(0, 0, 0),
    faint_ink=(90, 90, 90),
    guide=(226, 226, 226),
    dot=(0, 0, 0),
    route=(0, 0, 0),
    start=(0, 0, 0),
    goal=(0, 0, 0),
    kinds=((60, 60, 60),),
    tint=0.08,
)

DARK = Palette(
    page=(22, 27, 34),
    outside=(13, 17, 23),
    floor=(33, 40, 50),
    wall=(190, 198, 210),
    thing=(70, 78, 90),
    thing_edge=(120, 130, 145),
    ink=(236, 240, 246),
    faint_ink=(160, 170, 182),
    guide=(50, 58, 70),
    dot=(226, 232, 240),
    route=(255, 107, 107),
    start=(74, 222, 128),
    goal=(255, 107, 107),
    kinds=(
        (96, 165, 250),
        (251, 146, 60),
        (45, 212, 191),
        (192, 132, 252),
        (244, 114, 182),
        (163, 230, 53),
        (217, 160, 102),
        (56, 189, 248),
        (176, 176, 210),
    ),
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

_fonts: dict[int, ImageFont.FreeTypeFont | ImageFont.ImageFont] = {}


def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return Pillow's default font at a size in pixels."""
    if size not in _fonts:
        _fonts[size] = ImageFont.load_default(size)
    return _fonts[size]


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

    def add_line(self, points: Floats, half_width: float, step: float = 10.0) -> None:
        """Add a band around the line through points (n, 2)."""
        for a, b in pairwise(points):
            count = min(MOST_STEPS, max(1, int(np.hypot(*(b - a)) / step)))  # a line may extend far beyond the page
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
    """Return the largest readable place of a name inside a polygon (n, 2) in pixels that covers nothing, or None.

    Level text is preferred to turned text unless it would be much smaller.
    """
    room = _Room(ring)
    level = next((word for size in sizes for word in [_inside(text, size, False, room, taken)] if word), None)
    worth_turning = [size for size in sizes if level is None or level.size < WORTH_TURNING * size]
    turned = (_inside(text, size, True, room, taken) for size in worth_turning)
    return next((word for word in turned if word), level)


class _Room:
    """A polygon that is asked many times whether a rectangle lies in it."""

    def __init__(self, ring: Floats) -> None:
        from shapely import Polygon, prepare

        self.shape = Polygon(ring).buffer(0)
        prepare(self.shape)
        self.bounds: Box = self.shape.bounds
        at = self.shape.centroid if self.shape.contains(self.shape.centroid) else self.shape.representative_point()
        self.centre = np.array([at.x, at.y])


def _inside(text: str, size: int, turned: bool, room: _Room, taken: Taken) -> Word | None:
    """Return the place nearest to the middle where the name fits in this size, on one line if it can."""
    import shapely

    x0, y0, x1, y1 = room.bounds
    for lines in (text,) if turned else wrapped(text):
        half = np.array(text_size(lines, size)[:: -1 if turned else 1]) / 2
        if 2 * half[0] + 4 > x1 - x0 or 2 * half[1] + 4 > y1 - y0:
            continue
        xs = np.unique(np.append(np.linspace(x0 + half[0] + 2, x1 - half[0] - 2, SPOTS), room.centre[0]))
        ys = np.unique(np.append(np.linspace(y0 + half[1] + 2, y1 - half[1] - 2, SPOTS), room.centre[1]))
        centres = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
        boxes = np.concatenate([centres - half, centres + half], axis=1)
        good = taken.which_free(boxes)
        good[good] = shapely.contains(room.shape, shapely.box(*boxes[good].T))
        if good.any():
            away = np.hypot(*(centres - room.centre).T)
            left, top, right, bottom = boxes[np.flatnonzero(good)[np.argmin(away[good])]].tolist()
            return Word(lines, (left, top, right, bottom), size, turned)
    return None


def place_beside(text: str, ring: Floats, taken: Taken, sizes: Iterable[int], page: Box) -> Word | None:
    """Return a place near a polygon for a name that does not fit into it; None where all is taken."""
    low, high = ring.min(axis=0), ring.max(axis=0)
    middle = (low + high) / 2
    for size in sizes:
        for lines in wrapped(text):
            width, height = text_size(lines, size)
            for away in (3, 10, 20, 35, 55, 80):
                for x, y in _around(low - away, high + away, middle, width, height):
                    spot = (x - width / 2, y - height / 2, x + width / 2, y + height / 2)
                    inside = spot[0] >= page[0] and spot[1] >= page[1] and spot[2] <= page[2] and spot[3] <= page[3]
                    if inside and taken.free(spot):
                        return Word(lines, spot, size)
    return None


def _around(low: Floats, high: Floats, middle: Floats, width: float, height: float) -> Iterator[tuple[float, float]]:
    shares = (0.0, -0.35, 0.35, -0.7, 0.7, -1.0, 1.0)
    for side_x, side_y in ((0, -1), (0, 1), (1, 0), (-1, 0)):
        for share in shares:
            reach = (high - low) / 2
            if side_x:
                x = middle[0] + side_x * (reach[0] + width / 2)
                y = middle[1] + share * reach[1]
            else:
                x = middle[0] + share * reach[0]
                y = middle[1] + side_y * (reach[1] + height / 2)
            yield (float(x), float(y))


Window = tuple[float, float, float, float]

NARROWEST_PX, WIDEST_PX = 400, 6000
LONGEST = 60
BESIDE_MAP_M = 1.0  # objects up to this far beyond the map are drawn
TALLEST = 1.3  # a page is at most this many times as tall as it may be wide


@dataclass(frozen=True)
class View:
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


def view_of(world: World, *, width_px: int, window: Window | None, margins: tuple[int, int, int, int]) -> View:
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
    return View(shown, world.grid.up, scale, left + moved, top, width, height)


def known_window(world: World, margin_m: float = 0.15) -> Window:
    """Return the known part of the world: free or occupied cells, waypoints, and objects near the map."""
    occupancy = world_map(world)
    frame = frame_of(occupancy)
    known = outermost(occupancy.cells != UNKNOWN)
    parts = [np.array([[w.x, w.y] for w in world.grid.waypoints if w.human]).reshape(-1, 2)]
    if len(known):
        (c0, r0), (c1, r1) = known.min(axis=0), known.max(axis=0) + 1
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

    def __init__(self, view: View, palette: Palette) -> None:
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
        self, text: str, x: float, y: float, size: int, colour: Colour, *, anchor: str = "m", **how: bool
    ) -> Word:
        """Write a text whose box begins (anchor l), is centred (m) or ends (r) at x, vertically centred at y."""
        width, height = text_size(text, size)
        left = {"l": x, "m": x - width / 2, "r": x - width}[anchor]
        word = Word(text, (left, y - height / 2, left + width, y + height / 2), size)
        self.write(word, colour, bold=how.get("bold", False))
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
    stroke = max(1, word.size // 9) if halo is not None else 0
    if word.turned:
        width, height = text_size(word.text, word.size)
        mask, border = (Image.new("L", (width + 8, height + 8)) for _ in range(2))
        for layer, extra in ((mask, 0), (border, stroke)):
            _text(ImageDraw.Draw(layer), word, (width / 2 + 4, height / 2 + 4), 255, extra, bold)
        corner = (round(word.box[0]) - 4, round(word.box[1]) - 4)
        if halo is not None:
            page.paste(halo, corner, border.transpose(Image.Transpose.ROTATE_90))
        page.paste(colour, corner, mask.transpose(Image.Transpose.ROTATE_90))
        return
    if halo is not None:
        _text(draw, word, word.centre, halo, stroke + 1, bold)
    _text(draw, word, word.centre, colour, 0, bold)


def _text(
    draw: ImageDraw.ImageDraw, word: Word, centre: tuple[float, float], fill: Colour | int, stroke: int, bold: bool
) -> None:
    """Write centred lines. Pillow has one font, so bold text is drawn with a stroke of half a pixel."""
    lines = word.text.split("\n")
    step = word.size * 1.14
    for i, line in enumerate(lines):
        y = centre[1] + (i - (len(lines) - 1) / 2) * step
        at = (round(centre[0]), round(y))
        draw.text(at, line, fill=fill, font=font(word.size), anchor="mm", stroke_width=stroke + (0.4 if bold else 0))
