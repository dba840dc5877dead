"""Findings on a world folder, and what the checks read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rvsg.core.documents import Document, Problem, read_yaml
from rvsg.robots.robot import Robot
from rvsg.world.authoring.fixes import Fix
from rvsg.world.authoring.trial import Trial
from rvsg.world.grid import GridSpec
from rvsg.world.space import human_space, robot_space
from rvsg.world.world import World


@dataclass(frozen=True, kw_only=True)
class Remark:
    """A finding: `serious` ones stop a campaign or make its results wrong, the others are suspicious."""

    problem: Problem
    serious: bool
    key: tuple[str | int, ...] = ()
    """What of the file it is about, e.g. ("routes", 0, "goal")."""
    fix: Fix | None = None
    """What would mend it; None where only a person can tell."""

    @property
    def code(self) -> str:
        """What is wrong, as a stable word such as `pose-outside`."""
        return self.problem.code

    def __str__(self) -> str:
        return f"{'error' if self.serious else 'warning'}: {self.problem}"


class Subject:
    """A world that could be read, with its documents and spaces, and the remarks on it so far."""

    def __init__(self, folder: Path, world: World, trial: Trial | None, robot: Robot | None) -> None:
        from shapely import Polygon

        self.world = world
        self.trial = trial
        self.driver = robot
        self.head = read_yaml(folder / "world.yaml")
        self.labels = read_yaml(folder / str(self.head.value.get("labels", "labels.yaml")))
        self.routes = read_yaml(folder / str(self.head.value.get("routes", "routes.yaml")))
        self.spec = world.grid_spec or GridSpec()
        self.human = human_space(world)
        self.robot = robot_space(world)
        self.shapes = {area.name: Polygon(area.outline) for area in world.areas}
        self.remarks: list[Remark] = []

    def say(
        self, document: Document, code: str, message: str, *key: str | int, serious: bool = False,
        fix: Fix | None = None,
    ) -> None:  # fmt: skip
        """Add a remark on the part of a document that the keys lead to."""
        problem = document.problem(message, *key, code=code)
        self.remarks.append(Remark(problem=problem, serious=serious, key=key, fix=fix))


def listed_names(names: Sequence[str]) -> str:
    """Return the first names of a list, and how many more there are."""
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
