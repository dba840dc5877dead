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
from rvsg.evaluation.metrics.metric import Metric
from rvsg.evaluation.metrics.registry import BUILT_IN, METRICS, measure
from rvsg.evaluation.signals import SIGNALS, RunSignal, formula, robustness
from rvsg.simulation.run import Outcome
from rvsg.world.space import human_space, robot_space
from rvsg.world.world_folder import load_world


def value(run, name):
    return measure(run, [name])[name]


def test_distances_are_centre_to_centre_unless_logged_and_overlaps_negative():
    series = trajectory([0, 1], [0, 1], humans=[(3, 0), (0, 5)])
    run = run_of(series)
    assert value(run, "dto") == pytest.approx((3 + 2) / 2)
    assert value(run, "dto_logged") == pytest.approx((2.25 + 1.25) / 2)
    assert value(run, "min_distance") == pytest.approx(1.25)

    run = run_of(trajectory([0, 1], 0, humans=[(0.5, 0)]))
    assert value(run, "min_distance") == pytest.approx(-0.25)
    assert value(run, "min_distance_logged") == 0.0


def test_logged_jerk_is_the_mean_change_of_the_inertial_magnitude_over_time():
    run = run_of(trajectory([0, 0.5, 1.0, 1.1], 0, acceleration=[0, 1, 1, 3]))
    assert value(run, "jerk_logged") == pytest.approx((2 + 0 + 20) / 3)


def test_jerk_is_the_change_of_acceleration_over_the_interval():
    t = np.arange(0, 2, 0.05)
    assert value(run_of(trajectory(t, t**2, v=2 * t)), "jerk") == pytest.approx(0, abs=1e-9)
    circle = trajectory(t, np.cos(t), np.sin(t), yaw=t + np.pi / 2, v=1, omega=1)
    assert value(run_of(circle), "jerk") == pytest.approx(0, abs=1e-9)

    run = run_of(trajectory([0, 1, 2, 3], 0, v=[0, 2, 2, 2]))
    assert value(run, "jerk") == pytest.approx((2 + 0) / 2)


@given(st.integers(0, 49), st.floats(0.95, 1.0))
def test_expected_jerk_is_the_mean_of_logged_jerk_over_all_sampling_phases(seed, ratio):
    rng = np.random.default_rng(seed)
    imu = np.abs(rng.normal(size=400)) * (rng.random(400) < 0.2)
    lag = round(0.509 * ratio / 0.01)
    every = [abs(imu[k + lag] - imu[k]) / (lag * 0.01 / ratio) for k in range(400 - lag)]
    run = run_of(trajectory([0, 1], 0), imu=imu, clock_ratio=ratio)
    assert value(run, "expected_jerk") == pytest.approx(np.mean(every))


def test_a_run_that_misses_its_goal_counts_with_at_least_its_time_limit():
    series = trajectory([0, 10], 0)
    assert value(run_of(series), "trg") == 10
    assert value(run_of(series, outcome=Outcome.TIMED_OUT), "trg") == 25
    assert value(run_of(series, outcome=Outcome.ABORTED), "trg_logged") == 10


def test_collisions_follow_the_study_even_where_its_naming_looks_reversed():
    # Human at +x of the robot, walking towards +x: he sees the robot behind (pi), the robot sees him ahead (0).
    ahead = run_of(trajectory([0, 1], 0, v=0.5, humans=[(0.6, 0, 0.0, 0.0)]))
    assert (value(ahead, "rpc_logged"), value(ahead, "por_logged")) == (0, 2)
    # The robot drives away from a human who walks towards it: he sees it ahead (0), it sees him behind (pi).
    behind = run_of(trajectory([0, 1], 0, v=0.5, humans=[(-0.6, 0, 0.0, 1.0)]))
    assert (value(behind, "rpc_logged"), value(behind, "por_logged")) == (2, 0)
    standing = run_of(trajectory([0, 1], 0, humans=[(-0.6, 0, 0.0, 1.0)]))
    assert value(standing, "rpc_logged") == 0


def test_heading_changes_take_the_short_way_round():
    run = run_of(trajectory([0, 1, 2], 0, yaw=[3.0, -3.0, 3.0]))
    assert value(run, "chc") == pytest.approx(2 * (2 * math.pi - 6))


def test_time_not_moving_leaves_the_first_sample_out():
    run = run_of(trajectory([0, 1, 2, 4], 0, v=[0, 0.5, 0, 0]))
    assert value(run, "tnm") == pytest.approx(3)
    assert value(run, "tnm_logged") == pytest.approx(4 / 3 * 2)


def test_time_to_collision_of_a_head_on_meeting():
    run = run_of(trajectory([0, 0.1], 0, v=0.5, humans=[(3.75, 0, math.pi, 1.0)]))
    assert value(run, "ttc") == pytest.approx(3.0 / 1.5)
    passing = run_of(trajectory([0, 0.1], 0, v=0.5, humans=[(3.75, 2.0, math.pi, 1.0)]))
    assert value(passing, "ttc") is None


