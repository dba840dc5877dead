"""Rollouts of DWB's samples, cached by measured velocity, and their collision check."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner, kernel
from rvsg.simulation.embedded.navigation.controllers.samples import (
    SAMPLE_DT,
    SAMPLE_SIDE,
    SAMPLE_STEPS,
    SAMPLE_V,
    SAMPLE_W,
    towards,
)
from rvsg.simulation.embedded.navigation.costmap import INSCRIBED, outline_hits
from rvsg.simulation.embedded.stack import Stack

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

MEMO_SIZE = 1024
MEMO_SAMPLES = 450_000
"""The memory of a robot with more samples holds fewer velocities."""


class Rollouts(NamedTuple):
    """A memory of where every sample ends, by measured velocity: pure, so it may outlive an episode.

    `keys` (M, 3) are the measured v, omega and speed to the left (NaN: empty), `ends` (M, S, 5) in the frame of the
    robot: the end pose, and the point 0.1 m ahead of it.
    """

    keys: Floats
    ends: Floats


def rollouts(count: int) -> Rollouts:
    """An empty memory for `count` samples."""
    size = max(1, min(MEMO_SIZE, MEMO_SAMPLES // max(1, count)))
    return Rollouts(keys=np.full((size, 3), np.nan), ends=np.zeros((size, count, 5)))


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
        w = towards(w1, w, p.dwb_acc_w * dt, p.dwb_acc_w * dt)
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
            v = towards(samples[s, SAMPLE_V], v, p.dwb_acc_v * dt, p.dwb_dec_v * dt)
            x += v * heading[i, 0] * dt
            y += v * heading[i, 1] * dt
        if side0 != 0.0 or samples[s, SAMPLE_SIDE] != 0.0:
            side = side0
            for i in range(steps):
                side = towards(samples[s, SAMPLE_SIDE], side, p.dwb_acc_v * dt, p.dwb_acc_v * dt)
                x -= side * heading[i, 1] * dt
                y += side * heading[i, 0] * dt
        ends[s, 0] = x
        ends[s, 1] = y
        ends[s, 2] = heading[steps, 2]
        ends[s, 3] = x + p.dwb_forward_point * heading[steps, 0]
        ends[s, 4] = y + p.dwb_forward_point * heading[steps, 1]


@kernel
def ends_of(memo: Rollouts, v0: float, side0: float, w0: float, samples: Floats, p: Stack) -> int:
    """The row of the memory that holds the end poses for these measured velocities; works them out if need be."""
    slot = int(abs(v0 * 7919.0 + w0 * 104729.0 + side0 * 1299709.0) * 1009.0) % memo.keys.shape[0]
    if memo.keys[slot, 0] != v0 or memo.keys[slot, 1] != w0 or memo.keys[slot, 2] != side0:
        roll_out_ends(memo.ends[slot], v0, side0, w0, samples, p)
        memo.keys[slot, 0] = v0
        memo.keys[slot, 1] = w0
        memo.keys[slot, 2] = side0
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
        if p.dwb_footprint and outline_hits(master, p.footprint, x, y, yaw, p.resolution):
            return False
        if i < steps:
            v = towards(v1, v, p.dwb_acc_v * dt, p.dwb_dec_v * dt)
            w = towards(w1, w, p.dwb_acc_w * dt, p.dwb_acc_w * dt)
            x += v * math.cos(yaw) * dt / p.resolution
            y += v * math.sin(yaw) * dt / p.resolution
            if sideways:
                side = towards(side1, side, p.dwb_acc_v * dt, p.dwb_acc_v * dt)
                x -= side * math.sin(yaw) * dt / p.resolution
                y += side * math.cos(yaw) * dt / p.resolution
            yaw += w * dt
    return True
