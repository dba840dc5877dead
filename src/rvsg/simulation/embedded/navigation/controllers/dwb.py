"""DWB, Nav2's local planner: 419 sampled velocities, rolled out and scored by seven critics.

Values are those of the robot's configuration; rules those of nav2_dwb_controller (Humble).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.compiled import inner, kernel
from rvsg.simulation.embedded.base import wrap
from rvsg.simulation.embedded.navigation.costmap import INSCRIBED, outline_hits
from rvsg.simulation.embedded.stack import Stack

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Small = NDArray[np.int32]

MEMO_SIZE = 1024
ROUNDING = 1e-6
"""A sample is dropped only where its partial score is above the best total by more than rounding."""

# Indices of the integer state of the controller.
(IN_WINDOW, ROTATING, XY_REACHED, BAN_LEFT, BAN_RIGHT, LAST_SIGN, PLAN_BEGIN, PLAN_END, SOURCES, STAMP, ALL_SCORES,
 LAST_BEST) = range(12)  # fmt: skip
CONTROLLER_INTS = 12
# Indices of its real state: where the robot was when a turn was banned.
BAN_X, BAN_Y, BAN_YAW = range(3)
CONTROLLER_REALS = 3


# Columns of the table of samples.
SAMPLE_V, SAMPLE_W, SAMPLE_STEPS, SAMPLE_DT = range(4)


class Rollouts(NamedTuple):
    """A memory of where every sample ends, by measured velocity: pure, so it may outlive an episode.

    `keys` (M, 2) are the measured v and omega (NaN: empty), `ends` (M, S, 5) in the frame of the robot: the end pose,
    and the point 0.1 m ahead of it.
    """

    keys: Floats
    ends: Floats


class Scratch(NamedTuple):
    """Scratch space of a tick.

    `sources` (2, K) are columns and rows of the plan's cells; `distances` (2, 60, 60) remember distances already
    worked out and in which tick; `totals` (S,) the scores.
    """

    sources: Small
    distances: Ints
    totals: Floats


def samples(p: Stack) -> Floats:
    """Return v, omega, number of steps and length of a step of every sample, in DWB's order, (S, 4).

    Forward speeds from the lowest to the highest; yaw rates between both limits, and 0 between the innermost two;
    not both zero. With a dynamic window smaller than that there is space for as many samples as it can hold.
    """
    if not p.dwb_whole_range:
        return np.zeros((p.dwb_v_samples * (p.dwb_w_samples + 1), 4))
    speeds, rates = (p.dwb_min_v, p.dwb_max_v, p.dwb_v_samples), (p.dwb_max_w, p.dwb_w_samples)
    return _whole_table(speeds, rates, p.dwb_sim_time, p.dwb_linear, p.dwb_angular).copy()


@lru_cache(maxsize=8)
def _whole_table(
    speeds: tuple[float, float, int], turns: tuple[float, int], time_s: float, linear: float, angular: float
) -> Floats:
    """Return the samples of the whole range of velocities."""
    low, high, v_samples = speeds
    most, w_samples = turns
    rates = [-most + 2.0 * most * k / (w_samples - 1) for k in range(w_samples)]
    if 0.0 not in rates:
        rates.insert(w_samples // 2, 0.0)
    rows = []
    for k in range(v_samples):
        v = low + (high - low) * k / (v_samples - 1)
        for w in rates:
            steps = max(1, math.ceil(max(abs(v) * time_s / linear, abs(w) * time_s / angular)))
            if v != 0.0 or w != 0.0:
                rows.append((v, w, steps, time_s / steps))
    return np.array(rows, np.float64)


def rollouts(count: int) -> Rollouts:
    """An empty memory for `count` samples."""
    return Rollouts(keys=np.full((MEMO_SIZE, 2), np.nan), ends=np.zeros((MEMO_SIZE, count, 5)))


def scratch(count: int, cells: int) -> Scratch:
    """Scratch space for `count` samples."""
    return Scratch(
        sources=np.zeros((2, 256), np.int32),
        distances=np.zeros((2, cells, cells), np.int64),
        totals=np.zeros(count),
    )


@kernel
def towards(wanted: float, now: float, up: float, down: float) -> float:
    """Go from `now` towards `wanted`, by at most `up` or `down`; Nav2's projectVelocity."""
    if now < wanted:
        return min(wanted, now + up)
    return max(wanted, now - down)


