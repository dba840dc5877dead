"""Reader of configuration files of the published study. What the study's decoder dropped is dropped, and listed.

A file holds "Worker 1 Tasks" and "Worker 2 Tasks", each a list of tasks with "Task", "Start", "End" and "Path". The
study's decoder looked up the waypoints of every path in the grid and dropped unknown names without a message.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from rvsg.core.errors import FileError, InputError
from rvsg.core.inputs import parse_json, read_text
from rvsg.core.records import Record
from rvsg.scenario.scenario import ForceFactors, Human, HumanAgent, HumanConfiguration, Task
from rvsg.world.grid import Grid

_WORKER = re.compile(r"Worker ([1-9][0-9]{0,2}) Tasks")


class Dropped(Record):
    """A waypoint name that the grid does not know, and where it occurred."""

    human: str
    task: str
    position: int
    name: str


class StudyHuman(Record):
    """One worker of a file: its tasks with the paths as decoded. A task may have lost its whole path."""

    name: str
    tasks: tuple[Task, ...]

    @property
    def waypoints(self) -> tuple[str, ...]:
        """All waypoints of all tasks in order, doubles included: the goals the study gave to HuNavSim."""
        return tuple(name for task in self.tasks for name in task.path)


class StudyConfiguration(Record):
    """A decoded file and what was dropped from it."""

    humans: tuple[StudyHuman, ...]
    dropped: tuple[Dropped, ...] = ()

    def people(self) -> HumanConfiguration:
        """Return it as a HumanConfiguration; raises InputError if a human has no waypoint left.

        Human 1 has the default force factors; human 2 (and any further one) draws its own at every launch, as the
        study configured HuNavSim.
        """
        self._refuse_empty()
        return HumanConfiguration(
            humans=tuple(
                Human(
                    name=human.name,
                    tasks=tuple(task for task in human.tasks if task.path),
                    factors=ForceFactors() if index == 0 else "random_normal",
                )
                for index, human in enumerate(self.humans)
            )
        )

    def agents(self, grid: Grid) -> tuple[HumanAgent, ...]:
        """Return the people in coordinates, with the doubled waypoints between tasks that `decode` joins.

        HuNavSim reaches a doubled goal twice, and stands still for a tick each time.
        """
        self._refuse_empty()
        found = []
        for index, human in enumerate(self.humans):
            goals = tuple(grid.position(name) for name in human.waypoints)
            found.append(
                HumanAgent(
                    name=human.name,
                    start=goals[0],
                    goals=goals,
                    pauses_s=(0.0,) * len(goals),
                    factors=ForceFactors() if index == 0 else "random_normal",
                )
            )
        return tuple(found)

    def _refuse_empty(self) -> None:
        for human in self.humans:
            if not human.waypoints:
                raise InputError(
                    f"{human.name} has no waypoint that the grid knows; the study ran a stale file instead",
                    code="no-waypoint",
                )


def read_study_configuration(path: Path, grid: Grid) -> StudyConfiguration:
    """Read a configuration file of the study; raises FileError if it is not one."""
    value = parse_json(read_text(path), path)
    try:
        return decode_study(value, grid)
    except InputError as error:
        raise FileError(path, str(error)) from None


def decode_study(value: Any, grid: Grid) -> StudyConfiguration:
    """Decode the JSON value of such a file; raises InputError if it has another shape."""
    if not isinstance(value, dict):
        raise InputError('expected an object with "Worker 1 Tasks" and "Worker 2 Tasks"')
    numbers = sorted(int(found.group(1)) for key in value if (found := _WORKER.fullmatch(key)))
    if not numbers:
        raise InputError(f'expected the keys "Worker 1 Tasks" and "Worker 2 Tasks", got {sorted(map(str, value))}')
    dropped: list[Dropped] = []
    humans = []
    for number in numbers:
        name = f"Human {number}"
        listed = value[f"Worker {number} Tasks"]
        if not isinstance(listed, list) or not all(isinstance(task, dict) for task in listed):
            raise InputError(f'"Worker {number} Tasks" is not a list of tasks')
        humans.append(StudyHuman(name=name, tasks=tuple(_task(task, name, grid, dropped) for task in listed)))
    return StudyConfiguration(humans=tuple(humans), dropped=tuple(dropped))


def _task(value: dict[str, Any], human: str, grid: Grid, dropped: list[Dropped]) -> Task:
    path = value.get("Path") or []
    if not isinstance(path, list):
        raise InputError(f'a "Path" of {human} is not a list of waypoint names')
    title = str(value.get("Task") or "task")[:120]
    known = []
    for position, raw in enumerate(path):
        name = str(raw)
        if name in grid.valid:
            known.append(name)
        else:
            dropped.append(Dropped(human=human, task=title, position=position, name=name[:120]))
    return Task(name=title, path=tuple(known))
