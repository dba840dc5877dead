"""Reads a Gazebo world (.world, .sdf) into solid objects: sliced at the lidar height, footprints and heights kept."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from rvsg.core.documents import DocumentError, Problem
from rvsg.core.errors import FileError, InputError
from rvsg.world.io import mesh
from rvsg.world.io.mesh import Triangles
from rvsg.world.io.safe_xml import Element
from rvsg.world.io.sdf_tree import Frames, Matrix, Model, SdfTree, frames_of, numbers, search_folders
from rvsg.world.io.solid import solid_objects
from rvsg.world.world import SolidObject

LARGEST_M = 1000.0
LIDAR_HEIGHT_M = 0.21


@dataclass(frozen=True, kw_only=True)
class SdfWorld:
    """What a Gazebo world reduces to, and what was left out or replaced on the way."""

    objects: tuple[SolidObject, ...]
    notes: tuple[str, ...] = ()


def load_sdf(
    path: str | Path,
    *,
    model_paths: Sequence[Path] = (),
    lidar_height_m: float = LIDAR_HEIGHT_M,
    floor_m: float = 0.0,
    box_for_unreadable: bool = False,
    without: Sequence[str] = (),
) -> SdfWorld:
    """Read a `.world` or `.sdf` file.

    `model_paths` are searched first for `model://` includes and meshes; `floor_m` is the height of the floor in the
    world, which becomes 0; `without` are name patterns (`robot*`) of models to leave out. A mesh that cannot be read
    is an error, or with `box_for_unreadable` replaced by the box round its vertices, and noted.

    Raises DocumentError with everything that is wrong at once (includes not found with the folders searched, cyclic
    includes, unreadable meshes, bad numbers, a pattern of `without` that no model matches), each with file and line;
    FileError for a file that is no SDF.
    """
    path = Path(path)
    tree = SdfTree(search_folders(path, model_paths))
    reader = _Reader(tree, lidar_height_m, floor_m, box_for_unreadable, tuple(without))
    models = tree.read(path)
    for model in models:
        reader.add(model, tree.frames, np.eye(4), model.name)
    reader.refuse_unused_patterns(path)
    if tree.problems:
        raise DocumentError(tree.problems)
    objects = _short_names(reader.objects)
    if not objects:
        raise FileError(path, "no model of the world stands between the floor and 2 m height: nothing is solid here")
    _refuse_equal_names(path, objects)
    return SdfWorld(objects=objects, notes=(*tree.notes, *reader.all_notes()))


@dataclass
class _Reader:
    tree: SdfTree
    lidar_height_m: float
    floor_m: float
    box_for_unreadable: bool
    without: tuple[str, ...]
    objects: list[SolidObject] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    ignored: dict[str, list[str]] = field(default_factory=dict)
    meshes: dict[tuple[Path, str | None, bool], Triangles | None] = field(default_factory=dict)
    met: list[str] = field(default_factory=list)

    def add(self, model: Model, outer: Frames, base: Matrix, name: str) -> None:
        """Add a model's objects and those of the models nested in it."""
        self.met.append(name)
        if any(fnmatchcase(name, pattern) for pattern in self.without):
            self._ignore("left out as asked", name)
            return
        inner = frames_of(model, self.tree.problems)
        pose = base @ outer.model_pose(model)
        if model.links:
            self._add_links(model, inner, pose, name)
        wrapper = not model.links and len(model.children) == 1
        for child in model.children:
            self.add(child, inner, pose, name if wrapper else f"{name}/{child.name}")

    def refuse_unused_patterns(self, path: Path) -> None:
        """A pattern that matches nothing is a mistake: what it should leave out (a robot) would become an obstacle."""
        for pattern in self.without:
            if any(fnmatchcase(name, pattern) for name in self.met):
                continue
            listed = ", ".join(self.met[:12]) + (f" and {len(self.met) - 12} more" if len(self.met) > 12 else "")
            message = f'no model is called "{pattern}", so none can be left out. Models: {listed}'
            self.tree.problems.append(Problem(path, None, message))

    def _add_links(self, model: Model, frames: Frames, pose: Matrix, name: str) -> None:
        parts = []
        for placed in model.links.values():
            link_pose = pose @ frames.pose(placed)
            for collision in placed.element.all("collision"):
                where = frames.pose_of_inner(self.tree, collision, model.path, placed)
                surface = self._surface(collision, placed.element, model)
                if surface is not None:
                    parts.append(surface.moved(_lowered(self.floor_m) @ link_pose @ where))
        if not parts:
            self._ignore("left out, without a solid collision", name)
            return
        whole = mesh.joined(parts)
        size = np.ptp(whole.vertices, axis=0)
        found = solid_objects(
            name, _kind(model), _lowered(self.floor_m) @ pose, whole, lidar_height_m=self.lidar_height_m
        )
        if not found:
            self._ignore("left out, being floor or hanging above head height", name)
        elif float(size[:2].max()) > LARGEST_M:
            message = f'model "{name}" is {size[0]:.0f} x {size[1]:.0f} m wide: is the unit of its mesh right?'
            self.tree.problems.append(Problem(model.path, model.element.line, message))
        else:
            self.objects.extend(found)
            if model.element.all("plugin") or any(link.element.all("sensor") for link in model.links.values()):
                self.notes.append(
                    f'model "{name}" carries sensors or a plug-in: if it is the robot, leave it out with --without.'
                )

    # --- geometry ---

    def _surface(self, collision: Element, link: Element, model: Model) -> Triangles | None:
        geometry = collision.find("geometry")
        if geometry is None or not geometry.children:
            message = f'the collision "{collision.attributes.get("name", "")}" has no geometry'
            self.tree.problems.append(Problem(model.path, collision.line, message))
            return None
        shape = geometry.children[0]
        if shape.tag == "mesh":
            return self._mesh(shape, link, model)
        if shape.tag in ("empty",):
            return None
        maker = _SHAPES.get(shape.tag)
        if maker is None:
            self.notes.append(f'{model.path.name}:{shape.line}: a <{shape.tag}> in "{model.name}" is not read.')
            return None
        before = len(self.tree.problems)
        surface = maker(shape, model.path, self.tree.problems)
        return surface if len(self.tree.problems) == before else None

    def _mesh(self, shape: Element, link: Element, model: Model) -> Triangles | None:
        uri = shape.text_of("uri")
        found = self.tree.find(uri, shape, model.path) if uri else None
        if not uri:
            self.tree.problems.append(Problem(model.path, shape.line, "the mesh has no <uri>"))
        if found is None:
            return None
        part = shape.find("submesh")
        submesh = part.text_of("name") or None if part is not None else None
        center = part is not None and part.text_of("center").lower() in ("true", "1")
        key = (found.resolve(), submesh, center)
        if key not in self.meshes:
            self.meshes[key] = self._loaded(found, submesh, center, shape, model)
        surface = self.meshes[key]
        scale = shape.find("scale")
        if surface is None or scale is None:
            return surface
        factors = np.array(numbers(scale.text.strip(), 3, scale, model.path, self.tree.problems))
        if not factors.all():
            self.tree.problems.append(Problem(model.path, scale.line, f"a mesh scale of 0 ({scale.text.strip()})"))
            return None
        return surface.scaled(factors)

    def _loaded(self, path: Path, submesh: str | None, center: bool, shape: Element, model: Model) -> Triangles | None:
        try:
            return mesh.load_mesh(path, submesh=submesh, center=center)
        except FileError as error:
            rough = mesh.rough_box(path) if self.box_for_unreadable else None
            if rough is not None:
                self.notes.append(f'{path.name} of "{model.name}" cannot be read; its bounding box is used instead.')
                return rough
            advice = (
                "Not even a bounding box can be made out."
                if self.box_for_unreadable
                else "Mend it, or allow its bounding box instead with --box-for-unreadable."
            )
            self.tree.problems.append(Problem(error.path, error.line, f"{error.reason.rstrip('.')}. {advice}"))
        except InputError as error:
            self.tree.problems.append(Problem(model.path, shape.line, str(error)))
        return None

    def _ignore(self, reason: str, name: str) -> None:
        self.ignored.setdefault(reason, []).append(name)

    def all_notes(self) -> Iterator[str]:
        """What was left out or replaced, in sentences."""
        yield from self.notes
        for reason, names in self.ignored.items():
            listed = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
            yield f"{len(names)} model{'s' if len(names) > 1 else ''} {reason}: {listed}."


