"""Encounters of runs built by hand: who comes near, and from which side."""

from __future__ import annotations

import numpy as np
import pytest
from tests.evaluation.runs import run_of, trajectory

from rvsg.evaluation.detection import EncounterKind, encounters_of

T = np.linspace(0.0, 20.0, 401)
ROBOT_X = 0.5 * T


@pytest.mark.parametrize(
    ("human", "kind"),
    [
        ((10.0 - 0.5 * T, 0.9, np.pi, 0.5), EncounterKind.HEAD_ON),
        ((3.0 + 0.2 * T, 0.9, 0.0, 0.2), EncounterKind.ROBOT_OVERTAKES),
        ((-4.0 + 1.0 * T, 0.9, 0.0, 1.0), EncounterKind.PERSON_OVERTAKES),
        ((5.0, 10.0 - 1.0 * T, -np.pi / 2, 1.0), EncounterKind.FROM_LEFT),
        ((5.0, -10.0 + 1.0 * T, np.pi / 2, 1.0), EncounterKind.FROM_RIGHT),
        ((5.0, 0.9, 2.0, 0.0), EncounterKind.STANDING),
    ],
)
def test_the_kind_follows_from_the_directions_of_both(human, kind) -> None:  # type: ignore[no-untyped-def]
    run = run_of(trajectory(T, ROBOT_X, v=0.5, humans=[human]))
    (met,) = encounters_of(run)
    assert met.kind is kind
    assert met.person == "Human 1"


def test_someone_far_away_is_not_met_and_a_second_approach_is_a_second_encounter() -> None:
    away = run_of(trajectory(T, ROBOT_X, v=0.5, humans=[(ROBOT_X, 5.0, 0.0, 0.5)]))
    assert encounters_of(away) == ()
    near = np.where((T % 10) < 2, 1.5, 6.0)
    twice = run_of(trajectory(T, ROBOT_X, v=0.5, humans=[(ROBOT_X, near, 0.0, 0.5)]))
    met = encounters_of(twice)
    assert [round(each.gap_m, 2) for each in met[:2]] == [0.75, 0.75]
    assert met[0].time_s < 2.0 <= 10.0 <= met[1].time_s
    assert encounters_of(run_of(trajectory(T, ROBOT_X, v=0.5))) == (), "without people"