@kernel
def fill_window(samples: Floats, v0: float, w0: float, p: Stack) -> int:
    """Write the samples of the dynamic window at measured velocities v0, w0; return their number.

    As Nav2's XYThetaIterator: the velocities that can be reached within the time a rollout lasts, in even steps, the
    yaw rate 0 between the innermost two. A robot that cannot turn on the spot samples the yaw rates that its steering
    allows at each speed.
    """
    v = min(p.dwb_max_v, max(p.dwb_min_v, v0))
    low = towards(p.dwb_min_v, v, p.dwb_acc_v * p.dwb_sim_time, p.dwb_dec_v * p.dwb_sim_time)
    high = towards(p.dwb_max_v, v, p.dwb_acc_v * p.dwb_sim_time, p.dwb_dec_v * p.dwb_sim_time)
    speeds = p.dwb_v_samples if high - low > 1e-5 else 1
    change = p.dwb_acc_w * p.dwb_sim_time
    count = 0
    for i in range(speeds):
        speed = low + (high - low) * i / max(1, speeds - 1)
        limit = p.dwb_max_w
        if p.wheelbase > 0.0:
            limit = min(limit, abs(speed) * p.curvature)
        w = min(limit, max(-limit, w0))
        left = towards(-limit, w, change, change)
        right = towards(limit, w, change, change)
        rates = p.dwb_w_samples if right - left > 1e-5 else 1
        before = left
        for j in range(rates):
            rate = left + (right - left) * j / max(1, rates - 1)
            if before < 0.0 < rate:
                count = add_sample(samples, count, speed, 0.0, p)
            count = add_sample(samples, count, speed, rate, p)
            before = rate
    return count


@inner
def add_sample(samples: Floats, count: int, v: float, w: float, p: Stack) -> int:
    """Append a sample unless both velocities are zero; return the number of samples."""
    if v == 0.0 and w == 0.0:
        return count
    steps = max(1, math.ceil(max(abs(v) * p.dwb_sim_time / p.dwb_linear, abs(w) * p.dwb_sim_time / p.dwb_angular)))
    samples[count, SAMPLE_V] = v
    samples[count, SAMPLE_W] = w
    samples[count, SAMPLE_STEPS] = steps
    samples[count, SAMPLE_DT] = p.dwb_sim_time / steps
    return count + 1


@kernel
def roll_out_ends(ends: Floats, v0: float, w0: float, samples: Floats, p: Stack) -> None:
    """End poses (x, y, yaw) of all samples, and the points 0.1 m ahead, from pose (0, 0, 0) and velocities v0, w0.

    Per step: velocities approach the sample, the position advances along the old heading, then the heading turns.
    """
    for s in range(samples.shape[0]):
        v = v0
        w = w0
        x = 0.0
        y = 0.0
        yaw = 0.0
        dt = samples[s, SAMPLE_DT]
        for _ in range(int(samples[s, SAMPLE_STEPS])):
            v = towards(samples[s, SAMPLE_V], v, p.dwb_acc_v * dt, p.dwb_dec_v * dt)
            w = towards(samples[s, SAMPLE_W], w, p.dwb_acc_w * dt, p.dwb_acc_w * dt)
            x += v * math.cos(yaw) * dt
            y += v * math.sin(yaw) * dt
            yaw += w * dt
        ends[s, 0] = x
        ends[s, 1] = y
        ends[s, 2] = yaw
        ends[s, 3] = x + p.dwb_forward_point * math.cos(yaw)
        ends[s, 4] = y + p.dwb_forward_point * math.sin(yaw)


@kernel
def ends_of(memo: Rollouts, v0: float, w0: float, samples: Floats, p: Stack) -> int:
    """The row of the memory that holds the end poses for measured velocities v0, w0; works them out if need be."""
    slot = int(abs(v0 * 7919.0 + w0 * 104729.0) * 1009.0) % MEMO_SIZE
    if memo.keys[slot, 0] != v0 or memo.keys[slot, 1] != w0:
        roll_out_ends(memo.ends[slot], v0, w0, samples, p)
        memo.keys[slot, 0] = v0
        memo.keys[slot, 1] = w0
    return slot


