"""DWB, Nav2's local planner: 419 sampled velocities, rolled out and scored by seven critics.

Values are those of the robot's configuration; rules those of nav2_dwb_controller (Humble).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.angles import wrap
from rvsg.core.kernels import inner, kernel
from rvsg.simulation.costmap import INSCRIBED
from rvsg.simulation.embedded.robot_parameters import Stack
from rvsg.simulation.embedded.rollouts import (
    SAMPLE_DT,
    SAMPLE_SIDE,
    SAMPLE_STEPS,
    SAMPLE_V,
    SAMPLE_W,
    Rollouts,
    ends_of,
    is_free,
)

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Small = NDArray[np.int32]


ROUNDING = 1e-6
"""A sample is dropped only where its partial score is above the best total by more than rounding."""

# Indices of the integer state of the controller.
(IN_WINDOW, ROTATING, XY_REACHED, BAN_LEFT, BAN_RIGHT, LAST_SIGN, PLAN_BEGIN, PLAN_END, SOURCES, STAMP,
 LAST_BEST, BAN_ASIDE_LEFT, BAN_ASIDE_RIGHT, LAST_ASIDE) = range(14)  # fmt: skip
CONTROLLER_INTS = 14
# Indices of its real state: where the robot was when a turn was banned, and the highest speed as a share of that
# without Nav2's speed filter.
BAN_X, BAN_Y, BAN_YAW, SHARE = range(4)
CONTROLLER_REALS = 4


class Scratch(NamedTuple):
    """Scratch space of a tick.

    `sources` (2, K) are columns and rows of the plan's cells; `distances` (2, 60, 60) remember distances already
    worked out and in which tick.
    """

    sources: Small
    distances: Ints


def scratch(cells: int) -> Scratch:
    """Scratch space for a local costmap with so many cells to a side."""
    return Scratch(sources=np.zeros((2, 256), np.int32), distances=np.zeros((2, cells, cells), np.int64))


@kernel
def prune(state: Ints, path: Floats, x: float, y: float, window: float, distance: float) -> bool:
    """Choose the part of the plan to follow: from the first pose within 1.5 m to before the next one farther off.

    The first pose is looked for in the first 2.0 m of what remains; what lies before it is dropped for good. Sets
    nothing but PLAN_BEGIN; the end is returned by `window_end`. False where no pose is near.
    """
    begin = state[PLAN_BEGIN]
    end = state[PLAN_END]
    length = 0.0
    i = begin
    while i < end:
        dx = path[i, 0] - x
        dy = path[i, 1] - y
        if dx * dx + dy * dy < window * window:
            state[PLAN_BEGIN] = i
            return True
        if i + 1 < end:
            length += math.sqrt((path[i + 1, 0] - path[i, 0]) ** 2 + (path[i + 1, 1] - path[i, 1]) ** 2)
        if length > distance:
            break
        i += 1
    state[PLAN_BEGIN] = min(i + 1, end)
    return False


@kernel
def window_end(state: Ints, path: Floats, x: float, y: float, window: float) -> int:
    """The first pose after the begin that is farther than 1.5 m from the robot, or the plan's end."""
    i = state[PLAN_BEGIN]
    while i < state[PLAN_END]:
        dx = path[i, 0] - x
        dy = path[i, 1] - y
        if dx * dx + dy * dy > window * window:
            return i
        i += 1
    return i


@kernel
def take_sources(
    maps: Scratch,
    state: Ints,
    path: Floats,
    begin: int,
    end: int,
    last_x: float,
    last_y: float,
    ox: int,
    oy: int,
    resolution: float,
) -> tuple[int, int]:
    """Write the cells of the plan's poses from the first one on the map until it leaves the map.

    The last pose is taken at (last_x, last_y). Sets SOURCES; returns the last cell (column, row), or (-1, -1) where
    the plan does not touch the map.
    """
    count = 0
    column = -1
    row = -1
    rows, columns = maps.distances.shape[1:]
    for i in range(begin, end):
        px = last_x if i == end - 1 else path[i, 0]
        py = last_y if i == end - 1 else path[i, 1]
        c = math.floor(px / resolution - ox)
        r = math.floor(py / resolution - oy)
        if 0 <= c < columns and 0 <= r < rows:
            if c != column or r != row:
                if count < maps.sources.shape[1]:
                    maps.sources[0, count] = c
                    maps.sources[1, count] = r
                    count += 1
                column = c
                row = r
        elif count > 0:
            break
    state[SOURCES] = count
    return column, row


@kernel
def path_distance(maps: Scratch, state: Ints, column: int, row: int) -> int:
    """|Δcolumn| + |Δrow| from a cell to the plan cell nearest by Euclid (the earlier one of equals), in cells."""
    if maps.distances[1, row, column] == state[STAMP]:
        return maps.distances[0, row, column]
    best = 1 << 30
    for i in range(state[SOURCES]):
        dx = maps.sources[0, i] - column
        dy = maps.sources[1, i] - row
        best = min(best, (dx * dx + dy * dy) * 256 + i)
    i = best & 255
    distance = abs(maps.sources[0, i] - column) + abs(maps.sources[1, i] - row)
    maps.distances[0, row, column] = distance
    maps.distances[1, row, column] = state[STAMP]
    return distance


