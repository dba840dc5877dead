"""An SDF file as a tree of models with their poses: includes followed, frames resolved, nothing fetched.

Frames follow the SDF 1.7+ rules (`relative_to`, `attached_to`, `placement_frame`, `__model__`, `a::b`); the older
`frame` attribute, which Gazebo Classic never gave a meaning, is ignored. A saved `<state>` moves its models.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np
from numpy.typing import NDArray

from rvsg.core.documents import Problem
from rvsg.core.errors import FileError
from rvsg.world.io.safe_xml import Element, read_xml

Matrix = NDArray[np.float64]
ENVIRONMENT = ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")
DEEPEST = 30


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

    @property
    def folder(self) -> Path:
        """The folder of the file the model is written in."""
        return self.path.parent


class Frames:
    """Poses of named frames within one model (or the world), resolved on demand."""

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
        """The pose in the model of something placed in it."""
        if not placed.relative_to or placed.relative_to in ("__model__", "world"):
            return placed.matrix
        return self.named(placed.relative_to, placed.element, trail) @ placed.matrix

    def named(self, name: str, user: Element, trail: tuple[str, ...] = ()) -> Matrix:
        """The pose in the model of the frame of that name."""
        if name in ("__model__", "world"):
            return np.eye(4)
        head, inner, rest = name.partition("::")
        placed = self._named.get(name) or self._named.get(head)
        if placed is None:
            known = ", ".join(sorted(self._named)) or "none"
            self._problems.append(Problem(self._path, user.line, f'there is no frame "{name}" here. Known: {known}'))
            return np.eye(4)
        if name in trail:
            circle = " → ".join((*trail[trail.index(name) :], name))
            self._problems.append(Problem(self._path, user.line, f"frames refer to each other in a circle: {circle}"))
            return np.eye(4)
        pose = self.pose(placed, (*trail, name))
        child = self._models.get(head)
        if child is not None and name not in self._named:
            pose = pose @ frames_of(child, self._problems).named(rest, user) if inner else pose
        return pose

    def pose_of_inner(self, tree: SdfTree, element: Element, path: Path, link: Placed) -> Matrix:
        """The pose in its link of a collision, which may be given relative to another frame of the model."""
        placed = tree.placed(element, path)
        if not placed.relative_to:
            return placed.matrix
        return np.asarray(np.linalg.inv(self.pose(link)) @ self.pose(placed))

    def model_pose(self, child: Model) -> Matrix:
        """The pose of a nested model's own origin: its placement frame is what stands at its `<pose>`."""
        pose = self.pose(child.place, (child.name,))
        if child.placement_frame:
            pose = pose @ np.linalg.inv(frames_of(child, self._problems).named(child.placement_frame, child.element))
        return pose


def frames_of(model: Model, problems: list[Problem]) -> Frames:
    """The frames inside a model."""
    return Frames(model, model.children, problems, model.path)


