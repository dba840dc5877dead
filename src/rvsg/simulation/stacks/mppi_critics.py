"""The arrays of MPPI and its critics, which score the trajectories that were rolled out.

Arrays are (time steps, samples) in single precision, as in Nav2, so that the loops over samples become vector code.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.core.angles import wrap
from rvsg.core.kernels import kernel

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

BLOCK = 128
"""Samples that are rolled out and scored together, so that their states stay in the processor's cache."""


class Numbers(NamedTuple):
    """The options and the robot as the kernels read them; SI units."""

    options: Any
    """Those of `nav2-mppi`; the weight of a critic that is not enabled is 0."""
    constraint_max: float
    constraint_min: float
    shift: bool
    """Whether the control sequence moves on by a step in each period."""
    possible: float
    """Cost from which the outline is checked."""
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


def start_again(m: Work, rng: np.random.Generator, p: Any) -> None:
    """Forget the control sequence and draw other noise.

    By default Nav2 keeps the noise from one period to the next, and draws it when its optimiser is reset.
    """
    m.control[:] = 0.0
    m.history[:] = 0.0
    for noise, deviation in ((m.noise_v, p.options.vx_std), (m.noise_w, p.options.wz_std)):
        noise[:] = deviation * rng.standard_normal(noise.shape, np.float32)


def new_work(steps: int, samples: int, p: Any) -> Work:
    """Return the arrays of a run, without noise."""
    rows = (steps - 1) // p.options.PathAlignCritic.trajectory_point_step + 2
    shapes = {
        **dict.fromkeys(("noise_v", "noise_w"), (steps, samples)),
        **dict.fromkeys(("v", "w"), (steps + 1, samples)),
        **dict.fromkeys(("x", "y", "yaw"), (steps, BLOCK)),
        **dict.fromkeys(("kept_x", "kept_y"), (rows, samples)),
        **dict.fromkeys(("kept_yaw", "costs"), (samples,)),
        "scratch": (4, samples),
    }
    singles = {name: np.zeros(shape, np.float32) for name, shape in shapes.items()}
    return Work(**singles, control=np.zeros((2, steps)), history=np.zeros((2, 4)))


Bytes = NDArray[np.uint8]

F = np.float32
INSCRIBED, LETHAL = 253, 254
COLLIDES = F(-1.0)
BIN_M = 0.0025
"""Resolution of the table of the nearest points of a path."""


@kernel(arrays=True)
def add_beyond(costs: Singles, v: Singles, w: Singles, low: float, high: float, beyond: float, forward: float,
               twirl: float) -> None:  # fmt: skip
    """Add what the speeds of a step cost."""
    least, most, one, two, three, zero = F(low), F(high), F(beyond), F(forward), F(twirl), F(0.0)
    for b in range(costs.size):
        costs[b] += (
            one * (max(v[b] - most, zero) + max(least - v[b], zero)) + two * max(-v[b], zero) + three * abs(w[b])
        )


@kernel(arrays=True)
def add_effort(costs: Singles, v: Singles, middle: float, gamma: float) -> None:
    """Add what the distance of sampled controls from the sequence costs."""
    wanted, factor = F(middle), F(gamma * middle)
    for b in range(costs.size):
        costs[b] += factor * (v[b] - wanted)


@kernel(arrays=True)
def score_speeds(m: Work, begin: int, end: int, to_goal: float, p: Any) -> None:
    """ConstraintCritic, PreferForwardCritic, TwirlingCritic, and the distance of the samples from the sequence."""
    steps, o = m.x.shape[0], p.options
    prefer = o.PreferForwardCritic
    forward = prefer.cost_weight * o.model_dt if to_goal >= prefer.threshold_to_consider else 0.0
    constraint, twirl = o.ConstraintCritic.cost_weight * o.model_dt, o.TwirlingCritic.cost_weight / steps
    costs, vs, ws, control = m.costs[begin:end], m.v, m.w, m.control
    v, w = vs[0, begin:end], ws[0, begin:end]
    for k in range(steps):
        add_beyond(costs, v, w, p.constraint_min, p.constraint_max, constraint, forward, twirl)
        v, w = vs[k + 1, begin:end], ws[k + 1, begin:end]
        add_effort(costs, v, control[0, k], o.gamma / (o.vx_std * o.vx_std))
        add_effort(costs, w, control[1, k], o.gamma / (o.wz_std * o.wz_std))


