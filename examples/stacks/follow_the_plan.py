"""A local planner of your own: follow the plan, and wait where the costmap is occupied ahead.

rvsg simulate best_scenario.json --stack examples/stacks/follow_the_plan.py:FollowThePlan --stack-option speed=0.4
"""

import math

import numpy as np

from rvsg.robots.robot import Robot
from rvsg.stacks import LocalObservation, LocalPlanner, Parameter, Task


class FollowThePlan(LocalPlanner):
    """Steer towards the point of the plan that is `look_ahead` metres away."""

    def __init__(self, speed: float = 0.5, look_ahead: float = 0.6) -> None:
        self.speed, self.look_ahead = speed, look_ahead

    def tunable_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return what `rvsg tune` may change."""
        return (
            Parameter(name="speed", low=0.2, high=robot.limits.speed_m_s, unit="m/s", source="up to the robot's limit"),
            Parameter(name="look_ahead", low=0.3, high=1.5, unit="m", source="a robot's length to five"),
        )

    def reset(self, task: Task) -> None:
        """Keep what the robot can do."""
        self.turn = task.robot.limits.yaw_rate_rad_s

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Return forward speed and yaw rate."""
        x, y, yaw = seen.pose
        away = np.hypot(seen.plan[:, 0] - x, seen.plan[:, 1] - y)
        nearest = int(away.argmin())
        target = nearest + int(np.argmax(away[nearest:] > self.look_ahead)) or len(away) - 1
        heading = math.atan2(seen.plan[target, 1] - y, seen.plan[target, 0] - x)
        arrived = away[-1] < 0.2
        error = math.remainder((seen.goal[2] if arrived else heading) - yaw, math.tau)
        if arrived or abs(error) > 0.8:
            return 0.0, max(-self.turn, min(self.turn, 2.0 * error))
        return (0.0, 0.0) if self.occupied(seen, heading) else (self.speed, 2.0 * self.speed * math.sin(error) / 0.6)

    def occupied(self, seen: LocalObservation, heading: float) -> bool:
        """Whether the robot's centre must not be at the point half a metre ahead."""
        x, y = seen.pose[0] + 0.5 * math.cos(heading), seen.pose[1] + 0.5 * math.sin(heading)
        column = int((x - seen.costmap.origin_x) / seen.costmap.resolution)
        row = int((y - seen.costmap.origin_y) / seen.costmap.resolution)
        return bool(seen.costmap.cells[row, column] >= 253)
