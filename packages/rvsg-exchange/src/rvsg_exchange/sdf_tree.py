"""Tree of the models in an SDF file with their poses: includes followed, frames resolved, nothing downloaded.

Frames follow the SDF 1.7+ rules (`relative_to`, `attached_to`, `placement_frame`, `__model__`, `a::b`). The older
`frame` attribute, to which Gazebo Classic never gave a meaning, is ignored. A saved `<state>` moves its models.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import chain, count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.core.documents import Problem
from rvsg.core.errors import FileError
from rvsg.core.seeds import stream
from rvsg_exchange.mesh import numbers
from rvsg_exchange.model_files import SCHEMES, WEB, Element, ModelFiles, model_file, model_of, read_xml, split
from rvsg_exchange.urdf import as_sdf_model

Matrix = NDArray[np.float64]


@dataclass(eq=False)
class Placed:
    """Something with a pose in its model: its matrix relative to the frame `relative_to` (None: the model)."""

    matrix: Matrix
    relative_to: str | None
    element: Element


@dataclass(eq=False)
class Model:
    """A model: where it stands in its parent, its links, frames and nested models."""

    name: str
    path: Path
    element: Element
    place: Placed
    source: str | None = None
    placement_frame: str | None = None
    links: dict[str, Placed] = field(default_factory=dict)
    frames: dict[str, Placed] = field(default_factory=dict)
    children: list[Model] = field(default_factory=list)
    scale: Matrix | None = None

    @property
    def folder(self) -> Path:
        """The folder of the file the model is written in."""
        return self.path.parent


class Frames:
    """The poses of named frames within one model (or the world), resolved on demand."""

    def __init__(
        self,
        owner: Model | None,
        children: Sequence[Model],
        problems: list[Problem],
        path: Path,
        extra: Mapping[str, Placed] | None = None,
    ) -> None:
        self._named: dict[str, Placed] = {}
        if owner is not None:
            self._named |= owner.frames | owner.links
        self._models = {child.name: child for child in children}
        self._named |= {child.name: child.place for child in children} | dict(extra or {})
        self._problems = problems
        self._path = path

    def pose(self, placed: Placed, trail: tuple[str, ...] = ()) -> Matrix:
        """Return the pose in the model of something placed in it."""
        if not placed.relative_to or placed.relative_to in ("__model__", "world"):
            return placed.matrix
        return self.named(placed.relative_to, placed.element, trail) @ placed.matrix

    def named(self, name: str, user: Element, trail: tuple[str, ...] = ()) -> Matrix:
        """Return the pose in the model of the frame of that name."""
        if name in ("__model__", "world"):
            return np.eye(4)
        head, inner, rest = name.partition("::")
        placed = self._named.get(name) or self._named.get(head)
        if placed is None:
            known = ", ".join(sorted(self._named)) or "none"
            self._problems.append(
                Problem(
                    self._path, user.line, f'there is no frame "{name}" here. Known: {known}', code="sdf-unknown-frame"
                )
            )
            return np.eye(4)
        if name in trail:
            circle = " → ".join((*trail[trail.index(name) :], name))
            self._problems.append(
                Problem(
                    self._path, user.line, f"frames refer to each other in a circle: {circle}", code="sdf-frame-circle"
                )
            )
            return np.eye(4)
        pose = self.pose(placed, (*trail, name))
        child = self._models.get(head)
        if child is not None and name not in self._named:
            pose = pose @ frames_of(child, self._problems).named(rest, user) if inner else pose
        return pose

    def pose_of_inner(self, placed: Placed, link: Placed) -> Matrix:
        """Return the pose in its link of a collision, which may be relative to another frame of the model."""
        if not placed.relative_to:
            return placed.matrix
        return np.asarray(np.linalg.inv(self.pose(link)) @ self.pose(placed))

    def model_pose(self, child: Model) -> Matrix:
        """Return the pose of a nested model's origin; its placement frame stands at its `<pose>`."""
        pose = self.pose(child.place, (child.name,))
        if child.placement_frame:
            pose = pose @ np.linalg.inv(frames_of(child, self._problems).named(child.placement_frame, child.element))
        return pose


def frames_of(model: Model, problems: list[Problem]) -> Frames:
    """Return the frames inside a model."""
    return Frames(model, model.children, problems, model.path)


MOST_MODELS = 1000


