"""The robot's base: velocity smoother, yaw gain, integration of the pose, and what its inertial sensor shows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.simulation.embedded.compiled import kernel

Floats = NDArray[np.float64]

STEP_S = 0.01
"""Integration step, and the period of the inertial sensor (100 Hz)."""
SMOOTHER_PERIOD_S = 0.05
SMOOTHER_RATE_HZ = 20.0
MAX_V_M_S = 0.5
MAX_W_RAD_S = 2.5
STEP_V_M_S = 2.5 / SMOOTHER_RATE_HZ
STEP_W_RAD_S = 3.2 / SMOOTHER_RATE_HZ
COMMAND_TIMEOUT_S = 1.0
"""Nav2's velocity smoother with its defaults: speed limits, acceleration limits per tick, command time-out."""
IMU_BEHIND_M = 0.287
"""The inertial sensor sits this far behind the centre (the robot's URDF)."""
HALF_LENGTH_M = 0.36
HALF_WIDTH_M = 0.25
"""Half of the navigation footprint, 0.35 x 0.24 m, with Nav2's default padding of 0.01 m."""

# Indices of the state vector of the base.
X, Y, YAW, V, W, SMOOTH_V, SMOOTH_W, COMMAND_V, COMMAND_W, COMMAND_T, DIRECT = range(11)
BODY_SIZE = 11


@kernel
def wrap(angle: float) -> float:
    """The angle in (-π, π]."""
    turned = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return turned if turned > -math.pi else turned + 2.0 * math.pi


@kernel
def smoothed(command: float, last: float, limit: float, step: float) -> float:
    """One tick of Nav2's velocity smoother on one axis: the command within ±limit, approached by at most ±step.

    It works open loop: `last` is its own last output, not the measured velocity.
    """
    wanted = min(limit, max(-limit, command))
    return last + min(step, max(-step, wanted - last))


@kernel
def smooth(body: Floats, t_s: float) -> None:
    """Tick of the velocity smoother; a command older than 1 s counts as zero."""
    v = body[COMMAND_V]
    w = body[COMMAND_W]
    if t_s - body[COMMAND_T] > COMMAND_TIMEOUT_S:
        v = 0.0
        w = 0.0
    body[SMOOTH_V] = smoothed(v, body[SMOOTH_V], MAX_V_M_S, STEP_V_M_S)
    body[SMOOTH_W] = smoothed(w, body[SMOOTH_W], MAX_W_RAD_S, STEP_W_RAD_S)


@kernel
def advance(body: Floats, yaw_gain: float) -> tuple[float, float]:
    """Move the base by one step; returns the (forward, left) acceleration that the inertial sensor shows, m/s².

    The base follows its command at once, the yaw rate times `yaw_gain`. With α and v̇ the changes per step:
    forward v̇ + 0.287 ω², left v ω - 0.287 α. A recovery commands the base directly, past the smoother (DIRECT).
    """
    v = body[SMOOTH_V]
    w = yaw_gain * body[SMOOTH_W]
    if body[DIRECT] != 0.0:
        v = body[COMMAND_V]
        w = yaw_gain * body[COMMAND_W]
    forward = (v - body[V]) / STEP_S + IMU_BEHIND_M * w * w
    left = v * w - IMU_BEHIND_M * (w - body[W]) / STEP_S
    middle = body[YAW] + 0.5 * w * STEP_S
    body[X] += v * math.cos(middle) * STEP_S
    body[Y] += v * math.sin(middle) * STEP_S
    body[YAW] = wrap(body[YAW] + w * STEP_S)
    body[V] = v
    body[W] = w
    return forward, left
