"""How much of a brief's aim a forecast promises."""

from __future__ import annotations

from rvsg.generation.forecast import Forecast
from rvsg.scenario.requirement import Aim

# How many of a refinement's variants count as equally promising. The forecast ranks nearness as the simulator does
# (rank correlation 0.95), braking and delay hardly (0.3 to 0.4): there what is measured has to choose.
FINALISTS = {Aim.SHARE: 5, Aim.MEET: 10, Aim.DISTURB: 20, Aim.DELAY: 20, Aim.NONE: 1}


def promise(aim: Aim, forecast: Forecast) -> float:
    """Return how much of the aim a forecast promises: larger is worse for the robot. Comparable only within one aim.

    The weights for braking follow a regression on 180 simulated scenarios, those for delay one on 1200: there the
    forecast says little (rank correlation 0 to 0.4, by the route), so what is measured decides.
    """
    near = -forecast.mean_gap_m
    if aim is Aim.MEET:
        return 0.5 * near - 2.0 * forecast.least_gap_m + 0.5 * min(forecast.meetings, 6.0) + forecast.swerved_m
    if aim is Aim.DISTURB:
        return forecast.meetings + 0.7 * forecast.blocked_s + 0.3 * forecast.swerved_m
    if aim is Aim.DELAY:
        return 0.25 * forecast.swerved_m + 0.12 * forecast.meetings + 0.15 * near
    return near
