"""Reader of the map a Nav2 robot localises in: `map.yaml` with its pgm, png or bmp image.

Cells are classified as nav2_map_server does (navigation2, `map_io`: threshold comparisons, alpha and the three modes)
and then made trinary as Nav2's static costmap layer does by default (`trinary_costmap`, lethal threshold 100).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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


@dataclass(frozen=True, kw_only=True)
class Nav2Map:
    """A map as read: the occupancy (its origin may be turned), the image it came from, and what is worth knowing."""

    occupancy: OccupancyMap
    image: Path
    mode: str
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Header:
    image: Path
    resolution: float
    origin: Pose
    mode: str
    negate: bool
    occupied_thresh: float
    free_thresh: float


def load_nav2_map(
    path: str | Path, *, free_thresh: float | None = None, occupied_thresh: float | None = None
) -> Nav2Map:
    """Read `map.yaml` and its image; the two thresholds can be overridden.

    FileError with everything that is wrong in the header at once, or with what is wrong with the image: missing,
    unreadable, 16 bits deep, absurdly large or small, without a single free cell.
    """
    path = Path(path)
    if path.suffix.lower() in IMAGE_SUFFIXES:
        raise FileError(
            path,
            f"this is the picture of a map; give the yaml file that describes it ({path.stem}.yaml?)",
            code="map-picture",
        )
    document = read_yaml(path)
    header = _header(document, free_thresh, occupied_thresh)
    shade, opaque, notes = _shade(header.image, trinary=header.mode == "trinary", document=document)
    rows, columns = shade.shape
    _refuse_absurd_sides(document, header, rows, columns)
    cells = trinary(classify(shade, opaque, header))[::-1]
    notes = [*notes, *_grey_notes(shade, header)]
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
    occupancy = OccupancyMap(cells=np.ascontiguousarray(cells), resolution=header.resolution, origin=header.origin)
    return Nav2Map(occupancy=occupancy, image=header.image, mode=header.mode, notes=tuple(notes))


def classify(shade: NDArray[np.float64], opaque: NDArray[np.bool_], header: Any) -> NDArray[np.int16]:
    """Return the value of every cell as nav2_map_server publishes it: 0 to 100, -1 unknown.

    `shade` (rows, columns) is the brightness from 0 to 1, `opaque` whether the pixel is fully opaque; `header` has
    mode, negate, occupied_thresh and free_thresh. Rows stay in the image's order (top first).
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
    return upright(load_nav2_map(path).occupancy)


def upright(occupancy: OccupancyMap) -> OccupancyMap:
    """Return the same map with its cells along the axes of the map frame (origin yaw 0), at the same resolution.

    A turned map is sampled at 3 x 3 points per cell: occupied where three or more of them are, else unknown where
    most are, else free; what lies outside the original is unknown.
    """
    yaw = math.remainder(occupancy.origin.yaw, math.tau)
    if abs(yaw) < 1e-9:
        return (
            occupancy
            if occupancy.origin.yaw == 0.0
            else _with_origin(occupancy, occupancy.origin.x, occupancy.origin.y)
        )
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
    occupied = np.zeros((high, wide), np.uint8)
    unknown = np.zeros((high, wide), np.uint8)
    for part_x in (1 / 6, 3 / 6, 5 / 6):
        for part_y in (1 / 6, 3 / 6, 5 / 6):
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


def _with_origin(occupancy: OccupancyMap, x: float, y: float) -> OccupancyMap:
    return OccupancyMap(cells=occupancy.cells, resolution=occupancy.resolution, origin=Pose(x=x, y=y, yaw=0.0))


# --- the header ---------------------------------------------------------------------------------------------------


def _header(document: Document, free_thresh: float | None, occupied_thresh: float | None) -> _Header:
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
    occupied = occupied if occupied_thresh is None else occupied_thresh
    if not problems and not free < occupied:
        message = f"free_thresh ({free:g}) must be smaller than occupied_thresh ({occupied:g})"
        problems.append(document.problem(message, "free_thresh"))
    origin = _origin(document, problems)
    mode = str(data.get("mode", "trinary")).lower()
    if mode not in MODES:
        problems.append(document.problem(f"mode must be one of {', '.join(MODES)}, got {data['mode']!r}", "mode"))
    negate = data.get("negate")
    if negate not in (0, 1):
        problems.append(document.problem(f"negate must be 0 or 1, usually 0, got {negate!r}", "negate"))
    image = _image_path(document, problems)
    if problems:
        raise DocumentError(sorted(problems, key=lambda problem: problem.line or 0))
    return _Header(
        image=image,
        resolution=resolution,
        origin=origin,
        mode=mode,
        negate=bool(negate),
        occupied_thresh=occupied,
        free_thresh=free,
    )


