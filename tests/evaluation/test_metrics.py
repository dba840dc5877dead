from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.coded import coded, nearest
from tests.evaluation.runs import run_of, trajectory

from rvsg.core import plugins
from rvsg.core.errors import InputError, UnknownName
from rvsg.evaluation.metrics import BUILT_IN, METRICS, measure
from rvsg.evaluation.metrics.metric import Metric
from rvsg.evaluation.signals import SIGNALS, RunSignal, formula, robustness
from rvsg.simulation.run import Outcome
from rvsg.world.space import human_space, robot_space
from rvsg.world.world_folder import load_world


def value(run, name):
    return measure(run, [name])[name]


def still(t, **more):
    """A robot that stays at the origin."""
    return run_of(trajectory(t, 0, **more))


MOMENTS = np.arange(0, 2, 0.05)
CIRCLE = trajectory(MOMENTS, np.cos(MOMENTS), np.sin(MOMENTS), yaw=MOMENTS + np.pi / 2, v=1, omega=1)
MET_TWICE = np.array([3.0, 0.7, 0.6, 0.7, 3.0, 0.5, 3.0])
STOPS = [0.5, 0.5, 0.25, 0.0, 0.0, 0.5, 0.5, 0.25, 0.0, 0.0]
TWO = run_of(trajectory([0, 1], [0, 1], humans=[(3, 0), (0, 5)]))
OVERLAP = still([0, 1], humans=[(0.5, 0)])
# Human at +x of the robot, walking towards +x: he sees the robot behind (pi), the robot sees him ahead (0).
AHEAD = still([0, 1], v=0.5, humans=[(0.6, 0, 0.0, 0.0)])
# The robot drives away from a human who walks towards it: he sees it ahead (0), it sees him behind (pi).
BEHIND = still([0, 1], v=0.5, humans=[(-0.6, 0, 0.0, 1.0)])
CONTACTS = still(np.arange(7) * 0.5, v=0.2, humans=[(MET_TWICE, 0, 0.0, 0.0)])


@pytest.mark.parametrize(
    ("name", "run", "expected"),
    [
        ("dto", TWO, (3 + 2) / 2),  # centre to centre, unless logged
        ("dto_logged", TWO, (2.25 + 1.25) / 2),
        ("min_distance", TWO, 1.25),
        ("min_distance", OVERLAP, -0.25),  # negative for us and zero as logged
        ("min_distance_logged", OVERLAP, 0.0),
        ("jerk_logged", still([0, 0.5, 1.0, 1.1], acceleration=[0, 1, 1, 3]), (2 + 0 + 20) / 3),
        ("jerk", run_of(trajectory(MOMENTS, MOMENTS**2, v=2 * MOMENTS)), 0.0),  # constant acceleration
        ("jerk", run_of(CIRCLE), 0.0),
        ("jerk", still([0, 1, 2, 3], v=[0, 2, 2, 2]), (2 + 0) / 2),  # a sudden start
        ("trg", still([0, 10]), 10.0),
        ("trg", run_of(trajectory([0, 10], 0), outcome=Outcome.TIMED_OUT), 25.0),  # at least the time limit
        ("trg_logged", run_of(trajectory([0, 10], 0), outcome=Outcome.ABORTED), 10.0),
        ("rpc_logged", AHEAD, 0),  # as the study counts, even where its naming looks reversed
        ("por_logged", AHEAD, 2),
        ("rpc_logged", BEHIND, 2),
        ("por_logged", BEHIND, 0),
        ("rpc_logged", still([0, 1], humans=[(-0.6, 0, 0.0, 1.0)]), 0),
        ("chc", still([0, 1, 2], yaw=[3.0, -3.0, 3.0]), 2 * (2 * math.pi - 6)),  # the short way round
        ("tnm", still([0, 1, 2, 4], v=[0, 0.5, 0, 0]), 3.0),  # the first sample left out
        ("tnm_logged", still([0, 1, 2, 4], v=[0, 0.5, 0, 0]), 4 / 3 * 2),
        ("ttc", still([0, 0.1], v=0.5, humans=[(3.75, 0, math.pi, 1.0)]), 3.0 / 1.5),
        ("ttc", still([0, 0.1], v=0.5, humans=[(3.75, 2.0, math.pi, 1.0)]), None),  # they pass
        ("contacts", CONTACTS, 2),  # meetings, not samples
        ("contact_time", CONTACTS, 2.0),
        ("contact_robot_speed", CONTACTS, 0.2),
        ("stopping_margin", still([0, 0.1], v=0.5, humans=[(2.75, 0)]), 2.0 - 0.5 * 0.3 - 0.25 / 5),
        ("emergency_stops", still(np.arange(10) * 0.1, v=STOPS), 1),  # without the arrival
        ("emergency_stops", run_of(trajectory(np.arange(10) * 0.1, 0, v=STOPS), outcome=Outcome.TIMED_OUT), 2),
        ("dto", run_of(trajectory([0, 1], [0, 1])), None),  # without people there is no judgement on them
        ("contacts", run_of(trajectory([0, 1], [0, 1])), None),
        ("pl", run_of(trajectory([0, 1], [0, 1])), 1.0),
    ],
)
def test_a_metric_of_a_run_that_can_be_worked_out_on_paper(name, run, expected):
    assert value(run, name) == (None if expected is None else pytest.approx(expected, abs=1e-9))


