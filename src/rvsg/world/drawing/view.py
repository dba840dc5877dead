"""Convert metres to pixels: the visible window of the world, the axis that points up, and the position on the page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.world.raster import outermost
from rvsg.world.space import frame_of, world_map
from rvsg.world.world import UNKNOWN, World

Floats = NDArray[np.float64]
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


def view_of(world: World, *, width_px: int, window: Window | None, margins: tuple[int, int, int, int]) -> View:
    """The view that shows a window of the world (None: all that is known of it) on a page at most `width_px` wide.

    `margins` are pixels left, top, right and bottom of the plan. Raises InputError for absurd sizes.
    """
    if not NARROWEST_PX <= width_px <= WIDEST_PX:
        raise InputError(
            f"a picture is {NARROWEST_PX} to {WIDEST_PX} pixels wide; {width_px} were asked for", code="picture-width"
        )
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
