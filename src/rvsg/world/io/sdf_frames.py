"""Models, links and frames of an SDF file with their poses, resolved as SDF 1.7 and later define them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.core.documents import Problem
from rvsg.world.io.safe_xml import Element

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
