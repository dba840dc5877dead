"""The options and the arrays of MPPI as its kernels read them.

Arrays are (time steps, samples) in single precision, as in Nav2, so that the loops over samples become vector code.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.references import by_reference, refer

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

BLOCK = 128
"""Samples that are rolled out and scored together, so that their states stay in the processor's cache."""


class Numbers(NamedTuple):
    """The options and the robot as the kernels read them; SI units."""

    dt: float
    temperature: float
    gamma: float
    v_std: float
    w_std: float
    v_max: float
    v_min: float
    w_max: float
    a_max: float
    a_min: float
    aw_max: float
    prune_m: float
    shift: bool
    constraint: float
    constraint_max: float
    constraint_min: float
    cost: float
    critical: float
    near_collision: float
    collision: float
    near_goal_m: float
    cost_step: int
    outline: bool
    possible: float
    """Cost from which the outline has to be checked; below 1: always."""
    goal: float
    goal_m: float
    goal_angle: float
    goal_angle_m: float
    align: float
    align_m: float
    align_occupied: float
    align_offset: int
    align_step: int
    follow: float
    follow_m: float
    follow_offset: int
    angle: float
    angle_m: float
    angle_offset: int
    angle_max: float
    forward: float
    forward_m: float
    twirl: float
    footprint: Floats


class Work(NamedTuple):
    """Arrays of an optimisation: noises and controls, states, scores, the control sequence and its history."""

    noise_v: Singles
    noise_w: Singles
    v: Singles
    """(T + 1, B): measured speed, then the sampled controls within the limits of acceleration."""
    w: Singles
    x: Singles
    """(T, BLOCK): places and headings of the samples that are rolled out now."""
    y: Singles
    yaw: Singles
    kept_x: Singles
    """(K + 1, B): every `align_step`-th place of each sample, then its last one."""
    kept_y: Singles
    kept_yaw: Singles
    """(B,): the last heading of each sample."""
    costs: Singles
    scratch: Singles
    """(4, B)"""
    control: Floats
    """(2, T): v and w."""
    history: Floats
    """(2, 4)"""


NumbersRef: Any = by_reference(Numbers)
WorkRef: Any = by_reference(Work)


def bind(m: Work, p: Numbers) -> tuple[Any, Any]:
    """Return both by reference: taking them apart at every call costs a tenth of the command."""
    return refer(m), refer(p)


def start_again(m: Work, rng: np.random.Generator, p: Numbers) -> None:
    """Forget the control sequence and draw other noise.

    By default Nav2 keeps the noise from one period to the next, and draws it when its optimiser is reset.
    """
    m.control[:] = 0.0
    m.history[:] = 0.0
    for noise, deviation in ((m.noise_v, p.v_std), (m.noise_w, p.w_std)):
        noise[:] = deviation * rng.standard_normal(noise.shape, np.float32)


def new_work(steps: int, samples: int, p: Numbers) -> Work:
    """Return the arrays of a run, without noise."""
    state = (steps, samples)
    return Work(
        noise_v=np.zeros(state, np.float32),
        noise_w=np.zeros(state, np.float32),
        v=np.zeros((steps + 1, samples), np.float32),
        w=np.zeros((steps + 1, samples), np.float32),
        x=np.zeros((steps, BLOCK), np.float32),
        y=np.zeros((steps, BLOCK), np.float32),
        yaw=np.zeros((steps, BLOCK), np.float32),
        kept_x=np.zeros(((steps - 1) // p.align_step + 2, samples), np.float32),
        kept_y=np.zeros(((steps - 1) // p.align_step + 2, samples), np.float32),
        kept_yaw=np.zeros(samples, np.float32),
        costs=np.zeros(samples, np.float32),
        scratch=np.zeros((4, samples), np.float32),
        control=np.zeros((2, steps)),
        history=np.zeros((2, 4)),
    )
