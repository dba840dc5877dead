"""The optimisation of MPPI as kernels: roll out sampled controls, score them by critics, average them.

Arrays are (time steps, samples) in single precision, as in Nav2, so that the loops over samples become vector code.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.compiled import kernel
from rvsg.simulation.embedded.base import wrap
from rvsg.simulation.embedded.navigation.costmap import outline_hits

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Bytes = NDArray[np.uint8]

F = np.float32
INSCRIBED, LETHAL, OFF_MAP = 253, 254, 255
FILTER = np.array([-21.0, 14.0, 39.0, 54.0, 59.0, 54.0, 39.0, 14.0, -21.0]) / 231.0
"""Savitzky-Golay coefficients, quadratic over nine points."""


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
    y: Singles
    yaw: Singles
    costs: Singles
    scratch: Singles
    """(4, B)"""
    control: Floats
    """(2, T): v and w."""
    history: Floats
    """(2, 4)"""


def new_work(steps: int, samples: int, rng: np.random.Generator, p: Numbers) -> Work:
    """Return the arrays of a run; the noise is drawn once, as Nav2 does by default."""
    state = (steps, samples)
    return Work(
        noise_v=(p.v_std * rng.standard_normal(state, np.float32)).astype(np.float32),
        noise_w=(p.w_std * rng.standard_normal(state, np.float32)).astype(np.float32),
        v=np.zeros((steps + 1, samples), np.float32),
        w=np.zeros((steps + 1, samples), np.float32),
        x=np.zeros(state, np.float32),
        y=np.zeros(state, np.float32),
        yaw=np.zeros(state, np.float32),
        costs=np.zeros(samples, np.float32),
        scratch=np.zeros((4, samples), np.float32),
        control=np.zeros((2, steps)),
        history=np.zeros((2, 4)),
    )


# Loops over few arrays each: with more of them the compiler does not prove that they do not overlap.


@kernel
def limited(after: Singles, before: Singles, noise: Singles, middle: float, low: float, high: float) -> None:
    """The sampled controls of a step, within what can be reached from those of the step before."""
    wanted, down, up = F(middle), F(low), F(high)
    for b in range(after.size):
        after[b] = min(before[b] + up, max(before[b] + down, wanted + noise[b]))


@kernel
def add_scaled(sums: Singles, v: Singles, factor: Singles, dt: float) -> None:
    """Add v factor dt to running sums."""
    step = F(dt)
    for b in range(sums.size):
        sums[b] += v[b] * factor[b] * step


@kernel
def turn(cos: Singles, sin: Singles, w: Singles, dt: float) -> None:
    """Turn headings by w dt; the turn of a step is small, so its series is exact in single precision."""
    step = F(dt)
    half, sixth, fourth, fifth = F(0.5), F(1.0 / 6.0), F(1.0 / 24.0), F(1.0 / 120.0)
    one = F(1.0)
    for b in range(w.size):
        a = w[b] * step
        q = a * a
        c = one - q * (half - q * fourth)
        s = a * (one - q * (sixth - q * fifth))
        old = cos[b]
        cos[b] = old * c - sin[b] * s
        sin[b] = sin[b] * c + old * s


@kernel
def add_product(sums: Singles, w: Singles, dt: float) -> None:
    """Add w dt to running sums."""
    step = F(dt)
    for b in range(sums.size):
        sums[b] += w[b] * step


@kernel
def roll_out(m: Work, yaw0: float, v0: float, w0: float, p: Numbers) -> None:
    """Sample controls around the sequence and integrate them; positions are relative to the robot."""
    steps = m.x.shape[0]
    cos, sin = m.scratch[0], m.scratch[1]
    cos[:] = F(math.cos(yaw0))
    sin[:] = F(math.sin(yaw0))
    m.v[0, :] = F(v0)
    m.w[0, :] = F(w0)
    for k in range(steps):
        if k == 0:
            m.x[0, :] = F(0.0)
            m.y[0, :] = F(0.0)
            m.yaw[0, :] = F(yaw0)
        else:
            m.x[k, :] = m.x[k - 1]
            m.y[k, :] = m.y[k - 1]
            m.yaw[k, :] = m.yaw[k - 1]
        add_scaled(m.x[k], m.v[k], cos, p.dt)
        add_scaled(m.y[k], m.v[k], sin, p.dt)
        add_product(m.yaw[k], m.w[k], p.dt)
        turn(cos, sin, m.w[k], p.dt)
        limited(m.v[k + 1], m.v[k], m.noise_v[k], m.control[0, k], p.dt * p.a_min, p.dt * p.a_max)
        limited(m.w[k + 1], m.w[k], m.noise_w[k], m.control[1, k], -p.dt * p.aw_max, p.dt * p.aw_max)


@kernel
def add_beyond(costs: Singles, v: Singles, w: Singles, low: float, high: float, beyond: float, forward: float,
               twirl: float) -> None:  # fmt: skip
    """Add what the speeds of a step cost."""
    least, most, one, two, three, zero = F(low), F(high), F(beyond), F(forward), F(twirl), F(0.0)
    for b in range(costs.size):
        costs[b] += (
            one * (max(v[b] - most, zero) + max(least - v[b], zero)) + two * max(-v[b], zero) + three * abs(w[b])
        )


@kernel
def score_speeds(m: Work, to_goal: float, p: Numbers) -> None:
    """ConstraintCritic, PreferForwardCritic and TwirlingCritic."""
    steps = m.x.shape[0]
    forward = p.forward * p.dt if to_goal >= p.forward_m else 0.0
    for k in range(steps):
        add_beyond(m.costs, m.v[k], m.w[k], p.v_min, p.v_max, p.constraint * p.dt, forward, p.twirl / steps)


@kernel
def score_costmap(m: Work, cells: Bytes, ox: float, oy: float, side: float, to_goal: float, p: Numbers) -> bool:
    """CostCritic; return whether every trajectory collides. The origin is relative to the robot."""
    steps, samples = m.x.shape
    rows, columns = cells.shape
    strided = (steps - 1) // p.cost_step + 1
    near_goal = to_goal < p.near_goal_m
    total, hit = m.scratch[0], m.scratch[1]
    total[:] = F(0.0)
    hit[:] = F(0.0)
    fx, fy, scale = F(-ox / side), F(-oy / side), F(1.0 / side)
    for j in range(strided):
        k = j * p.cost_step
        for b in range(samples):
            if hit[b] != 0.0:
                continue
            cx, cy = m.x[k, b] * scale + fx, m.y[k, b] * scale + fy
            on_map = cx >= 0.0 and cy >= 0.0 and cx < columns and cy < rows
            cost = int(cells[int(cy), int(cx)]) if on_map else OFF_MAP
            if cost < 1:
                continue
            collides = cost >= LETHAL or (cost == INSCRIBED and not p.outline)
            if p.outline and not collides and cost >= p.possible:
                collides = outline_hits(cells, p.footprint, cx, cy, m.yaw[k, b], side)
            if collides:
                hit[b] = F(1.0)
                total[b] = F(p.collision)
            elif cost >= p.near_collision:
                total[b] += F(p.critical)
            elif not near_goal:
                total[b] += F(cost)
    weight = F(p.cost / 254.0 / strided)
    colliding = 0
    for b in range(samples):
        m.costs[b] += weight * total[b]
        if hit[b] != 0.0:
            colliding += 1
    return colliding == samples


@kernel
def score_goal(m: Work, gx: float, gy: float, goal_yaw: float, to_goal: float, p: Numbers) -> None:
    """GoalCritic and GoalAngleCritic: mean distance from the goal and from its yaw."""
    steps, samples = m.x.shape
    if to_goal < p.goal_m:
        weight = F(p.goal / steps)
        for k in range(steps):
            for b in range(samples):
                dx, dy = m.x[k, b] - F(gx), m.y[k, b] - F(gy)
                m.costs[b] += weight * np.sqrt(dx * dx + dy * dy)
    if to_goal < p.goal_angle_m:
        weight = F(p.goal_angle / steps)
        for k in range(steps):
            for b in range(samples):
                m.costs[b] += weight * F(abs(wrap(goal_yaw - m.yaw[k, b])))


@kernel
def furthest_point(m: Work, path: Floats) -> int:
    """Return the farthest point of the path that is the nearest one to the end of some trajectory."""
    count = path.shape[0]
    last = m.x.shape[0] - 1
    best = 0
    px, py = path[:, 0].astype(np.float32), path[:, 1].astype(np.float32)
    for b in range(m.x.shape[1]):
        ex, ey = m.x[last, b], m.y[last, b]
        nearest = best
        square = (px[best] - ex) * (px[best] - ex) + (py[best] - ey) * (py[best] - ey)
        for k in range(best + 1, count):
            away = (px[k] - ex) * (px[k] - ex) + (py[k] - ey) * (py[k] - ey)
            if away < square:
                square, nearest = away, k
        best = nearest
    return best


@kernel
def free_points(path: Floats, cells: Bytes, ox: float, oy: float, side: float) -> NDArray[np.bool_]:
    """Return which points of the path a robot's centre may be at."""
    free = np.zeros(path.shape[0], np.bool_)
    for k in range(path.shape[0]):
        column, row = (path[k, 0] - ox) / side, (path[k, 1] - oy) / side
        if 0.0 <= column < cells.shape[1] and 0.0 <= row < cells.shape[0]:
            free[k] = cells[int(row), int(column)] < INSCRIBED
    return free


