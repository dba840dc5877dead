"""Reads a Gazebo world (.world, .sdf) into solid objects: sliced at the lidar height, footprints and heights kept."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.core.documents import DocumentError, Problem
from rvsg.core.errors import FileError, InputError
from rvsg.world.doors import Door
from rvsg.world.io import mesh
from rvsg.world.io.mesh import Triangles
from rvsg.world.io.model_files import ModelFiles
from rvsg.world.io.safe_xml import Element
from rvsg.world.io.sdf_doors import Leaf, in_walls, leaves_of
from rvsg.world.io.sdf_frames import Frames, Matrix, Model, frames_of
from rvsg.world.io.sdf_shapes import SHAPES, heightmap, numbers
from rvsg.world.io.sdf_tree import BUILT_IN, SdfTree
from rvsg.world.io.solid import overhead, solid_objects
from rvsg.world.world import SolidObject

LARGEST_M = 1000.0
LIDAR_HEIGHT_M = 0.21
ASKED = "left out because of --without"
Progress = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class SdfWorld:
    """What a Gazebo world reduces to, and what was left out or replaced on the way."""

    objects: tuple[SolidObject, ...]
    notes: tuple[str, ...] = ()
    doors: tuple[Door, ...] = ()
    overhead: NDArray[np.float64] | None = None
    """The faces over people's heads, seen from above (n, 3, 2); None where there are none."""