def _lowered(floor_m: float) -> Matrix:
    matrix = np.eye(4)
    matrix[2, 3] = -floor_m
    return matrix


# --- shapes -------------------------------------------------------------------------------------------------------


def _positive(shape: Element, tag: str, count: int, path: Path, problems: list[Problem]) -> list[float]:
    child = shape.find(tag)
    if child is None:
        problems.append(Problem(path, shape.line, f"the <{shape.tag}> has no <{tag}>"))
        return [1.0] * count
    before = len(problems)
    values = numbers(child.text.strip(), count, child, path, problems)
    if len(problems) > before:
        return [1.0] * count
    if min(values) <= 0 or max(values) > 1e5:
        problems.append(Problem(path, child.line, f"<{tag}> must be positive metres, got {child.text.strip()}"))
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
    """A level plane is floor; any other one a thin sheet of its size."""
    given = shape.find("normal")
    normal = np.array(numbers(given.text.strip(), 3, given, path, problems) if given is not None else [0.0, 0.0, 1.0])
    length = float(np.linalg.norm(normal))
    if length < 1e-9:
        problems.append(Problem(path, shape.line, "the plane's <normal> is zero"))
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
            Problem(path, shape.line, "the <polyline> needs at least three points and must not cross itself")
        )
        return None
    return mesh.prism(np.array(points), 0.0, height)