@kernel
def score_alignment(m: Work, path: Floats, free: NDArray[np.bool_], count: int, p: Numbers) -> None:
    """PathAlignCritic: mean distance from the point of the path as far along it as the trajectory has come."""
    steps, samples = m.x.shape
    occupied = 0
    for k in range(count):
        if not free[k]:
            occupied += 1
        if occupied > 2 and occupied / count > p.align_occupied:
            return
    along = np.zeros(count, np.float32)
    px, py = np.empty(count, np.float32), np.empty(count, np.float32)
    for k in range(count):
        px[k], py[k] = F(path[k, 0]), F(path[k, 1])
        if k > 0:
            along[k] = along[k - 1] + F(math.hypot(path[k, 0] - path[k - 1, 0], path[k, 1] - path[k - 1, 1]))
    strided = (steps - 1) // p.align_step + 1
    weight = F(p.align)
    for b in range(samples):
        at, driven, total, seen = 0, F(0.0), F(0.0), 0
        bx, by = m.x[0, b], m.y[0, b]
        for j in range(1, strided):
            tx, ty = m.x[j * p.align_step, b], m.y[j * p.align_step, b]
            driven += np.sqrt((tx - bx) * (tx - bx) + (ty - by) * (ty - by))
            bx, by = tx, ty
            while at < count - 1 and along[at] < driven:
                at += 1
            near = at
            if at > 0 and driven - along[at - 1] < along[at] - driven:
                near = at - 1
            if free[near]:
                dx, dy = px[near] - tx, py[near] - ty
                total += np.sqrt(dx * dx + dy * dy)
                seen += 1
        if seen > 0:
            m.costs[b] += weight * total / F(seen)


