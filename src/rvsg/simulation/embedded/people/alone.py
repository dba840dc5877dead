"""A person who walks alone: whether they arrive, and when."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from rvsg.core.references import refer
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.embedded.people.behaviour import tick
from rvsg.simulation.embedded.people.crowd import PERIOD_S, PeopleOptions, initial
from rvsg.world.world import World

SLACK = 1.25
SLACK_S = 1.0
"""A person arrives in time who takes at most `SLACK` times distance over speed, plus `SLACK_S`."""
SLOW_M_S, FAST_M_S = 0.3, 1.5
_FAR = (1000.0, 1000.0, 0.0, 0.0, 0.0)
_NO_NOISE = PeopleOptions(leg_phase_noise=False)


def walking_time_s(world: World, way: Sequence[str], speed_m_s: float, limit_s: float) -> float:
    """Return the seconds a person takes along waypoints with nobody about; infinity where they take over `limit_s`."""
    goals = tuple(world.grid.position(name) for name in way)
    agent = HumanAgent(
        name="p",
        start=goals[0],
        goals=goals,
        pauses_s=(0.0,) * (len(goals) - 1) + (2 * limit_s,),
        speed_m_s=speed_m_s,
    )
    crowd = initial([agent], world, options=_NO_NOISE, seed=0, time_limit_s=limit_s)
    by_reference = refer(crowd)
    for k in range(math.ceil(limit_s / PERIOD_S)):
        tick(by_reference, PERIOD_S * k, PERIOD_S, *_FAR)
        if k > 0 and crowd.goal_index[0] == 0:
            return PERIOD_S * (k + 1)
    return math.inf


def limit_s(world: World, way: Sequence[str], speed_m_s: float) -> float:
    """Return the time within which a person should arrive at the end of a way."""
    points = [world.grid.position(name) for name in way]
    return SLACK * sum(math.dist(a, b) for a, b in pairwise(points)) / speed_m_s + SLACK_S


def not_walked(
    world: World, ways: Iterable[tuple[str, ...]], speeds_m_s: Sequence[float] = (SLOW_M_S, FAST_M_S)
) -> list[tuple[str, ...]]:
    """Return the ways on which a person does not arrive in time at each of the speeds."""
    found = []
    for way in ways:
        for speed in speeds_m_s:
            limit = limit_s(world, way, speed)
            if walking_time_s(world, way, speed, limit) > limit:
                found.append(way)
                break
    return found
