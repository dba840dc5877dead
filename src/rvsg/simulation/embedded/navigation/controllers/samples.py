"""The velocities that DWB samples: a fixed table or Nav2's dynamic window."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner, kernel
from rvsg.simulation.embedded.stack import Stack

Floats = NDArray[np.float64]

# Columns of the table of samples.
SAMPLE_V, SAMPLE_W, SAMPLE_STEPS, SAMPLE_DT, SAMPLE_SIDE = range(5)


def sample_table(p: Stack) -> Floats:
    """Return v, omega, number of steps, length of a step and speed to the left of every sample, in DWB's order, (S, 5).

    Forward speeds from the lowest to the highest; yaw rates between both limits, and 0 between the innermost two;
    not both zero. With a dynamic window smaller than that there is space for as many samples as it can hold.
    """
    if not p.dwb_whole_range:
        sides = p.dwb_side_samples + 1 if p.dwb_max_side > 0.0 else 1
        return np.zeros((p.dwb_v_samples * sides * (p.dwb_w_samples + 1), 5))
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
                rows.append((v, w, steps, time_s / steps, 0.0))
    return np.array(rows, np.float64)


@kernel
def towards(wanted: float, now: float, up: float, down: float) -> float:
    """Go from `now` towards `wanted`, by at most `up` or `down`; Nav2's projectVelocity."""
    if now < wanted:
        return min(wanted, now + up)
    return max(wanted, now - down)


@kernel
def fill_window(samples: Floats, v0: float, side0: float, w0: float, p: Stack) -> int:
    """Write the samples of the dynamic window at measured velocities v0, side0, w0; return their number.

    As Nav2's XYThetaIterator: the velocities that can be reached within the time a rollout lasts, in even steps, the
    lateral speed and the yaw rate 0 between the innermost two. A robot that cannot turn on the spot samples the yaw
    rates that its steering allows at each speed; one that moves sideways is in no direction faster than ahead.
    """
    v = min(p.dwb_max_v, max(p.dwb_min_v, v0))
    low = towards(p.dwb_min_v, v, p.dwb_acc_v * p.dwb_sim_time, p.dwb_dec_v * p.dwb_sim_time)
    high = towards(p.dwb_max_v, v, p.dwb_acc_v * p.dwb_sim_time, p.dwb_dec_v * p.dwb_sim_time)
    speeds = p.dwb_v_samples if high - low > 1e-5 else 1
    change = p.dwb_acc_v * p.dwb_sim_time
    aside = min(p.dwb_max_side, max(-p.dwb_max_side, side0))
    right = towards(-p.dwb_max_side, aside, change, change)
    left = towards(p.dwb_max_side, aside, change, change)
    sides = p.dwb_side_samples if left - right > 1e-5 else 1
    count = 0
    for i in range(speeds):
        speed = low + (high - low) * i / max(1, speeds - 1)
        before = right
        for j in range(sides):
            side = right + (left - right) * j / max(1, sides - 1)
            if before < 0.0 < side:
                count = add_rates(samples, count, speed, 0.0, w0, p)
            if side == 0.0 or speed * speed + side * side <= p.dwb_max_v * p.dwb_max_v:
                count = add_rates(samples, count, speed, side, w0, p)
            before = side
    return count


@inner
def add_rates(samples: Floats, count: int, v: float, side: float, w0: float, p: Stack) -> int:
    """Append a sample for every yaw rate within reach of w0; return the number of samples."""
    change = p.dwb_acc_w * p.dwb_sim_time
    limit = p.dwb_max_w
    if p.wheelbase > 0.0:
        limit = min(limit, abs(v) * p.curvature)
    w = min(limit, max(-limit, w0))
    right = towards(-limit, w, change, change)
    left = towards(limit, w, change, change)
    rates = p.dwb_w_samples if left - right > 1e-5 else 1
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
    steps = max(1, math.ceil(max(way * p.dwb_sim_time / p.dwb_linear, abs(w) * p.dwb_sim_time / p.dwb_angular)))
    samples[count, SAMPLE_V] = v
    samples[count, SAMPLE_W] = w
    samples[count, SAMPLE_STEPS] = steps
    samples[count, SAMPLE_DT] = p.dwb_sim_time / steps
    samples[count, SAMPLE_SIDE] = side
    return count + 1
