"""A page to draw on: shapes are drawn at twice the size for smooth edges, text at the end at the true size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rvsg.world.drawing.palette import Colour, Palette
from rvsg.world.drawing.placing import Taken, Word, font, text_size
from rvsg.world.drawing.view import View

Floats = NDArray[np.float64]
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

    def holed(self, ring: Floats, holes: Sequence[Floats], fill: Colour) -> None:
        """Draw a filled polygon with holes in page pixels."""
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
