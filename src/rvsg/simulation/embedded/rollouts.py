"""DWB samples: their velocities, their rollouts, cached by measured velocity, and the collision check."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner, kernel
from rvsg.simulation.costmap import INSCRIBED, outline_hits
from rvsg.simulation.embedded.robot_parameters import Stack

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


# Columns of the table of samples.
SAMPLE_V, SAMPLE_W, SAMPLE_STEPS, SAMPLE_DT, SAMPLE_SIDE = range(5)


def sample_table(p: Stack) -> Floats:
    """Return v, omega, number of steps, length of a step and speed to the left of every sample, in DWB's order, (S, 5).

    Forward speeds from the lowest to the highest; yaw rates between both limits, and 0 between the innermost two;
    not both zero. With a dynamic window smaller than that there is space for as many samples as it can hold.
    """
    if not p.whole_range:
        sides = p.dwb.lateral_samples + 1 if p.dwb.max_lateral_m_s > 0.0 else 1
        return np.zeros((p.dwb.speed_samples * sides * (p.dwb.yaw_rate_samples + 1), 5))
    low, high, most, time_s = p.dwb.min_speed_m_s, p.dwb.max_speed_m_s, p.dwb.max_yaw_rate_rad_s, p.dwb.sim_time_s
    rates = [-most + 2.0 * most * k / (p.dwb.yaw_rate_samples - 1) for k in range(p.dwb.yaw_rate_samples)]
    if 0.0 not in rates:
        rates.insert(p.dwb.yaw_rate_samples // 2, 0.0)
    speeds = low + (high - low) * np.arange(p.dwb.speed_samples) / (p.dwb.speed_samples - 1)
    v, w = np.repeat(speeds, len(rates)), np.tile(rates, p.dwb.speed_samples)
    moves = (v != 0.0) | (w != 0.0)
    v, w = v[moves], w[moves]
    linear, angular = p.dwb.linear_granularity_m, p.dwb.angular_granularity_rad
    longest = np.maximum(np.abs(v) * time_s / linear, np.abs(w) * time_s / angular)
    steps = np.maximum(1.0, np.ceil(longest))
    return np.column_stack([v, w, steps, time_s / steps, np.zeros(len(v))])


@kernel
def towards(wanted: float, now: float, up: float, down: float) -> float:
    """Go from `now` towards `wanted`, by at most `up` or `down`; Nav2's projectVelocity."""
    if now < wanted:
        return min(wanted, now + up)
    return max(wanted, now - down)


@kernel
def fill_window(samples: Floats, v0: float, side0: float, w0: float, share: float, p: Stack) -> int:
    """Write the samples of the dynamic window at measured velocities v0, side0, w0; return their number.

    As Nav2's XYThetaIterator: the velocities that can be reached within the time a rollout lasts, in even steps, the
    lateral speed and the yaw rate 0 between the innermost two. A robot that cannot turn on the spot samples the yaw
    rates that its steering allows at each speed; one that moves sideways is in no direction faster than ahead.
    A speed filter leaves a share of every highest speed.
    """
    share = min(1.0, share)
    fastest, most, turn = p.dwb.max_speed_m_s * share, p.dwb.max_lateral_m_s * share, p.dwb.max_yaw_rate_rad_s * share
    v = min(fastest, max(p.dwb.min_speed_m_s, v0))
    change, braking = p.dwb.acceleration_m_s2 * p.dwb.sim_time_s, p.dwb.deceleration_m_s2 * p.dwb.sim_time_s
    low = towards(p.dwb.min_speed_m_s, v, change, braking)
    high = towards(fastest, v, change, braking)
    speeds = p.dwb.speed_samples if high - low > 1e-5 else 1
    aside = min(most, max(-most, side0))
    right = towards(-most, aside, change, change)
    left = towards(most, aside, change, change)
    sides = p.dwb.lateral_samples if left - right > 1e-5 else 1
    count = 0
    for i in range(speeds):
        speed = low + (high - low) * i / max(1, speeds - 1)
        before = right
        for j in range(sides):
            side = right + (left - right) * j / max(1, sides - 1)
            if before < 0.0 < side:
                count = add_rates(samples, count, speed, 0.0, w0, turn, p)
            if side == 0.0 or speed * speed + side * side <= fastest * fastest:
                count = add_rates(samples, count, speed, side, w0, turn, p)
            before = side
    return count


