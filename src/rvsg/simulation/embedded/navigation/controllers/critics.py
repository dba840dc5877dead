"""Scores of DWB's critics for every sample, computed again for a trace.

The compiled planner keeps only totals. This repeats its critics from the state it leaves behind, in NumPy, so a traced
run stays the run.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.simulation.embedded.navigation.controllers import dwb
from rvsg.simulation.embedded.navigation.controllers.samples import SAMPLE_SIDE, SAMPLE_V
from rvsg.simulation.embedded.stack import Stack

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CRITICS = ("RotateToGoal", "BaseObstacle", "GoalAlign", "PathAlign", "PathDist", "GoalDist")
"""The critics that score; Oscillation only forbids."""


def scales(p: Stack) -> tuple[float, ...]:
    """Return the factor of each of `CRITICS`, as DWB publishes it."""
    return (p.dwb_rotate, p.dwb_obstacle, p.dwb_goal_align, p.dwb_path_align, p.dwb_path_dist, p.dwb_goal_dist)


def raw_scores(
    nav: Ints,
    sources: NDArray[np.int32],
    samples: Floats,
    ends: Floats,
    master: NDArray[np.uint8],
    window: tuple[int, int],
    path: Floats,
    goal_yaw: float,
    pose: tuple[float, float, float],
    p: Stack,
) -> Floats:
    """Return the raw score of every critic for every sample, (S, `CRITICS`), just after `dwb.choose`.

    `scales` times these adds up to the total where no critic forbids the sample; elsewhere they mean nothing.

    Args:
        nav: the controller's integers.
        sources: columns and rows of the plan's cells (`Scratch.sources`).
        ends: where the samples end, in the frame of the robot (`Rollouts.ends`).
        window: column and row of the local costmap's corner.
        path: the plan in the local frame, m.
        pose: x, y, yaw of the robot in the local frame.
    """
    x, y, yaw = pose
    on_plan = sources[:, : nav[dwb.SOURCES]].astype(np.int64)
    goal, align = on_plan[:, -1], _align_cell(nav, path, x, y, window, master.shape, p)
    cos, sin = math.cos(yaw) / p.resolution, math.sin(yaw) / p.resolution
    column, row = x / p.resolution - window[0], y / p.resolution - window[1]
    end = _cells(column, row, cos, sin, ends[:, 0], ends[:, 1], master.shape)
    ahead = _cells(column, row, cos, sin, ends[:, 3], ends[:, 4], master.shape)
    goal_x, goal_y = path[nav[dwb.PLAN_END] - 1]
    far = math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2) > p.dwb_forward_point
    return np.column_stack(
        [
            _rotate(nav, np.hypot(samples[:, SAMPLE_V], samples[:, SAMPLE_SIDE]), yaw + ends[:, 2] - goal_yaw, p),
            master[end[1], end[0]].astype(np.float64),
            np.abs(ahead - align[:, None]).sum(axis=0),
            _from_plan(on_plan, ahead) if far else np.zeros(len(ends)),
            _from_plan(on_plan, end),
            np.abs(end - goal[:, None]).sum(axis=0),
        ]
    )


def _rotate(nav: Ints, v: Floats, error: Floats, p: Stack) -> Floats:
    """RotateToGoal for the samples it allows."""
    if nav[dwb.IN_WINDOW] == 0:
        return np.zeros(len(v))
    off = np.abs(np.arctan2(np.sin(error), np.cos(error)))
    return off if nav[dwb.ROTATING] else p.dwb_slowing * v * v + off


def _align_cell(
    nav: Ints, path: Floats, x: float, y: float, window: tuple[int, int], shape: tuple[int, ...], p: Stack
) -> Ints:
    """Return the cell that GoalAlign measures from: ahead of the last pose of the plan within reach."""
    begin, last = int(nav[dwb.PLAN_BEGIN]), int(nav[dwb.PLAN_END])
    far = ((path[begin:last] - (x, y)) ** 2).sum(axis=1) > p.dwb_window * p.dwb_window
    end = begin + int(far.argmax()) if far.any() else last
    points = path[begin:end].copy()
    bearing = math.atan2(path[last - 1, 1] - y, path[last - 1, 0] - x)
    points[-1] += p.dwb_forward_point * math.cos(bearing), p.dwb_forward_point * math.sin(bearing)
    cells = np.floor(points / p.resolution - window).astype(np.int64)
    inside = np.all((cells >= 0) & (cells < shape[::-1]), axis=1).reshape(-1)
    first = int(inside.argmax())
    leaves = ~inside[first:]
    return np.asarray(cells[first + int(leaves.argmax()) - 1] if leaves.any() else cells[-1])


def _cells(
    column: float, row: float, cos: float, sin: float, dx: Floats, dy: Floats, shape: tuple[int, ...]
) -> NDArray[np.int64]:
    """Return columns and rows of places in the frame of the robot, kept on the map."""
    columns = np.clip(column + cos * dx - sin * dy, 0, shape[1] - 1)
    rows = np.clip(row + sin * dx + cos * dy, 0, shape[0] - 1)
    return np.array([columns, rows]).astype(np.int64)


def _from_plan(on_plan: Ints, cells: Ints) -> Floats:
    """Return |Δcolumn| + |Δrow| from cells to the plan cell nearest by Euclid, the earlier one of equals."""
    away = cells[:, :, None] - on_plan[:, None, :]
    nearest = (away**2).sum(axis=0).argmin(axis=1)
    return np.asarray(np.abs(away).sum(axis=0)[np.arange(cells.shape[1]), nearest], dtype=np.float64)