@kernel
def reset(state: Ints) -> None:
    """A new path: every critic and the goal checker forget what they knew."""
    state[IN_WINDOW] = 0
    state[ROTATING] = 0
    state[XY_REACHED] = 0
    forget_turns(state)


@inner
def forget_turns(state: Ints) -> None:
    """The Oscillation critic forgets the signs of the last commands and what they ban."""
    state[BAN_LEFT] = 0
    state[BAN_RIGHT] = 0
    state[LAST_SIGN] = 0
    state[BAN_ASIDE_LEFT] = 0
    state[BAN_ASIDE_RIGHT] = 0
    state[LAST_ASIDE] = 0


@kernel
def rotate_to_goal(state: Ints, v: float, side: float, yaw_error: float, square: float, slowing: float) -> float:
    """Raw score of RotateToGoal for a sample that ends `yaw_error` from the goal's yaw; -1 where it is illegal.

    `square` is that of the measured speed.
    """
    if state[IN_WINDOW] == 0:
        return 0.0
    if state[ROTATING] == 0:
        if v * v + side * side >= square:
            return -1.0
        return slowing * v * v + slowing * side * side + yaw_error
    return -1.0 if v > 0.0 or side != 0.0 else yaw_error


@kernel
def remember_turn(
    state: Ints, reals: Floats, v: float, side: float, w: float, x: float, y: float, yaw: float, p: Stack
) -> None:
    """Oscillation critic after a command: a turn that reverses the last one at |v| <= 0.05 m/s bans the way back.

    So does a step to the side. Signs and bans are forgotten once the robot is more than 0.05 m or 0.2 rad from where
    the ban began.
    """
    banned = False
    if abs(v) <= p.dwb.oscillation_speed_m_s and w != 0.0:
        sign = 1 if w > 0.0 else -1
        if state[LAST_SIGN] != 0 and sign != state[LAST_SIGN]:
            state[BAN_RIGHT if sign > 0 else BAN_LEFT] = 1
            banned = True
        state[LAST_SIGN] = sign
    if abs(v) <= p.dwb.oscillation_speed_m_s and side != 0.0:
        sign = 1 if side > 0.0 else -1
        if state[LAST_ASIDE] != 0 and sign != state[LAST_ASIDE]:
            state[BAN_ASIDE_RIGHT if sign > 0 else BAN_ASIDE_LEFT] = 1
            banned = True
        state[LAST_ASIDE] = sign
    if banned:
        reals[BAN_X] = x
        reals[BAN_Y] = y
        reals[BAN_YAW] = yaw
    if state[BAN_LEFT] != 0 or state[BAN_RIGHT] != 0 or state[BAN_ASIDE_LEFT] != 0 or state[BAN_ASIDE_RIGHT] != 0:
        square = (x - reals[BAN_X]) ** 2 + (y - reals[BAN_Y]) ** 2
        if square > p.dwb.oscillation_reset_m**2 or abs(yaw - reals[BAN_YAW]) > p.dwb.oscillation_reset_rad:
            forget_turns(state)


@inner
def is_banned(state: Ints, side: float, w: float) -> bool:
    """Whether the Oscillation critic forbids a turn or a step to the side."""
    if (state[BAN_LEFT] != 0 and w > 0.0) or (state[BAN_RIGHT] != 0 and w < 0.0):
        return True
    return (state[BAN_ASIDE_LEFT] != 0 and side > 0.0) or (state[BAN_ASIDE_RIGHT] != 0 and side < 0.0)


@inner
def cells_of(
    end: Floats, column: float, row: float, cos: float, sin: float, columns: int, rows: int
) -> tuple[int, int, int, int]:
    """Return the cells of a sample, (column, row) of its end and of the point ahead of it; -1 where one is off the map.

    Args:
        end: a row of `Rollouts.ends`.
        column: column of the robot with its fraction, cells; `row` likewise.
        cos: cosine of the robot's yaw over the side of a cell, 1/m; `sin` likewise.
    """
    x = column + cos * end[0] - sin * end[1]
    y = row + sin * end[0] + cos * end[1]
    ahead_x = column + cos * end[3] - sin * end[4]
    ahead_y = row + sin * end[3] + cos * end[4]
    if not (0.0 <= x < columns and 0.0 <= y < rows):
        return -1, -1, -1, -1
    if not (0.0 <= ahead_x < columns and 0.0 <= ahead_y < rows):
        return -1, -1, -1, -1
    return int(x), int(y), int(ahead_x), int(ahead_y)


