"""The colours of the pictures, by name of the palette."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from rvsg.core.errors import UnknownName

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
