"""The protocol of navigation stacks under test: observations, commands and the two base classes.

A `LocalPlanner` follows the plan of the built-in Nav2: planner, costmaps, progress checker and recoveries stay. A
`WholeStack` replaces all of that and decides itself when it has arrived. Both are asked in lock-step: simulated time
stands still until they answer.

Frames: `odom` is the robot's odometry, which does not drift here. `map` is the frame of the world's occupancy map.
The robot believes that the map lies at `Observation.map_from_odom` in it. Metres, seconds, radians.
"""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rvsg.core.records import Pose
from rvsg.robots.robot import Robot
from rvsg.simulation.stacks.parameters import Parameter
from rvsg.world.world import World

Floats = NDArray[np.float64]


class StackError(Exception):
    """A stack under test cannot go on; the run ends with the outcome STACK_FAILED and this reason.

    `code` says what is wrong as a stable word such as `stack-late`.
    """

    def __init__(self, reason: str = "", *, code: str = "stack") -> None:
        super().__init__(reason)
        self.code = code


class Velocity(NamedTuple):
    """What the base is told to do."""

    v: float
    """Forward speed, m/s."""
    w: float
    """Yaw rate, rad/s, counter-clockwise."""


class Twist(NamedTuple):
    """What a base that moves sideways is told to do."""

    vx: float
    """Forward speed, m/s."""
    vy: float
    """Speed to the left, m/s."""
    wz: float
    """Yaw rate, rad/s, counter-clockwise."""


Command: TypeAlias = "tuple[float, float] | tuple[float, float, float]"
"""(v, w), or (vx, vy, wz) for a base that moves sideways; a Velocity and a Twist are such."""


class Ended(Enum):
    """How a whole stack ends its task."""

    REACHED = "reached"
    GAVE_UP = "gave up"


class Costmap(NamedTuple):
    """Nav2's rolling local costmap in the odom frame."""

    cells: NDArray[np.uint8]
    """(rows, columns) costs: 0 free, 253 inscribed, 254 lethal; row 0 has the smallest y."""
    origin_x: float
    """x of the lower left corner of the first cell, m."""
    origin_y: float
    """y of that corner, m."""
    resolution: float
    """Side of a cell, m."""


class Scan(NamedTuple):
    """The latest scan of a lidar."""

    t: float
    """When it was taken, s of simulated time."""
    ranges: Floats
    """(rays,) metres; inf where a ray does not return."""
    angle_min: float
    """Bearing of the first ray in the lidar's frame, rad."""
    angle_increment: float
    """From a ray to the next, rad."""
    range_min: float
    """m; a nearer hit returns nothing."""
    range_max: float
    """m."""
    x: float
    """Place of the lidar in the base frame, m."""
    y: float
    yaw: float
    """Bearing of the lidar in the base frame, rad."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a stack is told before a run."""

    robot: Robot
    world: World
    """Its `occupancy` is the robot's map."""
    start: Pose
    """The robot's start in the map frame, as it believes it."""
    goals: tuple[Pose, ...]
    """Poses to drive through in the map frame; the last one is the goal."""
    time_limit_s: float
    seed: int
    period_s: float
    """Simulated time between two calls."""


class Observation(ABC):
    """What a stack is told at a call. Arrays are views that hold until the call returns."""

    t: float
    """Simulated time since the start, s."""
    pose: tuple[float, float, float]
    """x, y, yaw in the odom frame, m and rad."""
    velocity: tuple[float, float]
    """Measured forward speed, m/s, and yaw rate, rad/s."""
    lateral: float
    """Measured speed to the left, m/s; 0 for a base that does not move sideways."""
    map_from_odom: tuple[float, float, float]
    """x, y, yaw of the odom frame in the map frame, m and rad, as localisation estimates it."""

    @abstractmethod
    def scan(self, lidar: int = 0) -> Scan:
        """Return the latest scan of one of the robot's lidars; it is computed when it is asked for."""

    @abstractmethod
    def people(self) -> Floats:
        """Return the people that a lidar sees now, as a perfect tracker reports them.

        Returns:
            (N, 4): x, y, vx, vy in the odom frame, m and m/s.
        """