@given(st.integers(0, 49), st.floats(0.95, 1.0))
def test_expected_jerk_is_the_mean_of_logged_jerk_over_all_sampling_phases(seed, ratio):
    rng = np.random.default_rng(seed)
    imu = np.abs(rng.normal(size=400)) * (rng.random(400) < 0.2)
    lag = round(0.509 * ratio / 0.01)
    every = [abs(imu[k + lag] - imu[k]) / (lag * 0.01 / ratio) for k in range(400 - lag)]
    run = run_of(trajectory([0, 1], 0), imu=imu, clock_ratio=ratio)
    assert value(run, "expected_jerk") == pytest.approx(np.mean(every))


@pytest.mark.parametrize("samples", [0, 1, 2])
def test_no_metric_fails_on_a_short_run(samples):
    run = run_of(trajectory(np.arange(samples), 0, humans=[(np.ones(samples), 0)]))
    assert all(found is None or math.isfinite(found) for found in measure(run).values())


def test_a_typo_is_answered_with_the_nearest_metric():
    with pytest.raises(UnknownName, check=nearest("jerk")):
        measure(run_of(trajectory([0, 1], 0)), ["jerkk"])


def test_every_metric_says_its_formula_and_source():
    for info in METRICS.values():
        assert len(info.formula) > 20 and info.source and info.unit, info.id


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_a_metric_said_never_to_be_negative_never_is(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 30))
    human = (rng.uniform(-2, 2, n), rng.uniform(-2, 2, n), rng.uniform(-3, 3, n), rng.uniform(0, 2, n))
    series = trajectory(
        np.cumsum(rng.uniform(0.05, 0.6, n)),
        rng.uniform(-2, 2, n),
        rng.uniform(-2, 2, n),
        yaw=rng.uniform(-3, 3, n),
        v=rng.uniform(-0.5, 0.5, n),
        omega=rng.uniform(-1, 1, n),
        acceleration=rng.uniform(0, 3, n),
        humans=[human],
    )
    found = measure(run_of(series, human_groups=(1,)))
    for name, value in found.items():
        least = METRICS[name].least
        assert value is None or least is None or value >= least, name


def head_on(turn):
    """Robot and person walking at each other on a line at angle `turn`, for one second."""
    c, s = math.cos(turn), math.sin(turn)
    human = (2 * c, 2 * s, turn + math.pi, 1.0)
    return run_of(trajectory([0.0, 1.0], 0, yaw=turn, v=0.5, humans=[human]))


# k exp(-D / (gamma L)) with D = 2 m and L = |2 (1 + 0.5) + 1| = 4
FORCE = 2.1 * math.exp(-2 / 1.4)
# The person is straight ahead of the robot (bearing 0) and faces it (bearing 0): nobody's fault for us, but the
# evaluator takes the person's bearing for 90 degrees and blames the robot.
FACING = still([0, 1], v=0.5, humans=[(0.6, 0.0, math.pi, 1.0)])


@pytest.mark.parametrize(
    ("name", "run", "expected"),
    [
        *(("force_on_humans", head_on(turn), FORCE) for turn in (0.0, 0.4, math.pi / 4, 2.0)),
        ("force_on_humans_hunav", head_on(0.0), 0.0),  # the evaluator is right along 45 degrees only
        ("force_on_humans_hunav", head_on(math.pi / 4), 2 * FORCE),
        ("tnm", still([0, 1, 2], omega=-0.5), 0.0),
        ("tnm_hunav", still([0, 1, 2], omega=-0.5), 2.0),  # turning right stands still for it
        ("rpc", FACING, 0),
        ("por", FACING, 0),
        ("rpc_hunav", FACING, 2),
        ("por_hunav", FACING, 0),
        ("max_distance", still([0, 1], humans=[(3.0, 0.0)]), 2.25),
        ("max_distance_hunav", still([0, 1], humans=[(3.0, 0.0)]), 2.65),  # without the person's radius
    ],
)
def test_the_evaluators_defects_are_in_its_own_numbers_alone(name, run, expected):
    assert value(run, name) == pytest.approx(expected, abs=1e-8)


