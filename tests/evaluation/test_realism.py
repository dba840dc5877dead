"""Realism: percentiles of recorded people."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.simulation.parts import route

from rvsg.evaluation.realism import (
    PERCENTILES,
    QUANTITIES,
    Motion,
    closing,
    following,
    motions,
    rarest,
    summary,
    turning,
)
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
    seen = {(motion.person, motion.quantity) for motion in found}
    near = {(person, quantity) for person in ("ann", "ben") for quantity in ("closing", "following")}
    assert seen - near == {(person, quantity) for person in ("ann", "ben") for quantity in QUANTITIES} - near
    assert summary(found) == "No person does what fewer than 1 in 100 recorded people did."


STEPS = np.arange(30)
AHEAD, BACK = np.stack([0.4 * STEPS, 0.0 * STEPS]), np.stack([0.4 * np.abs(STEPS - 15), 0.0 * STEPS])
BEYOND = np.stack([0.4 * STEPS + 0.8, 0.0 * STEPS])
STANDS = np.stack([0.0 * STEPS + 6.0, 0.0 * STEPS])


@pytest.mark.parametrize(
    ("shown", "path", "other", "value"),
    [
        (closing, AHEAD, STANDS, 1.0),  # walks into somebody who stands
        (closing, STANDS, AHEAD, 0.0),  # and is not to blame for being walked into
        (closing, AHEAD, STANDS + 9.0, None),
        (following, AHEAD, BEYOND, 0.3),
        (following, BEYOND, AHEAD, None),
        (following, AHEAD, AHEAD[:, ::-1], None),
    ],
)
def test_what_somebody_does_to_another_is_measured_at_who_does_it(
    shown: Any, path: Any, other: Any, value: float | None
) -> None:
    found = shown(path, other, 0.5)
    assert (None if found is None else found[0]) == (None if value is None else pytest.approx(value))


def test_turning_round_counts_without_a_stop() -> None:
    stop = np.concatenate([BACK[:, :16], np.repeat(BACK[:, 15:16], 5, axis=1), BACK[:, 16:]], axis=1)
    assert [turning(path)[0] for path in (AHEAD, BACK, stop)] == [0, 1, 0]
    assert QUANTITIES["turning"].rarity(1.0) < 1.0 < QUANTITIES["turning"].rarity(0.0)


def test_the_rarest_motion_is_named_with_its_person_and_time() -> None:
    usual = Motion(person="ann", quantity="speed", value=1.2, time_s=0.4, recorded_percent=52.0)
    rare = Motion(person="ben", quantity="acceleration", value=4.6, time_s=3.64, recorded_percent=0.75)
    assert rarest((usual, rare)) == rare
    assert summary((usual, rare)) == "ben accelerates with 4.6 m/s² at 3.6 s; 0.8 % of the recorded people go as far."


def test_nobody_has_no_realism() -> None:
    run = simulate_agents(empty_room(), route((-2.0, -1.5), (2.0, -1.5)), [], seed=1)
    assert summary(motions(run)) == ""
