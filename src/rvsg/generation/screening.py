"""What a forecast says of a configuration, as numbers that a search may learn from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rvsg.generation.aims import promise
from rvsg.generation.forecast import AIMED, Forecaster, forecaster_of
from rvsg.scenario.requirement import Aim
from rvsg.scenario.scenario import HumanConfiguration, Mission
from rvsg.world.world import World

Floats = NDArray[np.float64]

FEATURES = 8
"""Promise, mean and least gap, seconds blocked, meetings, swerve, duration, and people who do not step aside."""


class Screen:
    """Forecasts configurations of one mission.

    Args:
        aim: What the people should bring about.
    """

    def __init__(self, mission: Mission, world: World, aim: Aim) -> None:
        self.aim = aim
        self.forecaster: Forecaster = forecaster_of(mission, world)

    def __call__(self, configurations: Sequence[HumanConfiguration]) -> Floats:
        """Return the features of each configuration, (n, FEATURES)."""
        features = np.zeros((len(configurations), FEATURES))
        sizes: dict[int, list[int]] = {}
        for k, people in enumerate(configurations):
            sizes.setdefault(min(AIMED, len(people.humans)), []).append(k)
        for size, members in sizes.items():
            if not size:
                continue
            forecasts = self.forecaster.compare([configurations[k].humans[:size] for k in members])
            for k, forecast in zip(members, forecasts, strict=True):
                heedless = sum(human.behaviour != "regular" for human in configurations[k].humans)
                features[k] = (
                    promise(self.aim, forecast),
                    forecast.mean_gap_m,
                    forecast.least_gap_m,
                    forecast.blocked_s,
                    forecast.meetings,
                    forecast.swerved_m,
                    forecast.duration_s,
                    heedless,
                )
        return features
