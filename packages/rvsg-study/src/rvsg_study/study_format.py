"""Files of the published study: configurations, tables and logs.

Nothing but `Unreadable` leaves the readers, whatever a damaged folder holds. A configuration file holds "Worker 1
Tasks" and "Worker 2 Tasks", each a list of tasks with "Task", "Start", "End" and "Path". What the study's decoder
dropped (unknown waypoints) is dropped, and listed. A log with any defect is refused as a whole: a metric over part of
a run would be a wrong number.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError, InputError
from rvsg.core.inputs import parse_json, read_text
from rvsg.core.records import Record
from rvsg.scenario.scenario import ForceFactors, Human, HumanAgent, HumanConfiguration, Task
from rvsg.simulation.run import Trajectory
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


LARGEST_LOG = 256 * 1024 * 1024
LARGEST_VALUE = 1e9
"""No position, speed, time or count of a run is larger; beyond it formulas overflow."""
MOST_DIGITS = 6
"""Digits of the number of a log, a configuration, a scenario or a worker."""


class Unreadable(Exception):
    """Why a file or a part of it cannot be used; the message is for the findings."""


def children(folder: Path) -> list[Path]:
    """Return what a folder holds, sorted by name; FileError if it cannot be listed."""
    try:
        return sorted(folder.iterdir())
    except OSError as error:
        raise FileError(folder, f"the folder cannot be read: {error.strerror}") from None


def folders(folder: Path) -> list[Path]:
    """Return the folders in a folder, sorted by name; FileError if it cannot be listed."""
    return [path for path in children(folder) if path.is_dir()]


def shown(path: Path, root: Path | None = None) -> str:
    """Return a path as text that every file and store can hold; bytes that are no text become `?`."""
    text = (path.relative_to(root) if root is not None else path).as_posix()
    return text.encode("utf-8", errors="replace").decode("utf-8")


def small_number(text: str) -> int | None:
    """Return the number that ASCII digits stand for; None if it is none or has more than `MOST_DIGITS` digits."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= MOST_DIGITS else None


def read_json(path: Path) -> Any:
    """Return the value of a JSON file; Unreadable says why there is none."""
    try:
        return parse_json(read_text(path), path)
    except (FileError, InputError) as error:
        raise Unreadable(getattr(error, "reason", str(error))) from None


def read_table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of a CSV file; Unreadable where it is none or a column occurs twice."""
    try:
        text = read_text(path, largest=LARGEST_LOG)
        lines = [line for line in csv.reader(io.StringIO(text, newline=""), strict=True) if line]
    except csv.Error as error:
        raise Unreadable(f"cannot be read: {error}") from None
    except (FileError, InputError) as error:
        raise Unreadable(getattr(error, "reason", str(error))) from None
    if not lines:
        raise Unreadable("the file is empty")
    header, *rows = lines
    doubled = sorted({name for name in header if header.count(name) > 1})
    if doubled:
        raise Unreadable(f"the column {doubled[0]!r} occurs twice")
    return header, rows


def as_number(text: str) -> float | None:
    """Return a finite number of a size that a run can have, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and abs(value) <= LARGEST_VALUE else None


_LOGGED_WORKER = re.compile(r"worker([1-9][0-9]{0,2})_x")
ROBOT = (
    "timestamp",
    "robot_x",
    "robot_y",
    "robot_orientation_z",
    "robot_orientation_w",
    "robot_speed",
    "robot_angular_velocity_z",
    "robot_acceleration",
)
WORKER = ("x", "y", "orientation_z", "orientation_w", "speed")
SHORTEST_STEP_S = 1e-6


def read_log(path: Path) -> tuple[Trajectory, bool | None]:
    """Return the trajectory of a log, and whether its last row says `completed` (None if it does not say).

    Raises Unreadable where a column is missing, a number is missing or not finite, there are fewer than two rows,
    time does not increase, or an orientation is no unit quaternion.
    """
    header, rows = _table(path)
    workers = sorted(int(found.group(1)) for name in header if (found := _LOGGED_WORKER.fullmatch(name)))
    wanted = [*ROBOT, *(f"worker{n}_{part}" for n in workers for part in WORKER)]
    missing = [name for name in wanted if name not in header]
    if missing:
        raise Unreadable(f"the column{'s' if len(missing) > 1 else ''} {', '.join(missing)} missing")
    if not workers:
        raise Unreadable("there is no column worker1_x: nobody but the robot was logged")
    if len(rows) < 2:
        raise Unreadable(f"{len(rows)} row{'' if len(rows) == 1 else 's'}: a run needs at least two")
    columns = {name: _numbers(rows, header, name) for name in wanted}
    time = columns["timestamp"]
    if not (np.diff(time) > SHORTEST_STEP_S).all():
        row = int(np.flatnonzero(np.diff(time) <= SHORTEST_STEP_S)[0]) + 3
        raise Unreadable(f"time does not increase at line {row}")
    trajectory = Trajectory(
        t=time,
        x=columns["robot_x"],
        y=columns["robot_y"],
        yaw=_yaw(columns, "robot"),
        v=columns["robot_speed"],
        omega=columns["robot_angular_velocity_z"],
        acceleration=columns["robot_acceleration"],
        human_x=np.stack([columns[f"worker{n}_x"] for n in workers], axis=1),
        human_y=np.stack([columns[f"worker{n}_y"] for n in workers], axis=1),
        human_yaw=np.stack([_yaw(columns, f"worker{n}") for n in workers], axis=1),
        human_speed=np.stack([columns[f"worker{n}_speed"] for n in workers], axis=1),
    )
    return trajectory, truth(rows[-1][header.index("completed")]) if "completed" in header else None


def truth(text: str) -> bool | None:
    """Return True or False as the logs spell it; None for anything else."""
    return {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}.get(text.strip().lower())


def _table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of a log; a row of another length than the header makes it unusable."""
    header, rows = read_table(path)
    for number, row in enumerate(rows, 2):
        if len(row) != len(header):
            raise Unreadable(f"line {number} has {len(row)} values, expected {len(header)}: is the file cut off?")
    return header, rows


def _numbers(rows: Sequence[Sequence[str]], header: Sequence[str], name: str) -> NDArray[np.float64]:
    index = header.index(name)
    values = [as_number(row[index]) for row in rows]
    for line, value in enumerate(values, 2):
        if value is None:
            raise Unreadable(f"line {line}: {name} is {rows[line - 2][index][:40]!r}; expected a number up to 1e9")
    return np.array(values, dtype=np.float64)


def _yaw(columns: dict[str, NDArray[np.float64]], who: str) -> NDArray[np.float64]:
    """Return the yaw of the quaternion (0, 0, z, w) as ROS's tf computes it.

    It equals 2 atan2(z, w) up to rounding. The study's client used this form, and quaternions with a length of 1 only
    to 1e-8 make the difference visible in the ninth digit.
    """
    z, w = columns[f"{who}_orientation_z"], columns[f"{who}_orientation_w"]
    off = np.abs(z * z + w * w - 1.0)
    if (off > 1e-3).any():
        line = int(np.argmax(off > 1e-3)) + 2
        raise Unreadable(f"line {line}: the orientation of {who} is no rotation about the vertical axis")
    yaw: NDArray[np.float64] = np.arctan2(2.0 * w * z, 1.0 - 2.0 * z * z)
    return yaw