def _as_float(value: Any) -> float | None:
    """Return a finite number; YAML 1.1 reads `5e-2` as text, Nav2's reader as a number, so text is tried too."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _origin(document: Document, problems: list[Problem]) -> Pose:
    given = document.value.get("origin")
    values = [_as_float(v) for v in given] if isinstance(given, list) else []
    numbers = [v for v in values if v is not None]
    if len(values) != 3 or len(numbers) != 3:
        wanted = "[x, y, yaw] of the image's lower left corner, metres and radians"
        problems.append(document.problem(f"origin must be three numbers, {wanted}, got {given!r}", "origin"))
        return Pose(x=0.0, y=0.0)
    x, y, yaw = numbers
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
    return Pose(x=x, y=y, yaw=yaw)


def _image_path(document: Document, problems: list[Problem]) -> Path:
    name = document.value.get("image")
    if not isinstance(name, str) or not name:
        problems.append(document.problem(f"image must name the map's picture, such as map.pgm, got {name!r}", "image"))
        return document.path
    image = document.path.parent / name
    if not image.is_file():
        there = sorted(p.name for p in image.parent.glob("*") if p.suffix.lower() in IMAGE_SUFFIXES)
        listed = f"Images there: {', '.join(there[:10])}" if there else "There is no pgm, png or bmp image there"
        problems.append(document.problem(f"the image {image} does not exist. {listed}", "image"))
    return image


# --- the image ----------------------------------------------------------------------------------------------------


def _shade(
    path: Path, *, trinary: bool, document: Document
) -> tuple[NDArray[np.float64], NDArray[np.bool_], list[str]]:
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
                raise FileError(
                    path,
                    f"the image has more than 8 bits per channel ({image.mode}); Nav2 maps are "
                    "8 bit. Convert it to 8-bit grey first (an 8-bit map needs no more than three "
                    "shades).",
                    code="map-depth",
                )
            if wide == 0 or high == 0:
                raise FileError(path, f"the image is empty ({wide} x {high} pixels).")
            transparent = "A" in image.getbands() or "transparency" in image.info
            coloured = image.mode not in ("1", "L", "LA")
            pixels = np.asarray(image.convert("RGBA" if transparent else "RGB" if coloured else "L"))
    except UnidentifiedImageError:
        raise FileError(path, "this is not a readable pgm, png or bmp image.") from None
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise FileError(
            path, f"the image is far too large; at most {MOST_CELLS} pixels are supported.", code="map-too-large"
        ) from None
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        raise FileError(path, f"the image cannot be read: {error}. Is the file complete?") from None
    if pixels.ndim == 2:
        return pixels / 255.0, np.ones(pixels.shape, np.bool_), notes
    colour = pixels[..., :3].astype(np.float64)
    if np.ptp(pixels[..., :3], axis=-1).any():
        notes.append("the image is coloured; its channels are averaged, as Nav2's map server does.")
    opaque = pixels[..., 3] == 255 if transparent else np.ones(pixels.shape[:2], np.bool_)
    if transparent and trinary:
        notes.append(
            "the image has an alpha channel; in trinary mode it is averaged with the colours, as Nav2's map "
            "server does, so that greys read as freer than they look."
        )
        return pixels.astype(np.float64).sum(axis=-1) / 4.0 / 255.0, opaque, notes
    return colour.sum(axis=-1) / 3.0 / 255.0, opaque, notes


def _refuse_absurd_sides(document: Document, header: _Header, rows: int, columns: int) -> None:
    wide, high = columns * header.resolution, rows * header.resolution
    if max(wide, high) > LONGEST_SIDE_M:
        problem = document.problem(
            f"the map would be {wide:g} x {high:g} m ({columns} x {rows} cells of {header.resolution:g} m); at most "
            f"{LONGEST_SIDE_M:g} m a side are supported. Is the resolution in metres?",
            "resolution",
        )
        raise DocumentError([problem])
    if min(rows, columns) < 2:
        raise FileError(
            header.image, f"the image has {columns} x {rows} pixels: too few to be a map.", code="map-too-small"
        )


def _grey_notes(shade: NDArray[np.float64], header: _Header) -> list[str]:
    """Return what to know when the grey that map savers write for unknown is taken for free."""
    if header.mode != "trinary" or header.negate:
        return []
    grey = np.isclose(shade, SAVERS_UNKNOWN / 255.0, atol=1e-6)
    share = float(grey.mean())
    occupied_share = 1.0 - SAVERS_UNKNOWN / 255.0
    if share > 0.0 and occupied_share < header.free_thresh:
        return [
            f"{share:.0%} of the pixels have the grey {SAVERS_UNKNOWN} that map savers write for unknown, and with "
            f"free_thresh {header.free_thresh:g} they count as free, as they do for Nav2. If they are unknown, "
            "give a free threshold of 0.196."
        ]
    return []


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
