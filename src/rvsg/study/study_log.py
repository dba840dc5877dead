"""One log of the published study's layout (`log_K.csv`, one row per half second) becomes a Trajectory, or a reason.

A log that cannot be trusted in full is refused whole: a metric over part of a run would be a wrong number.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError
from rvsg.core.inputs import read_text
from rvsg.simulation.run import Trajectory

_WORKER = re.compile(r"worker(\d+)_x")
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
LARGEST_BYTES = 256 * 1024 * 1024


class UnusableLog(Exception):
    """Why a log cannot be used; the message is for the findings."""


def read_log(path: Path) -> tuple[Trajectory, bool | None]:
    """The trajectory of a log, and whether its last row says `completed` (None where it does not say).

    Raises UnusableLog where a column is missing, a number is missing or not finite, there are fewer than two rows,
    time does not increase, or an orientation is no unit quaternion.
    """
    header, rows = _table(path)
    workers = sorted(int(found.group(1)) for name in header if (found := _WORKER.fullmatch(name)))
    wanted = [*ROBOT, *(f"worker{n}_{part}" for n in workers for part in WORKER)]
    missing = [name for name in wanted if name not in header]
    if missing:
        raise UnusableLog(f"the column{'s' if len(missing) > 1 else ''} {', '.join(missing)} missing")
    if not workers:
        raise UnusableLog("there is no column worker1_x: nobody but the robot was logged")
    if len(rows) < 2:
        raise UnusableLog(f"{len(rows)} row{'' if len(rows) == 1 else 's'}: a run needs at least two")
    columns = {name: _numbers(rows, header, name) for name in wanted}
    time = columns["timestamp"]
    if not (np.diff(time) > 0).all():
        row = int(np.flatnonzero(np.diff(time) <= 0)[0]) + 3
        raise UnusableLog(f"time does not increase at line {row}")
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
    """True or False as the logs spell it; None for anything else."""
    return {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}.get(text.strip().lower())


def _table(path: Path) -> tuple[list[str], list[list[str]]]:
    """The header and the rows of a CSV file; a row of another length than the header makes it unusable."""
    try:
        text = read_text(path, largest=LARGEST_BYTES)
        lines = [line for line in csv.reader(io.StringIO(text, newline=""), strict=True) if line]
    except (FileError, csv.Error) as error:
        raise UnusableLog(f"cannot be read: {error}") from None
    if not lines:
        raise UnusableLog("the file is empty")
    header, *rows = lines
    for number, row in enumerate(rows, 2):
        if len(row) != len(header):
            raise UnusableLog(f"line {number} has {len(row)} values, expected {len(header)}: is the file cut off?")
    return header, rows


def _numbers(rows: Sequence[Sequence[str]], header: Sequence[str], name: str) -> NDArray[np.float64]:
    index = header.index(name)
    try:
        values = np.array([float(row[index]) for row in rows])
    except ValueError:
        line = next(n for n, row in enumerate(rows, 2) if not _is_number(row[index]))
        raise UnusableLog(f"line {line}: {name} is not a number: {rows[line - 2][index]!r}") from None
    if not np.isfinite(values).all():
        line = int(np.flatnonzero(~np.isfinite(values))[0]) + 2
        raise UnusableLog(f"line {line}: {name} is {values[line - 2]}")
    return values


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _yaw(columns: dict[str, NDArray[np.float64]], who: str) -> NDArray[np.float64]:
    """Yaw from the quaternion (0, 0, z, w) as ROS's tf computes it.

    Equal to 2 atan2(z, w) but for rounding; the study's client used this form, and quaternions that are a unit only
    to 1e-8 make the difference show in the ninth digit.
    """
    z, w = columns[f"{who}_orientation_z"], columns[f"{who}_orientation_w"]
    off = np.abs(z * z + w * w - 1.0)
    if (off > 1e-3).any():
        line = int(np.argmax(off > 1e-3)) + 2
        raise UnusableLog(f"line {line}: the orientation of {who} is no rotation about the vertical axis")
    yaw: NDArray[np.float64] = np.arctan2(2.0 * w * z, 1.0 - 2.0 * z * z)
    return yaw