@kernel(arrays=True)
def cell_scores(cells: Bytes, near_goal: bool, p: Any) -> Singles:
    """Return what a cell costs a trajectory, as a flat grid with a border around it.

    COLLIDES: it collides there; below: the outline has to be checked, and the cost is COLLIDES - 1 less that.
    """
    rows, columns = cells.shape
    scores = np.full((rows + 2) * (columns + 2), COLLIDES, np.float32)
    for row in range(rows):
        for column in range(columns):
            cost = cells[row, column]
            if cost >= LETHAL or (cost == INSCRIBED and not p.options.CostCritic.consider_footprint):
                continue
            score = F(0.0) if near_goal else F(cost)
            if cost >= p.options.CostCritic.near_collision_cost:
                score = F(p.options.CostCritic.critical_cost)
            if p.options.CostCritic.consider_footprint and cost >= max(p.possible, 1.0):
                score = COLLIDES - F(1.0) - score
            scores[(row + 1) * (columns + 2) + column + 1] = score
    return scores


@kernel(arrays=True)
def look_up(found: Singles, x: Singles, y: Singles, scores: Singles, fx: np.float32, fy: np.float32, scale: np.float32,
            columns: int, rows: int) -> None:  # fmt: skip
    """Read the scores of the cells at relative positions; the border stands for everything off the costmap."""
    right, top, zero = F(columns), F(rows), F(0.0)
    width = np.uint32(columns + 2)
    for b in range(found.size):
        cx, cy = x[b] * scale + fx, y[b] * scale + fy
        column = np.uint32(min(max(cx, zero), right)) + np.uint32(cx >= zero)
        row = np.uint32(min(max(cy, zero), top)) + np.uint32(cy >= zero)
        found[b] = scores[row * width + column]


@kernel(arrays=True)
def clearances(cells: Bytes) -> NDArray[np.int64]:
    """Return how many cells away, diagonals included, the nearest lethal cell or the outside of the costmap is."""
    rows, columns = cells.shape
    away = np.zeros((rows + 2, columns + 2), np.int64)
    for row in range(1, rows + 1):
        for column in range(1, columns + 1):
            if cells[row - 1, column - 1] != LETHAL:
                least = min(away[row - 1, column - 1], away[row - 1, column])
                away[row, column] = 1 + min(least, min(away[row - 1, column + 1], away[row, column - 1]))
    for row in range(rows, 0, -1):
        for column in range(columns, 0, -1):
            least = min(away[row + 1, column + 1], away[row + 1, column])
            least = 1 + min(least, min(away[row + 1, column - 1], away[row, column + 1]))
            away[row, column] = min(away[row, column], least)
    return away


@kernel(arrays=True)
def rim(footprint: Floats, side: float) -> Floats:
    """Return points along the outline of a footprint less than half a cell apart, (N, 2) in cells."""
    corners = footprint.shape[0]
    steps = np.zeros(corners, np.int64)
    for k in range(corners):
        ax, ay = footprint[k] / side
        bx, by = footprint[(k + 1) % corners] / side
        steps[k] = int(2.0 * math.hypot(bx - ax, by - ay)) + 1
    points = np.zeros((steps.sum(), 2))
    at = 0
    for k in range(corners):
        a, b = footprint[k] / side, footprint[(k + 1) % corners] / side
        for i in range(steps[k]):
            points[at] = a + i / steps[k] * (b - a)
            at += 1
    return points


@kernel(arrays=True)
def rim_hits(away: NDArray[np.int64], points: Floats, x: float, y: float, yaw: float) -> bool:
    """Whether the outline at a pose (cells) leaves the costmap or runs over a lethal cell.

    Where the nearest such cell is d cells away, none is hit within the next d - 1 cells of the outline.
    """
    rows, columns = away.shape
    cos, sin = math.cos(yaw), math.sin(yaw)
    i = 0
    while i < points.shape[0]:
        px = x + points[i, 0] * cos - points[i, 1] * sin
        py = y + points[i, 0] * sin + points[i, 1] * cos
        if not (0.0 <= px < columns - 2 and 0.0 <= py < rows - 2):
            return True
        clear = away[int(py) + 1, int(px) + 1]
        if clear == 0:
            return True
        i += max(1, 2 * (clear - 1))
    return False


@kernel(arrays=True)
def add_scores(total: Singles, found: Singles) -> bool:
    """Add the scores that are none of a collision or of an outline to check; return whether there is one of these."""
    zero = F(0.0)
    negative = 0
    for b in range(total.size):
        total[b] += max(found[b], zero)
        negative |= found[b] < zero
    return negative != 0


