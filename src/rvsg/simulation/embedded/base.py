"""The robot's base: velocity smoother, drive with its limits, integration of the pose, inertial sensor."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.angles import wrap
from rvsg.core.kernels import inner, kernel
from rvsg.simulation.embedded.robot_parameters import Stack

Floats = NDArray[np.float64]

STEP_S = 0.01
"""Integration step, and the period of the inertial sensor (100 Hz)."""

# Indices of the state vector of the base: pose, velocity, last output of the smoother, command with its time and
# whether it goes past the smoother, acceleration and steering angle now, highest forward and reverse speed that the
# safety scanners allow, until when a touched bumper stops the drive, by what the collision monitor scales the command;
# and of the motion to the left: speed, last output of the smoother, command, acceleration.
(X, Y, YAW, V, W, SMOOTH_V, SMOOTH_W, COMMAND_V, COMMAND_W, COMMAND_T, DIRECT, ACCELERATION, STEERING, CAP_AHEAD,
 CAP_BEHIND, STOPPED_T, RATIO, SIDE, SMOOTH_SIDE, COMMAND_SIDE, SIDE_ACCELERATION) = range(21)  # fmt: skip
BODY_SIZE = 21
NO_CAP = 1e9


def new_body() -> Floats:
    """Return the state of a base that stands at the origin."""
    body = np.zeros(BODY_SIZE)
    body[CAP_AHEAD] = NO_CAP
    body[CAP_BEHIND] = NO_CAP
    body[STOPPED_T] = -NO_CAP
    body[RATIO] = 1.0
    return body


@inner
def into_frame(edge: Floats, x: float, y: float, cos: float, sin: float) -> tuple[float, float, float, float]:
    """Return both ends of an edge in a frame at (x, y) that is turned by the angle of `cos` and `sin`."""
    ax = edge[0] - x
    ay = edge[1] - y
    bx = edge[2] - x
    by = edge[3] - y
    return cos * ax + sin * ay, cos * ay - sin * ax, cos * bx + sin * by, cos * by - sin * bx


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
    side = body[COMMAND_SIDE]
    if t_s - body[COMMAND_T] > stack.smoother.timeout_s:
        v = 0.0
        w = 0.0
        side = 0.0
    smoother, lateral = stack.smoother, stack.limits.lateral_m_s
    up = smoother.acceleration_m_s2 / smoother.frequency_hz
    down = smoother.deceleration_m_s2 / smoother.frequency_hz
    turn, change = smoother.max_yaw_rate_rad_s, smoother.yaw_acceleration_rad_s2 / smoother.frequency_hz
    body[SMOOTH_V] = smoothed(v, body[SMOOTH_V], -smoother.max_reverse_m_s, smoother.max_speed_m_s, up, down)
    body[SMOOTH_W] = smoothed(w, body[SMOOTH_W], -turn, turn, change, change)
    if lateral > 0.0:
        body[SMOOTH_SIDE] = smoothed(side, body[SMOOTH_SIDE], -lateral, lateral, up, down)


@inner
def delayed(waiting: Floats, k: int, v: float, side: float, w: float) -> tuple[float, float, float]:
    """Return the command of `latency_ticks` ago; `waiting` (ticks, 3) is the ring of commands on their way."""
    row = waiting[k % waiting.shape[0]]
    old_v = row[0]
    old_w = row[1]
    old_side = row[2]
    row[0] = v
    row[1] = w
    row[2] = side
    return old_v, old_side, old_w


@inner
def speed_up(now: float, acceleration: float, wanted: float, stack: Stack) -> tuple[float, float]:
    """Return a speed after a step towards `wanted`, within the base's limits of acceleration and jerk, and its rate."""
    braking = abs(wanted) < abs(now) or wanted * now < 0.0
    limit = stack.limits.deceleration_m_s2 if braking else stack.limits.acceleration_m_s2
    rate = (wanted - now) / STEP_S
    jerk = stack.limits.jerk_m_s3
    if jerk > 0.0:
        # The acceleration must be back at 0 when the speed is reached.
        step = jerk * STEP_S
        limit = min(limit, math.sqrt(0.25 * step * step + 2.0 * jerk * abs(wanted - now)) - 0.5 * step)
    rate = min(limit, max(-limit, rate))
    if jerk > 0.0:
        change = jerk * STEP_S
        rate = min(acceleration + change, max(acceleration - change, rate))
        if abs(rate) * STEP_S > abs(wanted - now) and rate * (wanted - now) > 0.0:
            rate = (wanted - now) / STEP_S
    return now + rate * STEP_S, rate


