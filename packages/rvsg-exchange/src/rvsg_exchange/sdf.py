"""Gazebo worlds (.world, .sdf) as solid objects: sliced at the lidar height, footprints, heights and doors."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import count
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from rvsg.core.documents import DocumentError, Problem
from rvsg.core.errors import FileError, InputError
from rvsg.world.creation import Progress, WorldSource
from rvsg.world.lattice import LIDAR_HEIGHT_M
from rvsg.world.world import WIDTHS_M, Door, Point, SolidObject
from rvsg_exchange import mesh
from rvsg_exchange.mesh import SHAPES, Triangles, heightmap
from rvsg_exchange.model_files import Element, ModelFiles
from rvsg_exchange.sdf_tree import BUILT_IN, Frames, Matrix, Model, SdfTree
from rvsg_exchange.solid import overhead, solid_objects

LOWEST_M, SHORTEST_M = 0.3, 1.4
"""A leaf begins at most this high above the floor, and is at least so high."""
THICKEST_M = 0.25
THIN = 0.35
"""A leaf is at most this share of its width thick."""
ALONG = 0.9
"""The cosine of the angle within which an axis counts as upright, or as along the leaf."""
AT_END = 0.3
"""The hinge of a leaf is at most this share of its width away from its end; in the middle, it is a turnstile."""
TURN_RAD = math.radians(30.0)
SLIDE = 0.5
"""A sliding leaf moves by at least this share of its width."""
WALL_M = 0.3
"""The wall or the frame is this near to the end at which a leaf is held."""
ROOM_M = 0.4
"""This far to both sides of a leaf is open floor; a cupboard has its inside on one."""


@dataclass(frozen=True)
class Leaf:
    """A link that may be the leaf of a door."""

    door: Door
    surface: Triangles
    kind: str
    pose: Matrix


def leaves_of(
    model: Model, frames: Frames, pose: Matrix, surfaces: dict[str, Triangles], name: str, kind: str
) -> dict[str, Leaf]:
    """Return the links of a model that look like leaves, by name; pose and surfaces lie above the floor."""
    if model.element.is_true("static"):
        return {}
    found = {}
    for joint in model.element.all("joint"):
        child = joint.text_of("child").rpartition("::")[2]
        if child not in surfaces or joint.attributes.get("type") not in ("revolute", "continuous", "prismatic"):
            continue
        door = _door(joint, pose @ frames.pose(model.frames[joint.name]), pose, surfaces[child], name)
        if door is not None:
            found[child] = door
    if len(found) > 1:
        found = {link: door.model_copy(update={"name": f"{name} {link}"}) for link, door in found.items()}
    return {link: Leaf(door, surfaces[link], kind, pose) for link, door in found.items()}


def _door(joint: Element, at: Matrix, model: Matrix, surface: Triangles, name: str) -> Door | None:
    """Return the door whose leaf a joint moves; None where it looks like something else."""
    ends = _ends(surface.vertices)
    if ends is None:
        return None
    a, b, thickness = ends
    axis, low, high = _axis(joint, at, model)
    width = math.dist(a, b)
    far = high if abs(high) >= abs(low) else low
    thickness_m = round(max(thickness, 0.01), 3)
    if joint.attributes.get("type") == "prismatic":
        along = float(np.dot(axis[:2], np.subtract(b, a))) / width * (1.0 if far >= 0 else -1.0)
        if abs(along) < ALONG or abs(far) < SLIDE * width:
            return None
        hinge, end = (b, a) if along > 0 else (a, b)
        return Door(name=name, hinge=hinge, end=end, kind="sliding", thickness_m=thickness_m)
    anchor = (float(at[0, 3]), float(at[1, 3]))
    hinge, end = sorted((a, b), key=lambda point: math.dist(point, anchor))
    if abs(axis[2]) < ALONG or math.dist(hinge, anchor) > max(AT_END * width, 2 * thickness) or abs(far) < TURN_RAD:
        return None
    return Door(
        name=name,
        hinge=hinge,
        end=end,
        kind="swing",
        turns="left" if far * axis[2] > 0 else "right",
        thickness_m=thickness_m,
    )


def _ends(vertices: NDArray[np.float64]) -> tuple[Point, Point, float] | None:
    """Return the ends of a leaf's middle line and its thickness, metres; None where it is no upright leaf."""
    low, high = float(vertices[:, 2].min()), float(vertices[:, 2].max())
    if low > LOWEST_M or high - max(low, 0.0) < SHORTEST_M:
        return None
    corners = shapely.get_coordinates(shapely.oriented_envelope(shapely.MultiPoint(vertices[:, :2])))[:4]
    if len(corners) < 4:
        return None
    sides = [math.dist(corners[i], corners[i + 1]) for i in (0, 1)]
    first = 0 if sides[0] <= sides[1] else 1  # the two short sides, whose middles are the ends
    thickness, width = sides[first], sides[1 - first]
    if not WIDTHS_M[0] <= width <= WIDTHS_M[1] or thickness > min(THICKEST_M, THIN * width):
        return None
    middles = [(corners[i] + corners[(i + 1) % 4]) / 2 for i in (first, first + 2)]
    a, b = ((round(float(x), 3), round(float(y), 3)) for x, y in middles)
    return a, b, thickness


