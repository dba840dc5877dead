"""Shapes as triangles: the primitives of SDF, and COLLADA, STL and OBJ files in metres.

Mesh files need the optional extra `mesh` (trimesh and pycollada), which is imported only when one is read.
"""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from rvsg.core.errors import FileError, InputError, how_to_install
from rvsg_exchange.model_files import Element, Problems, parse_xml, read_bytes

Floats = NDArray[np.float64]
FORMATS = {".dae": "dae", ".stl": "stl", ".obj": "obj", ".glb": "glb", ".gltf": "gltf"}
MOST_TRIANGLES = 2_000_000
ROUND_SIDES = 32


@dataclass(frozen=True, kw_only=True, eq=False)
class Triangles:
    """A surface: `vertices` (N, 3) in metres, `faces` (M, 3) indices, counter-clockwise from outside."""

    vertices: Floats
    faces: NDArray[np.int64]

    @cached_property
    def is_oriented(self) -> bool:
        """Whether every edge is used as often in one direction as in the other: closed bodies, also several."""
        ends = np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=-1).reshape(-1, 2)
        _, edge = np.unique(ends.min(axis=1) * len(self.vertices) + ends.max(axis=1), return_inverse=True)
        return not np.bincount(edge, np.where(ends[:, 0] < ends[:, 1], 1.0, -1.0)).any()

    @cached_property
    def volume(self) -> float:
        """Cubic metres; negative where the faces look inwards."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6.0

    def moved(self, matrix: Floats) -> Triangles:
        """Return the surface under a 4 x 4 transform."""
        return Triangles(vertices=self.vertices @ matrix[:3, :3].T + matrix[:3, 3], faces=self.faces)

    def scaled(self, factors: Floats) -> Triangles:
        """The surface with every axis scaled; a mirroring scale turns the faces so that they still look outwards."""
        faces = self.faces if float(np.prod(factors)) > 0 else self.faces[:, ::-1]
        return Triangles(vertices=self.vertices * factors, faces=faces)


def joined(parts: list[Triangles]) -> Triangles:
    """Several surfaces as one."""
    offsets = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    return Triangles(
        vertices=np.concatenate([p.vertices for p in parts]),
        faces=np.concatenate([p.faces + offset for p, offset in zip(parts, offsets, strict=True)]),
    )


def box(size: Floats) -> Triangles:
    """Return a box about the origin; `size` (3,) in metres."""
    half = np.asarray(size, np.float64) / 2.0
    outline = np.array([(-half[0], -half[1]), (half[0], -half[1]), (half[0], half[1]), (-half[0], half[1])])
    return prism(outline, -float(half[2]), float(half[2]))


def prism(outline: Floats, low: float, high: float) -> Triangles:
    """Return an upright prism over a simple outline (N, 2), counter-clockwise or not, from height `low` to `high`."""
    if _signed_area(outline) < 0:
        outline = outline[::-1]
    n = len(outline)
    vertices = np.concatenate([np.column_stack([outline, np.full(n, z)]) for z in (low, high)])
    sides = [f for i in range(n) for f in ((i, (i + 1) % n, n + (i + 1) % n), (i, n + (i + 1) % n, n + i))]
    index = {(float(x), float(y)): i for i, (x, y) in enumerate(outline)}
    caps = []
    for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(outline))):
        corners = shapely.get_coordinates(triangle)[:3]
        a, b, c = (index[(float(x), float(y))] for x, y in corners)
        if _signed_area(corners) < 0:
            b, c = c, b
        caps += [(a, c, b), (n + a, n + b, n + c)]
    return Triangles(vertices=vertices, faces=np.array(sides + caps, np.int64))


def cylinder(radius: float, length: float) -> Triangles:
    """Return an upright cylinder about the origin, as a prism of 32 sides whose area is that of the circle."""
    return prism(_circle(radius), -length / 2, length / 2)


def _circle(radius: float) -> Floats:
    """Return the corners of a regular polygon whose area is that of a circle, (32, 2)."""
    step = math.tau / ROUND_SIDES
    angles = np.arange(ROUND_SIDES) * step
    return radius * math.sqrt(step / math.sin(step)) * np.column_stack([np.cos(angles), np.sin(angles)])


def turned_profile(profile: Floats) -> Triangles:
    """A body of revolution about z; `profile` (N, 2) holds radius and height from the lower to the upper pole."""
    circle = _circle(1.0)
    rings = [np.column_stack([r * circle, np.full(ROUND_SIDES, z)]) for r, z in profile]
    faces = []
    for ring in range(len(profile) - 1):
        low, high = ring * ROUND_SIDES, (ring + 1) * ROUND_SIDES
        for i in range(ROUND_SIDES):
            j = (i + 1) % ROUND_SIDES
            faces += [(low + i, low + j, high + j), (low + i, high + j, high + i)]
    return Triangles(vertices=np.concatenate(rings), faces=np.array(faces, np.int64))


def sphere(radius: float) -> Triangles:
    """Return a sphere about the origin."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, ROUND_SIDES // 2 + 1)
    return turned_profile(radius * np.column_stack([np.cos(angles).clip(0.0), np.sin(angles)]))