@kernel(arrays=True)
def add_distance(sums: Singles, x: Singles, y: Singles, px: float, py: float, factor: float) -> None:
    """Add the distances from a point times a factor."""
    tx, ty, weight = F(px), F(py), F(factor)
    for b in range(sums.size):
        dx, dy = x[b] - tx, y[b] - ty
        sums[b] += weight * np.sqrt(dx * dx + dy * dy)


class Ground(NamedTuple):
    """The local costmap as the trajectories are scored on it; its origin is relative to the robot."""

    scores: Singles
    """See `cell_scores`."""
    away: NDArray[np.int64]
    """See `clearances`."""
    rim: Floats
    """See `rim`."""
    x: float
    """The robot's column, with its fraction."""
    y: float
    per_m: float


@kernel(arrays=True)
def score_costmap(m: Work, begin: int, end: int, ground: Ground, p: Any) -> int:
    """CostCritic; return how many trajectories collide."""
    steps = m.x.shape[0]
    rows, columns = ground.away.shape
    strided = (steps - 1) // p.options.CostCritic.trajectory_point_step + 1
    total, hit, found = m.scratch[0, begin:end], m.scratch[1, begin:end], m.scratch[2, begin:end]
    total[:] = F(0.0)
    hit[:] = F(0.0)
    fx, fy, scale = F(ground.x), F(ground.y), F(ground.per_m)
    xs, ys, yaws, n = m.x, m.y, m.yaw, end - begin
    scores, away, points = ground.scores, ground.away, ground.rim
    for j in range(strided):
        k = j * p.options.CostCritic.trajectory_point_step
        x, y = xs[k, :n], ys[k, :n]
        look_up(found, x, y, scores, fx, fy, scale, columns - 2, rows - 2)
        if not add_scores(total, found):
            continue
        for b in range(total.size):
            if found[b] >= 0.0 or hit[b] != 0.0:
                continue
            column, row = x[b] * scale + fx, y[b] * scale + fy
            if found[b] == COLLIDES or rim_hits(away, points, column, row, yaws[k, b]):
                hit[b] = F(1.0)
            else:
                total[b] += COLLIDES - F(1.0) - found[b]
    weight = F(p.options.CostCritic.cost_weight / 254.0 / strided)
    colliding = 0
    for b in range(total.size):
        if hit[b] != 0.0:
            total[b] = F(p.options.CostCritic.collision_cost)
            colliding += 1
        m.costs[begin + b] += weight * total[b]
    return colliding


@kernel(arrays=True)
def score_goal(m: Work, begin: int, end: int, gx: float, gy: float, goal_yaw: float, to_goal: float, p: Any) -> None:
    """GoalCritic and GoalAngleCritic: mean distance from the goal and from its yaw."""
    steps, goal, angle = m.x.shape[0], p.options.GoalCritic, p.options.GoalAngleCritic
    if to_goal < goal.threshold_to_consider:
        costs, weight_m = m.costs[begin:end], goal.cost_weight / steps
        for k in range(steps):
            add_distance(costs, m.x[k, : end - begin], m.y[k, : end - begin], gx, gy, weight_m)
    if to_goal < angle.threshold_to_consider:
        weight = F(angle.cost_weight / steps)
        for k in range(steps):
            for b in range(begin, end):
                m.costs[b] += weight * F(abs(wrap(goal_yaw - m.yaw[k, b - begin])))


@kernel(arrays=True)
def furthest_point(m: Work, path: Floats) -> int:
    """Return the farthest point of the path that is the nearest one to the end of some trajectory."""
    count = path.shape[0]
    best = 0
    px, py = path[:, 0].astype(np.float32), path[:, 1].astype(np.float32)
    for b in range(m.costs.size):
        ex, ey = m.kept_x[-1, b], m.kept_y[-1, b]
        nearest = best
        square = (px[best] - ex) * (px[best] - ex) + (py[best] - ey) * (py[best] - ey)
        for k in range(best + 1, count):
            away = (px[k] - ex) * (px[k] - ex) + (py[k] - ey) * (py[k] - ey)
            if away < square:
                square, nearest = away, k
        best = nearest
    return best


@kernel(arrays=True)
def free_points(path: Floats, cells: Bytes, ox: float, oy: float, side: float) -> NDArray[np.bool_]:
    """Return which points of the path a robot's centre may be at."""
    free = np.zeros(path.shape[0], np.bool_)
    for k in range(path.shape[0]):
        column, row = (path[k, 0] - ox) / side, (path[k, 1] - oy) / side
        if 0.0 <= column < cells.shape[1] and 0.0 <= row < cells.shape[0]:
            free[k] = cells[int(row), int(column)] < INSCRIBED
    return free