@kernel
def is_free(
    master: Bytes,
    column: float,
    row: float,
    yaw: float,
    v0: float,
    w0: float,
    v1: float,
    w1: float,
    steps: int,
    dt: float,
    p: Stack,
) -> bool:
    """Whether every pose of a rollout has its centre on the map and off inscribed and lethal cells; in cells.

    With `dwb_footprint` the outline of the footprint must be on the map and off lethal cells, too.
    """
    rows, columns = master.shape
    v = v0
    w = w0
    x = column
    y = row
    for i in range(steps + 1):
        if not (0.0 <= x < columns and 0.0 <= y < rows) or master[int(y), int(x)] >= INSCRIBED:
            return False
        if p.dwb_footprint and outline_hits(master, p.footprint, x, y, yaw, p.resolution):
            return False
        if i < steps:
            v = towards(v1, v, p.dwb_acc_v * dt, p.dwb_dec_v * dt)
            w = towards(w1, w, p.dwb_acc_w * dt, p.dwb_acc_w * dt)
            x += v * math.cos(yaw) * dt / p.resolution
            y += v * math.sin(yaw) * dt / p.resolution
            yaw += w * dt
    return True


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
    state[BAN_LEFT] = 0
    state[BAN_RIGHT] = 0
    state[LAST_SIGN] = 0


@kernel
def rotate_to_goal(state: Ints, v: float, yaw_error: float, measured_v: float, slowing: float) -> float:
    """Raw score of RotateToGoal for a sample that ends `yaw_error` from the goal's yaw; -1 where it is illegal."""
    if state[IN_WINDOW] == 0:
        return 0.0
    if state[ROTATING] == 0:
        if v * v >= measured_v * measured_v:
            return -1.0
        return slowing * v * v + yaw_error
    return -1.0 if v > 0.0 else yaw_error


@kernel
def remember_turn(state: Ints, reals: Floats, v: float, w: float, x: float, y: float, yaw: float, p: Stack) -> None:
    """Oscillation critic after a command: a turn that reverses the last one at |v| <= 0.05 m/s bans the way back.

    Signs and bans are forgotten once the robot is more than 0.05 m or 0.2 rad from where the ban began.
    """
    if abs(v) <= p.dwb_oscillation_v and w != 0.0:
        sign = 1 if w > 0.0 else -1
        if state[LAST_SIGN] != 0 and sign != state[LAST_SIGN]:
            state[BAN_RIGHT if sign > 0 else BAN_LEFT] = 1
            reals[BAN_X] = x
            reals[BAN_Y] = y
            reals[BAN_YAW] = yaw
        state[LAST_SIGN] = sign
    if state[BAN_LEFT] != 0 or state[BAN_RIGHT] != 0:
        square = (x - reals[BAN_X]) ** 2 + (y - reals[BAN_Y]) ** 2
        if square > p.dwb_oscillation_m**2 or abs(yaw - reals[BAN_YAW]) > p.dwb_oscillation_rad:
            state[BAN_LEFT] = 0
            state[BAN_RIGHT] = 0
            state[LAST_SIGN] = 0


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
    measured_w: float,
    p: Stack,
) -> int:
    """The index of the best legal sample, -1 where there is none.

    `path` is in the local frame (metres), `origin_column`, `origin_row` the window's place in cells of 0.05 m, the
    velocities are the measured ones. Where ALL_SCORES is set, all samples are scored for a recorder, and only the best
    are rolled out to see whether they are free. Else a sample is dropped as soon as it cannot be the best any more.
    Both select the same sample as scoring and checking them all.
    """
    if not prune(state, path, x, y, p.dwb_window, p.dwb_prune):
        return -1
    begin = state[PLAN_BEGIN]
    end = window_end(state, path, x, y, p.dwb_window)
    goal_x = path[state[PLAN_END] - 1, 0]
    goal_y = path[state[PLAN_END] - 1, 1]
    to_goal = math.sqrt((goal_x - x) ** 2 + (goal_y - y) ** 2)
    if to_goal <= p.xy_tolerance:
        state[IN_WINDOW] = 1
    if state[IN_WINDOW] == 1 and abs(measured_v) <= p.dwb_stopped:
        state[ROTATING] = 1
    last_x = path[end - 1, 0]
    last_y = path[end - 1, 1]
    bearing = math.atan2(goal_y - y, goal_x - x)
    forward_x = last_x + p.dwb_forward_point * math.cos(bearing)
    forward_y = last_y + p.dwb_forward_point * math.sin(bearing)
    align_column, align_row = take_sources(
        maps, state, path, begin, end, forward_x, forward_y, origin_column, origin_row, p.resolution
    )
    goal_column, goal_row = take_sources(
        maps, state, path, begin, end, last_x, last_y, origin_column, origin_row, p.resolution
    )
    if goal_column < 0 or align_column < 0:
        return -1
    state[STAMP] += 1
    ends = memo.ends[ends_of(memo, measured_v, measured_w, samples, p)]
    column = x / p.resolution - origin_column
    row = y / p.resolution - origin_row
    if state[ALL_SCORES] == 0:
        best = best_of(
            maps, state, samples, ends, master, column, row, yaw, goal_yaw, measured_v, measured_w, goal_column,
            goal_row, align_column, align_row, to_goal > p.dwb_forward_point, p,
        )  # fmt: skip
        state[LAST_BEST] = best + 1
        return best
    score(
        maps, state, samples, ends, master, column, row, yaw, goal_yaw, measured_v, goal_column, goal_row, align_column,
        align_row, to_goal > p.dwb_forward_point, p,
    )  # fmt: skip
    totals = maps.totals[: samples.shape[0]]
    return best_free(totals, samples, master, column, row, yaw, measured_v, measured_w, p)