def expanded(
    population: Element, path: Path, problems: list[Problem]
) -> Iterator[tuple[Element, tuple[float, float, float]]]:
    """Yield the `<model>` or `<include>` of a population once per copy, with its position relative to the population.

    Gazebo draws `random` and `uniform` populations again at every start. Here they are drawn from a seed that follows
    from the population's name, so the same file always gives the same world.
    """
    template = next((child for child in population.children if child.tag in ("model", "include")), None)
    if template is None:
        problems.append(Problem(path, population.line, "the <population> holds no <model>", code="sdf-empty"))
        return
    for number, place in enumerate(_places(population, path, problems)):
        name = f"{_name(template)}_clone_{number}"
        copy = Element(template.tag, dict(template.attributes), template.line, template.text, list(template.children))
        if copy.tag == "model":
            copy.attributes["name"] = name
        else:
            copy.children = [child for child in copy.children if child.tag != "name"]
            copy.children.append(Element("name", {}, template.line, text=name))
        yield copy, place


def _name(template: Element) -> str:
    return template.attributes.get("name") or template.text_of("name") or template.text_of("uri").rpartition("/")[2]


def _places(population: Element, path: Path, problems: list[Problem]) -> list[tuple[float, float, float]]:
    """Return the position of every copy relative to the population, in metres."""
    distribution = population.find("distribution")
    kind = distribution.text_of("type", "random") if distribution is not None else "random"
    if kind == "grid" and distribution is not None:
        rows, columns = (max(1, int(_number(distribution, tag, 1.0, path, problems))) for tag in ("rows", "cols"))
        step = distribution.find("step")
        dx, dy, _ = numbers(step.text.strip(), 3, step, path, problems) if step is not None else (1.0, 1.0, 0.0)
        if rows * columns > MOST_MODELS:
            problems.append(
                Problem(path, population.line, f"the <population> has more than {MOST_MODELS} models", code="sdf-count")
            )
            return []
        return [
            ((column - (columns - 1) / 2) * dx, (row - (rows - 1) / 2) * dy, 0.0)
            for row in range(rows)
            for column in range(columns)
        ]
    count = int(_number(population, "model_count", 1.0, path, problems))
    if not 0 <= count <= MOST_MODELS:
        problems.append(
            Problem(path, population.line, f"<model_count> must be 0 to {MOST_MODELS}, got {count}", code="sdf-count")
        )
        return []
    if kind.startswith("linear-"):
        axis = "xyz".find(kind[-1])
        size = _region(population, path, problems)[1]
        along = (np.arange(count) + 0.5) / max(count, 1) - 0.5
        return [tuple(float(a * size[i]) if i == axis else 0.0 for i in range(3)) for a in along]  # type: ignore[misc]
    return _drawn(population, count, path, problems)


def _drawn(population: Element, count: int, path: Path, problems: list[Problem]) -> list[tuple[float, float, float]]:
    shape, size = _region(population, path, problems)
    draw = stream(0, f"population {population.attributes.get('name', '')}")
    places = []
    for u, v, w in draw.random((count, 3)):
        if shape == "cylinder":
            radius, angle = size[0] / 2 * math.sqrt(u), math.tau * v
            places.append((radius * math.cos(angle), radius * math.sin(angle), float((w - 0.5) * size[2])))
        else:
            places.append((float((u - 0.5) * size[0]), float((v - 0.5) * size[1]), float((w - 0.5) * size[2])))
    return places


def _region(population: Element, path: Path, problems: list[Problem]) -> tuple[str, list[float]]:
    """Return the shape and the size in metres of the region that a population fills."""
    box, cylinder = population.find("box"), population.find("cylinder")
    if box is not None and (size := box.find("size")) is not None:
        return "box", numbers(size.text.strip(), 3, size, path, problems)
    if cylinder is not None:
        radius, length = (_number(cylinder, tag, 1.0, path, problems) for tag in ("radius", "length"))
        return "cylinder", [2 * radius, 2 * radius, length]
    return "box", [1.0, 1.0, 1.0]


def _number(parent: Element, tag: str, otherwise: float, path: Path, problems: list[Problem]) -> float:
    child = parent.find(tag)
    return numbers(child.text.strip(), 1, child, path, problems)[0] if child is not None else otherwise


