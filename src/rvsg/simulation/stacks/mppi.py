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
from numpy.typing import NDArray
from pydantic import Field

from rvsg.core.records import Record
from rvsg.core.seeds import stream
from rvsg.robots.polygons import distance, padded, reach
from rvsg.robots.robot import Robot
from rvsg.simulation.stacks.configured import AS_JAZZY, Configured, Nav2Settings
from rvsg.simulation.stacks.mppi_kernel import optimise
from rvsg.simulation.stacks.mppi_work import Numbers, bind, new_work, start_again
from rvsg.simulation.stacks.protocol import LocalObservation, StackError, Task

Floats = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Steps = Annotated[int, Field(ge=1, le=100)]


class Constraint(Record):
    """Speeds beyond the limits."""

    enabled: bool = True
    cost_weight: NotNegative = 4.0


class Cost(Record):
    """Costs of the local costmap under the trajectories."""

    enabled: bool = True
    cost_weight: NotNegative = 3.81
    critical_cost: NotNegative = 300.0
    near_collision_cost: NotNegative = 253.0
    collision_cost: NotNegative = 1_000_000.0
    near_goal_distance: NotNegative = 0.5
    trajectory_point_step: Steps = 2
    consider_footprint: bool = True


class Goal(Record):
    """Distance from the goal."""

    enabled: bool = True
    cost_weight: NotNegative = 5.0
    threshold_to_consider: NotNegative = 1.4


class GoalAngle(Record):
    """Distance from the goal's yaw."""

    enabled: bool = True
    cost_weight: NotNegative = 3.0
    threshold_to_consider: NotNegative = 0.5


class PathAlign(Record):
    """Distance from the path along the trajectory."""

    enabled: bool = True
    cost_weight: NotNegative = 10.0
    max_path_occupancy_ratio: NotNegative = 0.07
    offset_from_furthest: Annotated[int, Field(ge=1)] = 20
    trajectory_point_step: Steps = 4
    threshold_to_consider: NotNegative = 0.5


class PathFollow(Record):
    """Distance of the trajectory's end from a point ahead on the path."""

    enabled: bool = True
    cost_weight: NotNegative = 5.0
    offset_from_furthest: Annotated[int, Field(ge=0)] = 6
    threshold_to_consider: NotNegative = 1.4


class PathAngle(Record):
    """Heading of the trajectory's end towards a point ahead on the path."""

    enabled: bool = True
    cost_weight: NotNegative = 2.2
    offset_from_furthest: Annotated[int, Field(ge=0)] = 4
    threshold_to_consider: NotNegative = 0.5
    max_angle_to_furthest: NotNegative = 0.785398


class PreferForward(Record):
    """Driving backwards."""

    enabled: bool = True
    cost_weight: NotNegative = 5.0
    threshold_to_consider: NotNegative = 0.5


class Twirling(Record):
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


class Mppi(Configured):
    """Nav2 with MPPI as local planner."""

    name: ClassVar[str] = "nav2-mppi"
    version = "4"
    own_behaviours: ClassVar[Mapping[str, Any]] = AS_JAZZY
    sideways: ClassVar[bool] = False
    title: ClassVar[str] = "Nav2 (Kilted) with MPPI, NavFn and the default behaviour tree"
    Settings: ClassVar[type[Nav2Settings]] = MppiSettings

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Compile or load the kernels."""
        square = [(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)]
        p = self._of(np.array(square), 1.0, 0.05)
        plan = np.column_stack([np.linspace(1.0, 2.0, 40), np.ones(40)])
        cells = np.zeros((60, 60), np.uint8)
        work, numbers = bind(new_work(self.settings.time_steps, 10, p), p)
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
        self._start_again = partial(start_again, work, rng, numbers)
        self._work, self._numbers = bind(work, numbers)
        self._until = -math.inf
        self._period_s = task.period_s

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Return the optimised command; None where every sampled trajectory collides."""
        cells, x, y, side = seen.costmap
        if seen.t > self._until:
            self._start_again()
        self._until = seen.t + 1.5 * self._period_s
        for _ in range(self.settings.retry_attempt_limit + 1):
            valid, v, w = optimise(
                self._work, seen.plan, cells, x, y, side, *seen.pose, *seen.velocity, seen.goal[2],
                self.settings.iteration_count, self._numbers,
            )  # fmt: skip
            if valid:
                return v, w
            self._start_again()
        return None

    def _of(self, footprint: Floats, possible: float, period_s: float) -> Numbers:
        """Return the options with what the robot adds to them."""
        s = self.settings

        def weight(critic: Record) -> float:
            return float(critic.cost_weight) if critic.enabled else 0.0  # type: ignore[attr-defined]

        cost, align, follow, angle = s.CostCritic, s.PathAlignCritic, s.PathFollowCritic, s.PathAngleCritic
        return Numbers(
            dt=s.model_dt,
            temperature=s.temperature,
            gamma=s.gamma,
            v_std=s.vx_std,
            w_std=s.wz_std,
            v_max=s.vx_max,
            v_min=s.vx_min,
            w_max=s.wz_max,
            a_max=s.ax_max,
            a_min=s.ax_min,
            aw_max=s.az_max,
            prune_m=s.prune_distance,
            shift=abs(period_s - s.model_dt) < 1e-6,
            constraint=weight(s.ConstraintCritic),
            constraint_max=math.hypot(s.vx_max, s.vy_max),
            constraint_min=-math.hypot(s.vx_min, s.vy_max),
            cost=weight(cost),
            critical=cost.critical_cost,
            near_collision=cost.near_collision_cost,
            collision=cost.collision_cost,
            near_goal_m=cost.near_goal_distance,
            cost_step=cost.trajectory_point_step,
            outline=cost.consider_footprint,
            possible=possible,
            goal=weight(s.GoalCritic),
            goal_m=s.GoalCritic.threshold_to_consider,
            goal_angle=weight(s.GoalAngleCritic),
            goal_angle_m=s.GoalAngleCritic.threshold_to_consider,
            align=weight(align),
            align_m=align.threshold_to_consider,
            align_occupied=align.max_path_occupancy_ratio,
            align_offset=align.offset_from_furthest,
            align_step=align.trajectory_point_step,
            follow=weight(follow),
            follow_m=follow.threshold_to_consider,
            follow_offset=follow.offset_from_furthest,
            angle=weight(angle),
            angle_m=angle.threshold_to_consider,
            angle_offset=angle.offset_from_furthest,
            angle_max=angle.max_angle_to_furthest,
            forward=weight(s.PreferForwardCritic),
            forward_m=s.PreferForwardCritic.threshold_to_consider,
            twirl=weight(s.TwirlingCritic),
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
