"""Realism: percentiles of recorded people."""

from __future__ import annotations

import numpy as np
import pytest
from tests.simulation.parts import route

from rvsg.evaluation.realism import PERCENTILES, QUANTITIES, Motion, motions, rarest, summary
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.embedded.profiles import profile
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents


def walker(name: str, *points: tuple[float, float]) -> HumanAgent:
    return HumanAgent(name=name, start=points[0], goals=points, pauses_s=(0.0,) * (len(points) - 1) + (60.0,))


def simulated(name: str) -> tuple[object, ...]:
    people = walker("ann", (-2.5, 1.5), (2.5, 1.5)), walker("ben", (2.5, 1.55), (-2.5, 1.55))
    run = simulate_agents(empty_room(), route((-2.0, -1.5), (2.0, -1.5)), people, options=profile(name), seed=3)
    return motions(run)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_recorded_values_increase(quantity: str) -> None:
    values = QUANTITIES[quantity].recorded
    assert len(values) == len(PERCENTILES) and (np.diff(values) > 0.0).all()


def test_rarity_is_the_share_of_people_who_go_as_far() -> None:
    assert QUANTITIES["speed"].rarity(1.19) == pytest.approx(50.0)
    assert QUANTITIES["acceleration"].rarity(9.6) == 0.0
    assert QUANTITIES["distance"].rarity(0.25) == pytest.approx(1.0)
    assert QUANTITIES["standing"].rarity(0.0) == 100.0


def test_people_of_the_default_profile_move_as_recorded_people_do() -> None:
    found = simulated("default")
    assert {(motion.person, motion.quantity) for motion in found} == {
        (person, quantity) for person in ("ann", "ben") for quantity in QUANTITIES
    }
    assert summary(found) == "No person does what fewer than 1 in 100 recorded people did."


def test_the_rarest_motion_is_named_with_its_person_and_time() -> None:
    usual = Motion(person="ann", quantity="speed", value=1.2, time_s=0.4, recorded_percent=52.0)
    rare = Motion(person="ben", quantity="acceleration", value=4.6, time_s=3.64, recorded_percent=0.75)
    assert rarest((usual, rare)) == rare
    assert summary((usual, rare)) == "ben accelerates with 4.6 m/s² at 3.6 s; 0.8 % of the recorded people go as far."


def test_nobody_has_no_realism() -> None:
    run = simulate_agents(empty_room(), route((-2.0, -1.5), (2.0, -1.5)), [], seed=1)
    assert summary(motions(run)) == ""