_SHAPES: dict[str, Callable[[Element, Path, list[Problem]], Triangles | None]] = {
    "box": _box,
    "cylinder": _round(mesh.cylinder),
    "capsule": _round(mesh.capsule),
    "cone": _round(mesh.cone),
    "sphere": _sphere,
    "ellipsoid": _ellipsoid,
    "plane": _plane,
    "polyline": _polyline,
}


# --- names --------------------------------------------------------------------------------------------------------


def _kind(model: Model) -> str:
    """What a model is an instance of: the model it includes, or its own name without a trailing number."""
    return model.source or re.sub(r"([_\- ]*(clone|copy)?[_\- ]*\d+)+$", "", model.name) or model.name


def _short_names(objects: Sequence[SolidObject]) -> tuple[SolidObject, ...]:
    """Names and kinds without the leading words that all kinds share (`aws_robomaker_warehouse_`)."""
    kinds = sorted({thing.kind for thing in objects})
    if len(kinds) < 2:
        return tuple(objects)
    words = [kind.split("_") for kind in kinds]
    shared = 0
    while all(len(w) > shared + 1 and w[shared] == words[0][shared] for w in words):
        shared += 1
    prefix = "".join(f"{word}_" for word in words[0][:shared])
    if not prefix:
        return tuple(objects)
    return tuple(
        thing.model_copy(update={"name": thing.name.removeprefix(prefix), "kind": thing.kind.removeprefix(prefix)})
        for thing in objects
    )


def _refuse_equal_names(path: Path, objects: Sequence[SolidObject]) -> None:
    twice = [name for name, count in Counter(thing.name for thing in objects).items() if count > 1]
    if twice:
        raise FileError(
            path, f"several models would be named {', '.join(sorted(twice)[:5])}; give them names of their own"
        )
