"""The lowest layers of a floor plan: the floor as the map shows it, and the objects that stand on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rvsg.world.drawing.sheet import FINE, Sheet
from rvsg.world.drawing.view import View
from rvsg.world.raster import Frame
from rvsg.world.space import frame_of, solid_cells, world_map
from rvsg.world.world import FREE, OCCUPIED, SolidObject, World

Floats = NDArray[np.float64]

THICK_WALL_M = 0.3  # parts of the map thicker than this are drawn as objects with an edge


def draw_floor(sheet: Sheet, world: World, guides: tuple[list[float], list[float]], *, hidden: bool) -> None:
    """Draw the occupancy map as a coloured floor with faint lines; unknown cells look like the outside.

    `hidden`: without the cells that belong to objects, as these are drawn themselves.
    """
    from scipy.ndimage import binary_dilation, binary_erosion

    occupancy = world_map(world)
    frame = frame_of(occupancy)
    ink = sheet.palette
    colours = np.array([ink.outside, ink.floor, ink.wall, ink.guide, ink.thing], np.uint8)
    kind = np.zeros(frame.shape, np.uint8)
    kind[occupancy.cells == FREE] = 1
    kind[occupancy.cells == OCCUPIED] = 2
    thick = max(1, round(THICK_WALL_M / 2 / frame.resolution))
    kind[binary_erosion(kind == 2, iterations=thick)] = 4
    if hidden and world.solids:
        kind[binary_dilation(solid_cells(world.solids, frame), np.ones((5, 5), bool)) & (kind == 2)] = 1
    left, top, right, bottom = sheet.view.plan
    across = left + (np.arange((right - left) * FINE) + 0.5) / FINE
    all_down = top + (np.arange((bottom - top) * FINE) + 0.5) / FINE
    on_row, on_column = _lines(all_down, guides[0]), _lines(across, guides[1])
    bands = []
    for first in range(0, len(all_down), 256):  # in bands, to save memory on large pages
        down = all_down[first : first + 256]
        found = _shown(kind, frame, sheet.view, across, down)
        found[(found == 1) & (on_row[first : first + 256, None] | on_column)] = 3
        bands.append(colours[found])
    sheet.paste(np.concatenate(bands), left, top)


def _shown(kind: NDArray[np.uint8], frame: Frame, view: View, across: Floats, down: Floats) -> NDArray[np.uint8]:
    """Return the kinds of the cells under the pixels of a band (down, across); 0 off the map."""
    if frame.origin.yaw:
        return frame.looked_up(kind, view.metres(np.stack(np.meshgrid(across, down), axis=-1)))
    # Rows and columns of cells lie along those of pixels: one index for each of them, not for each pixel.
    along = frame.to_cells(view.metres(np.stack([across, np.full_like(across, down[0])], axis=-1)))
    below = frame.to_cells(view.metres(np.stack([np.full_like(down, across[0]), down], axis=-1)))
    column, row = (along[None, :, 0], below[:, None, 1]) if view.up == "y" else (below[:, None, 0], along[None, :, 1])
    edged = np.pad(kind, 1)
    rows, columns = (
        np.clip(np.floor(at + 1e-9), -1, most).astype(int) + 1
        for at, most in zip((row, column), kind.shape, strict=True)
    )
    return np.asarray(edged[rows, columns])


def _lines(pixels: Floats, at: list[float]) -> NDArray[np.bool_]:
    """Return which of the pixels along one side belong to lines one pixel wide."""
    lines = np.zeros(len(pixels), bool)
    for place in at:
        lines |= np.abs(pixels - place) <= 0.5
    return lines


def is_wall(thing: SolidObject) -> bool:
    """Return whether an object is drawn as part of the building."""
    return bool(thing.holes) or "wall" in thing.kind.lower()


def draw_objects(sheet: Sheet, objects: tuple[SolidObject, ...]) -> None:
    """Draw the footprints of objects, walls first."""
    for thing in sorted(objects, key=lambda o: (not is_wall(o), o.box.size[2], o.name)):
        ring = sheet.view.pixels(np.array(thing.footprint))
        fill = sheet.palette.wall if is_wall(thing) else sheet.palette.thing
        if thing.holes:
            sheet.holed(ring, [sheet.view.pixels(np.array(hole)) for hole in thing.holes], fill)
        else:
            edge = sheet.palette.wall if is_wall(thing) else sheet.palette.thing_edge
            sheet.polygon(ring, fill=fill, edge=edge, width=1.0)
