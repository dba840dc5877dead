"""An SDF file as a tree of models with their poses: includes followed, frames resolved, nothing downloaded.

Frames follow the SDF 1.7+ rules (`relative_to`, `attached_to`, `placement_frame`, `__model__`, `a::b`). The older
`frame` attribute, to which Gazebo Classic never gave a meaning, is ignored. A saved `<state>` moves its models.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from itertools import chain, count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.core.documents import Problem
from rvsg.core.errors import FileError
from rvsg.core.seeds import stream
from rvsg_exchange.model_files import (
    SCHEMES,
    WEB,
    Element,
    ModelFiles,
    Problems,
    model_file,
    model_of,
    read_xml,
    split,
)
from rvsg_exchange.urdf_model import as_sdf_model

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
    element: Element
    place: Placed
    source: str | None = None
    placement_frame: str | None = None
    links: dict[str, Placed] = field(default_factory=dict)
    frames: dict[str, Placed] = field(default_factory=dict)
    children: list[Model] = field(default_factory=list)
    scale: Matrix | None = None


class Frames:
    """The poses of named frames within one model (or the world), resolved on demand."""

    def __init__(self, named: Mapping[str, Placed], children: Sequence[Model], problems: Problems) -> None:
        self._models = {child.name: child for child in children}
        self._named = {**named, **{child.name: child.place for child in children}}
        self._problems = problems

    @classmethod
    def of(cls, model: Model, problems: Problems) -> Frames:
        """Return the frames inside a model."""
        return cls(model.frames | model.links, model.children, problems)

    def pose(self, placed: Placed, trail: tuple[str, ...] = ()) -> Matrix:
        """Return the pose in the model of something placed in it."""
        if not placed.relative_to:
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
            self._problems.add(user, f'there is no frame "{name}" here. Known: {known}', "sdf-unknown-frame")
            return np.eye(4)
        if name in trail:
            circle = " → ".join((*trail[trail.index(name) :], name))
            self._problems.add(user, f"frames refer to each other in a circle: {circle}", "sdf-frame-circle")
            return np.eye(4)
        pose = self.pose(placed, (*trail, name))
        child = self._models.get(head)
        if inner and child is not None and name not in self._named:
            pose = pose @ Frames.of(child, self._problems).named(rest, user)
        return pose

    def model_pose(self, child: Model) -> Matrix:
        """Return the pose of a nested model's origin; its placement frame stands at its `<pose>`."""
        pose = self.pose(child.place, (child.name,))
        if child.placement_frame:
            inner = Frames.of(child, self._problems)
            pose = pose @ np.linalg.inv(inner.named(child.placement_frame, child.element))
        return pose


MOST_MODELS = 1000


def expanded(population: Element, problems: Problems) -> Iterator[tuple[Element, tuple[float, float, float]]]:
    """Yield the `<model>` or `<include>` of a population once per copy, with its position relative to the population.

    `random` and `uniform` ones are drawn from a seed that follows from the population's name.
    """
    template = next((child for child in population.children if child.tag in ("model", "include")), None)
    if template is None:
        problems.add(population, "the <population> holds no <model>", "sdf-empty")
        return
    base = template.name or template.text_of("name") or template.text_of("uri").rpartition("/")[2]
    for number, place in enumerate(_places(population, problems)):
        name = f"{base}_clone_{number}"
        if template.tag == "model":
            yield replace(template, attributes={**template.attributes, "name": name}), place
        else:
            children = [child for child in template.children if child.tag != "name"]
            children.append(Element("name", {}, template.line, text=name, path=template.path))
            yield replace(template, children=children), place