@kernel
def score_path(m: Work, path: Floats, free: NDArray[np.bool_], yaw0: float, to_goal: float, p: Numbers) -> None:
    """PathAlignCritic, PathFollowCritic and PathAngleCritic."""
    samples = m.x.shape[1]
    last = m.x.shape[0] - 1
    end = path.shape[0] - 1
    furthest = furthest_point(m, path)
    if p.align > 0.0 and to_goal >= p.align_m and furthest >= p.align_offset:
        score_alignment(m, path, free, furthest, p)
    if p.follow > 0.0 and to_goal >= p.follow_m and end > 0:
        at = min(furthest + p.follow_offset, end)
        while at < end - 1 and not free[at]:
            at += 1
        for b in range(samples):
            dx, dy = m.x[last, b] - F(path[at, 0]), m.y[last, b] - F(path[at, 1])
            m.costs[b] += F(p.follow) * np.sqrt(dx * dx + dy * dy)
    if p.angle > 0.0 and to_goal >= p.angle_m:
        at = min(furthest + p.angle_offset, end)
        tx, ty = path[at, 0], path[at, 1]
        if abs(wrap(math.atan2(ty, tx) - yaw0)) >= p.angle_max:
            for b in range(samples):
                towards = math.atan2(ty - m.y[last, b], tx - m.x[last, b])
                m.costs[b] += F(p.angle * abs(wrap(towards - m.yaw[last, b])))


@kernel
def add_effort(costs: Singles, v: Singles, middle: float, gamma: float) -> None:
    """Add what the distance of sampled controls from the sequence costs."""
    wanted, factor = F(middle), F(gamma * middle)
    for b in range(costs.size):
        costs[b] += factor * (v[b] - wanted)


@kernel
def weighted(values: Singles, weights: Singles) -> float:
    """Return the sum of values times weights, in eight lanes so that it becomes vector code."""
    lanes = np.zeros(8, np.float32)
    whole = values.size // 8 * 8
    for b in range(0, whole, 8):
        for i in range(8):
            lanes[i] += values[b + i] * weights[b + i]
    total = 0.0
    for i in range(8):
        total += lanes[i]
    for b in range(whole, values.size):
        total += values[b] * weights[b]
    return total


