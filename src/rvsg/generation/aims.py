"""What a requirement asks the people of a scenario to bring about, and how much of it a forecast promises."""

from __future__ import annotations

import re
from enum import Enum

from rvsg.generation.forecast import Forecast
from rvsg.scenario.requirement import Requirement


class Aim(str, Enum):
    """What the people's work should bring about, in the words of the reasoning."""

    SHARE = "work close to the robot all along its way"
    MEET = "meet the robot closely where it has to pass"
    DISTURB = "come up in front of the robot again and again"
    DELAY = "walk and stand in the robot's lane, before it or towards it"
    NONE = "do the place's work wherever it is"


# Looked for in this order in a requirement's metric, formula and name: the first that is found decides.
_SIGNS: tuple[tuple[Aim, str], ...] = (
    (Aim.DISTURB, r"jerk|accel|heading|chc|brak|smooth|stab|angular"),
    (Aim.MEET, r"contact|collision|rpc|por|ttc|min\w*dist|min\w*gap|clearance|margin|touch"),
    (Aim.DELAY, r"trg|time|tnm|speed|progress|stop|goal|duration|path_length|\bpl\b|eventually"),
    (Aim.SHARE, r"dto|dist|gap|space|near|intru"),
)


def aim_of(requirement: Requirement | None) -> Aim:
    """The aim for a requirement; an unknown kind of requirement is served by nearness, which disturbs everything."""
    if requirement is None:
        return Aim.NONE
    for text in (requirement.metric or requirement.formula or "", requirement.title):
        for aim, signs in _SIGNS:
            if re.search(signs, text.lower()):
                return aim
    return Aim.SHARE


# How many of a refinement's variants count as equally promising. The forecast ranks nearness as the simulator does
# (rank correlation 0.95), braking and delay hardly (0.3 to 0.4): there what is measured has to choose.
FINALISTS = {Aim.SHARE: 5, Aim.MEET: 10, Aim.DISTURB: 20, Aim.DELAY: 20, Aim.NONE: 1}


def promise(aim: Aim, forecast: Forecast) -> float:
    """How much of the aim a forecast promises: larger is worse for the robot. Comparable only within one aim.

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