def _places(population: Element, problems: Problems) -> list[tuple[float, float, float]]:
    """Return the position of every copy relative to the population, in metres."""
    distribution = population.find("distribution")
    kind = distribution.text_of("type", "random") if distribution is not None else "random"
    if kind == "grid" and distribution is not None:
        rows, columns = (max(1, int(problems.numbers_of(distribution, tag, (1.0,))[0])) for tag in ("rows", "cols"))
        dx, dy, _ = problems.numbers_of(distribution, "step", (1.0, 1.0, 0.0))
        if rows * columns > MOST_MODELS:
            problems.add(population, f"the <population> has more than {MOST_MODELS} models", "sdf-count")
            return []
        return [
            ((column - (columns - 1) / 2) * dx, (row - (rows - 1) / 2) * dy, 0.0)
            for row in range(rows)
            for column in range(columns)
        ]
    count = int(problems.numbers_of(population, "model_count", (1.0,))[0])
    if not 0 <= count <= MOST_MODELS:
        problems.add(population, f"<model_count> must be 0 to {MOST_MODELS}, got {count}", "sdf-count")
        return []
    box, cylinder = population.find("box"), population.find("cylinder")
    size = [1.0, 1.0, 1.0]
    if box is not None and box.find("size") is not None:
        size, cylinder = problems.numbers_of(box, "size", size), None
    elif cylinder is not None:
        radius, length = (problems.numbers_of(cylinder, tag, (1.0,))[0] for tag in ("radius", "length"))
        size = [2 * radius, 2 * radius, length]
    if kind.startswith("linear-"):
        axis = "xyz".find(kind[-1])
        along = (np.arange(count) + 0.5) / max(count, 1) - 0.5
        places = np.where(np.arange(3) == axis, along[:, None] * size, 0.0)
    else:
        draws = stream(0, f"population {population.name}").random((count, 3))
        places = (draws - 0.5) * size
        if cylinder is not None:
            radii, angles = size[0] / 2 * np.sqrt(draws[:, 0]), math.tau * draws[:, 1]
            places[:, :2] = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    return [(float(x), float(y), float(z)) for x, y, z in places]


DEEPEST = 30
BUILT_IN = ("sun", "ground_plane")  # known without a model folder: nothing of them is solid
NOT_SOLID = ("light", "actor", "plugin", "world")


@dataclass(eq=False)
class Missing:
    """A model that was not found: the URI, where it is first used, how often, and where it was looked for."""

    uri: str
    element: Element
    searched: tuple[Path, ...]
    times: int = 0