DEEPEST = 30
BUILT_IN = ("sun", "ground_plane")  # known without a model folder: nothing of them is solid
NOT_SOLID = ("light", "actor", "plugin", "world")


@dataclass(eq=False)
class Missing:
    """A model that was not found: the URI, where it is first used, how often, and where it was looked for."""

    uri: str
    path: Path
    line: int
    searched: tuple[Path, ...]
    times: int = 0


class SdfTree:
    """Reads a world or model file and everything it includes.

    What is wrong is gathered in `problems`, what was left out or changed in `notes`. `without` are patterns of names
    whose models need not be found. With `lenient`, files that are missing or unreadable are noted and left out.
    """

    def __init__(self, files: ModelFiles, *, without: Sequence[str] = (), lenient: bool = False) -> None:
        self.files = files
        self.without = tuple(without)
        self.lenient = lenient
        self.problems: list[Problem] = []
        self.notes: list[str] = []
        self.left_out: list[str] = []  # names that --without may give although nothing of them is solid
        self.asked: list[str] = []  # left out because of --without before they were looked for
        self.skipped: dict[str, list[str]] = {}  # what is not a solid model: tag to names
        self.missing: dict[str, Missing] = {}
        self._files: dict[Path, Element] = {}

    def read(self, path: Path) -> list[Model]:
        """Return the models of a world, SDF or URDF file, with `place` in the world."""
        root = self._parsed(path)
        if root.tag == "robot":
            model = self._model(as_sdf_model(root, path), path, (path.resolve(),))
            self.frames = Frames(None, [model], self.problems, path)
            return [model]
        if root.tag not in ("sdf", "gazebo"):
            raise FileError(
                path,
                f"expected an SDF file (<sdf>) or a URDF file (<robot>), found <{root.tag}>",
                line=root.line,
                code="sdf-expected",
            )
        worlds = root.all("world")
        if len(worlds) > 1:
            self.notes.append(f"{path.name} holds {len(worlds)} worlds; the first is read.")
        top = worlds[0] if worlds else root
        models = [*self._models_in(top, path, (path.resolve(),)), *self._inserted(top, path)]
        if not models and not (self.problems or self.missing or self.left_out):
            raise FileError(path, "the file holds no model and includes none", line=top.line, code="sdf-empty")
        self._skip(top)
        models = self._apply_state(top, models)
        named = {frame.attributes.get("name", ""): self.placed(frame, path) for frame in top.all("frame")}
        self.frames = Frames(None, models, self.problems, path, named)
        return models

    def fault(self, problem: Problem, left_out: str) -> None:
        """Report a file that cannot be used; with `lenient` note what is left out because of it."""
        if self.lenient:
            self.notes.append(f"{left_out} is left out: {problem}")
        else:
            self.problems.append(problem)

    def find(self, uri: str, element: Element, path: Path) -> Path | None:
        """Return the file or folder of a URI; None, with an entry in `missing` or a problem, if there is none."""
        scheme, _ = split(uri)
        if scheme not in SCHEMES:
            self.problems.append(
                Problem(path, element.line, f'"{uri}": the scheme {scheme}: is not supported', code="sdf-scheme")
            )
            return None
        found = self.files.find(uri, path)
        if found is None:
            key = model_of(uri)
            known = self.missing.setdefault(key, Missing(uri, path, element.line, self.files.searched(uri, path)))
            known.times += 1
        return found

    def report_missing(self, world: Path) -> None:
        """Report every missing model once, and the folders that were searched."""
        if not self.missing:
            return
        folders = list(dict.fromkeys(folder for m in self.missing.values() for folder in m.searched))
        web = any(split(m.uri)[0] in WEB for m in self.missing.values())
        where = f"Searched: {', '.join(str(f) for f in folders)}."
        if self.lenient:
            names = ", ".join(f"{name} ({m.times})" if m.times > 1 else name for name, m in self.missing.items())
            many = "models were not found and are" if len(self.missing) > 1 else "model was not found and is"
            self.notes.append(f"{len(self.missing)} {many} left out: {names}. {where}")
            return
        for name, m in self.missing.items():
            times = f", used {m.times} times" if m.times > 1 else ""
            self.problems.append(
                Problem(m.path, m.line, f'"{name}" was not found ({m.uri}{times})', code="sdf-model-missing")
            )
        web_said = " Nothing is downloaded: `gz fuel download -u ADDRESS` fills the local cache." if web else ""
        advice = "Give the folder that holds them with --model-path, or import the rest with --lenient."
        self.problems.append(Problem(world, None, f"{advice}{web_said} {where}", code="sdf-searched"))

    def _skip(self, top: Element) -> None:
        for tag in ("light", "actor", "plugin", "road"):
            for element in top.all(tag):
                name = element.attributes.get("name") or element.attributes.get("filename", "")
                self.skipped.setdefault(tag, []).append(name)
                self.left_out.append(name)

    def _parsed(self, path: Path) -> Element:
        key = path.resolve()
        if key not in self._files:
            self._files[key] = read_xml(path)
        return self._files[key]

    def _models_in(self, parent: Element, path: Path, trail: tuple[Path, ...]) -> Iterator[Model]:
        taken: set[str] = set()
        for element, population in self._model_elements(parent, path):
            model = (
                self._model(element, path, trail) if element.tag == "model" else self._included(element, path, trail)
            )
            if model is None:
                continue
            if population is not None:
                place = Placed(np.eye(4), None, element)
                place.matrix[:3, 3] = population[1]
                place.matrix = self.placed(population[0], path).matrix @ place.matrix @ model.place.matrix
                model.place = place
            model.name = self._free_name(model.name, taken, path, element)
            taken.add(model.name)
            yield model

    def _model_elements(
        self, parent: Element, path: Path
    ) -> Iterator[tuple[Element, tuple[Element, tuple[float, float, float]] | None]]:
        for element in parent.all("model", "include"):
            yield element, None
        for population in parent.all("population"):
            for element, place in expanded(population, path, self.problems):
                yield element, (population, place)

    def _free_name(self, name: str, taken: set[str], path: Path, element: Element) -> str:
        """Return the name, with a number if it is taken: the first free one from 0, as Gazebo does."""
        if name not in taken:
            return name
        free = next(f"{name}_{number}" for number in count() if f"{name}_{number}" not in taken)
        self.notes.append(f'{path.name}:{element.line}: a second model "{name}" is called "{free}".')
        return free

    def _model(self, element: Element, path: Path, trail: tuple[Path, ...]) -> Model:
        name = element.attributes.get("name", "")
        if not name:
            self.problems.append(Problem(path, element.line, "the model has no name", code="sdf-name-missing"))
        model = Model(name=name, path=path, element=element, place=self.placed(element, path))
        model.placement_frame = element.attributes.get("placement_frame")
        for link in element.all("link"):
            given = link.attributes.get("name", "")
            numbered = (f"{given}_{i}" for i in count())
            free = next(n for n in chain([given], numbered) if n not in model.links)
            model.links[free] = self.placed(link, path)
        for frame in element.all("frame"):
            model.frames[frame.attributes.get("name", "")] = self.placed(frame, path)
        for joint in element.all("joint"):
            placed = self.placed(joint, path)
            placed.relative_to = placed.relative_to or joint.text_of("child") or None
            model.frames[joint.attributes.get("name", "")] = placed
        model.children = list(self._models_in(element, path, trail))
        return model

    def _included(self, element: Element, path: Path, trail: tuple[Path, ...]) -> Model | None:
        uri = element.text_of("uri")
        if not uri:
            self.problems.append(Problem(path, element.line, "the include has no <uri>", code="sdf-tag-missing"))
            return None
        name = element.text_of("name")
        found = self._model_file(uri, element, path, name)
        if found is None:
            return None
        if found.resolve() in trail or len(trail) > DEEPEST:
            chain = " → ".join(p.name if p.name != "model.sdf" else p.parent.name for p in (*trail, found))
            self.problems.append(
                Problem(path, element.line, f"the includes go in a circle: {chain}", code="sdf-include-circle")
            )
            return None
        try:
            root = self._parsed(found)
            inner = as_sdf_model(root, found) if root.tag == "robot" else root.find("model")
        except FileError as error:
            self.fault(Problem.of(error), f'the model "{name or model_of(uri)}"')
            return None
        if inner is None:
            self._skip_included(root, found, element, path, name or model_of(uri))
            return None
        model = self._model(inner, found, (*trail, found.resolve()))
        model.source = found.parent.name if model_file(found.parent) == found else found.stem
        if split(uri)[0] in WEB:
            model.source = model_of(uri)
        model.name = name or model.name
        model.placement_frame = element.text_of("placement_frame") or model.placement_frame
        if element.find("pose") is not None:
            model.place = self.placed(element, path)
        return model

    def _skip_included(self, root: Element, found: Path, element: Element, path: Path, name: str) -> None:
        """Note an included light, actor or plug-in; report an included file that holds nothing known."""
        held = next((child.tag for child in root.children if child.tag in NOT_SOLID), None)
        if held is None:
            message = f"the file included by {path.name}:{element.line} holds no <model>"
            self.fault(Problem(found, root.line, message, code="sdf-empty"), f'"{name}"')
            return
        self.skipped.setdefault(held, []).append(name)
        self.left_out.append(name)

    def _inserted(self, top: Element, path: Path) -> Iterator[Model]:
        """Yield the models that were added after a saved world was started."""
        for state in top.all("state"):
            for inserted in state.all("insertions"):
                yield from self._models_in(inserted, path, (path.resolve(),))

    def _apply_state(self, top: Element, models: Sequence[Model]) -> list[Model]:
        """Move and scale the models as a saved world's `<state>` has them; without those it has deleted."""
        states = {m.attributes.get("name"): m for state in top.all("state") for m in state.all("model")}
        deleted = {
            name.text.strip() for state in top.all("state") for d in state.all("deletions") for name in d.all("name")
        }
        left = [model for model in models if model.name not in deleted]
        for model in left:
            state = states.get(model.name)
            if state is None:
                continue
            if state.find("pose") is not None:
                model.place = self.placed(state, model.path)
                model.placement_frame = None
            scale = state.text_of("scale")
            if scale:
                model.scale = np.array(self._numbers(scale, 3, state, model.path))
        return left

    def placed(self, element: Element, path: Path) -> Placed:
        """Return an element's `<pose>` with the frame it is relative to."""
        pose = element.find("pose")
        if pose is None:
            return Placed(np.eye(4), element.attributes.get("attached_to"), element)
        relative = pose.attributes.get("relative_to") or element.attributes.get("attached_to")
        return Placed(self.matrix(pose, path), relative, element)

    def matrix(self, pose: Element, path: Path) -> Matrix:
        """Return the 4 x 4 matrix of a `<pose>`: x y z and roll pitch yaw, or x y z and a quaternion."""
        text = pose.text.strip()
        if not text:
            return np.eye(4)
        if pose.attributes.get("rotation_format") == "quat_xyzw":
            x, y, z, *quaternion = self._numbers(text, 7, pose, path)
            rotation = _from_quaternion(*quaternion)
        else:
            x, y, z, roll, pitch, yaw = self._numbers(text, 6, pose, path)
            if pose.attributes.get("degrees", "").lower() in ("true", "1"):
                roll, pitch, yaw = (math.radians(a) for a in (roll, pitch, yaw))
            rotation = _from_angles(roll, pitch, yaw)
        matrix = np.eye(4)
        matrix[:3, :3] = rotation
        matrix[:3, 3] = (x, y, z)
        return matrix

    def _numbers(self, text: str, count: int, element: Element, path: Path) -> list[float]:
        return numbers(text, count, element, path, self.problems)

    def _model_file(self, uri: str, element: Element, path: Path, name: str) -> Path | None:
        known = model_of(uri)
        called = [n for n in (name, known) if n]
        asked = any(fnmatchcase(n, pattern) for n in called for pattern in self.without)
        if asked or (known.lower().replace(" ", "_") in BUILT_IN and self.files.find(uri, path) is None):
            self.left_out += called
            if asked:
                self.asked.append(name or known)
            return None
        found = self.find(uri, element, path)
        if found is None or found.is_file():
            return found
        inner = model_file(found)
        if inner is None:
            message = f"the model folder {found} holds no model.config that names an SDF file, and no model.sdf"
            self.fault(Problem(path, element.line, message, code="sdf-model-missing"), f'the model "{name or known}"')
        return inner


def _from_angles(roll: float, pitch: float, yaw: float) -> Matrix:
    """Rotation about fixed x, y, z in this order, as SDF defines it."""
    (sr, sp, sy), (cr, cp, cy) = np.sin((roll, pitch, yaw)), np.cos((roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _from_quaternion(x: float, y: float, z: float, w: float) -> Matrix:
    norm = math.sqrt(x * x + y * y + z * z + w * w) or 1.0
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