@inner
def best_of(
    maps: Scratch,
    state: Ints,
    samples: Floats,
    ends: Floats,
    master: Bytes,
    column: float,
    row: float,
    yaw: float,
    goal_yaw: float,
    measured_v: float,
    measured_w: float,
    goal_column: int,
    goal_row: int,
    align_column: int,
    align_row: int,
    align_path: bool,
    p: Stack,
) -> int:
    """The first free sample of least total, -1 where there is none: `score` and `best_free` in one pass.

    The sample that was best last time comes first, so that most others are dropped before the distances from the path
    are looked for. Terms are added in the same order as in `score`, so the totals are the same to the last bit.
    """
    rows, columns = master.shape
    if not (0.0 <= column < columns and 0.0 <= row < rows) or master[int(row), int(column)] >= INSCRIBED:
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
        if (state[BAN_LEFT] != 0 and w > 0.0) or (state[BAN_RIGHT] != 0 and w < 0.0):
            continue
        x = column + cos * ends[s, 0] - sin * ends[s, 1]
        y = row + sin * ends[s, 0] + cos * ends[s, 1]
        ahead_x = column + cos * ends[s, 3] - sin * ends[s, 4]
        ahead_y = row + sin * ends[s, 3] + cos * ends[s, 4]
        if not (0.0 <= x < columns and 0.0 <= y < rows):
            continue
        if not (0.0 <= ahead_x < columns and 0.0 <= ahead_y < rows):
            continue
        end_column = int(x)
        end_row = int(y)
        ahead_column = int(ahead_x)
        ahead_row = int(ahead_y)
        align = p.dwb_goal_align * (abs(ahead_column - align_column) + abs(ahead_row - align_row))
        goal = p.dwb_goal_dist * (abs(end_column - goal_column) + abs(end_row - goal_row))
        if align + goal > least + ROUNDING:
            continue
        cost = master[end_row, end_column]
        if cost >= INSCRIBED:
            continue
        rotate = 0.0
        if state[IN_WINDOW] != 0:
            rotate = rotate_to_goal(
                state, samples[s, SAMPLE_V], abs(wrap(yaw + ends[s, 2] - goal_yaw)), measured_v, p.dwb_slowing
            )
            if rotate < 0.0:
                continue
        total = p.dwb_rotate * rotate + p.dwb_obstacle * cost
        total += align
        if total + goal > least + ROUNDING:
            continue
        if align_path:
            total += p.dwb_path_align * path_distance(maps, state, ahead_column, ahead_row)
            if total + goal > least + ROUNDING:
                continue
        total += p.dwb_path_dist * path_distance(maps, state, end_column, end_row)
        total += goal
        if total > least or (total == least and s > best):
            continue
        if is_free(
            master, column, row, yaw, measured_v, measured_w, samples[s, SAMPLE_V], w, int(samples[s, SAMPLE_STEPS]),
            samples[s, SAMPLE_DT], p,
        ):  # fmt: skip
            least = total
            best = s
    return best


