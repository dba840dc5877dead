"""An oblique view from above without perspective, and a canvas with a depth buffer for flat faces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rvsg.world.drawing.palette import Colour

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
