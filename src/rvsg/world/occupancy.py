"""Reader of the map a Nav2 robot localises in: `map.yaml` with its pgm, png or bmp image.

Cells are classified as nav2_map_server does (navigation2, `map_io`: threshold comparisons, alpha and the three modes)
and then made trinary as Nav2's static costmap layer does by default (`trinary_costmap`, lethal threshold 100).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from rvsg.core.documents import Document, DocumentError, Problem, read_yaml
from rvsg.core.errors import FileError, InputError
from rvsg.core.records import Pose
from rvsg.world.space import Frame, covering, inside_cells, outline_cells
from rvsg.world.world import FREE, OCCUPIED, UNKNOWN, OccupancyMap, SolidObject

MODES = ("trinary", "scale", "raw")
MOST_CELLS = 64_000_000
LONGEST_SIDE_M = 1000.0
FINEST_M, COARSEST_M = 0.001, 1.0
FARTHEST_ORIGIN_M = 1.0e6
SAVERS_UNKNOWN = 205  # the grey that Nav2's and ROS 1's map savers write for an unknown cell
IMAGE_FORMATS = ("PPM", "PNG", "BMP")
IMAGE_SUFFIXES = (".pgm", ".png", ".bmp")


class _Header(NamedTuple):
    image: Path
    resolution: float
    origin: Pose
    mode: str
    negate: bool
    occupied_thresh: float
    free_thresh: float


def load_nav2_map(path: str | Path, *, free_thresh: float | None = None) -> tuple[OccupancyMap, tuple[str, ...]]:
    """Return the map of a `map.yaml`, whose origin may be turned, and notes; `free_thresh` overrides that of the file.

    Raises FileError with everything that is wrong in the header at once, or with what is wrong with the image.
    """
    path = Path(path)
    if path.suffix.lower() in IMAGE_SUFFIXES:
        message = f"this is the picture of a map; give the yaml file that describes it ({path.stem}.yaml?)"
        raise FileError(path, message, code="map-picture")
    document = read_yaml(path)
    header = _header(document, free_thresh)
    shade, opaque, notes = _shade(header.image, trinary=header.mode == "trinary")
    rows, columns = shade.shape
    wide, high = columns * header.resolution, rows * header.resolution
    if max(wide, high) > LONGEST_SIDE_M:
        message = (
            f"the map would be {wide:g} x {high:g} m ({columns} x {rows} cells of {header.resolution:g} m); at most "
            f"{LONGEST_SIDE_M:g} m a side are supported. Is the resolution in metres?"
        )
        raise DocumentError([document.problem(message, "resolution")])
    if min(rows, columns) < 2:
        message = f"the image has {columns} x {rows} pixels: too few to be a map."
        raise FileError(header.image, message, code="map-too-small")
    cells = trinary(classify(shade, opaque, header))[::-1]
    grey = float(np.isclose(shade, SAVERS_UNKNOWN / 255.0, atol=1e-6).mean())
    taken_for_free = header.mode == "trinary" and not header.negate and header.free_thresh > 1 - SAVERS_UNKNOWN / 255
    if grey > 0.0 and taken_for_free:
        notes.append(
            f"{grey:.0%} of the pixels have the grey {SAVERS_UNKNOWN} that map savers write for unknown, and with "
            f"free_thresh {header.free_thresh:g} they count as free, as they do for Nav2. If they are unknown, "
            "give a free threshold of 0.196."
        )
    counts = {value: int(np.count_nonzero(cells == value)) for value in (FREE, OCCUPIED, UNKNOWN)}
    if counts[FREE] == 0:
        raise FileError(
            header.image,
            f"the map has no free space: {counts[OCCUPIED]} of {cells.size} cells are occupied and "
            f"{counts[UNKNOWN]} unknown. Check negate ({int(header.negate)}), free_thresh ({header.free_thresh:g}) "
            f"and mode ({header.mode}) in {document.path.name}.",
            code="map-no-floor",
        )
    if counts[OCCUPIED] == 0:
        notes.append("the map holds no obstacle at all: is this the right image?")
    cells = np.ascontiguousarray(cells)
    return OccupancyMap(cells=cells, resolution=header.resolution, origin=header.origin), tuple(notes)


def read_mask(path: Path) -> tuple[NDArray[np.int16], float, Pose]:
    """Return the cells of a mask of Nav2's costmap filters, its resolution and its origin, whose yaw Nav2 ignores.

    The cells (rows, columns), the lowest y first, are as Nav2's map server publishes them: 0 to 100, -1 unknown.
    Raises FileError as `load_nav2_map` does.
    """
    header = _header(read_yaml(path), None)
    shade, opaque, _ = _shade(header.image, trinary=header.mode == "trinary")
    return classify(shade, opaque, header)[::-1], header.resolution, header.origin


def runs_of(mask: NDArray[np.int16]) -> list[tuple[int, int]]:
    """Return runs of equal cells: each value of a mask (rows, columns) and how often it follows itself."""
    flat = mask.ravel()
    begins = np.flatnonzero(np.diff(flat, prepend=flat[0] - 1))
    lengths = np.diff(begins, append=flat.size)
    return [(int(flat[begin]), int(length)) for begin, length in zip(begins, lengths, strict=True)]


def classify(shade: NDArray[np.float64], opaque: NDArray[np.bool_], header: Any) -> NDArray[np.int16]:
    """Return the value of every cell as nav2_map_server publishes it: 0 to 100, -1 unknown; the image's top row first.

    `shade` (rows, columns) is the brightness from 0 to 1, `opaque` whether the pixel is fully opaque.
    """
    if header.mode == "raw":
        value = np.round(shade * 255.0)
        return np.where(value <= OCCUPIED, value, -1).astype(np.int16)
    occupied_share = shade if header.negate else 1.0 - shade
    between: Any = -1
    if header.mode == "scale":
        span = header.occupied_thresh - header.free_thresh
        between = np.rint((occupied_share - header.free_thresh) / span * 100.0)
    value = np.where(occupied_share < header.free_thresh, FREE, between)
    value = np.where(header.occupied_thresh < occupied_share, OCCUPIED, value)
    if header.mode == "scale":
        value = np.where(opaque, value, -1)
    return value.astype(np.int16)


def trinary(values: NDArray[np.int16]) -> NDArray[np.uint8]:
    """Published values as free, occupied or unknown: below 100 is free, as Nav2's static layer takes it by default."""
    cells = np.where(values >= OCCUPIED, OCCUPIED, FREE)
    return np.where(values < 0, UNKNOWN, cells).astype(np.uint8)


