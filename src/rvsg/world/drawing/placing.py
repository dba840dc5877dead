"""Place labels so that none covers another label, a dot or a line."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import ImageFont

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