@kernel
def average(m: Work, p: Numbers) -> None:
    """Replace the control sequence by the mean of the sampled ones, weighted by their scores."""
    steps, samples = m.x.shape
    for k in range(steps):
        add_effort(m.costs, m.v[k + 1], m.control[0, k], p.gamma / (p.v_std * p.v_std))
        add_effort(m.costs, m.w[k + 1], m.control[1, k], p.gamma / (p.w_std * p.w_std))
    least = m.costs.min()
    weights = m.scratch[0]
    total = 0.0
    for b in range(samples):
        weights[b] = F(math.exp(-(m.costs[b] - least) / p.temperature))
        total += weights[b]
    for k in range(steps):
        m.control[0, k] = weighted(m.v[k + 1], weights) / total
        m.control[1, k] = weighted(m.w[k + 1], weights) / total


@kernel
def smooth_sequence(m: Work, offset: int) -> None:
    """Filter the control sequence with what was sent before it."""
    steps = m.control.shape[1]
    if steps < 21:
        return
    for axis in range(2):
        raw = np.empty(steps + 8)
        raw[:4] = m.history[axis]
        raw[4 : steps + 4] = m.control[axis]
        raw[steps + 4 :] = m.control[axis, steps - 1]
        for k in range(steps - 1):
            value = 0.0
            for i in range(9):
                value += FILTER[i] * raw[k + i]
            m.control[axis, k] = value
        m.history[axis, :3] = m.history[axis, 1:]
        m.history[axis, 3] = m.control[axis, offset]


@kernel
def constrain(m: Work, p: Numbers) -> None:
    """Keep the control sequence within the limits of speed and acceleration."""
    v = min(p.v_max, max(p.v_min, m.control[0, 0]))
    w = min(p.w_max, max(-p.w_max, m.control[1, 0]))
    m.control[0, 0], m.control[1, 0] = v, w
    for k in range(1, m.control.shape[1]):
        v = min(v + p.dt * p.a_max, max(v + p.dt * p.a_min, min(p.v_max, max(p.v_min, m.control[0, k]))))
        w = min(w + p.dt * p.aw_max, max(w - p.dt * p.aw_max, min(p.w_max, max(-p.w_max, m.control[1, k]))))
        m.control[0, k], m.control[1, k] = v, w


@kernel
def local_path(plan: Floats, x: float, y: float, prune_m: float) -> Floats:
    """Return the plan from its point nearest to the robot for `prune_m`, relative to the robot."""
    begin = 0
    nearest = np.inf
    for k in range(plan.shape[0]):
        away = math.hypot(plan[k, 0] - x, plan[k, 1] - y)
        if away < nearest:
            nearest, begin = away, k
    end = begin + 1
    along = 0.0
    while end < plan.shape[0]:
        along += math.hypot(plan[end, 0] - plan[end - 1, 0], plan[end, 1] - plan[end - 1, 1])
        if along > prune_m:
            break
        end += 1
    path = plan[begin:end].copy()
    path[:, 0] -= x
    path[:, 1] -= y
    return path


@kernel
def optimise(
    m: Work, plan: Floats, cells: Bytes, ox: float, oy: float, side: float, x: float, y: float, yaw: float, v0: float,
    w0: float, goal_yaw: float, iterations: int, p: Numbers,
) -> tuple[bool, float, float]:  # fmt: skip
    """Return whether there is a valid command, and forward speed and yaw rate."""
    path = local_path(plan, x, y, p.prune_m)
    end = plan.shape[0] - 1
    gx, gy = plan[end, 0] - x, plan[end, 1] - y
    to_goal = math.hypot(gx, gy)
    free = free_points(path, cells, ox - x, oy - y, side)
    offset = 1 if p.shift else 0
    colliding = False
    for _ in range(iterations):
        m.costs[:] = F(0.0)
        roll_out(m, yaw, v0, w0, p)
        score_speeds(m, to_goal, p)
        colliding = score_costmap(m, cells, ox - x, oy - y, side, to_goal, p)
        score_goal(m, gx, gy, goal_yaw, to_goal, p)
        score_path(m, path, free, yaw, to_goal, p)
        average(m, p)
        smooth_sequence(m, offset)
        constrain(m, p)
    if colliding:
        m.control[:] = 0.0
        m.history[:] = 0.0
        return False, 0.0, 0.0
    v, w = m.control[0, offset], m.control[1, offset]
    if p.shift:
        m.control[:, :-1] = m.control[:, 1:].copy()
    return True, v, w