@kernel(arrays=True)
def nearest_along(path: Floats, count: int) -> tuple[NDArray[np.int64], Singles]:
    """Return which of the first points of a path is nearest to a distance along it.

    That is the point which the first array holds for the distance in units of BIN_M, or one of the next: `middles` has
    the distance at which the next point becomes the nearest.
    """
    middles = np.full(count, np.inf, np.float32)
    along = 0.0
    for k in range(1, count):
        step = math.hypot(path[k, 0] - path[k - 1, 0], path[k, 1] - path[k - 1, 1])
        middles[k - 1] = F(along + 0.5 * step)
        along += step
    nearest = np.zeros(int(along / BIN_M) + 2, np.int64)
    for i in range(1, nearest.size):
        k = nearest[i - 1]
        while F(i * BIN_M) >= middles[k]:
            k += 1
        nearest[i] = k
    return nearest, middles


@kernel(arrays=True)
def add_steps(sums: Singles, x: Singles, y: Singles, last_x: Singles, last_y: Singles) -> None:
    """Add the distances between two rows of positions."""
    for b in range(sums.size):
        dx, dy = x[b] - last_x[b], y[b] - last_y[b]
        sums[b] += np.sqrt(dx * dx + dy * dy)


@kernel(arrays=True)
def score_alignment(m: Work, path: Floats, free: NDArray[np.bool_], count: int, p: Any) -> None:
    """PathAlignCritic: mean distance from the point of the path as far along it as the trajectory has come."""
    samples = m.costs.size
    occupied = 0
    for k in range(count):
        if not free[k]:
            occupied += 1
        if occupied > 2 and occupied / count > p.options.PathAlignCritic.max_path_occupancy_ratio:
            return
    nearest, middles = nearest_along(path, count)
    px, py = path[:count, 0].astype(np.float32), path[:count, 1].astype(np.float32)
    driven, total, seen = m.scratch[0], m.scratch[1], m.scratch[2]
    driven[:] = F(0.0)
    total[:] = F(0.0)
    seen[:] = F(0.0)
    per, last = F(1.0 / BIN_M), nearest.size - 1
    for j in range(1, m.kept_x.shape[0] - 1):
        x, y = m.kept_x[j], m.kept_y[j]
        add_steps(driven, x, y, m.kept_x[j - 1], m.kept_y[j - 1])
        for b in range(samples):
            near = nearest[min(int(driven[b] * per), last)]
            while driven[b] >= middles[near]:
                near += 1
            if free[near]:
                dx, dy = px[near] - x[b], py[near] - y[b]
                total[b] += np.sqrt(dx * dx + dy * dy)
                seen[b] += F(1.0)
    weight = F(p.options.PathAlignCritic.cost_weight)
    for b in range(samples):
        if seen[b] > 0.0:
            m.costs[b] += weight * total[b] / seen[b]


@kernel(arrays=True)
def score_path(m: Work, path: Floats, free: NDArray[np.bool_], yaw0: float, to_goal: float, p: Any) -> None:
    """PathAlignCritic, PathFollowCritic and PathAngleCritic."""
    samples, end, o = m.costs.size, path.shape[0] - 1, p.options
    align, follow, angle = o.PathAlignCritic, o.PathFollowCritic, o.PathAngleCritic
    furthest = furthest_point(m, path)
    if align.cost_weight > 0.0 and to_goal >= align.threshold_to_consider and furthest >= align.offset_from_furthest:
        score_alignment(m, path, free, furthest, p)
    if follow.cost_weight > 0.0 and to_goal >= follow.threshold_to_consider and end > 0:
        at = min(furthest + follow.offset_from_furthest, end)
        while at < end - 1 and not free[at]:
            at += 1
        add_distance(m.costs, m.kept_x[-1], m.kept_y[-1], path[at, 0], path[at, 1], follow.cost_weight)
    if angle.cost_weight > 0.0 and to_goal >= angle.threshold_to_consider:
        at = min(furthest + angle.offset_from_furthest, end)
        tx, ty = path[at, 0], path[at, 1]
        if abs(wrap(math.atan2(ty, tx) - yaw0)) >= angle.max_angle_to_furthest:
            for b in range(samples):
                towards = math.atan2(ty - m.kept_y[-1, b], tx - m.kept_x[-1, b])
                m.costs[b] += F(angle.cost_weight * abs(wrap(towards - m.kept_yaw[b])))
