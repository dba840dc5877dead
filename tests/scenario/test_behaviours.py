"""Simulated people react to the robot as docs/explanation/people.md says."""

from __future__ import annotations

import math

import pytest
from tests.simulation.test_people import CORRECT, crowd_of, human, tick

from rvsg.scenario.scenario import Behaviour

SEES_RAD = 1.74
WITHIN_M = {Behaviour.SURPRISED: 4.0, Behaviour.SCARED: 3.0, Behaviour.CURIOUS: 10.0, Behaviour.THREATENING: 4.5}


def reacts(behaviour: Behaviour, distance_m: float, bearing_rad: float = 0.0, pause_s: float = 0.0) -> bool:
    crowd = crowd_of(human((0.0, 0.0), (5.0, 0.0), behaviour=behaviour, start_pause_s=pause_s), options=CORRECT)
    crowd.yaw[0] = 0.0
    for k in range(3):
        crowd.x[0] = crowd.y[0] = 0.0
        tick(crowd, 0.1 * k, 0.1, distance_m * math.cos(bearing_rad), distance_m * math.sin(bearing_rad), 0.0, 0.0)
        if crowd.reacting[0]:
            return True
    return False


@pytest.mark.parametrize(("behaviour", "within_m"), WITHIN_M.items())
def test_people_react_within_the_documented_distance_and_angle(behaviour: Behaviour, within_m: float) -> None:
    assert reacts(behaviour, within_m - 0.05)
    assert not reacts(behaviour, within_m + 0.05)
    assert reacts(behaviour, 2.0, SEES_RAD - 0.02)
    assert not reacts(behaviour, 2.0, SEES_RAD + 0.02)
    assert reacts(behaviour, 2.0, pause_s=60.0)  # a reaction interrupts a pause


@pytest.mark.parametrize("behaviour", [b for b in Behaviour if b not in WITHIN_M])
def test_the_others_never_react(behaviour: Behaviour) -> None:
    assert not reacts(behaviour, 1.0)
