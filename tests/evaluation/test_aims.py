from __future__ import annotations

import numpy as np
import pytest
from tests.evaluation.runs import run_of, trajectory

from rvsg.evaluation.metrics.registry import METRICS
from rvsg.evaluation.signals import SIGNALS, aim_of, robustness, series_name, series_of
from rvsg.scenario.requirement import Aim, Requirement, load_requirement, shipped_requirements

T = np.arange(0.0, 5.0, 0.05)


def asking(metric: str | None = None, formula: str | None = None) -> Requirement:
    return Requirement(name="X", title="X", text="X", metric=metric, formula=formula)


@pytest.mark.parametrize(
    ("name", "aim"),
    [
        ("R1", Aim.SHARE),
        ("R2", Aim.DISTURB),
        ("R3", Aim.DELAY),
        ("clearance", Aim.MEET),
        ("deadlock", Aim.DELAY),
        ("arrival", Aim.DELAY),
        ("detour", Aim.DELAY),
        ("emergency_stops", Aim.DISTURB),
        ("slow_near_people", Aim.MEET),
        ("recovers_distance", Aim.MEET),
    ],
)
def test_the_aim_of_a_shipped_requirement_is_that_of_its_metric_or_signals(name: str, aim: Aim) -> None:
    assert aim_of(load_requirement(name)) is aim


def test_every_shipped_requirement_has_an_aim_and_a_series() -> None:
    for requirement in shipped_requirements().values():
        assert aim_of(requirement) in (Aim.SHARE, Aim.MEET, Aim.DISTURB, Aim.DELAY)
        assert series_name(requirement)


def test_every_metric_declares_a_series_that_exists_and_what_moves_it() -> None:
    for metric in METRICS.values():
        assert metric.shown in SIGNALS and metric.moved_by and metric.aim is not Aim.NONE


def test_the_name_of_a_metric_decides_nothing() -> None:
    assert aim_of(asking("time_near_goal_stop")) is None
    assert aim_of(None) is None
    assert aim_of(asking(formula="always (time < 3 or speed > 0.1)")) is Aim.DELAY
    assert aim_of(asking(formula="always abs(acceleration) < 3")) is Aim.DISTURB


def test_the_series_of_a_metric_is_the_signal_it_declares() -> None:
    run = run_of(trajectory(T, np.linspace(0, 3, len(T)), v=0.6, humans=[(6.0, 0.0)]), goal=(4.0, 0.0, 0.0))
    assert series_of(run, asking("trg"))[0] == pytest.approx(4.0)
    assert series_of(run, asking("dto"))[0] == pytest.approx(6.0)
    assert series_of(run, asking("jerk")).tolist() == [0.0] * len(T)


def test_the_series_of_a_formula_is_the_room_left_at_each_moment() -> None:
    speed = np.where(T < 2, 0.5, 0.1)
    run = run_of(trajectory(T, 0.0, v=speed))
    formula = "always speed < 0.3"
    found = series_of(run, asking(formula=formula))
    assert found == pytest.approx(0.3 - speed)
    assert found.min() == pytest.approx(robustness(run, formula))


def test_without_people_or_samples_a_series_of_people_is_not_known() -> None:
    assert np.isnan(series_of(run_of(trajectory(T, 0.0)), asking("dto"))).all()
    assert len(series_of(run_of(trajectory(np.empty(0), np.empty(0))), asking("dto"))) == 0
