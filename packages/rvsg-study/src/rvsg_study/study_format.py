"""Readers of the files of the published study: JSON, tables and logs.

Nothing but `Unreadable` leaves the readers, whatever a damaged folder holds. A log with any defect is refused as a
whole: a metric over part of a run would be a wrong number.
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
from rvsg.simulation.run import Trajectory

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