@kernel
def choose(
    state: Ints,
    reals: Floats,
    maps: Scratch,
    memo: Rollouts,
    samples: Floats,
    master: Bytes,
    origin_column: int,
    origin_row: int,
    path: Floats,
    goal_yaw: float,
    x: float,
    y: float,
    yaw: float,
    measured_v: float,
    measured_side: float,
    measured_w: float,
    p: Stack,
) -> int:
    """The index of the best legal sample, -1 where there is none.

    `path` is in the local frame (metres), `origin_column`, `origin_row` the window's place in cells of 0.05 m, the
    velocities are the measured ones. The critics are RotateToGoal 32, Oscillation, BaseObstacle 0.02, GoalAlign 0.6,
    PathAlign 0.8 (off near the goal), PathDist 0.8, GoalDist 0.6; the best is the first free sample of least total.
    The sample that was best last time comes first, and a sample is dropped as soon as it cannot be the best any more:
    most before the distances from the path are looked for. `trace` works out the totals of all.
    """
    window, per_cell = 0.5 * p.maps.local_size_m, 0.5 * p.resolution  # distances are counted in cells
    goal_align, goal_distance = p.dwb.goal_align_scale * per_cell, p.dwb.goal_distance_scale * per_cell
    path_align, path_distance_scale = p.dwb.path_align_scale * per_cell, p.dwb.path_distance_scale * per_cell
    if not prune(state, path, x, y, window, p.dwb.prune_distance_m):
        return -1
    begin = state[PLAN_BEGIN]
    end = window_end(state, path, x, y, window)
    goal_x = path[state[PLAN_END] - 1, 0]
    goal_y = path[state[PLAN_END] - 1, 1]
    to_goal = math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)
    if to_goal <= p.behaviours.goal_tolerance_m:
        state[IN_WINDOW] = 1
    square = measured_v * measured_v + measured_side * measured_side
    if state[IN_WINDOW] == 1 and abs(measured_v) <= p.dwb.stopped_m_s and abs(measured_side) <= p.dwb.stopped_m_s:
        state[ROTATING] = 1
    last_x = path[end - 1, 0]
    last_y = path[end - 1, 1]
    bearing = math.atan2(goal_y - y, goal_x - x)
    forward_x = last_x + p.dwb.forward_point_m * math.cos(bearing)
    forward_y = last_y + p.dwb.forward_point_m * math.sin(bearing)
    align_column, align_row = take_sources(
        maps, state, path, begin, end, forward_x, forward_y, origin_column, origin_row, p.resolution
    )
    goal_column, goal_row = take_sources(
        maps, state, path, begin, end, last_x, last_y, origin_column, origin_row, p.resolution
    )
    if goal_column < 0 or align_column < 0:
        return -1
    state[STAMP] += 1
    ends = memo.ends[ends_of(memo, measured_v, measured_side, measured_w, reals[SHARE], samples, p)]
    column = x / p.resolution - origin_column
    row = y / p.resolution - origin_row
    rows, columns = master.shape
    if not (0.0 <= column < columns and 0.0 <= row < rows) or master[int(row), int(column)] >= INSCRIBED:
        state[LAST_BEST] = 0
        return -1
    cos = math.cos(yaw) / p.resolution
    sin = math.sin(yaw) / p.resolution
    count = samples.shape[0]
    best = -1
    least = math.inf
    for k in range(-1, count):
        s = state[LAST_BEST] - 1 if k < 0 else k
        if s < 0 or s >= count or s == best:
            continue
        w = samples[s, SAMPLE_W]
        side = samples[s, SAMPLE_SIDE]
        if is_banned(state, side, w):
            continue
        end_column, end_row, ahead_column, ahead_row = cells_of(ends[s], column, row, cos, sin, columns, rows)
        if end_column < 0:
            continue
        align = goal_align * (abs(ahead_column - align_column) + abs(ahead_row - align_row))
        goal = goal_distance * (abs(end_column - goal_column) + abs(end_row - goal_row))
        if align + goal > least + ROUNDING:
            continue
        cost = master[end_row, end_column]
        if cost >= INSCRIBED:
            continue
        rotate = 0.0
        if state[IN_WINDOW] != 0:
            rotate = rotate_to_goal(
                state, samples[s, SAMPLE_V], side, abs(wrap(yaw + ends[s, 2] - goal_yaw)), square, p.dwb.slowing_factor
            )
            if rotate < 0.0:
                continue
        total = p.dwb.rotate_to_goal_scale * rotate + p.dwb.obstacle_scale * cost
        total += align
        if total + goal > least + ROUNDING:
            continue
        if to_goal > p.dwb.forward_point_m:
            total += path_align * path_distance(maps, state, ahead_column, ahead_row)
            if total + goal > least + ROUNDING:
                continue
        total += path_distance_scale * path_distance(maps, state, end_column, end_row)
        total += goal
        if total > least or (total == least and s > best):
            continue
        if is_free(
            master, column, row, yaw, measured_v, measured_side, measured_w, samples[s, SAMPLE_V], side, w,
            int(samples[s, SAMPLE_STEPS]), samples[s, SAMPLE_DT], p,
        ):  # fmt: skip
            least = total
            best = s
    state[LAST_BEST] = best + 1
    return best