def test_the_evaluators_sums_grow_with_the_sampling_rate_and_ours_do_not():
    human = (2.0, 2.0, -2.0, 1.0)
    runs = [run_of(trajectory(np.linspace(0, 2, n), 0, yaw=0.7, v=0.5, humans=[human])) for n in (11, 21)]
    ours = [value(run, "social_work") for run in runs]
    theirs = [value(run, "social_work_hunav") for run in runs]
    assert ours[0] == pytest.approx(ours[1])
    assert theirs[1] / theirs[0] == pytest.approx(21 / 11)


def around(*groups):
    """A robot at the origin, and three people 3 m off who all look at it: the points 1.5 m ahead are 1.5 m off."""
    humans = [(3.0, 0.0, math.pi, 0.0), (0.0, 3.0, -math.pi / 2, 0.0), (-3.0, 0.0, 0.0, 0.0)]
    return run_of(trajectory([0.0, 1.0], 0, humans=humans), human_groups=groups)


def test_the_space_of_a_group_is_in_front_of_its_members():
    # The first and the third share the very spot of the robot; the first and the second one 1.06 m off.
    assert value(around(1, None, 1), "group_intimate_space") == 100.0
    assert value(around(1, 1, None), "group_personal_space") == 100.0  # 1.06 - 0.35 = 0.71 m from the robot's edge
    assert value(around(1, 1, None), "group_intimate_space") == 0.0
    # With two groups the nearer one counts; all three have their space 0.5 m off.
    assert value(around(4, 4, 4), "group_intimate_space") == 100.0
    for groups in ((), (None, None, None), (1, 2, 3)):
        assert value(around(*groups), "group_social_space") is None


def test_obstacles_push_as_the_nearest_surface_does_and_need_the_world():
    warehouse = load_world("warehouse")
    x, y = warehouse.grid.position("E15")
    run = run_of(trajectory(np.linspace(0, 2, 5), x, y, humans=[(x, y)]))
    found = measure(run, ["obstacle_force_on_humans", "obstacle_force_on_robot"], world=warehouse)
    for name, radius, space in (("humans", 0.4, human_space), ("robot", 0.35, robot_space)):
        clear = space(warehouse).clearance(x, y)
        assert found[f"obstacle_force_on_{name}"] == pytest.approx(2.0 * 10 * math.exp(-(clear - radius) / 0.2))

    assert value(run, "obstacle_force_on_humans") is None is value(run, "obstacle_force_on_robot")


PAGE = Path(__file__).parents[2] / "docs" / "reference" / "metrics.md"
T = np.arange(0.0, 2.001, 0.05)
REVERSING = trajectory(T, 0.0, v=np.where(T > 1.0, -0.2, 0.2))


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """Plug-ins by name; the registries read them anew."""
    known: dict[str, Any] = {}
    monkeypatch.setattr(plugins, "names", lambda kind: tuple(sorted(known)))
    monkeypatch.setattr(plugins, "find", lambda kind, name: known[name])
    for registry in (METRICS, SIGNALS):
        monkeypatch.setattr(registry, "_all", None)
    formula.cache_clear()
    yield known
    formula.cache_clear()


def documented() -> Metric:
    names: dict[str, Any] = {}
    exec(re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1], names)  # type: ignore[index]
    return names["REVERSING"]


def test_the_documented_metric_measures_as_a_plug_in_that_may_give_several(installed: dict[str, Any]) -> None:
    one = documented()
    installed["pack"] = (one, Metric(**{**vars(one), "id": "other"}))
    assert list(METRICS)[-2:] == ["reversing", "other"]
    assert measure(run_of(REVERSING), ["reversing"])["reversing"] == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("wrong", ["text", 7, [object()]])
def test_a_plug_in_that_is_no_metric_is_named(wrong: object, installed: dict[str, Any]) -> None:
    installed["wrong"] = wrong
    with pytest.raises(InputError, check=coded("plug-in-kind")):
        list(METRICS)


def test_a_bound_that_is_no_number_is_refused_where_it_is_declared() -> None:
    with pytest.raises(InputError, check=coded("metric-bound")):
        Metric(**{**vars(documented()), "most": "speed"})


def test_a_plug_in_cannot_take_the_id_of_another(installed: dict[str, Any]) -> None:
    installed["mine"] = Metric(**{**vars(documented()), "id": "dto"})
    with pytest.raises(InputError, check=coded("plug-in-name-taken")):
        list(METRICS)


def test_a_signal_of_a_plug_in_can_be_named_in_a_formula(installed: dict[str, Any]) -> None:
    installed["backwards"] = RunSignal(id="backwards", title="speed in reverse", unit="m/s", of=lambda s: -s.series.v)
    assert robustness(run_of(REVERSING), "always backwards < 0.5") == pytest.approx(0.3)


def test_the_metrics_of_the_study_are_a_plug_in() -> None:
    assert "dto_logged" in METRICS and "dto_logged" not in {metric.id for metric in BUILT_IN}