def load_sdf(
    path: str | Path,
    *,
    model_paths: Sequence[Path] = (),
    lidar_height_m: float = LIDAR_HEIGHT_M,
    floor_m: float = 0.0,
    box_for_unreadable: bool = False,
    lenient: bool = False,
    without: Sequence[str] = (),
    progress: Progress | None = None,
) -> SdfWorld:
    """Read a `.world`, `.sdf` or `.urdf` file.

    Args:
        model_paths: Folders that are searched first for models and meshes.
        lidar_height_m: Height of the lidar plane above the floor.
        floor_m: Height of the floor in the file's coordinates; it becomes 0.
        box_for_unreadable: Replace a mesh that cannot be read by the box around its vertices, and note it.
        lenient: Leave out models and meshes that are missing or unreadable, and note them.
        without: Name patterns (`robot*`) of models to leave out.
        progress: Called with a line of text as the work proceeds.

    Raises:
        DocumentError: With everything that is wrong, each with file and line.
        FileError: For a file that is neither SDF nor URDF, or holds nothing solid.
    """
    path = Path(path)
    tell = progress or (lambda _line: None)
    tell(f"Reading {path.name}")
    tree = SdfTree(ModelFiles(path, model_paths), without=without, lenient=lenient)
    reader = _Reader(tree, lidar_height_m, floor_m, box_for_unreadable, tuple(without))
    models = tree.read(path)
    for number, model in enumerate(models, start=1):
        tell(f"Model {number} of {len(models)}: {model.name}")
        reader.add(model, tree.frames, np.eye(4), model.name)
    reader.refuse_unused_patterns(path)
    tree.report_missing(path)
    if tree.problems:
        raise DocumentError(tree.problems)
    notes = [*tree.notes]
    doors = reader.doors()
    objects = _numbered_names(_short_names(reader.objects), notes)
    if not objects:
        gone = f"; {len(tree.missing)} models were not found: {_some(list(tree.missing))}" if tree.missing else ""
        raise FileError(
            path,
            f"nothing solid stands between the floor and 2 m height, so there is no obstacle{gone}",
            code="sdf-nothing-solid",
        )
    above = np.concatenate(reader.overhead) if reader.overhead else np.empty((0, 3, 2))
    return SdfWorld(
        objects=objects, notes=(*notes, *reader.all_notes()), doors=doors, overhead=above if len(above) else None
    )


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
    overhead: list[NDArray[np.float64]] = field(default_factory=list)
    leaves: list[Leaf] = field(default_factory=list)

    def add(self, model: Model, outer: Frames, base: Matrix, name: str) -> None:
        """Add a model's objects and those of the models nested in it."""
        self.met.append(name)
        if any(fnmatchcase(name, pattern) for pattern in self.without):
            self._ignore(ASKED, name)
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
        met = list(dict.fromkeys([*self.met, *self.tree.left_out, *self.tree.missing]))
        for pattern in self.without:
            if any(fnmatchcase(name, pattern) for name in (*met, *BUILT_IN)):
                continue
            listed = ", ".join(met[:12]) + (f" and {len(met) - 12} more" if len(met) > 12 else "")
            message = f'no model is called "{pattern}", so none can be left out. Models: {listed}'
            self.tree.problems.append(Problem(path, None, message, code="sdf-unknown-model"))

    def _add_links(self, model: Model, frames: Frames, pose: Matrix, name: str) -> None:
        surfaces = self._surfaces(model, frames, pose)
        if not surfaces:
            self._ignore("left out: no solid collision", name)
            return
        leaves = leaves_of(model, frames, _lowered(self.floor_m) @ pose, surfaces, name, _kind(model))
        self.leaves += leaves.values()
        parts = [surface for link, surface in surfaces.items() if link not in leaves]
        if parts:
            self._add_solid(model, pose, name, mesh.joined(parts))

    def _surfaces(self, model: Model, frames: Frames, pose: Matrix) -> dict[str, Triangles]:
        """Return the collision surface of every link that has one, above the floor."""
        found = {}
        for link, placed in model.links.items():
            parts = []
            link_pose = pose @ frames.pose(placed)
            for collision in placed.element.all("collision"):
                where = frames.pose_of_inner(self.tree.placed(collision, model.path), placed)
                surface = self._surface(collision, placed.element, model)
                if surface is not None:
                    parts.append(surface.moved(_lowered(self.floor_m) @ link_pose @ where))
            if parts:
                found[link] = mesh.joined(parts)
        return found

    def _add_solid(self, model: Model, pose: Matrix, name: str, whole: Triangles) -> None:
        size = np.ptp(whole.vertices, axis=0)
        self.overhead.append(overhead(whole))
        found = solid_objects(
            name, _kind(model), _lowered(self.floor_m) @ pose, whole, lidar_height_m=self.lidar_height_m
        )
        if not found:
            self._ignore("left out: floor, or above head height", name)
        elif float(size[:2].max()) > LARGEST_M:
            message = f'model "{name}" is {size[0]:.0f} x {size[1]:.0f} m wide: is the unit of its mesh right?'
            self.tree.problems.append(Problem(model.path, model.element.line, message, code="sdf-size"))
        else:
            self.objects.extend(found)
            if model.element.all("plugin") or any(link.element.all("sensor") for link in model.links.values()):
                self.notes.append(
                    f'model "{name}" carries sensors or a plug-in: if it is the robot, leave it out with --without.'
                )

    def doors(self) -> tuple[Door, ...]:
        """Return the doors; a leaf that stands in no wall becomes a solid object."""
        kept = in_walls(self.leaves, self.objects)
        for leaf in self.leaves:
            if leaf not in kept:
                self.objects.extend(
                    solid_objects(
                        leaf.door.name, leaf.kind, leaf.pose, leaf.surface, lidar_height_m=self.lidar_height_m
                    )
                )
        if kept:
            listed = _some([leaf.door.name for leaf in kept])
            count, opens = ("1 door is", "It opens") if len(kept) == 1 else (f"{len(kept)} doors are", "They open")
            self.notes.append(
                f"{count} proposed: {listed}. {opens} for people and the robot; doors.yaml can say otherwise."
            )
        taken: dict[str, int] = {}
        named = []
        for door in (leaf.door for leaf in kept):
            taken[door.name] = taken.get(door.name, 0) + 1
            number = taken[door.name]
            named.append(door if number == 1 else door.model_copy(update={"name": f"{door.name} {number}"}))
        return tuple(named)

    # --- geometry ---

    def _surface(self, collision: Element, link: Element, model: Model) -> Triangles | None:
        geometry = collision.find("geometry")
        if geometry is None or not geometry.children:
            message = f'the collision "{collision.attributes.get("name", "")}" has no geometry'
            self.tree.problems.append(Problem(model.path, collision.line, message, code="sdf-tag-missing"))
            return None
        shape = geometry.children[0]
        if shape.tag == "mesh":
            return self._scaled(self._mesh(shape, link, model), model)
        if shape.tag in ("empty",):
            return None
        if shape.tag in ("heightmap", "dem"):
            return self._scaled(self._terrain(shape, model), model)
        maker = SHAPES.get(shape.tag)
        if maker is None:
            self.notes.append(f'{model.path.name}:{shape.line}: a <{shape.tag}> in "{model.name}" is not read.')
            return None
        before = len(self.tree.problems)
        surface = maker(shape, model.path, self.tree.problems)
        return self._scaled(surface, model) if len(self.tree.problems) == before else None

    def _scaled(self, surface: Triangles | None, model: Model) -> Triangles | None:
        """Apply the scale of a saved state, which Gazebo applies to every shape and not to the poses."""
        return surface if surface is None or model.scale is None else surface.scaled(model.scale)

    def _terrain(self, shape: Element, model: Model) -> Triangles | None:
        uri = shape.text_of("uri")
        found = self.tree.find(uri, shape, model.path) if uri else None
        if found is None:
            return None
        if found.suffix.lower() in (".tif", ".tiff", ".dem"):
            self.notes.append(f"{model.path.name}:{shape.line}: the elevation model {found.name} is not read.")
            return None
        try:
            return heightmap(shape, found, model.path, self.tree.problems)
        except FileError as error:
            self.tree.fault(Problem.of(error), f'the terrain of "{model.name}"')
            return None

    def _mesh(self, shape: Element, link: Element, model: Model) -> Triangles | None:
        uri = shape.text_of("uri")
        found = self.tree.find(uri, shape, model.path) if uri else None
        if not uri:
            self.tree.problems.append(Problem(model.path, shape.line, "the mesh has no <uri>", code="sdf-tag-missing"))
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
            self.tree.problems.append(
                Problem(model.path, scale.line, f"a mesh scale of 0 ({scale.text.strip()})", code="sdf-size")
            )
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
                "It has no readable vertices, so there is no bounding box either."
                if self.box_for_unreadable
                else "Repair it, use its bounding box with --box-for-unreadable, or leave it out with --lenient."
            )
            problem = Problem(error.path, error.line, f"{error.reason.rstrip('.')}. {advice}", code=error.code)
            self.tree.fault(problem, f'the mesh {path.name} of "{model.name}"')
        except InputError as error:
            self.tree.problems.append(Problem(model.path, shape.line, str(error), code=error.code))
        return None

    def _ignore(self, reason: str, name: str) -> None:
        self.ignored.setdefault(reason, []).append(name)

    def all_notes(self) -> Iterator[str]:
        """Yield sentences on what was left out or replaced."""
        yield from self.notes
        for tag, names in self.tree.skipped.items():
            what = f"{len(names)} {_WORDS[tag]}{'s' if len(names) > 1 else ''}"
            given = [name for name in names if name]
            yield f"{what} skipped: {_some(given)}." if given else f"{what} skipped."
        for name in self.tree.asked:
            self._ignore(ASKED, name)
        for reason, names in self.ignored.items():
            yield f"{len(names)} model{'s' if len(names) > 1 else ''} {reason}: {_some(names)}."