def capsule(radius: float, length: float) -> Triangles:
    """Return an upright capsule: a cylinder of `length` with half spheres on both ends."""
    angles = np.linspace(0.0, math.pi / 2, ROUND_SIDES // 4 + 1)
    upper = radius * np.column_stack([np.cos(angles).clip(0.0), np.sin(angles)]) + (0.0, length / 2)
    return turned_profile(np.concatenate([upper[::-1] * (1.0, -1.0), upper]))


def cone(radius: float, length: float) -> Triangles:
    """Return an upright cone, its base down."""
    return turned_profile(np.array([(0.0, -length / 2), (radius, -length / 2), (0.0, length / 2)]))


def _signed_area(outline: Floats) -> float:
    x, y = outline[:, 0], outline[:, 1]
    return float(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y)) / 2.0


_Y_UP_TO_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])


def load_mesh(path: Path, *, submesh: str | None = None, center: bool = False) -> Triangles:
    """Read the triangles of a mesh file in metres, z up.

    A COLLADA file's unit is applied and its up axis ignored, as in Gazebo; STL and OBJ are metres and z up; glTF is
    metres and y up. Raises FileError for a file that cannot be read, has no triangles or no such `submesh`.
    """
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise FileError(
            path,
            f"mesh format {path.suffix or '(none)'} is not supported; expected dae, stl, obj or glb.",
            code="mesh-format",
        )
    content = read_bytes(path)
    if kind == "dae":
        parse_xml(path, content, keep=False)
    trimesh = _trimesh(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=None)
            parts = _parts(scene, submesh, trimesh)
            number, star, _ = (scene.units or "meters").partition("*")  # "meters" or "0.01 * meters"
            factor = float(number) if star and kind == "dae" else 1.0
    except Exception as error:  # a foreign reader of a foreign file: whatever it raises, the file cannot be read
        raise FileError(
            path, f"the mesh cannot be read: {type(error).__name__}: {error}", code="mesh-unreadable"
        ) from None
    if submesh is not None and not parts:
        names = ", ".join(sorted(str(name) for name in scene.geometry))
        raise FileError(path, f'the mesh has no part "{submesh}". Parts: {names}.', code="mesh-part-unknown")
    parts = [part for part in parts if len(part.faces)]
    if not parts:
        raise FileError(path, "the mesh holds no triangles.", code="mesh-empty")
    mesh = joined(parts).scaled(np.full(3, factor))
    if kind in ("glb", "gltf"):  # glTF has y up; SDF has z up
        mesh = mesh.moved(_Y_UP_TO_Z_UP)
    if len(mesh.faces) > MOST_TRIANGLES:
        raise FileError(
            path, f"the mesh has {len(mesh.faces)} triangles; at most {MOST_TRIANGLES} are read.", code="mesh-large"
        )
    if not np.isfinite(mesh.vertices).all():
        raise FileError(path, "the mesh has vertices that are not finite numbers.", code="mesh-unreadable")
    if center:
        middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2.0
        mesh = Triangles(vertices=mesh.vertices - middle, faces=mesh.faces)
    return mesh