class SdfTree:
    """Reads a world or model file and everything it includes; gathers what is wrong in `problems`."""

    def __init__(self, search: Sequence[Path]) -> None:
        self.search = tuple(search)
        self.problems: list[Problem] = []
        self.notes: list[str] = []
        self._files: dict[Path, Element] = {}

    def read(self, path: Path) -> list[Model]:
        """The models of a `.world` or `.sdf` file, with `place` in the world."""
        root = self._parsed(path)
        if root.tag != "sdf":
            raise FileError(path, f"expected an SDF file (<sdf>), found <{root.tag}>", line=root.line)
        worlds = root.all("world")
        if len(worlds) > 1:
            self.notes.append(f"{path.name} holds {len(worlds)} worlds; the first is read.")
        top = worlds[0] if worlds else root
        models = list(self._models_in(top, path, (path.resolve(),)))
        if not models and not self.problems:
            raise FileError(path, "the file holds no model and includes none", line=top.line)
        for tag in ("actor", "population", "road"):
            if found := top.all(tag):
                self.notes.append(f"{len(found)} <{tag}> left out: only solid models become obstacles.")
        self._apply_state(top, models)
        named = {frame.attributes.get("name", ""): self.placed(frame, path) for frame in top.all("frame")}
        self.frames = Frames(None, models, self.problems, path, named)
        return models

    def _parsed(self, path: Path) -> Element:
        key = path.resolve()
        if key not in self._files:
            self._files[key] = read_xml(path)
        return self._files[key]

    def _models_in(self, parent: Element, path: Path, trail: tuple[Path, ...]) -> Iterator[Model]:
        taken: set[str] = set()
        for element in parent.all("model", "include"):
            model = (
                self._model(element, path, trail) if element.tag == "model" else self._included(element, path, trail)
            )
            if model is None:
                continue
            if model.name in taken:
                self.problems.append(Problem(path, element.line, f'the model name "{model.name}" is used twice'))
            taken.add(model.name)
            yield model

    def _model(self, element: Element, path: Path, trail: tuple[Path, ...]) -> Model:
        name = element.attributes.get("name", "")
        if not name:
            self.problems.append(Problem(path, element.line, "the model has no name"))
        model = Model(name=name, path=path, element=element, place=self.placed(element, path))
        model.placement_frame = element.attributes.get("placement_frame")
        for link in element.all("link"):
            model.links[link.attributes.get("name", "")] = self.placed(link, path)
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
            self.problems.append(Problem(path, element.line, "the include has no <uri>"))
            return None
        found = self._model_file(uri, element, path)
        if found is None:
            return None
        if found.resolve() in trail or len(trail) > DEEPEST:
            chain = " → ".join(p.name if p.name != "model.sdf" else p.parent.name for p in (*trail, found))
            self.problems.append(Problem(path, element.line, f"the includes go in a circle: {chain}"))
            return None
        try:
            root = self._parsed(found)
        except FileError as error:
            self.problems.append(Problem(error.path, error.line, error.reason))
            return None
        inner = root.find("model")
        if root.tag != "sdf" or inner is None:
            message = f"the file included by {path.name}:{element.line} holds no <sdf> with a <model>"
            self.problems.append(Problem(found, root.line, message))
            return None
        model = self._model(inner, found, (*trail, found.resolve()))
        model.source = found.parent.name if found.name == "model.sdf" or _config(found.parent) else found.stem
        model.name = element.text_of("name") or model.name
        model.placement_frame = element.text_of("placement_frame") or model.placement_frame
        if element.find("pose") is not None:
            model.place = self.placed(element, path)
        return model

    def _apply_state(self, top: Element, models: Sequence[Model]) -> None:
        """Move the models to where a saved world's `<state>` has them (poses in the world)."""
        states = {m.attributes.get("name"): m for state in top.all("state") for m in state.all("model")}
        for model in models:
            state = states.get(model.name)
            if state is not None and state.find("pose") is not None:
                model.place = self.placed(state, model.path)
                model.placement_frame = None
                scale = state.text_of("scale")
                if scale and any(abs(float(v) - 1.0) > 1e-9 for v in self._numbers(scale, 3, state, model.path)):
                    self.notes.append(f'model "{model.name}": the scale {scale} of its saved state is not applied.')

    def placed(self, element: Element, path: Path) -> Placed:
        """An element's `<pose>` with the frame it is relative to."""
        pose = element.find("pose")
        if pose is None:
            return Placed(np.eye(4), element.attributes.get("attached_to"), element)
        relative = pose.attributes.get("relative_to") or element.attributes.get("attached_to")
        return Placed(self.matrix(pose, path), relative, element)

    def matrix(self, pose: Element, path: Path) -> Matrix:
        """The 4 x 4 matrix of a `<pose>`: x y z roll pitch yaw (radians or degrees) or x y z and a quaternion."""
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

    # --- finding files ---

    def _model_file(self, uri: str, element: Element, path: Path) -> Path | None:
        found = self.find(uri, element, path)
        if found is None:
            return None
        if found.is_file():
            return found
        for candidate in (*_config(found), found / "model.sdf"):
            if candidate.is_file():
                return candidate
        message = f"the model folder {found} holds no model.config that names an SDF file, and no model.sdf"
        self.problems.append(Problem(path, element.line, message))
        return None

    def find(self, uri: str, element: Element, path: Path) -> Path | None:
        """The file or folder of a URI, never from the network; a problem listing the searched folders otherwise."""
        parsed = urlparse(uri)
        rest = unquote(parsed.netloc + parsed.path)
        where = (*self.search, path.parent.parent)
        if parsed.scheme in ("model", "package"):
            tries = [folder / rest for folder in where]
        elif parsed.scheme in ("http", "https"):
            tries = [folder / rest.rstrip("/").rpartition("/")[2] for folder in where]
        elif parsed.scheme == "file":
            tries = [Path(unquote(parsed.path))] if parsed.path.startswith("/") else [folder / rest for folder in where]
        elif parsed.scheme == "":
            tries = [path.parent / rest, *(folder / rest for folder in where)]
        else:
            self.problems.append(Problem(path, element.line, f'"{uri}": the scheme {parsed.scheme}: is not supported'))
            return None
        if ".." not in Path(rest).parts or parsed.scheme == "":
            for candidate in tries:
                if candidate.exists():
                    return candidate
        listed = "".join(f"\n      {folder}" for folder in dict.fromkeys(str(t.parent) for t in tries))
        fetched = " (nothing is fetched from the network: download it)" if parsed.scheme in ("http", "https") else ""
        message = f'"{uri}" was not found{fetched}. Give the folder that holds it with --model-path. Searched:{listed}'
        self.problems.append(Problem(path, element.line, message))
        return None


def numbers(text: str, count: int, element: Element, path: Path, problems: list[Problem]) -> list[float]:
    """`count` finite numbers; zeros and a problem where the text is something else."""
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) == count and all(math.isfinite(v) for v in values):
        return values
    problems.append(Problem(path, element.line, f'<{element.tag}> must be {count} finite numbers, got "{text[:80]}"'))
    return [0.0] * (count - 1) + [1.0]


def search_folders(world: Path, given: Sequence[Path] = (), environment: Mapping[str, str] | None = None) -> list[Path]:
    """Where models are looked for: given folders, those round the world file, Gazebo's variables and its cache."""
    folder = world.resolve().parent
    found = [*given, folder, folder / "models", folder.parent / "models", folder.parent]
    variables = os.environ if environment is None else environment
    for name in ENVIRONMENT:
        found += [Path(part) for part in variables.get(name, "").split(os.pathsep) if part]
    found.append(Path.home() / ".gazebo" / "models")
    return list(dict.fromkeys(found))


def _config(folder: Path) -> list[Path]:
    """The SDF files that a model folder's model.config names, the newest version first."""
    config = folder / "model.config"
    if not config.is_file():
        return []
    named = []
    for sdf in read_xml(config).all("sdf"):
        version = tuple(int(p) if p.isdigit() else 0 for p in sdf.attributes.get("version", "0").split("."))
        named.append((version, sdf.text.strip()))
    return [folder / name for _, name in sorted(named, reverse=True) if name]


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