@inner
def steer(body: Floats, v: float, wanted_v: float, wanted_w: float, stack: Stack) -> float:
    """Turn the steered wheel towards what (wanted_v, wanted_w) asks for; return the yaw rate at speed v."""
    wanted = body[STEERING]
    if abs(wanted_v) > 1e-6:
        wanted = math.atan(wanted_w * stack.drive.wheelbase_m / wanted_v)
    elif wanted_w == 0.0:
        wanted = 0.0
    wanted = min(stack.drive.max_steering_rad, max(-stack.drive.max_steering_rad, wanted))
    if stack.drive.steering_rate_rad_s > 0.0:
        step = stack.drive.steering_rate_rad_s * STEP_S
        wanted = min(body[STEERING] + step, max(body[STEERING] - step, wanted))
    body[STEERING] = wanted
    return float(v * math.tan(wanted) / stack.drive.wheelbase_m)


@inner
def follow_command(
    body: Floats, v: float, side: float, w: float, t_s: float, stack: Stack
) -> tuple[float, float, float]:
    """Return the velocities after a step: what the drive, its limits, scanners and bumper make of (v, side, w).

    A zone of the scanners that limits the speed ahead or behind limits the lateral one, too.
    """
    v = min(body[CAP_AHEAD], max(-body[CAP_BEHIND], v))
    cap = min(stack.limits.lateral_m_s, body[CAP_AHEAD], body[CAP_BEHIND])
    side = min(cap, max(-cap, side))
    if t_s < body[STOPPED_T]:
        v = 0.0
        side = 0.0
        w = 0.0
    if not stack.limits.enforced:
        return v, side, w
    wanted = v
    v = min(stack.limits.speed_m_s, max(-stack.limits.reverse_m_s, v))
    v, body[ACCELERATION] = speed_up(body[V], body[ACCELERATION], v, stack)
    if stack.drive.wheelbase_m > 0.0:
        return v, 0.0, steer(body, v, wanted, w, stack)
    if stack.limits.lateral_m_s > 0.0:
        side, body[SIDE_ACCELERATION] = speed_up(body[SIDE], body[SIDE_ACCELERATION], side, stack)
    w = min(stack.limits.yaw_rate_rad_s, max(-stack.limits.yaw_rate_rad_s, w))
    step = stack.limits.yaw_acceleration_rad_s2 * STEP_S
    return v, side, min(body[W] + step, max(body[W] - step, w))


@kernel
def advance(body: Floats, yaw_gain: float, waiting: Floats, k: int, stack: Stack) -> tuple[float, float]:
    """Move the base by one step; return the (forward, left) acceleration that the inertial sensor shows, m/s².

    The yaw rate is the commanded one times `yaw_gain`. With α, v̇ and u̇ the changes per step of yaw rate, forward and
    lateral speed and r the sensor's distance behind the base frame: forward v̇ + r ω² - u ω, left v ω - r α + u̇.
    A recovery commands the base directly, past the smoother.

    Args:
        waiting: commands on their way to the base, (latency in ticks, 3).
        k: number of the tick.
    """
    v = body[SMOOTH_V]
    side = body[SMOOTH_SIDE]
    w = yaw_gain * body[SMOOTH_W]
    if body[DIRECT] != 0.0:
        v = body[COMMAND_V]
        side = body[COMMAND_SIDE]
        w = yaw_gain * body[COMMAND_W]
    v *= body[RATIO]
    side *= body[RATIO]
    w *= body[RATIO]
    if stack.latency_ticks > 0:
        v, side, w = delayed(waiting, k, v, side, w)
    v, side, w = follow_command(body, v, side, w, k * STEP_S, stack)
    forward = (v - body[V]) / STEP_S + stack.imu_behind * w * w
    left = v * w - stack.imu_behind * (w - body[W]) / STEP_S
    middle = body[YAW] + 0.5 * w * STEP_S
    body[X] += v * math.cos(middle) * STEP_S
    body[Y] += v * math.sin(middle) * STEP_S
    if side != 0.0 or body[SIDE] != 0.0:
        forward -= side * w
        left += (side - body[SIDE]) / STEP_S
        body[X] -= side * math.sin(middle) * STEP_S
        body[Y] += side * math.cos(middle) * STEP_S
    body[YAW] = wrap(body[YAW] + w * STEP_S)
    body[V] = v
    body[SIDE] = side
    body[W] = w
    return forward, left
