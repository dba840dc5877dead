"""Model predictive path integral control, after nav2_mppi_controller of Nav2 Kilted, differential drive.

Parameters have Nav2's names and defaults, except that the footprint is considered, as in Nav2's bring-up. Not built:
the omnidirectional and Ackermann models, ObstaclesCritic, VelocityDeadbandCritic, `regenerate_noises`, symmetric goals,
`mode` of PathAngleCritic other than 0, powers other than 1 and the trajectory validator of later releases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from rvsg.core.kernels import kernel
from rvsg.core.records import Record
from rvsg.core.references import refer
from rvsg.core.seeds import stream
from rvsg.robots.polygons import distance, padded, reach
from rvsg.robots.robot import Robot
from rvsg.simulation.stacks.mppi_critics import (
    BLOCK,
    Bytes,
    F,
    Floats,
    Ground,
    Numbers,
    Singles,
    Work,
    cell_scores,
    clearances,
    free_points,
    new_work,
    rim,
    score_costmap,
    score_goal,
    score_path,
    score_speeds,
    start_again,
)
from rvsg.simulation.stacks.nav2_stack import AS_JAZZY, Configured, Nav2Settings
from rvsg.simulation.stacks.parameters import Parameter, of_mppi
from rvsg.simulation.stacks.protocol import LocalObservation, StackError, Task

FILTER = np.array([-21.0, 14.0, 39.0, 54.0, 59.0, 54.0, 39.0, 14.0, -21.0]) / 231.0
"""Savitzky-Golay coefficients, quadratic over nine points."""


# Loops over few arrays each: with more of them the compiler does not prove that they do not overlap. Arrays are taken
# out of the work before a loop: numba counts a reference each time.


@kernel(arrays=True)
def limited(after: Singles, before: Singles, noise: Singles, middle: float, low: float, high: float) -> None:
    """The sampled controls of a step, within what can be reached from those of the step before."""
    wanted, down, up = F(middle), F(low), F(high)
    for b in range(after.size):
        after[b] = min(before[b] + up, max(before[b] + down, wanted + noise[b]))


@kernel(arrays=True)
def add_scaled(after: Singles, before: Singles, v: Singles, factor: Singles, dt: float) -> None:
    """Add v factor dt to sums."""
    step = F(dt)
    for b in range(after.size):
        after[b] = before[b] + v[b] * factor[b] * step


@kernel(arrays=True)
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


@kernel(arrays=True)
def add_product(after: Singles, before: Singles, w: Singles, dt: float) -> None:
    """Add w dt to sums."""
    step = F(dt)
    for b in range(after.size):
        after[b] = before[b] + w[b] * step


@kernel(arrays=True)
def roll_out(m: Work, begin: int, end: int, yaw0: float, v0: float, w0: float, p: Any) -> None:
    """Sample controls around the sequence and integrate them; positions are relative to the robot."""
    cos, sin = m.scratch[0, begin:end], m.scratch[1, begin:end]
    still, ahead = m.scratch[2, begin:end], m.scratch[3, begin:end]
    cos[:] = F(math.cos(yaw0))
    sin[:] = F(math.sin(yaw0))
    still[:] = F(0.0)
    ahead[:] = F(yaw0)
    m.v[0, begin:end] = F(v0)
    m.w[0, begin:end] = F(w0)
    n, dt = end - begin, p.options.model_dt
    xs, ys, yaws, vs, ws = m.x, m.y, m.yaw, m.v, m.w
    noise_v, noise_w, control = m.noise_v, m.noise_w, m.control
    x, y, yaw, v, w = still, still, ahead, vs[0, begin:end], ws[0, begin:end]
    for k in range(xs.shape[0]):
        next_x, next_y, next_yaw = xs[k, :n], ys[k, :n], yaws[k, :n]
        next_v, next_w = vs[k + 1, begin:end], ws[k + 1, begin:end]
        add_scaled(next_x, x, v, cos, dt)
        add_scaled(next_y, y, v, sin, dt)
        add_product(next_yaw, yaw, w, dt)
        turn(cos, sin, w, dt)
        reach = dt if k < xs.shape[0] - 1 else np.inf  # Nav2 limits only controls that move a trajectory
        limited(next_v, v, noise_v[k, begin:end], control[0, k], reach * p.options.ax_min, reach * p.options.ax_max)
        limited(next_w, w, noise_w[k, begin:end], control[1, k], -reach * p.options.az_max, reach * p.options.az_max)
        x, y, yaw, v, w = next_x, next_y, next_yaw, next_v, next_w


@kernel(arrays=True)
def keep(m: Work, begin: int, end: int, p: Any) -> None:
    """Keep what the critics of the path read of the samples of a block."""
    last, n = m.x.shape[0] - 1, end - begin
    rows = m.kept_x.shape[0]
    for j in range(rows):
        k = last if j == rows - 1 else j * p.options.PathAlignCritic.trajectory_point_step
        m.kept_x[j, begin:end] = m.x[k, :n]
        m.kept_y[j, begin:end] = m.y[k, :n]
    m.kept_yaw[begin:end] = m.yaw[last, :n]


@kernel(arrays=True)
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


@kernel(arrays=True)
def average(m: Work, p: Any) -> None:
    """Replace the control sequence by the mean of the sampled ones, weighted by their scores."""
    steps, samples = m.noise_v.shape
    least = m.costs.min()
    weights = m.scratch[0]
    total = 0.0
    for b in range(samples):
        weights[b] = F(math.exp(-(m.costs[b] - least) / p.options.temperature))
        total += weights[b]
    control, v, w = m.control, m.v, m.w
    for k in range(steps):
        control[0, k] = weighted(v[k + 1], weights) / total
        control[1, k] = weighted(w[k + 1], weights) / total


@kernel(arrays=True)
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


@kernel(arrays=True)
def constrain(m: Work, p: Any) -> None:
    """Keep the control sequence within the limits of speed and acceleration."""
    o = p.options
    dt, turn = o.model_dt, o.wz_max
    v = min(o.vx_max, max(o.vx_min, m.control[0, 0]))
    w = min(turn, max(-turn, m.control[1, 0]))
    m.control[0, 0], m.control[1, 0] = v, w
    for k in range(1, m.control.shape[1]):
        v = min(v + dt * o.ax_max, max(v + dt * o.ax_min, min(o.vx_max, max(o.vx_min, m.control[0, k]))))
        w = min(w + dt * o.az_max, max(w - dt * o.az_max, min(turn, max(-turn, m.control[1, k]))))
        m.control[0, k], m.control[1, k] = v, w


@kernel(arrays=True)
def local_path(
    plan: Floats, cells: Bytes, ox: float, oy: float, side: float, x: float, y: float, prune_m: float
) -> Floats:
    """Return the plan from its point nearest to the robot for `prune_m` within the costmap, relative to the robot."""
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
        column, row = (plan[end, 0] - ox) / side, (plan[end, 1] - oy) / side
        if along > prune_m or not (0.0 <= column < cells.shape[1] and 0.0 <= row < cells.shape[0]):
            break
        end += 1
    path = plan[begin:end].copy()
    path[:, 0] -= x
    path[:, 1] -= y
    return path


@kernel(arrays=True)
def optimise(
    m: Work, plan: Floats, cells: Bytes, ox: float, oy: float, side: float, x: float, y: float, yaw: float, v0: float,
    w0: float, goal_yaw: float, iterations: int, p: Any,
) -> tuple[bool, float, float]:  # fmt: skip
    """Return whether there is a valid command, and forward speed and yaw rate."""
    path = local_path(plan, cells, ox, oy, side, x, y, p.options.prune_distance)
    last = plan.shape[0] - 1
    gx, gy = plan[last, 0] - x, plan[last, 1] - y
    to_goal = math.hypot(gx, gy)
    free = free_points(path, cells, ox - x, oy - y, side)
    scores = cell_scores(cells, to_goal < p.options.CostCritic.near_goal_distance, p)
    ground = Ground(scores, clearances(cells), rim(p.footprint, side), (x - ox) / side, (y - oy) / side, 1.0 / side)
    samples = m.costs.size
    offset = 1 if p.shift else 0
    colliding = 0
    for _ in range(iterations):
        m.costs[:] = F(0.0)
        colliding = 0
        for begin in range(0, samples, BLOCK):
            end = min(begin + BLOCK, samples)
            roll_out(m, begin, end, yaw, v0, w0, p)
            keep(m, begin, end, p)
            score_speeds(m, begin, end, to_goal, p)
            colliding += score_costmap(m, begin, end, ground, p)
            score_goal(m, begin, end, gx, gy, goal_yaw, to_goal, p)
        score_path(m, path, free, yaw, to_goal, p)
        average(m, p)
        constrain(m, p)
    if colliding == samples:
        return False, 0.0, 0.0
    smooth_sequence(m, offset)
    v, w = m.control[0, offset], m.control[1, offset]
    if p.shift:
        m.control[:, :-1] = m.control[:, 1:].copy()
    return True, v, w


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Steps = Annotated[int, Field(ge=1, le=100)]


class Critic(Record):
    """A critic of the sampled trajectories; what is scored says its class."""

    enabled: bool = True
    cost_weight: NotNegative = 5.0


class Constraint(Critic):
    """Speeds beyond the limits."""

    cost_weight: NotNegative = 4.0


class Cost(Critic):
    """Costs of the local costmap under the trajectories."""

    cost_weight: NotNegative = 3.81
    critical_cost: NotNegative = 300.0
    near_collision_cost: NotNegative = 253.0
    collision_cost: NotNegative = 1_000_000.0
    near_goal_distance: NotNegative = 0.5
    trajectory_point_step: Steps = 2
    consider_footprint: bool = True


class Goal(Critic):
    """Distance from the goal."""

    threshold_to_consider: NotNegative = 1.4


class GoalAngle(Critic):
    """Distance from the goal's yaw."""

    cost_weight: NotNegative = 3.0
    threshold_to_consider: NotNegative = 0.5


