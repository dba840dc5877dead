"""The occupancy map that a robot's own mapping would show of solid objects, and Nav2's map files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError
from rvsg.world.raster import Frame, covering, inside_cells, outline_cells
from rvsg.world.world import FREE, OCCUPIED, UNKNOWN, OccupancyMap, SolidObject

MOST_CELLS = 60_000_000
MainPart = Callable[[NDArray[np.int32], NDArray[np.int64], Frame], int]
"""Returns the number of the part that is the floor, of the numbers of all open cells and the sizes of the parts."""


def occupancy_from_objects(
    objects: Sequence[SolidObject],
    *,
    resolution_m: float = 0.05,
    seeds: Iterable[tuple[float, float]] = (),
    margin_m: float = 0.0,
    main: MainPart | None = None,
) -> OccupancyMap:
    """The map a lidar draws of the objects: what it hits is occupied, the floor free, the inside of things unknown.

    A cell is occupied where an outline of a slice crosses it and it borders the floor. The floor is every open part
    that holds one of the `seeds` (places where the robot drives, metres), and the part that `main` chooses; with
    neither the largest open one.
    The map reaches `margin_m` beyond the objects: the floor round things that no wall encloses.
    Raises InputError where no object has a slice.
    """
    outlines = [polygon for thing in objects for polygon in thing.slices]
    if not outlines:
        raise InputError(
            "no object is cut by the lidar plane, so there is nothing to draw a map of", code="map-no-object"
        )
    frame = covering(np.concatenate([np.asarray(p, float) for p in outlines]), resolution_m, margin_m)
    if frame.shape[0] * frame.shape[1] > MOST_CELLS:
        raise InputError(
            f"a map of {frame.shape[1]} x {frame.shape[0]} cells at {resolution_m} m is too large "
            f"(at most {MOST_CELLS} cells): give a coarser resolution",
            code="map-too-large",
        )
    edges = outline_cells(outlines, frame)
    solid = np.zeros(frame.shape, bool)
    for thing in objects:
        solid |= inside_cells(thing.slices, frame)
    floor = _floor(~edges & ~solid, frame, list(seeds), main)
    cells = np.full(frame.shape, UNKNOWN, np.uint8)
    cells[floor] = FREE
    cells[edges & _grown(floor)] = OCCUPIED
    cells.setflags(write=False)
    return OccupancyMap(cells=cells, resolution=resolution_m, origin=frame.origin)


def _floor(
    open_cells: NDArray[np.bool_], frame: Frame, seeds: list[tuple[float, float]], main: MainPart | None
) -> NDArray[np.bool_]:
    from scipy.ndimage import label

    parts, count = label(open_cells)
    if count == 0:
        raise InputError("the objects leave no open floor", code="map-no-floor")
    rows, columns = frame.shape
    wanted = set()
    for seed in seeds:
        column, row = np.floor(frame.to_cells(np.array(seed))).astype(int)
        if 0 <= row < rows and 0 <= column < columns and parts[row, column]:
            wanted.add(int(parts[row, column]))
    if not wanted or main is not None:
        sizes = np.bincount(parts.ravel())
        sizes[0] = 0
        wanted.add(int(sizes.argmax()) if main is None else main(parts, sizes, frame))
    return np.isin(parts, sorted(wanted))


def _grown(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    from scipy.ndimage import binary_dilation

    return np.asarray(binary_dilation(cells, np.ones((3, 3), bool)))


def write_map(occupancy: OccupancyMap, folder: Path, name: str = "map") -> Path:
    """Write `name.png` and `name.yaml` in Nav2's format; returns the path of the YAML file."""
    from PIL import Image

    grey = np.full(occupancy.cells.shape, 205, np.uint8)
    grey[occupancy.cells == FREE] = 254
    grey[occupancy.cells == OCCUPIED] = 0
    Image.fromarray(grey[::-1]).save(folder / f"{name}.png", optimize=False)
    o = occupancy.origin
    (folder / f"{name}.yaml").write_text(
        "# The occupancy map in Nav2's format: black is occupied, white is free, grey is unknown.\n"
        f"image: {name}.png\nmode: trinary\nresolution: {occupancy.resolution!r}\n"
        f"origin: [{o.x!r}, {o.y!r}, {o.yaw!r}]  # x, y (m), yaw (rad) of the lower left corner\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return folder / f"{name}.yaml"