def test_contact_events_count_meetings_and_not_samples():
    x = [3.0, 0.7, 0.6, 0.7, 3.0, 0.5, 3.0]
    run = run_of(trajectory(np.arange(7) * 0.5, 0, v=0.2, humans=[(np.array(x), 0, 0.0, 0.0)]))
    assert value(run, "contacts") == 2
    assert value(run, "contact_time") == pytest.approx(2.0)
    assert value(run, "contact_robot_speed") == pytest.approx(0.2)


def test_stopping_margin_subtracts_what_the_robot_needs_to_stop():
    run = run_of(trajectory([0, 0.1], 0, v=0.5, humans=[(2.75, 0)]))
    assert value(run, "stopping_margin") == pytest.approx(2.0 - 0.5 * 0.3 - 0.25 / 5)


def test_only_hard_stops_on_the_way_are_emergency_stops():
    v = [0.5, 0.5, 0.25, 0.0, 0.0, 0.5, 0.5, 0.25, 0.0, 0.0]
    run = run_of(trajectory(np.arange(10) * 0.1, 0, v=v))
    assert value(run, "emergency_stops") == 1
    assert value(run_of(run.trajectory, outcome=Outcome.TIMED_OUT), "emergency_stops") == 2


def test_a_run_without_people_has_no_judgement_on_them():
    found = measure(run_of(trajectory([0, 1], [0, 1])))
    assert (found["dto"], found["contacts"], found["pl"]) == (None, None, 1.0)


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


@pytest.mark.parametrize("turn", [0.0, 0.4, math.pi / 4, 2.0])
def test_the_social_force_does_not_depend_on_the_direction_of_the_axes(turn):
    # k exp(-D / (gamma L)) with D = 2 m and L = |2 (1 + 0.5) + 1| = 4: 2.1 exp(-2 / 1.4).
    assert value(head_on(turn), "force_on_humans") == pytest.approx(2.1 * math.exp(-2 / 1.4))


def test_the_evaluators_force_is_right_only_along_45_degrees():
    assert value(head_on(0.0), "force_on_humans_hunav") < 1e-8
    along = value(head_on(math.pi / 4), "force_on_humans_hunav")
    assert along == pytest.approx(2 * 2.1 * math.exp(-2 / 1.4))


def test_the_evaluators_sums_grow_with_the_sampling_rate_and_ours_do_not():
    human = (2.0, 2.0, -2.0, 1.0)
    runs = [run_of(trajectory(np.linspace(0, 2, n), 0, yaw=0.7, v=0.5, humans=[human])) for n in (11, 21)]
    ours = [value(run, "social_work") for run in runs]
    theirs = [value(run, "social_work_hunav") for run in runs]
    assert ours[0] == pytest.approx(ours[1])
    assert theirs[1] / theirs[0] == pytest.approx(21 / 11)


def test_turning_right_on_the_spot_stands_still_for_the_evaluator_alone():
    run = run_of(trajectory([0, 1, 2], 0, omega=-0.5))
    assert value(run, "tnm") == 0.0
    assert value(run, "tnm_hunav") == 2.0


def test_the_evaluator_swaps_the_axes_of_the_person_in_the_robots_frame():
    # The person is straight ahead of the robot (bearing 0) and faces it (bearing 0): nobody's fault for us, but the
    # evaluator takes the person's bearing for 90 degrees and blames the robot.
    run = run_of(trajectory([0, 1], 0, v=0.5, humans=[(0.6, 0.0, math.pi, 1.0)]))
    assert (value(run, "rpc"), value(run, "por")) == (0, 0)
    assert (value(run, "rpc_hunav"), value(run, "por_hunav")) == (2, 0)


def test_the_evaluator_forgets_the_persons_radius_in_the_largest_distance():
    run = run_of(trajectory([0, 1], 0, humans=[(3.0, 0.0)]))
    assert value(run, "max_distance") == pytest.approx(2.25)
    assert value(run, "max_distance_hunav") == pytest.approx(2.65)


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


def test_a_plug_in_cannot_take_the_id_of_another(installed: dict[str, Any]) -> None:
    installed["mine"] = Metric(**{**vars(documented()), "id": "dto"})
    with pytest.raises(InputError, check=coded("plug-in-name-taken")):
        list(METRICS)


def test_a_signal_of_a_plug_in_can_be_named_in_a_formula(installed: dict[str, Any]) -> None:
    installed["backwards"] = RunSignal(id="backwards", title="speed in reverse", unit="m/s", of=lambda s: -s.series.v)
    assert robustness(run_of(REVERSING), "always backwards < 0.5") == pytest.approx(0.3)


def test_the_metrics_of_the_study_are_a_plug_in() -> None:
    assert "dto_logged" in METRICS and "dto_logged" not in {metric.id for metric in BUILT_IN}