class SdfTree:
    """Reader of a world or model file and everything it includes, with all `problems` and `notes` on what is left out.

    `without` are patterns of names whose models need not be found; `lenient` leaves out files that are missing.
    """

    def __init__(self, files: ModelFiles, *, without: Sequence[str] = (), lenient: bool = False) -> None:
        self.files = files
        self.without = tuple(without)
        self.lenient = lenient
        self.problems = Problems()
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
            model = self._model(as_sdf_model(root, path).set_path(path), (path.resolve(),))
            self.frames = Frames({}, [model], self.problems)
            return [model]
        if root.tag not in ("sdf", "gazebo"):
            said = f"expected an SDF file (<sdf>) or a URDF file (<robot>), found <{root.tag}>"
            raise FileError(path, said, line=root.line, code="sdf-expected")
        worlds = root.all("world")
        if len(worlds) > 1:
            self.notes.append(f"{path.name} holds {len(worlds)} worlds; the first is read.")
        top = worlds[0] if worlds else root
        trail = (path.resolve(),)
        states = top.all("state")
        inserted = [each for state in states for each in state.all("insertions")]  # added after a saved world's start
        models = [model for parent in (top, *inserted) for model in self._models_in(parent, trail)]
        if not models and not (self.problems or self.missing or self.left_out):
            raise FileError(path, "the file holds no model and includes none", line=top.line, code="sdf-empty")
        for tag in ("light", "actor", "plugin", "road"):
            names = [element.name or element.attributes.get("filename", "") for element in top.all(tag)]
            if names:
                self.skipped.setdefault(tag, []).extend(names)
                self.left_out += names
        models = self._apply_states(states, models)
        named = {frame.name: self.placed(frame) for frame in top.all("frame")}
        self.frames = Frames(named, models, self.problems)
        return models

    def fault(self, problem: Problem, left_out: str) -> None:
        """Report a file that cannot be used; with `lenient` note what is left out because of it."""
        if self.lenient:
            self.notes.append(f"{left_out} is left out: {problem}")
        else:
            self.problems.append(problem)

    def find(self, uri: str, element: Element) -> Path | None:
        """Return the file or folder of a URI; None, with an entry in `missing` or a problem, if there is none."""
        scheme, _ = split(uri)
        if scheme not in SCHEMES:
            self.problems.add(element, f'"{uri}": the scheme {scheme}: is not supported', "sdf-scheme")
            return None
        found = self.files.find(uri, element.path)
        if found is None:
            known = self.missing.setdefault(
                model_of(uri), Missing(uri, element, self.files.searched(uri, element.path))
            )
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
            self.problems.add(m.element, f'"{name}" was not found ({m.uri}{times})', "sdf-model-missing")
        web_said = " Nothing is downloaded: `gz fuel download -u ADDRESS` fills the local cache." if web else ""
        advice = "Give the folder that holds them with --model-path, or import the rest with --lenient."
        self.problems.append(Problem(world, None, f"{advice}{web_said} {where}", code="sdf-searched"))

    def _parsed(self, path: Path) -> Element:
        key = path.resolve()
        if key not in self._files:
            self._files[key] = read_xml(path)
        return self._files[key]

    def _models_in(self, parent: Element, trail: tuple[Path, ...]) -> Iterator[Model]:
        taken: set[str] = set()
        none = (0.0, 0.0, 0.0)
        elements: list[tuple[Element, Element | None, tuple[float, float, float]]]
        elements = [(element, None, none) for element in parent.all("model", "include")]
        for each in parent.all("population"):
            elements += [(element, each, at) for element, at in expanded(each, self.problems)]
        for element, population, at in elements:
            model = self._model(element, trail) if element.tag == "model" else self._included(element, trail)
            if model is None:
                continue
            if population is not None:
                place = Placed(np.eye(4), None, element)
                place.matrix[:3, 3] = at
                place.matrix = self.placed(population).matrix @ place.matrix @ model.place.matrix
                model.place = place
            if model.name in taken:  # the first free number from 0, as Gazebo does it
                free = next(f"{model.name}_{number}" for number in count() if f"{model.name}_{number}" not in taken)
                where = f"{element.path.name}:{element.line}"
                self.notes.append(f'{where}: a second model "{model.name}" is called "{free}".')
                model.name = free
            taken.add(model.name)
            yield model

    def _model(self, element: Element, trail: tuple[Path, ...]) -> Model:
        if not element.name:
            self.problems.add(element, "the model has no name", "sdf-name-missing")
        model = Model(name=element.name, element=element, place=self.placed(element))
        model.placement_frame = element.attributes.get("placement_frame")
        for link in element.all("link"):
            numbered = (f"{link.name}_{i}" for i in count())
            free = next(n for n in chain([link.name], numbered) if n not in model.links)
            model.links[free] = self.placed(link)
        model.frames = {frame.name: self.placed(frame) for frame in element.all("frame")}
        for joint in element.all("joint"):
            placed = self.placed(joint)
            placed.relative_to = placed.relative_to or joint.text_of("child") or None
            model.frames[joint.name] = placed
        model.children = list(self._models_in(element, trail))
        return model

    def _included(self, element: Element, trail: tuple[Path, ...]) -> Model | None:
        uri = element.text_of("uri")
        if not uri:
            self.problems.add(element, "the include has no <uri>", "sdf-tag-missing")
            return None
        name = element.text_of("name")
        called = name or model_of(uri)
        found = self._model_file(uri, element, name)
        if found is None:
            return None
        if found.resolve() in trail or len(trail) > DEEPEST:
            chain = " → ".join(p.name if p.name != "model.sdf" else p.parent.name for p in (*trail, found))
            self.problems.add(element, f"the includes go in a circle: {chain}", "sdf-include-circle")
            return None
        try:
            root = self._parsed(found)
            inner = as_sdf_model(root, found).set_path(found) if root.tag == "robot" else root.find("model")
        except FileError as error:
            self.fault(Problem.of(error), f'the model "{called}"')
            return None
        if inner is None:  # a light, an actor or a plug-in, else nothing known
            held = next((child.tag for child in root.children if child.tag in NOT_SOLID), None)
            if held is None:
                message = f"the file included by {element.path.name}:{element.line} holds no <model>"
                self.fault(Problem(found, root.line, message, code="sdf-empty"), f'"{called}"')
            else:
                self.skipped.setdefault(held, []).append(called)
                self.left_out.append(called)
            return None
        model = self._model(inner, (*trail, found.resolve()))
        model.source = found.parent.name if model_file(found.parent) == found else found.stem
        if split(uri)[0] in WEB:
            model.source = model_of(uri)
        model.name = name or model.name
        model.placement_frame = element.text_of("placement_frame") or model.placement_frame
        if element.find("pose") is not None:
            model.place = self.placed(element)
        return model

    def _apply_states(self, states: Sequence[Element], models: Sequence[Model]) -> list[Model]:
        """Move and scale the models as a saved world's `<state>` has them; without those it has deleted."""
        moved = {each.attributes.get("name"): each for state in states for each in state.all("model")}
        deleted = {name.text.strip() for state in states for d in state.all("deletions") for name in d.all("name")}
        left = [model for model in models if model.name not in deleted]
        for model in left:
            state = moved.get(model.name)
            if state is not None and state.find("pose") is not None:
                model.place = self.placed(state)
                model.placement_frame = None
            if state is not None and state.text_of("scale"):
                model.scale = np.array(self.problems.numbers_of(state, "scale", (1.0, 1.0, 1.0)))
        return left

    def placed(self, element: Element) -> Placed:
        """Return an element's `<pose>` with the frame it is relative to."""
        pose = element.find("pose")
        if pose is None:
            return Placed(np.eye(4), element.attributes.get("attached_to"), element)
        relative = pose.attributes.get("relative_to") or element.attributes.get("attached_to")
        return Placed(self._matrix(pose), relative, element)

    def _matrix(self, pose: Element) -> Matrix:
        """Return the 4 x 4 matrix of a `<pose>`: x y z and roll pitch yaw, or x y z and a quaternion."""
        matrix = np.eye(4)
        if not pose.text.strip():
            return matrix
        if pose.attributes.get("rotation_format") == "quat_xyzw":
            *position, x, y, z, w = self.problems.numbers(pose, 7)
            matrix[:3, :3] = _from_quaternion(x, y, z, w)
        else:
            *position, roll, pitch, yaw = self.problems.numbers(pose, 6)
            if pose.attributes.get("degrees", "").lower() in ("true", "1"):
                roll, pitch, yaw = (math.radians(a) for a in (roll, pitch, yaw))
            matrix[:3, :3] = _from_angles(roll, pitch, yaw)
        matrix[:3, 3] = position
        return matrix

    def _model_file(self, uri: str, element: Element, name: str) -> Path | None:
        known = model_of(uri)
        called = [n for n in (name, known) if n]
        asked = any(fnmatchcase(n, pattern) for n in called for pattern in self.without)
        if asked or (known.lower().replace(" ", "_") in BUILT_IN and self.files.find(uri, element.path) is None):
            self.left_out += called
            if asked:
                self.asked.append(name or known)
            return None
        found = self.find(uri, element)
        if found is None or found.is_file():
            return found
        inner = model_file(found)
        if inner is None:
            message = f"the model folder {found} holds no model.config that names an SDF file, and no model.sdf"
            problem = Problem(element.path, element.line, message, code="sdf-model-missing")
            self.fault(problem, f'the model "{name or known}"')
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