@inner
def add_rates(samples: Floats, count: int, v: float, side: float, w0: float, limit: float, p: Stack) -> int:
    """Append a sample for every yaw rate within the limit and reach of w0; return the number of samples."""
    change = p.dwb.yaw_acceleration_rad_s2 * p.dwb.sim_time_s
    if p.drive.wheelbase_m > 0.0:
        limit = min(limit, abs(v) * p.curvature)
    w = min(limit, max(-limit, w0))
    right = towards(-limit, w, change, change)
    left = towards(limit, w, change, change)
    rates = p.dwb.yaw_rate_samples if left - right > 1e-5 else 1
    before = right
    for j in range(rates):
        rate = right + (left - right) * j / max(1, rates - 1)
        if before < 0.0 < rate:
            count = add_sample(samples, count, v, side, 0.0, p)
        count = add_sample(samples, count, v, side, rate, p)
        before = rate
    return count


@inner
def add_sample(samples: Floats, count: int, v: float, side: float, w: float, p: Stack) -> int:
    """Append a sample unless all velocities are zero; return the number of samples."""
    if v == 0.0 and side == 0.0 and w == 0.0:
        return count
    way = abs(v) if side == 0.0 else math.sqrt(v * v + side * side)
    along, turned = way * p.dwb.sim_time_s, abs(w) * p.dwb.sim_time_s
    steps = max(1, math.ceil(max(along / p.dwb.linear_granularity_m, turned / p.dwb.angular_granularity_rad)))
    samples[count, SAMPLE_V] = v
    samples[count, SAMPLE_W] = w
    samples[count, SAMPLE_STEPS] = steps
    samples[count, SAMPLE_DT] = p.dwb.sim_time_s / steps
    samples[count, SAMPLE_SIDE] = side
    return count + 1


MEMO_SIZE = 1024
MEMO_SAMPLES = 450_000
"""The memory of a robot with more samples holds fewer velocities."""


class Rollouts(NamedTuple):
    """A memory of where every sample ends, by measured velocity: pure, so it may outlive an episode.

    `keys` (M, 4) are the measured v, omega and speed to the left and the share of a speed filter (NaN: empty), `ends`
    (M, S, 5) in the frame of the robot: the end pose, and the point 0.1 m ahead of it.
    """

    keys: Floats
    ends: Floats


