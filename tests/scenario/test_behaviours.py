"""The facts about behaviours are those of the simulated people."""

from __future__ import annotations

import math

import pytest
from tests.simulation.test_people import CORRECT, crowd_of, human, tick

from rvsg.scenario.agents import reaction_of
from rvsg.scenario.behaviours import BEHAVIOURS, SEES_RAD
from rvsg.scenario.scenario import Behaviour

REACTING = [behaviour for behaviour, facts in BEHAVIOURS.items() if facts.reacts]


def reacts(behaviour: Behaviour, distance_m: float, bearing_rad: float = 0.0, pause_s: float = 0.0) -> bool:
    crowd = crowd_of(human((0.0, 0.0), (5.0, 0.0), behaviour=behaviour, start_pause_s=pause_s), options=CORRECT)
    crowd.yaw[0] = 0.0
    for k in range(3):
        crowd.x[0] = crowd.y[0] = 0.0
        tick(crowd, 0.1 * k, 0.1, distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad), 0.0, 0.0)
        if crowd.reacting[0]:
            return True
    return False


def test_every_behaviour_has_its_facts() -> None:
    assert set(BEHAVIOURS) == set(Behaviour)


@pytest.mark.parametrize("behaviour", REACTING)
def test_people_react_from_the_distance_and_angle_that_the_facts_name(behaviour: Behaviour) -> None:
    facts = BEHAVIOURS[behaviour]
    assert facts.trigger_distance_m is not None
    assert reacts(behaviour, facts.trigger_distance_m - 0.05)
    assert not reacts(behaviour, facts.trigger_distance_m + 0.05)
    assert reacts(behaviour, 2.0, SEES_RAD - 0.02)
    assert not reacts(behaviour, 2.0, SEES_RAD + 0.02)


@pytest.mark.parametrize("behaviour", REACTING)
def test_a_reaction_interrupts_a_pause_as_the_facts_say(behaviour: Behaviour) -> None:
    assert reacts(behaviour, 2.0, pause_s=60.0) == BEHAVIOURS[behaviour].interrupts_pause


@pytest.mark.parametrize("behaviour", REACTING)
def test_the_facts_agree_with_the_default_reaction(behaviour: Behaviour) -> None:
    facts, reaction = BEHAVIOURS[behaviour], reaction_of(behaviour, 1.5)
    assert facts.duration_s == reaction.duration_s
    assert reaction.distance_m == (facts.keeps_distance_m or facts.trigger_distance_m)


@pytest.mark.parametrize("behaviour", [b for b in Behaviour if b not in REACTING])
def test_the_others_never_react(behaviour: Behaviour) -> None:
    assert not reacts(behaviour, 1.0)