class PathAlign(Critic):
    """Distance from the path along the trajectory."""

    cost_weight: NotNegative = 10.0
    max_path_occupancy_ratio: NotNegative = 0.07
    offset_from_furthest: Annotated[int, Field(ge=1)] = 20
    trajectory_point_step: Steps = 4
    threshold_to_consider: NotNegative = 0.5


class PathFollow(Critic):
    """Distance of the trajectory's end from a point ahead on the path."""

    offset_from_furthest: Annotated[int, Field(ge=0)] = 6
    threshold_to_consider: NotNegative = 1.4


class PathAngle(Critic):
    """Heading of the trajectory's end towards a point ahead on the path."""

    cost_weight: NotNegative = 2.2
    offset_from_furthest: Annotated[int, Field(ge=0)] = 4
    threshold_to_consider: NotNegative = 0.5
    max_angle_to_furthest: NotNegative = 0.785398


class PreferForward(Critic):
    """Driving backwards."""

    threshold_to_consider: NotNegative = 0.5


class Twirling(Critic):
    """Turning."""

    enabled: bool = False
    cost_weight: NotNegative = 10.0


class MppiSettings(Nav2Settings):
    """The options of `nav2-mppi`."""

    time_steps: Annotated[int, Field(ge=5, le=400)] = 56
    model_dt: Positive = 0.05
    batch_size: Annotated[int, Field(ge=10, le=10_000)] = 1000
    iteration_count: Annotated[int, Field(ge=1, le=10)] = 1
    temperature: Positive = 0.3
    gamma: NotNegative = 0.015
    vx_max: Positive = 0.5
    vx_min: Annotated[float, Field(le=0)] = -0.35
    vy_max: NotNegative = 0.5
    wz_max: Positive = 1.9
    ax_max: Positive = 3.0
    ax_min: Annotated[float, Field(lt=0)] = -3.0
    az_max: Positive = 3.5
    vx_std: Positive = 0.2
    wz_std: Positive = 0.4
    prune_distance: Positive = 1.5
    open_loop: Annotated[bool, Field(exclude_if=lambda open_loop: not open_loop)] = False
    """Begin from the last command instead of the measured speed."""
    retry_attempt_limit: Annotated[int, Field(ge=0, le=10)] = 1
    ConstraintCritic: Constraint = Constraint()
    CostCritic: Cost = Cost()
    GoalCritic: Goal = Goal()
    GoalAngleCritic: GoalAngle = GoalAngle()
    PathAlignCritic: PathAlign = PathAlign()
    PathFollowCritic: PathFollow = PathFollow()
    PathAngleCritic: PathAngle = PathAngle()
    PreferForwardCritic: PreferForward = PreferForward()
    TwirlingCritic: Twirling = Twirling()