def rough_box(path: Path) -> Triangles | None:
    """The box round whatever vertices can be made out in a mesh file that is broken; None where there are none."""
    content = read_bytes(path)
    kind = FORMATS.get(path.suffix.lower())
    number = rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
    factor = 1.0
    if kind == "dae":
        arrays = re.findall(rb'<float_array[^>]*id="[^"]*pos[^"]*"[^>]*>([^<]*)', content, re.IGNORECASE)
        values = [float(v) for array in arrays for v in re.findall(number, array)]
        values = values[: len(values) // 3 * 3]
        unit = re.search(rb'<unit[^>]*meter="(' + number + rb')"', content)
        factor = float(unit[1]) if unit else 1.0
    elif kind == "stl" and not content.lstrip().startswith(b"solid"):
        count = max(0, (len(content) - 84) // 50)
        records = np.frombuffer(content, np.uint8, count * 50, 84).reshape(count, 50) if count else np.empty((0, 50))
        values = list(np.ascontiguousarray(records[:, 12:48], np.uint8).view("<f4").ravel().astype(float))
    else:
        word = rb"vertex" if kind == "stl" else rb"^v"
        lines = re.findall(word + (rb"\s+(" + number + rb")") * 3, content, re.MULTILINE)
        values = [float(v) for line in lines for v in line]
    points = np.array(values, np.float64).reshape(-1, 3) * factor
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 3:
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    around = box(np.maximum(high - low, 1e-3))
    return Triangles(vertices=around.vertices + (low + high) / 2.0, faces=around.faces)


def _parts(scene: Any, submesh: str | None, trimesh: Any) -> list[Triangles]:
    parts = []
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        if submesh is not None and submesh not in (name, node):
            continue
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh):
            triangles = Triangles(
                vertices=np.array(geometry.vertices, np.float64), faces=np.array(geometry.faces, np.int64)
            )
            parts.append(triangles.moved(np.array(matrix, np.float64)))
    return parts


def _trimesh(path: Path) -> Any:
    try:
        import trimesh
    except ImportError:
        raise InputError(f"{path} is a mesh; reading it needs trimesh: {how_to_install('mesh')}") from None
    if path.suffix.lower() == ".dae":
        try:
            import collada  # noqa: F401
        except ImportError:
            raise InputError(f"{path} is a COLLADA mesh; it needs pycollada: {how_to_install('mesh')}") from None
    return trimesh


LARGEST_SIZE_M = 1e5
HEIGHTMAP_SAMPLES = 129  # per side; a finer heightmap is sampled down
MOST_HEIGHTMAP_PIXELS = 8193 * 8193


def _positive(shape: Element, tag: str, count: int, problems: Problems) -> list[float]:
    """Return positive metres; ones, and a problem, where a shape does not give them."""
    child = shape.find(tag)
    if child is None:
        problems.add(shape, f"the <{shape.tag}> has no <{tag}>", "sdf-tag-missing")
        return [1.0] * count
    before = len(problems)
    values = problems.numbers(child, count)
    if len(problems) == before and not 0 < min(values) <= max(values) <= LARGEST_SIZE_M:
        problems.add(child, f"<{tag}> must be positive metres, got {child.text.strip()}", "sdf-size")
    return values if len(problems) == before else [1.0] * count


def _round(make: Callable[[float, float], Triangles], shape: Element, problems: Problems) -> Triangles:
    radius = _positive(shape, "radius", 1, problems)[0]
    return make(radius, _positive(shape, "length", 1, problems)[0])


def _plane(shape: Element, problems: Problems) -> Triangles | None:
    """Return a thin sheet; None for a level plane, which is floor."""
    normal = np.array(problems.numbers_of(shape, "normal", (0.0, 0.0, 1.0)))
    length = float(np.linalg.norm(normal))
    if length < 1e-9:
        problems.add(shape, "the plane's <normal> is zero", "sdf-normal")
        return None
    normal = normal / length
    if abs(normal[2]) > 0.99:
        return None
    width, depth = _positive(shape, "size", 2, problems) if shape.find("size") is not None else (1.0, 1.0)
    side = np.cross([0.0, 0.0, 1.0], normal)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([side, np.cross(normal, side), normal])
    return box(np.array([width, depth, 0.01])).moved(matrix)


def _polyline(shape: Element, problems: Problems) -> Triangles | None:
    points = [problems.numbers(point, 2) for point in shape.all("point")]
    height = _positive(shape, "height", 1, problems)[0]
    if len(points) > 1 and points[0] == points[-1]:
        points = points[:-1]
    if len(points) < 3 or not shapely.Polygon(points).is_valid:
        said = "the <polyline> needs at least three points and must not cross itself"
        problems.add(shape, said, "sdf-polyline")
        return None
    return prism(np.array(points), 0.0, height)


SHAPES: dict[str, Callable[[Element, Problems], Triangles | None]] = {
    "box": lambda shape, problems: box(np.array(_positive(shape, "size", 3, problems))),
    "cylinder": partial(_round, cylinder),
    "capsule": partial(_round, capsule),
    "cone": partial(_round, cone),
    "sphere": lambda shape, problems: sphere(_positive(shape, "radius", 1, problems)[0]),
    "ellipsoid": lambda shape, problems: sphere(1.0).scaled(np.array(_positive(shape, "radii", 3, problems))),
    "plane": _plane,
    "polyline": _polyline,
}


def heightmap(shape: Element, image: Path, problems: Problems) -> Triangles:
    """Return the terrain of a `<heightmap>` as a closed body (bright is high); FileError for an unreadable image."""
    from PIL import Image, UnidentifiedImageError

    size = _positive(shape, "size", 3, problems) if shape.find("size") is not None else [1.0, 1.0, 1.0]
    offset = np.array(problems.numbers_of(shape, "pos", (0.0, 0.0, 0.0)))
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
    bottom = top * (1.0, 1.0, 0.0) - (0.0, 0.0, 1.0)
    count = z.size
    index = np.arange(count).reshape(z.shape)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    sheet = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    rim = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    following = np.roll(rim, -1)
    sides = np.concatenate(
        [np.stack([rim + count, following + count, following], -1), np.stack([rim + count, following, rim], -1)]
    )
    vertices = np.concatenate([(top + offset).reshape(-1, 3), (bottom + offset).reshape(-1, 3)])
    return Triangles(vertices=vertices, faces=np.concatenate([sheet, sheet[:, ::-1] + count, sides]).astype(np.int64))