@kernel
def score(
    maps: Scratch,
    state: Ints,
    samples: Floats,
    ends: Floats,
    master: Bytes,
    column: float,
    row: float,
    yaw: float,
    goal_yaw: float,
    measured_v: float,
    goal_column: int,
    goal_row: int,
    align_column: int,
    align_row: int,
    align_path: bool,
    p: Stack,
) -> None:
    """Total score of every sample into `maps.totals`, infinite where a critic that needs only the end forbids it.

    RotateToGoal 32, Oscillation, BaseObstacle 0.02, GoalAlign 0.6, PathAlign 0.8 (off near the goal), PathDist 0.8,
    GoalDist 0.6.
    """
    cos = math.cos(yaw) / p.resolution
    sin = math.sin(yaw) / p.resolution
    rows, columns = master.shape
    slowing = p.dwb_slowing
    rotate_scale = p.dwb_rotate
    obstacle_scale = p.dwb_obstacle
    goal_align = p.dwb_goal_align
    goal_dist = p.dwb_goal_dist
    path_align = p.dwb_path_align
    path_dist = p.dwb_path_dist
    for s in range(samples.shape[0]):
        maps.totals[s] = math.inf
        w = samples[s, SAMPLE_W]
        if (state[BAN_LEFT] != 0 and w > 0.0) or (state[BAN_RIGHT] != 0 and w < 0.0):
            continue
        rotate = 0.0
        if state[IN_WINDOW] != 0:
            rotate = rotate_to_goal(
                state, samples[s, SAMPLE_V], abs(wrap(yaw + ends[s, 2] - goal_yaw)), measured_v, slowing
            )
            if rotate < 0.0:
                continue
        x = column + cos * ends[s, 0] - sin * ends[s, 1]
        y = row + sin * ends[s, 0] + cos * ends[s, 1]
        ahead_x = column + cos * ends[s, 3] - sin * ends[s, 4]
        ahead_y = row + sin * ends[s, 3] + cos * ends[s, 4]
        if not (0.0 <= x < columns and 0.0 <= y < rows):
            continue
        if not (0.0 <= ahead_x < columns and 0.0 <= ahead_y < rows):
            continue
        end_column = int(x)
        end_row = int(y)
        ahead_column = int(ahead_x)
        ahead_row = int(ahead_y)
        cost = master[end_row, end_column]
        if cost >= INSCRIBED:
            continue
        total = rotate_scale * rotate + obstacle_scale * cost
        total += goal_align * (abs(ahead_column - align_column) + abs(ahead_row - align_row))
        if align_path:
            total += path_align * path_distance(maps, state, ahead_column, ahead_row)
        total += path_dist * path_distance(maps, state, end_column, end_row)
        total += goal_dist * (abs(end_column - goal_column) + abs(end_row - goal_row))
        maps.totals[s] = total


@kernel
def best_free(
    totals: Floats,
    samples: Floats,
    master: Bytes,
    column: float,
    row: float,
    yaw: float,
    measured_v: float,
    measured_w: float,
    p: Stack,
) -> int:
    """The first sample of least total whose whole rollout is free; -1 where there is none. Overwrites `totals`."""
    rows, columns = master.shape
    if not (0.0 <= column < columns and 0.0 <= row < rows) or master[int(row), int(column)] >= INSCRIBED:
        return -1
    while True:
        best = -1
        least = math.inf
        for s in range(totals.size):
            if totals[s] < least:
                least = totals[s]
                best = s
        if best < 0:
            return -1
        if is_free(
            master, column, row, yaw, measured_v, measured_w, samples[best, SAMPLE_V], samples[best, SAMPLE_W],
            int(samples[best, SAMPLE_STEPS]), samples[best, SAMPLE_DT], p,
        ):  # fmt: skip
            return best
        totals[best] = math.inf