CRITICS = tuple(name for name in MppiSettings.model_fields if name.endswith("Critic"))
LIMITED = ("vx_max", "vx_min", "wz_max")
"""What a speed filter scales; the constraint critic keeps its limits, as in Nav2."""


class Mppi(Configured):
    """Nav2 with MPPI as local planner."""

    name: ClassVar[str] = "nav2-mppi"
    version = "4"
    own_behaviours: ClassVar[Mapping[str, Any]] = AS_JAZZY
    sideways: ClassVar[bool] = False
    title: ClassVar[str] = "Nav2 (Kilted) with MPPI, NavFn and the default behaviour tree"
    Settings: ClassVar[type[Nav2Settings]] = MppiSettings

    @property
    def notes(self) -> tuple[str, ...]:
        """A warning where the robot may crawl: sampled speeds drift towards the larger of two unequal limits.

        As in Nav2 until April 2026 (issue 5465 and pull request 6072 of ros-navigation/navigation2).
        """
        s = self.settings
        if s.ax_max >= -s.ax_min:
            return ()
        return (
            f"ax_max {s.ax_max:g} is smaller than -ax_min {-s.ax_min:g}: the speeds that MPPI samples drift downwards, "
            "and the robot may crawl or reverse. Nav2 before April 2026 does the same. Give both the same size.",
        )

    def full_speed(self, robot: Robot) -> float:
        """Return its highest forward speed."""
        return float(self.settings.vx_max)

    def planner_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return the weights of the critics, the noise and the speed."""
        return of_mppi(robot)

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Compile or load the kernels."""
        square = [(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)]
        p = self._of(np.array(square), 1.0, 0.05)
        plan = np.column_stack([np.linspace(1.0, 2.0, 40), np.ones(40)])
        cells = np.zeros((60, 60), np.uint8)
        work, numbers = refer(new_work(self.settings.time_steps, 10, p)), refer(p)
        optimise(work, plan, cells, 0.0, 0.0, 0.05, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1, numbers)

    def reset(self, task: Task) -> None:
        """Draw the noise of the run."""
        s = self.settings
        if task.period_s > s.model_dt + 1e-6:
            raise StackError(
                f"the controller period ({task.period_s:g} s) is longer than model_dt ({s.model_dt:g} s); set it equal"
            )
        outline = padded(task.robot.footprint, task.robot.padding_m)
        numbers = self._of(np.array(outline, np.float64), _cost_at_reach(task.robot), task.period_s)
        work = new_work(s.time_steps, s.batch_size, numbers)
        rng = stream(task.seed, "stack/mppi")
        self._draw_noise = partial(start_again, work, rng, numbers)
        self._work, self._numbers = refer(work), refer(numbers)  # taken apart at every call they cost a tenth of it
        self._full, self._share = numbers, 1.0
        self._sent = (0.0, 0.0)
        self._until = -math.inf
        self._period_s = task.period_s

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Return the optimised command; None where every sampled trajectory collides."""
        cells, x, y, side = seen.costmap
        if seen.t > self._until:
            self._start_again()
        self._until = seen.t + 1.5 * self._period_s
        if seen.speed_share != self._share:
            self._share = seen.speed_share
            options = self._full.options
            limits = {name: self._share * getattr(options, name) for name in LIMITED}
            self._numbers = refer(self._full._replace(options=options.model_copy(update=limits)))
        for _ in range(self.settings.retry_attempt_limit + 1):
            before = self._sent if self.settings.open_loop else seen.velocity
            valid, v, w = optimise(
                self._work, seen.plan, cells, x, y, side, *seen.pose, *before, seen.goal[2],
                self.settings.iteration_count, self._numbers,
            )  # fmt: skip
            if valid:
                self._sent = (v, w)
                return v, w
            self._start_again()
        return None

    def _start_again(self) -> None:
        """Forget the control sequence and the last command."""
        self._draw_noise()
        self._sent = (0.0, 0.0)

    def _of(self, footprint: Floats, possible: float, period_s: float) -> Any:
        """Return the options with what the robot adds to them."""
        s = self.settings
        critics = {name: getattr(s, name) for name in CRITICS}
        off = {name: each.model_copy(update={"cost_weight": 0.0}) for name, each in critics.items() if not each.enabled}
        return Numbers(
            options=s.model_copy(update=off),
            constraint_max=math.hypot(s.vx_max, s.vy_max),
            constraint_min=-math.hypot(s.vx_min, s.vy_max),
            shift=abs(period_s - s.model_dt) < 1e-6,
            possible=possible,
            footprint=footprint,
        )


def _cost_at_reach(robot: Robot) -> float:
    """Return the cost at which the farthest corner may touch an obstacle; 0 where inflation does not reach so far."""
    outline = padded(robot.footprint, robot.padding_m)
    maps = robot.navigation.costmaps
    far, inscribed = reach(outline), distance(outline, 0.0, 0.0)
    if maps.local_inflation_m < far:
        return 0.0
    return math.floor(252.0 * math.exp(-maps.local_cost_scaling * (far - inscribed)))