def read_map(path: str | Path) -> OccupancyMap:
    """Return the map with its cells along the axes of the map frame; raises as `load_nav2_map` does."""
    return upright(load_nav2_map(path)[0])


def upright(occupancy: OccupancyMap) -> OccupancyMap:
    """Return the same map with its cells along the axes of the map frame (origin yaw 0), at the same resolution.

    Of 3 x 3 samples per cell three make it occupied, else most make it unknown, else it is free.
    """
    yaw = math.remainder(occupancy.origin.yaw, math.tau)
    if occupancy.origin.yaw == 0.0:
        return occupancy
    if abs(yaw) < 1e-9:
        return replace(occupancy, origin=occupancy.origin.model_copy(update={"yaw": 0.0}))
    rows, columns = occupancy.cells.shape
    size = occupancy.resolution
    cos, sin = math.cos(yaw), math.sin(yaw)
    corners = np.array([(u * columns * size, v * rows * size) for u in (0, 1) for v in (0, 1)])
    xs = occupancy.origin.x + cos * corners[:, 0] - sin * corners[:, 1]
    ys = occupancy.origin.y + sin * corners[:, 0] + cos * corners[:, 1]
    left, low = float(xs.min()), float(ys.min())
    wide = math.ceil((float(xs.max()) - left) / size - 1e-9)
    high = math.ceil((float(ys.max()) - low) / size - 1e-9)
    if wide * high > MOST_CELLS:
        raise InputError(f"the turned map would need {wide} x {high} cells; at most {MOST_CELLS} are supported.")
    occupied, unknown = np.zeros((2, high, wide), np.uint8)
    for part_x, part_y in itertools.product((1 / 6, 3 / 6, 5 / 6), repeat=2):
        x = left + (np.arange(wide) + part_x) * size - occupancy.origin.x
        y = (low + (np.arange(high) + part_y) * size - occupancy.origin.y)[:, None]
        column = np.floor((cos * x + sin * y) / size).astype(np.int64)
        row = np.floor((cos * y - sin * x) / size).astype(np.int64)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        seen = occupancy.cells[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
        occupied += inside & (seen == OCCUPIED)
        unknown += ~inside | (seen == UNKNOWN)
    cells = np.where(occupied >= 3, OCCUPIED, np.where(unknown >= 5, UNKNOWN, FREE)).astype(np.uint8)
    return OccupancyMap(cells=cells, resolution=size, origin=Pose(x=left, y=low, yaw=0.0))


# --- the header ---------------------------------------------------------------------------------------------------


def _header(document: Document, free_thresh: float | None) -> _Header:
    data = document.value
    if not isinstance(data, dict):
        raise DocumentError([document.problem("expected a Nav2 map header: image, resolution, origin, negate, ...")])
    problems: list[Problem] = []

    def number(key: str, low: float, high: float, hint: str) -> float:
        value = _as_float(data.get(key))
        if key not in data:
            problems.append(document.problem(f"{key} is missing; it is {hint}", key))
        elif value is None or not low <= value <= high:
            problems.append(document.problem(f"{key} must be {hint}, got {data[key]!r}", key))
        else:
            return value
        return low

    resolution = number("resolution", FINEST_M, COARSEST_M, f"metres per cell, from {FINEST_M} to {COARSEST_M:g}")
    occupied = number("occupied_thresh", 0.0, 1.0, "a share from 0 to 1, usually 0.65")
    free = number("free_thresh", 0.0, 1.0, "a share from 0 to 1, usually 0.196 or 0.25")
    free = free if free_thresh is None else free_thresh
    if not problems and not free < occupied:
        message = f"free_thresh ({free:g}) must be smaller than occupied_thresh ({occupied:g})"
        problems.append(document.problem(message, "free_thresh"))
    origin = Pose(x=0.0, y=0.0)
    given = data.get("origin")
    values = [_as_float(value) for value in given] if isinstance(given, list) else []
    x, y, yaw = (values[0], values[1], values[2]) if len(values) == 3 else (None, None, None)
    if x is None or y is None or yaw is None:
        wanted = "[x, y, yaw] of the image's lower left corner, metres and radians"
        problems.append(document.problem(f"origin must be three numbers, {wanted}, got {given!r}", "origin"))
    else:
        origin = Pose(x=x, y=y, yaw=yaw)
        if max(abs(x), abs(y)) > FARTHEST_ORIGIN_M:
            message = (
                f"the origin ({x:g}, {y:g}) lies more than {FARTHEST_ORIGIN_M:g} m away: is it in millimetres or a "
                "geographic coordinate? Expected metres in the map frame"
            )
            problems.append(document.problem(message, "origin"))
        if abs(yaw) > math.tau:
            message = (
                f"the origin's yaw must be in radians, between -6.28 and 6.28, got {yaw:g}; "
                f"if these are degrees, write {math.radians(yaw):.4f}"
            )
            problems.append(document.problem(message, "origin"))
    mode = str(data.get("mode", "trinary")).lower()
    if mode not in MODES:
        problems.append(document.problem(f"mode must be one of {', '.join(MODES)}, got {data['mode']!r}", "mode"))
    negate = data.get("negate")
    if negate not in (0, 1):
        problems.append(document.problem(f"negate must be 0 or 1, usually 0, got {negate!r}", "negate"))
    name = data.get("image")
    image = document.path.parent / str(name)
    if not isinstance(name, str) or not name:
        problems.append(document.problem(f"image must name the map's picture, such as map.pgm, got {name!r}", "image"))
    elif not image.is_file():
        there = sorted(p.name for p in image.parent.glob("*") if p.suffix.lower() in IMAGE_SUFFIXES)
        listed = f"Images there: {', '.join(there[:10])}" if there else "There is no pgm, png or bmp image there"
        problems.append(document.problem(f"the image {image} does not exist. {listed}", "image"))
    if problems:
        raise DocumentError(sorted(problems, key=lambda problem: problem.line or 0))
    return _Header(image, resolution, origin, mode, bool(negate), occupied, free)


def _as_float(value: Any) -> float | None:
    """Return a finite number; YAML 1.1 reads `5e-2` as text, Nav2's reader as a number, so text is tried too."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


# --- the image ----------------------------------------------------------------------------------------------------


def _shade(path: Path, *, trinary: bool) -> tuple[NDArray[np.float64], NDArray[np.bool_], list[str]]:
    """Brightness (rows, columns) from 0 to 1 as Nav2 averages it, whether opaque, and notes."""
    notes: list[str] = []
    try:
        with Image.open(path, formats=IMAGE_FORMATS) as image:
            wide, high = image.size
            if wide * high > MOST_CELLS:
                raise FileError(
                    path,
                    f"the image has {wide} x {high} pixels; at most {MOST_CELLS} are supported. "
                    "Crop it, or save it at a coarser resolution.",
                )
            if image.mode.startswith(("I", "F")):
                message = (
                    f"the image has more than 8 bits per channel ({image.mode}); Nav2 maps are 8 bit. Convert it to "
                    "8-bit grey first (an 8-bit map needs no more than three shades)."
                )
                raise FileError(path, message, code="map-depth")
            if wide == 0 or high == 0:
                raise FileError(path, f"the image is empty ({wide} x {high} pixels).")
            transparent = "A" in image.getbands() or "transparency" in image.info
            coloured = image.mode not in ("1", "L", "LA")
            pixels = np.asarray(image.convert("RGBA" if transparent else "RGB" if coloured else "L"))
    except UnidentifiedImageError:
        raise FileError(path, "this is not a readable pgm, png or bmp image.") from None
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        message = f"the image is far too large; at most {MOST_CELLS} pixels are supported."
        raise FileError(path, message, code="map-too-large") from None
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        raise FileError(path, f"the image cannot be read: {error}. Is the file complete?") from None
    opaque = pixels[..., 3] == 255 if transparent else np.ones(pixels.shape[:2], np.bool_)
    if pixels.ndim == 2:
        return pixels / 255.0, opaque, notes
    averaged = pixels[..., :3]
    if np.ptp(averaged, axis=-1).any():
        notes.append("the image is coloured; its channels are averaged, as Nav2's map server does.")
    if transparent and trinary:
        averaged = pixels
        notes.append(
            "the image has an alpha channel; in trinary mode it is averaged with the colours, as Nav2's map "
            "server does, so that greys read as freer than they look."
        )
    return averaged.astype(np.float64).sum(axis=-1) / averaged.shape[-1] / 255.0, opaque, notes


MOST_DRAWN_CELLS = 60_000_000
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
    """Return the map a lidar draws of objects: what it hits is occupied, the floor free, the inside of things unknown.

    The floor is every open part that holds one of the `seeds` (where the robot drives, metres), and the part that
    `main` chooses; with neither the largest open one. The map reaches `margin_m` beyond the objects.
    Raises InputError where no object has a slice.
    """
    from scipy.ndimage import binary_dilation, label

    outlines = [polygon for thing in objects for polygon in thing.slices]
    if not outlines:
        message = "no object is cut by the lidar plane, so there is nothing to draw a map of"
        raise InputError(message, code="map-no-object")
    frame = covering(np.concatenate([np.asarray(p, float) for p in outlines]), resolution_m, margin_m)
    if frame.shape[0] * frame.shape[1] > MOST_DRAWN_CELLS:
        raise InputError(
            f"a map of {frame.shape[1]} x {frame.shape[0]} cells at {resolution_m} m is too large "
            f"(at most {MOST_DRAWN_CELLS} cells): give a coarser resolution",
            code="map-too-large",
        )
    edges = outline_cells(outlines, frame)
    solid = np.zeros(frame.shape, bool)
    for thing in objects:
        solid |= inside_cells(thing.slices, frame)
    parts, count = label(~edges & ~solid)
    if count == 0:
        raise InputError("the objects leave no open floor", code="map-no-floor")
    wanted = {int(number) for seed in seeds if (number := frame.looked_up_at(parts, *seed))}
    if not wanted or main is not None:
        sizes = np.bincount(parts.ravel())
        sizes[0] = 0
        wanted.add(int(sizes.argmax()) if main is None else main(parts, sizes, frame))
    floor = np.isin(parts, sorted(wanted))
    cells = np.full(frame.shape, UNKNOWN, np.uint8)
    cells[floor] = FREE
    cells[edges & binary_dilation(floor, np.ones((3, 3), bool))] = OCCUPIED
    cells.setflags(write=False)
    return OccupancyMap(cells=cells, resolution=resolution_m, origin=frame.origin)


def write_mask(values: NDArray[np.int16], path: Path, resolution: float, origin: Pose) -> None:
    """Write the mask of a costmap filter, 0 to 100, and its picture beside it."""
    Image.fromarray(np.round(255.0 - 2.55 * values[::-1]).astype(np.uint8)).save(path.with_suffix(".pgm"))
    path.write_text(
        f"image: {path.stem}.pgm\nmode: scale\nresolution: {resolution!r}\norigin: [{origin.x!r}, {origin.y!r}, 0.0]\n"
        "negate: 0\noccupied_thresh: 1.0\nfree_thresh: 0.0\n"
    )


def write_map(occupancy: OccupancyMap, folder: Path) -> None:
    """Write `map.png` and `map.yaml` in Nav2's format."""
    grey = np.full(occupancy.cells.shape, SAVERS_UNKNOWN, np.uint8)
    grey[occupancy.cells == FREE] = 254
    grey[occupancy.cells == OCCUPIED] = 0
    Image.fromarray(grey[::-1]).save(folder / "map.png", optimize=False)
    o = occupancy.origin
    (folder / "map.yaml").write_text(
        "# The occupancy map in Nav2's format: black is occupied, white is free, grey is unknown.\n"
        f"image: map.png\nmode: trinary\nresolution: {occupancy.resolution!r}\n"
        f"origin: [{o.x!r}, {o.y!r}, {o.yaw!r}]  # x, y (m), yaw (rad) of the lower left corner\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