class LocalObservation(Observation):
    """What a local planner is told besides."""

    plan: Floats
    """(N, 2) the rest of the plan, x and y in the odom frame, m."""
    goal: tuple[float, float, float]
    """x, y, yaw of the goal in the odom frame, m and rad."""
    costmap: Costmap
    """What Nav2 keeps around the robot."""
    speed_share: float = 1.0
    """The highest speed here, as a share of the planner's own: what Nav2's speed filter says."""


class NavigationStack(ABC):
    """Anything that drives the robot. Derive a class from `LocalPlanner` or `WholeStack`, not from this one.

    A stack reaches worker processes by pickling, before or after `prepare`. One instance makes many runs, one after
    another.
    """

    name: ClassVar[str] = ""
    """The name in records; by default that of the class."""
    title: ClassVar[str] = ""
    """One line on what it is."""
    version: str = "1"
    """Part of a run's id: raise it when equal options and seeds give other runs than before."""
    answer_time_s: ClassVar[float | None] = 10.0
    """Wall time within which a call must return; None: without limit. A call that takes longer ends the run."""

    sideways: ClassVar[bool] = True
    """Whether it may command a lateral speed, for a robot that has one."""
    code_options: ClassVar[tuple[str, ...] | None] = None
    """Options whose values are run, such as a command: a file of settings cannot give them unless its user allows it.
    None: those of `rvsg.core.permission.CODE_OPTIONS`, and every text that names a Python file or a class."""
    repeatable: ClassVar[bool] = True
    """Whether equal seeds give equal runs; not where it runs in wall time: then a seed is the number of a run."""

    @classmethod
    def default_options(cls) -> Mapping[str, Any]:
        """Return every option with its default, None without one; by default the parameters of `__init__`."""
        kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
        named = [each for each in inspect.signature(cls).parameters.values() if each.kind in kinds]
        return {each.name: None if each.default is each.empty else each.default for each in named}

    @property
    def options(self) -> Mapping[str, Any]:
        """The effective options as JSON-able data; part of a run's id."""
        return {}

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user has to know of these options."""
        return ()

    def tunable_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return the numbers among the options that `rvsg tune` may change, with their ranges; by default none."""
        return ()

    def parameter_file(self) -> tuple[str, str] | None:
        """Return name and text of the parameter file that holds what may be tuned; None where options hold it."""
        return None

    def adapt(self, robot: Robot) -> Robot:
        """Return the robot with the navigation parameters that this stack sets."""
        return robot

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Do once what takes long, e.g. compile or connect; `tell` takes messages for people. May be called again."""
        return

    @abstractmethod
    def reset(self, task: Task) -> None:
        """Get ready for a run. Forget everything of the run before: equal tasks must give equal runs."""

    def close(self) -> None:
        """Release what `prepare` or `reset` acquired. May be called again; `prepare` or `reset` may follow.

        An instance that you make and hand over stays open: close it yourself. A copy in a worker is closed there.
        """
        return

    def finish(self) -> Mapping[str, Any]:
        """End a run; return facts for the run's `details`, as JSON-able data."""
        return {}


class LocalPlanner(NavigationStack):
    """A local planner under the built-in Nav2, asked every control period (50 ms)."""

    @abstractmethod
    def command(self, seen: LocalObservation) -> Command | None:
        """Return forward speed (m/s) and yaw rate (rad/s), or None where there is no valid command.

        For a robot with `limits.lateral_m_s`, three numbers are forward speed, speed to the left and yaw rate. Without
        a valid command for some time (Nav2's `failure_tolerance`), the built-in behaviour tree recovers.
        """


class WholeStack(NavigationStack):
    """A navigation stack with planner, maps and behaviours of its own."""

    @property
    def period_s(self) -> float:
        """Simulated time between two steps, a multiple of 0.01 s."""
        return 0.05

    @abstractmethod
    def step(self, seen: Observation) -> Command | Ended | None:
        """Return a velocity as `LocalPlanner.command` does, None where there is no new one, or how the task ended.

        The base goes on with the last velocity for a second (the time-out of a velocity smoother), then it stops.
        """
