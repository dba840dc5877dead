"""An industrial vehicle that slows and stops for what its safety field sees, and never drives around it."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, model_validator

from rvsg.robots.polygons import rectangle
from rvsg.robots.robot import Robot
from rvsg.simulation.stacks.configured import Nav2Settings
from rvsg.simulation.stacks.protocol import LocalObservation, Task
from rvsg.simulation.stacks.pure_pursuit import PurePursuit, PurePursuitSettings

Positive = Annotated[float, Field(gt=0)]

WAITS_S = 3600.0
"""Nav2's progress checker leaves it alone for so long."""
SAME_GOAL_M = 0.5
"""Plans that end within this distance lead to the same goal."""


class StopAndGoSettings(PurePursuitSettings):
    """The options of `stop-and-go`: those of `nav2-rpp` and the safety field."""

    use_collision_detection: bool = False
    protective_m: Positive = 0.5
    """The vehicle stops for what is nearer ahead of its front than this."""
    warning_m: Positive = 1.5
    """It slows down for what is nearer than this."""
    side_m: Annotated[float, Field(ge=0)] = 0.1
    """How far the field reaches beyond each side of the vehicle."""
    creep: Annotated[float, Field(ge=0, le=1)] = 0.1
    """Least share of the speed in the warning field."""

    @model_validator(mode="after")
    def _in_order(self) -> StopAndGoSettings:
        if self.warning_m <= self.protective_m:
            raise ValueError("warning_m must be larger than protective_m")
        return self


class StopAndGo(PurePursuit):
    """Pure pursuit under a safety field.

    It follows the first plan to each goal and waits as long as it must: replanning and recoveries have no part in it.
    """

    name: ClassVar[str] = "stop-and-go"
    title: ClassVar[str] = "Pure pursuit under a safety field that slows and stops; it does not drive around people"
    Settings: ClassVar[type[Nav2Settings]] = StopAndGoSettings

    def adapt(self, robot: Robot) -> Robot:
        """Return the robot without recoveries for lack of progress."""
        robot = super().adapt(robot)
        if "progress_s" in self.settings.behaviours:
            return robot
        behaviours = robot.navigation.behaviours.replace(progress_s=WAITS_S)
        return robot.replace(navigation=robot.navigation.replace(behaviours=behaviours))

    def reset(self, task: Task) -> None:
        """Keep where the field lies."""
        super().reset(task)
        self._plan = np.zeros((0, 2))
        (_, right), (self._front, left) = rectangle(task.robot.outline)
        self._half = max(left, -right) + self.settings.side_m
        self._lidars = len(task.robot.lidars)

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Return the command of pure pursuit, slowed down by what the field sees."""
        if not len(self._plan) or math.dist(self._plan[-1], seen.plan[-1]) > SAME_GOAL_M:
            self._plan = seen.plan.copy()
        v, w = self.pursue(seen, self._plan) or (0.0, 0.0)
        if v <= 0.0:
            return v, w
        gap, s = self._gap(seen), self.settings
        if gap < s.protective_m:
            return 0.0, 0.0
        share = min(1.0, max(s.creep, (gap - s.protective_m) / (s.warning_m - s.protective_m)))
        return v * share, w * share

    def _gap(self, seen: LocalObservation) -> float:
        """Return the distance from the front to the nearest return in the field, m."""
        nearest = math.inf
        for lidar in range(self._lidars):
            scan = seen.scan(lidar)
            angle = scan.yaw + scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
            found = np.isfinite(scan.ranges) & (scan.ranges >= scan.range_min)
            x = scan.x + scan.ranges[found] * np.cos(angle[found])
            y = scan.y + scan.ranges[found] * np.sin(angle[found])
            ahead = x[(np.abs(y) < self._half) & (x > self._front)]
            nearest = min(nearest, float(ahead.min()) - self._front if ahead.size else math.inf)
        return nearest