_WORDS = {"light": "light", "actor": "actor", "plugin": "plug-in", "road": "road", "world": "included world"}


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _lowered(floor_m: float) -> Matrix:
    matrix = np.eye(4)
    matrix[2, 3] = -floor_m
    return matrix


# --- names --------------------------------------------------------------------------------------------------------


def _kind(model: Model) -> str:
    """Return what a model is an instance of: the model it includes, or its own name without a trailing number."""
    return model.source or re.sub(r"([_\- ]*(clone|copy)?[_\- ]*\d+)+$", "", model.name) or model.name


def _short_names(objects: Sequence[SolidObject]) -> tuple[SolidObject, ...]:
    """Return names and kinds without the leading words that all kinds share (`aws_robomaker_warehouse_`)."""
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


def _numbered_names(objects: Sequence[SolidObject], notes: list[str]) -> tuple[SolidObject, ...]:
    """Return the objects with names of their own: a name that is taken gets the first free number."""
    taken = {thing.name for thing in objects}
    used: set[str] = set()
    named = []
    for thing in objects:
        name = thing.name
        if name in used:
            name = next(f"{thing.name}_{n}" for n in count() if f"{thing.name}_{n}" not in taken)
            notes.append(f'a second model "{thing.name}" is called "{name}".')
            taken.add(name)
        used.add(name)
        named.append(thing if name == thing.name else thing.model_copy(update={"name": name}))
    return tuple(named)
