"""The robot's base: velocity smoother, yaw gain, integration of the pose, and what its inertial sensor shows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.simulation.embedded.compiled import kernel
from rvsg.simulation.embedded.stack import Stack

Floats = NDArray[np.float64]

STEP_S = 0.01
"""Integration step, and the period of the inertial sensor (100 Hz)."""

# Indices of the state vector of the base.
X, Y, YAW, V, W, SMOOTH_V, SMOOTH_W, COMMAND_V, COMMAND_W, COMMAND_T, DIRECT = range(11)
BODY_SIZE = 11


@kernel
def wrap(angle: float) -> float:
    """The angle in (-π, π]."""
    turned = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return turned if turned > -math.pi else turned + 2.0 * math.pi


@kernel
def smoothed(command: float, last: float, low: float, high: float, up: float, down: float) -> float:
    """One tick of Nav2's velocity smoother on one axis: the command within low..high, approached by at most a step.

    It works open loop: `last` is its own last output, not the measured velocity.
    """
    wanted = min(high, max(low, command))
    step = up if abs(wanted) >= abs(last) and wanted * last >= 0.0 else down
    return last + min(step, max(-step, wanted - last))


@kernel
def smooth(body: Floats, t_s: float, stack: Stack) -> None:
    """Tick of the velocity smoother; a command older than 1 s counts as zero."""
    v = body[COMMAND_V]
    w = body[COMMAND_W]
    if t_s - body[COMMAND_T] > stack.command_timeout:
        v = 0.0
        w = 0.0
    body[SMOOTH_V] = smoothed(v, body[SMOOTH_V], stack.min_v, stack.max_v, stack.step_v, stack.step_down_v)
    body[SMOOTH_W] = smoothed(w, body[SMOOTH_W], -stack.max_w, stack.max_w, stack.step_w, stack.step_w)


@kernel
def advance(body: Floats, yaw_gain: float, imu_behind: float) -> tuple[float, float]:
    """Move the base by one step; returns the (forward, left) acceleration that the inertial sensor shows, m/s².

    The base follows its command at once, the yaw rate times `yaw_gain`. With α and v̇ the changes per step:
    forward v̇ + 0.287 ω², left v ω - 0.287 α. A recovery commands the base directly, past the smoother (DIRECT).
    """
    v = body[SMOOTH_V]
    w = yaw_gain * body[SMOOTH_W]
    if body[DIRECT] != 0.0:
        v = body[COMMAND_V]
        w = yaw_gain * body[COMMAND_W]
    forward = (v - body[V]) / STEP_S + imu_behind * w * w
    left = v * w - imu_behind * (w - body[W]) / STEP_S
    middle = body[YAW] + 0.5 * w * STEP_S
    body[X] += v * math.cos(middle) * STEP_S
    body[Y] += v * math.sin(middle) * STEP_S
    body[YAW] = wrap(body[YAW] + w * STEP_S)
    body[V] = v
    body[W] = w
    return forward, left
