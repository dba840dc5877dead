"""Reader of a log of the published study's layout (`log_K.csv`, one row per half second) as a Trajectory.

A log with any defect is refused as a whole: a metric over part of a run would be a wrong number.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rvsg.simulation.run import Trajectory
from rvsg_study.files import Unreadable, as_number, read_table

_WORKER = re.compile(r"worker([1-9][0-9]{0,2})_x")
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
    workers = sorted(int(found.group(1)) for name in header if (found := _WORKER.fullmatch(name)))
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
