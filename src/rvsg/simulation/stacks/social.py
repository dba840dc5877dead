"""A robot that keeps people's personal space: pure pursuit over what people are predicted to do."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rvsg.simulation.stacks.configured import Nav2Settings
from rvsg.simulation.stacks.protocol import LocalObservation, Task
from rvsg.simulation.stacks.pure_pursuit import PurePursuit, PurePursuitSettings

Floats = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0)]

TURNS_S = 0.75
"""How long a command that is tried turns the robot before it goes straight on."""


class SocialSettings(PurePursuitSettings):
    """The options of `social`: those of `nav2-rpp` and personal space."""

    personal_space_m: Positive = 1.2
    """Distance between the robot's centre and a person that it keeps (Hall's personal distance)."""
    horizon_s: Annotated[float, Field(gt=0, le=10)] = 4.0
    """How far people are predicted, at constant velocity."""
    swerve_rad: Annotated[float, Field(gt=0, le=1.5)] = 0.9
    """Largest angle by which it turns away from its way."""
    discomfort: Positive = 8.0
    """Weight of coming too close, against progress along the plan."""


class Social(PurePursuit):
    """Choose among headings and speeds around those of pure pursuit the one that disturbs nobody.

    People are tracked perfectly where a lidar sees them and predicted by constant velocity.
    """

    name: ClassVar[str] = "social"
    title: ClassVar[str] = "Pure pursuit that keeps personal space; it predicts people by constant velocity"
    Settings: ClassVar[type[Nav2Settings]] = SocialSettings

    def reset(self, task: Task) -> None:
        """Keep the robot's numbers and the commands to choose from."""
        super().reset(task)
        swerves = np.linspace(-self.settings.swerve_rad, self.settings.swerve_rad, 9)
        self._shares, self._swerves = (grid.ravel() for grid in np.meshgrid([1.0, 0.6, 0.3, 0.0], swerves))
        self._times = np.arange(0.25, self.settings.horizon_s + 1e-9, 0.25)
        self._turn = task.robot.limits.yaw_rate_rad_s

    def command(self, seen: LocalObservation) -> tuple[float, float] | None:
        """Return the command with the least discomfort and detour."""
        asked = super().command(seen)
        people = seen.people()
        if asked is None or asked[0] <= 0.0 or not len(people):
            return asked
        v, w = asked
        speeds = v * self._shares
        rates = np.clip(w * self._shares + self._swerves, -self._turn, self._turn)
        x, y = self._ways(seen.pose, speeds, rates)
        cost = self.settings.discomfort * self._discomfort(x, y, people)
        cost += 0.5 * (1.0 - self._shares) + 0.3 * np.abs(self._swerves)
        cost[self._blocked(seen, x, y)] = math.inf
        best = int(np.argmin(cost))
        return (float(speeds[best]), float(rates[best])) if math.isfinite(cost[best]) else (0.0, 0.0)

    def _ways(self, pose: tuple[float, float, float], speeds: Floats, rates: Floats) -> tuple[Floats, Floats]:
        """Return where each command leads, (commands, times): it turns, then goes straight on."""
        turned = np.minimum(self._times, TURNS_S)[None, :] * rates[:, None]
        heading = pose[2] + turned
        step = np.diff(self._times, prepend=0.0)[None, :] * speeds[:, None]
        return pose[0] + np.cumsum(step * np.cos(heading), axis=1), pose[1] + np.cumsum(step * np.sin(heading), axis=1)

    def _discomfort(self, x: Floats, y: Floats, people: Floats) -> Floats:
        """Return the largest intrusion into anybody's space, as a share of it; later ones count less."""
        worst = np.zeros(len(x))
        weight = np.exp(-self._times / self.settings.horizon_s)
        for px, py, vx, vy in people:
            away = np.hypot(x - px - vx * self._times, y - py - vy * self._times)
            intrusion = np.clip(1.0 - away / self.settings.personal_space_m, 0.0, 1.0) * weight
            worst = np.maximum(worst, intrusion.max(axis=1))
        return worst

    def _blocked(self, seen: LocalObservation, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Whether a command leads the robot's centre into an inscribed cell within a second."""
        cells, ox, oy, side = seen.costmap
        near = self._times <= 1.0
        columns = np.clip(((x[:, near] - ox) / side).astype(int), 0, cells.shape[1] - 1)
        rows = np.clip(((y[:, near] - oy) / side).astype(int), 0, cells.shape[0] - 1)
        return np.asarray((cells[rows, columns] >= 253).any(axis=1) & (self._shares > 0.0))
