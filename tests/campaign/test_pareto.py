"""Several requirements at once: the front, its hypervolume, and the strategy that fills it."""

from __future__ import annotations

import numpy as np
import pytest
from tests.campaign.parts import REQUIREMENT, distance, plan, searched

from rvsg.campaign.attempt import Attempt, Measurement, Plan
from rvsg.campaign.hybrid import MultiStrategy
from rvsg.campaign.ranking import front_of, hypervolume, share_of, undominated
from rvsg.evaluation.metrics.registry import measure as measure_all
from rvsg.scenario.requirement import Requirement
from rvsg.simulation.run import Run

LATE = Requirement(name="R3", title="Time", text="Arrive.", metric="trg", worse="larger", limit=20.0, unit="s")
NEAR = REQUIREMENT.replace(limit=10.0)


def measured(run: Run, _place: object = None) -> Measurement:
    values = measure_all(run, ["trg"])
    return Measurement(run_id=run.id, seed=run.seed, outcome=run.outcome.value, values=values, objective=distance(run))


def the_plan() -> Plan:
    return plan(requirement=NEAR, also=(LATE,), scenarios=5, refinements=3, repeats=2, confirmations=0, budget_runs=40)


@pytest.fixture(scope="module")
def whole() -> list[Attempt]:
    return searched(MultiStrategy, the_plan(), measure=measured)


@pytest.mark.parametrize(
    ("requirement", "value", "share"), [(NEAR, 10.0, 1.0), (NEAR, 5.0, 1.5), (NEAR, 30.0, 0.0), (LATE, 10.0, 0.5)]
)
def test_a_value_is_a_share_of_what_violates(requirement: Requirement, value: float, share: float) -> None:
    assert share_of(requirement, value) == pytest.approx(share)


def test_the_front_holds_what_none_beats_and_one_of_equals() -> None:
    shares = np.array([[1.0, 1.0], [2.0, 0.5], [0.5, 0.5], [1.0, 1.0], [2.0, 0.4]])
    assert undominated(shares) == [0, 1]


@pytest.mark.parametrize(
    ("points", "volume"),
    [
        ([], 0.0),
        ([(1.0, 1.0)], 1.0),
        ([(2.0, 0.5), (1.0, 1.0)], 1.5),
        ([(2.0, 0.0)], 0.0),
        ([(1.0, 1.0, 1.0), (2.0, 1.0, 0.5), (0.5, 0.5, 2.0)], 1.75),
    ],
)
def test_the_hypervolume_is_what_the_front_dominates(points: list[tuple[float, ...]], volume: float) -> None:
    assert hypervolume(points) == pytest.approx(volume)


def test_multi_spends_its_runs_and_repeats_its_front(whole: list[Attempt]) -> None:
    assert len({m.run_id for a in whole for m in a.measurements}) == 40
    front = front_of(the_plan(), whole)
    assert front.points
    assert front.hypervolume > 0.0
    for point in front.points:
        assert [tried.requirement for tried in point.tried] == ["R1", "R3"]
        assert all(tried.runs > 1 for tried in point.tried)
    shares = [[tried.share for tried in point.tried] for point in front.points]
    assert undominated(np.array(shares)) == list(range(len(shares)))
    assert shares == sorted(shares, reverse=True)


def test_multi_is_the_same_again(whole: list[Attempt]) -> None:
    assert searched(MultiStrategy, the_plan(), measure=measured) == whole
