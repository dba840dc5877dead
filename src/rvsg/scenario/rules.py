"""Limits of a valid configuration, the findings and repairs of the checker, and where a task has to start and end."""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from typing import Any, Self

from rvsg.core.records import Record
from rvsg.scenario.scenario import HumanConfiguration, Task
from rvsg.world.world import World

MAX_HUMANS = 100
"""More people than this in one configuration are refused (Brief allows as many)."""

SPEED_RANGE_M_S = (0.3, 2.0)
"""Walking, not running: an ambling and a fast walk. HuNavSim's sample people walk at up to 1.5 m/s."""

ROBOT_RADIUS_M = 0.35
"""Radius of the disc that stands for a robot known by name only, and for the robot in the study's metrics."""

START_CLEARANCE_M = 0.5
"""Gap that RVSG's generators keep between robot and people at the start: the clearance that ISO 3691-4 requires beside
a driverless truck."""


class Finding(Record):
    """One reason why a configuration is not valid."""

    rule: str
    """The rule it breaks, a row of `docs/reference/validity-rules.md`."""
    human: str | None = None
    """The name of the person."""
    task: str | None = None
    """The name of the person's task."""
    position: int | None = None
    """The index in the path of the task, from 0."""
    reason: str
    suggestion: str = ""
    """How to correct it."""

    @classmethod
    def of(cls, rule: str, reason: str, suggestion: str = "", **place: Any) -> Self:
        """Return a finding; `place` says where: human, task, position."""
        return cls(rule=rule, reason=reason, suggestion=suggestion, **place)

    def __str__(self) -> str:
        task = f'task "{self.task}"' if self.task else None
        waypoint = f"waypoint {self.position + 1}" if self.position is not None else None
        place = ", ".join(part for part in (self.human, task, waypoint) if part)
        return f"{place + ': ' if place else ''}{self.reason}{' ' + self.suggestion if self.suggestion else ''}"


class Repair(Record):
    """One change made by a repair."""

    human: str
    task: str
    what: str
    """The change in words."""
    before: tuple[str, ...]
    """The path before; both paths are empty if no path changed."""
    after: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.human}{f', task {chr(34)}{self.task}{chr(34)}' if self.task else ''}: {self.what}"


_ARROW = re.compile(r"\s*(?:→|⟶|➔|➜|⇒|-+>|=+>|–>|—>)\s*")
_TO = re.compile(r"\s+to\s+", re.IGNORECASE)
_NOTE = re.compile(r"\s*\([^()]*\)\s*")


@dataclass(frozen=True)
class TaskEnd:
    """The start or the end of a task: its text, and the waypoints it allows (None: any)."""

    text: str
    waypoints: frozenset[str] | None = None
    known: bool = True

    def allows(self, waypoint: str) -> bool:
        """Return whether the task may begin or end there."""
        return self.waypoints is None or waypoint in self.waypoints


ANYWHERE = TaskEnd("")


def resolve(text: str, world: World) -> TaskEnd:
    """Return the area or waypoint a text names, ignoring case and spacing; an unknown one has `known` False."""
    wanted = " ".join(text.split()).casefold()
    for area in world.areas:
        if area.name.casefold() == wanted:
            return TaskEnd(area.name, frozenset(area.waypoints) & world.grid.valid)
    for name in world.grid.valid:
        if name.casefold() == wanted:
            return TaskEnd(name, frozenset({name}))
    bare = " ".join(_NOTE.sub(" ", text).split())
    if bare and bare != " ".join(text.split()):
        return resolve(bare, world)
    return TaskEnd(text.strip(), None, known=False)


def task_ends(task: Task, world: World) -> tuple[TaskEnd, TaskEnd]:
    """Return the start and the end that a task promises by `start_area` and `end_area`."""
    start, end = task.start_area, task.end_area
    return (resolve(start, world) if start else ANYWHERE, resolve(end, world) if end else ANYWHERE)


def read_ends(people: HumanConfiguration, world: World) -> HumanConfiguration:
    """Return the configuration with the areas of tasks read from their names where the fields do not say them.

    For replies of models, which say "Area 2 → Shelf 6" in the name alone. Nothing else reads the name of a task.
    """

    def with_ends(task: Task) -> Task:
        named = _named_places(task.name, world)
        if not named or (task.start_area and task.end_area):
            return task
        ends = {"start_area": task.start_area or named[0], "end_area": task.end_area or named[-1]}
        return task.model_copy(update=ends)

    humans = [human.model_copy(update={"tasks": tuple(map(with_ends, human.tasks))}) for human in people.humans]
    return people.model_copy(update={"humans": tuple(humans)})


def _named_places(name: str, world: World) -> tuple[str, ...]:
    """The places a task's name lists: two or more around arrows, one for the name of an area, none for free text."""
    parts = tuple(part.strip() for part in _ARROW.split(name.strip()) if part.strip())
    if len(parts) >= 2:
        return parts
    by_word = tuple(part.strip() for part in _TO.split(name.strip()))
    if len(by_word) == 2 and all(resolve(part, world).known for part in by_word):
        return by_word
    return parts if len(parts) == 1 and resolve(parts[0], world).known else ()


def near_place(text: str, world: World, cutoff: float = 0.6) -> str | None:
    """Return what an unknown place most likely means.

    That is the one area or waypoint its text contains ("Area 3 entry"), else the area with the most similar name;
    None if the text contains two ("Shelf 2/Shelf 3") or no name is similar.
    """
    areas = [area.name for area in world.areas]
    for names in (areas, sorted(world.grid.valid)):
        mentioned = [name for name in names if re.search(rf"(?<!\w){re.escape(name)}(?!\w)", text, re.IGNORECASE)]
        longest = [name for name in mentioned if not any(name != other and name in other for other in mentioned)]
        if longest:
            return longest[0] if len(longest) == 1 else None
    bare = _NOTE.sub(" ", text).strip() or text
    return next(iter(difflib.get_close_matches(bare, areas, n=1, cutoff=cutoff)), None)


def spelled(name: str, world: World) -> str | None:
    """Return the one waypoint a misspelt name can mean: `e15`, `E-15`, `E 15`, `E015`, `(E15)`; or None."""
    match = re.fullmatch(r"\W*([A-Za-z]{1,2})[\s_\-.,]*0*(\d{1,3})\W*", name)
    if match is None:
        return None
    candidate = f"{match[1].upper()}{match[2]}"
    return candidate if candidate in world.grid.by_name else None