def rollouts(count: int) -> Rollouts:
    """An empty memory for `count` samples."""
    size = max(1, min(MEMO_SIZE, MEMO_SAMPLES // max(1, count)))
    return Rollouts(keys=np.full((size, 4), np.nan), ends=np.zeros((size, count, 5)))


@inner
def turns_of(samples: Floats, turns: Floats, which: Ints) -> int:
    """Write the yaw rates among the samples, and which of them each sample has; return their number."""
    count = 0
    for s in range(samples.shape[0]):
        k = 0
        while k < count and turns[k] != samples[s, SAMPLE_W]:
            k += 1
        if k == count:
            turns[k] = samples[s, SAMPLE_W]
            count += 1
        which[s] = k
    return count


@inner
def roll_out_headings(headings: Floats, w0: float, w1: float, steps: int, dt: float, p: Stack) -> None:
    """Write cosine, sine and angle of the heading before every step of a rollout, and after the last one."""
    w = w0
    yaw = 0.0
    for i in range(steps):
        headings[i, 0] = math.cos(yaw)
        headings[i, 1] = math.sin(yaw)
        headings[i, 2] = yaw
        w = towards(w1, w, p.dwb.yaw_acceleration_rad_s2 * dt, p.dwb.yaw_acceleration_rad_s2 * dt)
        yaw += w * dt
    headings[steps, 0] = math.cos(yaw)
    headings[steps, 1] = math.sin(yaw)
    headings[steps, 2] = yaw


@kernel(arrays=True)
def roll_out_ends(ends: Floats, v0: float, side0: float, w0: float, samples: Floats, p: Stack) -> None:
    """End poses (x, y, yaw) of all samples, and the points 0.1 m ahead, from pose (0, 0, 0) and velocities v0, w0.

    Per step: velocities approach the sample, the position advances along the old heading, then the heading turns.
    Samples of equal yaw rate and number of steps share their headings.
    """
    count = samples.shape[0]
    which = np.empty(count, np.int64)
    turns = np.empty(count)
    rates = turns_of(samples, turns, which)
    longest = 0
    for s in range(count):
        longest = max(longest, int(samples[s, SAMPLE_STEPS]))
    known = np.zeros(rates, np.int64)
    headings = np.empty((rates, longest + 1, 3))
    for s in range(count):
        steps = int(samples[s, SAMPLE_STEPS])
        dt = samples[s, SAMPLE_DT]
        heading = headings[which[s]]
        if known[which[s]] != steps:
            roll_out_headings(heading, w0, samples[s, SAMPLE_W], steps, dt, p)
            known[which[s]] = steps
        v = v0
        x = 0.0
        y = 0.0
        for i in range(steps):
            v = towards(samples[s, SAMPLE_V], v, p.dwb.acceleration_m_s2 * dt, p.dwb.deceleration_m_s2 * dt)
            x += v * heading[i, 0] * dt
            y += v * heading[i, 1] * dt
        if side0 != 0.0 or samples[s, SAMPLE_SIDE] != 0.0:
            side, change = side0, p.dwb.acceleration_m_s2 * dt
            for i in range(steps):
                side = towards(samples[s, SAMPLE_SIDE], side, change, change)
                x -= side * heading[i, 1] * dt
                y += side * heading[i, 0] * dt
        ends[s, 0] = x
        ends[s, 1] = y
        ends[s, 2] = heading[steps, 2]
        ends[s, 3] = x + p.dwb.forward_point_m * heading[steps, 0]
        ends[s, 4] = y + p.dwb.forward_point_m * heading[steps, 1]


@kernel
def ends_of(memo: Rollouts, v0: float, side0: float, w0: float, share: float, samples: Floats, p: Stack) -> int:
    """The row of the memory that holds the end poses for these measured velocities; works them out if need be."""
    slot = int(abs(v0 * 7919.0 + w0 * 104729.0 + side0 * 1299709.0) * 1009.0) % memo.keys.shape[0]
    key = memo.keys[slot]
    if key[0] != v0 or key[1] != w0 or key[2] != side0 or key[3] != share:
        roll_out_ends(memo.ends[slot], v0, side0, w0, samples, p)
        memo.keys[slot, 0] = v0
        memo.keys[slot, 1] = w0
        memo.keys[slot, 2] = side0
        memo.keys[slot, 3] = share
    return slot


@kernel
def is_free(
    master: Bytes,
    column: float,
    row: float,
    yaw: float,
    v0: float,
    side0: float,
    w0: float,
    v1: float,
    side1: float,
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
    side = side0
    w = w0
    x = column
    y = row
    sideways = side0 != 0.0 or side1 != 0.0
    for i in range(steps + 1):
        if not (0.0 <= x < columns and 0.0 <= y < rows) or master[int(y), int(x)] >= INSCRIBED:
            return False
        if p.dwb.check_footprint and outline_hits(master, p.footprint, x, y, yaw, p.resolution):
            return False
        if i < steps:
            v = towards(v1, v, p.dwb.acceleration_m_s2 * dt, p.dwb.deceleration_m_s2 * dt)
            w = towards(w1, w, p.dwb.yaw_acceleration_rad_s2 * dt, p.dwb.yaw_acceleration_rad_s2 * dt)
            x += v * math.cos(yaw) * dt / p.resolution
            y += v * math.sin(yaw) * dt / p.resolution
            if sideways:
                side = towards(side1, side, p.dwb.acceleration_m_s2 * dt, p.dwb.acceleration_m_s2 * dt)
                x -= side * math.sin(yaw) * dt / p.resolution
                y += side * math.cos(yaw) * dt / p.resolution
            yaw += w * dt
    return True
