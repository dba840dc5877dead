"""The geometries of SDF but meshes as triangles in metres: box, cylinder, sphere, polyline, heightmap and others."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rvsg.core.documents import Problem
from rvsg.core.errors import FileError
from rvsg.world.io import mesh
from rvsg.world.io.mesh import Triangles
from rvsg.world.io.safe_xml import Element

LARGEST_SIZE_M = 1e5
HEIGHTMAP_SAMPLES = 129  # per side; a finer heightmap is sampled down
MOST_HEIGHTMAP_PIXELS = 8193 * 8193


def numbers(text: str, count: int, element: Element, path: Path, problems: list[Problem]) -> list[float]:
    """Return `count` finite numbers; zeros, and a problem, if the text is something else."""
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) == count and all(math.isfinite(v) for v in values):
        return values
    problems.append(
        Problem(
            path, element.line, f'<{element.tag}> must be {count} finite numbers, got "{text[:80]}"', code="sdf-numbers"
        )
    )
    return [0.0] * (count - 1) + [1.0]


def _positive(shape: Element, tag: str, count: int, path: Path, problems: list[Problem]) -> list[float]:
    child = shape.find(tag)
    if child is None:
        problems.append(Problem(path, shape.line, f"the <{shape.tag}> has no <{tag}>", code="sdf-tag-missing"))
        return [1.0] * count
    before = len(problems)
    values = numbers(child.text.strip(), count, child, path, problems)
    if len(problems) > before:
        return [1.0] * count
    if min(values) <= 0 or max(values) > LARGEST_SIZE_M:
        problems.append(
            Problem(path, child.line, f"<{tag}> must be positive metres, got {child.text.strip()}", code="sdf-size")
        )
        return [1.0] * count
    return values


def _box(shape: Element, path: Path, problems: list[Problem]) -> Triangles:
    return mesh.box(np.array(_positive(shape, "size", 3, path, problems)))


def _round(make: Callable[[float, float], Triangles]) -> Callable[[Element, Path, list[Problem]], Triangles]:
    def read(shape: Element, path: Path, problems: list[Problem]) -> Triangles:
        radius = _positive(shape, "radius", 1, path, problems)[0]
        return make(radius, _positive(shape, "length", 1, path, problems)[0])

    return read


def _sphere(shape: Element, path: Path, problems: list[Problem]) -> Triangles:
    return mesh.sphere(_positive(shape, "radius", 1, path, problems)[0])


def _ellipsoid(shape: Element, path: Path, problems: list[Problem]) -> Triangles:
    return mesh.sphere(1.0).scaled(np.array(_positive(shape, "radii", 3, path, problems)))


def _plane(shape: Element, path: Path, problems: list[Problem]) -> Triangles | None:
    """Return a thin sheet; None for a level plane, which is floor."""
    given = shape.find("normal")
    normal = np.array(numbers(given.text.strip(), 3, given, path, problems) if given is not None else [0.0, 0.0, 1.0])
    length = float(np.linalg.norm(normal))
    if length < 1e-9:
        problems.append(Problem(path, shape.line, "the plane's <normal> is zero", code="sdf-normal"))
        return None
    normal = normal / length
    if abs(normal[2]) > 0.99:
        return None
    width, depth = _positive(shape, "size", 2, path, problems) if shape.find("size") is not None else (1.0, 1.0)
    side = np.cross([0.0, 0.0, 1.0], normal)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([side, np.cross(normal, side), normal])
    return mesh.box(np.array([width, depth, 0.01])).moved(matrix)


def _polyline(shape: Element, path: Path, problems: list[Problem]) -> Triangles | None:
    import shapely

    points = [numbers(p.text.strip(), 2, p, path, problems) for p in shape.all("point")]
    height = _positive(shape, "height", 1, path, problems)[0]
    if len(points) > 1 and points[0] == points[-1]:
        points = points[:-1]
    if len(points) < 3 or not shapely.Polygon(points).is_valid:
        problems.append(
            Problem(
                path,
                shape.line,
                "the <polyline> needs at least three points and must not cross itself",
                code="sdf-polyline",
            )
        )
        return None
    return mesh.prism(np.array(points), 0.0, height)


SHAPES: dict[str, Callable[[Element, Path, list[Problem]], Triangles | None]] = {
    "box": _box,
    "cylinder": _round(mesh.cylinder),
    "capsule": _round(mesh.capsule),
    "cone": _round(mesh.cone),
    "sphere": _sphere,
    "ellipsoid": _ellipsoid,
    "plane": _plane,
    "polyline": _polyline,
}


def heightmap(shape: Element, image: Path, path: Path, problems: list[Problem]) -> Triangles | None:
    """Return the terrain of a `<heightmap>` as a closed body: brightness is height, black is the lowest.

    Raises FileError for an image that cannot be read.
    """
    from PIL import Image, UnidentifiedImageError

    size = _positive(shape, "size", 3, path, problems) if shape.find("size") is not None else [1.0, 1.0, 1.0]
    at = shape.find("pos")
    offset = np.array(numbers(at.text.strip(), 3, at, path, problems) if at is not None else [0.0, 0.0, 0.0])
    try:
        with Image.open(image) as opened:
            if opened.width * opened.height > MOST_HEIGHTMAP_PIXELS:
                raise FileError(image, f"the heightmap has {opened.width} x {opened.height} pixels; that is too large.")
            deep = opened.mode.startswith("I")
            grey = np.asarray(opened if deep else opened.convert("L"), np.float64) / (65535.0 if deep else 255.0)
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError) as error:
        raise FileError(image, f"the heightmap cannot be read as an image: {error}") from None
    rows, columns = (np.linspace(0, n - 1, min(n, HEIGHTMAP_SAMPLES)).round().astype(int) for n in grey.shape)
    z = grey[np.ix_(rows, columns)][::-1] * size[2]  # the image's first row is the terrain's highest y
    x, y = np.linspace(-size[0] / 2, size[0] / 2, len(columns)), np.linspace(-size[1] / 2, size[1] / 2, len(rows))
    top = np.stack([*np.meshgrid(x, y), z], axis=-1)
    bottom = top.copy()
    bottom[..., 2] = -1.0
    return _closed_terrain(top + offset, bottom + offset)


def _closed_terrain(top: mesh.Floats, bottom: mesh.Floats) -> Triangles:
    """Return the body between two sheets of points (rows, columns, 3)."""
    rows, columns = top.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    sheet = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    count = rows * columns
    rim = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    following = np.roll(rim, -1)
    sides = np.concatenate(
        [np.stack([rim + count, following + count, following], -1), np.stack([rim + count, following, rim], -1)]
    )
    vertices = np.concatenate([top.reshape(-1, 3), bottom.reshape(-1, 3)])
    return Triangles(vertices=vertices, faces=np.concatenate([sheet, sheet[:, ::-1] + count, sides]).astype(np.int64))