def _axis(joint: Element, at: Matrix, model: Matrix) -> tuple[NDArray[np.float64], float, float]:
    """Return the axis of a joint in the world and its limits; without limits it moves without end."""
    axis = joint.find("axis") or Element("axis", {}, joint.line)
    xyz, limit = axis.find("xyz"), axis.find("limit")
    in_model = axis.is_true("use_parent_model_frame")
    if xyz is not None:
        in_model = in_model or xyz.attributes.get("expressed_in") == "__model__"
    values = _finite(xyz.text if xyz is not None else "")
    direction = (model if in_model else at)[:3, :3] @ np.array(values if len(values) == 3 else (0.0, 0.0, 1.0))
    lower, upper = (_finite(limit.text_of(key)) if limit is not None else [] for key in ("lower", "upper"))
    low, high = (given[0] if len(given) == 1 else usual for given, usual in ((lower, -99.0), (upper, 99.0)))
    return direction / max(float(np.linalg.norm(direction)), 1e-12), low, high


def _finite(text: str) -> list[float]:
    """Return the numbers of a text; none where one is no finite number."""
    try:
        values = [float(v) for v in text.split()]
    except ValueError:
        return []
    return values if all(math.isfinite(v) for v in values) else []


def in_walls(leaves: Sequence[Leaf], solids: Sequence[SolidObject]) -> list[Leaf]:
    """Return the leaves that are held by something solid and have open floor on both sides."""
    tree = shapely.STRtree([shapely.Polygon(thing.footprint, thing.holes).buffer(0) for thing in solids])

    def is_near(at: Point, reach_m: float) -> bool:
        return len(tree.query(shapely.Point(at), predicate="dwithin", distance=reach_m)) > 0

    found = []
    for leaf in leaves:
        door = leaf.door
        (x, y), (hx, hy), (ex, ey) = door.middle, door.hinge, door.end
        out = door.thickness_m / 2 + ROOM_M
        across = (-(ey - hy) / door.width_m * out, (ex - hx) / door.width_m * out)
        sides = [(x + sign * across[0], y + sign * across[1]) for sign in (1.0, -1.0)]
        if is_near(door.hinge, WALL_M) and not any(is_near(side, 0.0) for side in sides):
            found.append(leaf)
    return found


LARGEST_M = 1000.0
ASKED = "left out because of --without"


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
) -> WorldSource:
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
    reader = _Reader(tree, lidar_height_m, floor_m, box_for_unreadable)
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
        said = f"nothing solid stands between the floor and 2 m height, so there is no obstacle{gone}"
        raise FileError(path, said, code="sdf-nothing-solid")
    above = np.concatenate(reader.overhead) if reader.overhead else np.empty((0, 3, 2))
    notes += reader.all_notes()
    return WorldSource(objects=objects, notes=tuple(notes), doors=doors, overhead=above if len(above) else None)


class _Reader:
    """The solid objects, doors and notes of the models of a tree."""

    def __init__(self, tree: SdfTree, lidar_height_m: float, floor_m: float, box_for_unreadable: bool) -> None:
        self.tree, self.lidar_height_m, self.box_for_unreadable = tree, lidar_height_m, box_for_unreadable
        self.lowered = np.eye(4)
        self.lowered[2, 3] = -floor_m
        self.objects: list[SolidObject] = []
        self.notes: list[str] = []
        self.ignored: dict[str, list[str]] = {}
        self.meshes: dict[tuple[Path, str | None, bool], Triangles | None] = {}
        self.met: list[str] = []
        self.overhead: list[NDArray[np.float64]] = []
        self.leaves: list[Leaf] = []

    def add(self, model: Model, outer: Frames, base: Matrix, name: str) -> None:
        """Add a model's objects and those of the models nested in it."""
        self.met.append(name)
        if any(fnmatchcase(name, pattern) for pattern in self.tree.without):
            self._ignore(ASKED, name)
            return
        inner = Frames.of(model, self.tree.problems)
        pose = base @ outer.model_pose(model)
        if model.links:
            self._add_links(model, inner, pose, name)
        wrapper = not model.links and len(model.children) == 1
        for child in model.children:
            self.add(child, inner, pose, name if wrapper else f"{name}/{child.name}")

    def refuse_unused_patterns(self, path: Path) -> None:
        """A pattern that matches nothing is a mistake: what it should leave out (a robot) would become an obstacle."""
        met = list(dict.fromkeys([*self.met, *self.tree.left_out, *self.tree.missing]))
        for pattern in self.tree.without:
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
        # What a model is an instance of: the model it includes, or its own name without a trailing number.
        kind = model.source or re.sub(r"([_\- ]*(clone|copy)?[_\- ]*\d+)+$", "", model.name) or model.name
        pose = self.lowered @ pose
        leaves = leaves_of(model, frames, pose, surfaces, name, kind)
        self.leaves += leaves.values()
        parts = [surface for link, surface in surfaces.items() if link not in leaves]
        if not parts:
            return
        whole = mesh.joined(parts)
        self.overhead.append(overhead(whole))
        found = solid_objects(name, kind, pose, whole, lidar_height_m=self.lidar_height_m)
        width, depth, _ = np.ptp(whole.vertices, axis=0)
        if not found:
            self._ignore("left out: floor, or above head height", name)
        elif max(width, depth) > LARGEST_M:
            message = f'model "{name}" is {width:.0f} x {depth:.0f} m wide: is the unit of its mesh right?'
            self.tree.problems.add(model.element, message, "sdf-size")
        else:
            self.objects.extend(found)
            if model.element.all("plugin") or any(link.element.all("sensor") for link in model.links.values()):
                self.notes.append(
                    f'model "{name}" carries sensors or a plug-in: if it is the robot, leave it out with --without.'
                )

    def _surfaces(self, model: Model, frames: Frames, pose: Matrix) -> dict[str, Triangles]:
        """Return the collision surface of every link that has one, above the floor."""
        found = {}
        for link, placed in model.links.items():
            parts = []
            link_in_model = frames.pose(placed)
            link_pose = pose @ link_in_model
            for collision in placed.element.all("collision"):
                inner = self.tree.placed(collision)
                where = inner.matrix
                if inner.relative_to:  # another frame of the model
                    where = np.linalg.inv(link_in_model) @ frames.pose(inner)
                surface = self._surface(collision, model)
                if surface is not None:
                    # A saved state's scale applies to every shape and not to the poses, as in Gazebo.
                    surface = surface if model.scale is None else surface.scaled(model.scale)
                    parts.append(surface.moved(self.lowered @ link_pose @ where))
            if parts:
                found[link] = mesh.joined(parts)
        return found

    def doors(self) -> tuple[Door, ...]:
        """Return the doors; a leaf that stands in no wall becomes a solid object."""
        held = in_walls(self.leaves, self.objects)
        for leaf in self.leaves:
            if leaf not in held:
                self.objects += solid_objects(
                    leaf.door.name, leaf.kind, leaf.pose, leaf.surface, lidar_height_m=self.lidar_height_m
                )
        if held:
            listed = _some([leaf.door.name for leaf in held])
            many, opens = ("1 door is", "It opens") if len(held) == 1 else (f"{len(held)} doors are", "They open")
            self.notes.append(
                f"{many} proposed: {listed}. {opens} for people and the robot; doors.yaml can say otherwise."
            )
        taken: Counter[str] = Counter()
        named = []
        for door in (leaf.door for leaf in held):
            taken[door.name] += 1
            number = f" {taken[door.name]}" if taken[door.name] > 1 else ""
            named.append(door.model_copy(update={"name": f"{door.name}{number}"}))
        return tuple(named)

    def _surface(self, collision: Element, model: Model) -> Triangles | None:
        geometry = collision.find("geometry")
        if geometry is None or not geometry.children:
            message = f'the collision "{collision.name}" has no geometry'
            self.tree.problems.add(collision, message, "sdf-tag-missing")
            return None
        shape = geometry.children[0]
        if shape.tag == "mesh":
            return self._mesh(shape, model)
        if shape.tag in ("heightmap", "dem"):
            return self._terrain(shape, model)
        maker = SHAPES.get(shape.tag)
        if maker is None:
            if shape.tag != "empty":
                where = f"{shape.path.name}:{shape.line}"
                self.notes.append(f'{where}: a <{shape.tag}> in "{model.name}" is not read.')
            return None
        before = len(self.tree.problems)
        surface = maker(shape, self.tree.problems)
        return surface if len(self.tree.problems) == before else None

    def _terrain(self, shape: Element, model: Model) -> Triangles | None:
        uri = shape.text_of("uri")
        found = self.tree.find(uri, shape) if uri else None
        if found is None:
            return None
        if found.suffix.lower() in (".tif", ".tiff", ".dem"):
            self.notes.append(f"{shape.path.name}:{shape.line}: the elevation model {found.name} is not read.")
            return None
        try:
            return heightmap(shape, found, self.tree.problems)
        except FileError as error:
            self.tree.fault(Problem.of(error), f'the terrain of "{model.name}"')
            return None

    def _mesh(self, shape: Element, model: Model) -> Triangles | None:
        uri = shape.text_of("uri")
        if not uri:
            self.tree.problems.add(shape, "the mesh has no <uri>", "sdf-tag-missing")
            return None
        found = self.tree.find(uri, shape)
        if found is None:
            return None
        part = shape.find("submesh")
        submesh = part.text_of("name") or None if part is not None else None
        center = part is not None and part.is_true("center")
        key = (found.resolve(), submesh, center)
        if key not in self.meshes:
            self.meshes[key] = self._loaded(found, submesh, center, shape, model)
        surface, scale = self.meshes[key], shape.find("scale")
        if surface is None or scale is None:
            return surface
        factors = np.array(self.tree.problems.numbers(scale, 3))
        if not factors.all():
            self.tree.problems.add(scale, f"a mesh scale of 0 ({scale.text.strip()})", "sdf-size")
            return None
        return surface.scaled(factors)

    def _loaded(self, path: Path, submesh: str | None, center: bool, shape: Element, model: Model) -> Triangles | None:
        try:
            return mesh.load_mesh(path, submesh=submesh, center=center)
        except FileError as error:
            advice = "Repair it, use its bounding box with --box-for-unreadable, or leave it out with --lenient."
            if self.box_for_unreadable:
                rough = mesh.rough_box(path)
                if rough is not None:
                    said = f'{path.name} of "{model.name}" cannot be read'
                    self.notes.append(f"{said}; its bounding box is used instead.")
                    return rough
                advice = "It has no readable vertices, so there is no bounding box either."
            problem = Problem(error.path, error.line, f"{error.reason.rstrip('.')}. {advice}", code=error.code)
            self.tree.fault(problem, f'the mesh {path.name} of "{model.name}"')
        except InputError as error:
            self.tree.problems.add(shape, str(error), error.code)
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
