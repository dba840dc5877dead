import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.coded import nearest
from tests.evaluation.runs import run_of, trajectory

from rvsg.core.errors import UnknownName
from rvsg.evaluation.metrics.registry import METRICS, measure
from rvsg.simulation.run import Outcome


def value(run, name):
    return measure(run, [name])[name]


def test_distances_are_centre_to_centre_unless_logged():
    series = trajectory([0, 1], [0, 1], humans=[(3, 0), (0, 5)])
    run = run_of(series)
    assert value(run, "dto") == pytest.approx((3 + 2) / 2)
    assert value(run, "dto_logged") == pytest.approx((2.25 + 1.25) / 2)
    assert value(run, "min_distance") == pytest.approx(1.25)


def test_an_overlap_is_negative_for_us_and_zero_as_logged():
    run = run_of(trajectory([0, 1], 0, humans=[(0.5, 0)]))
    assert value(run, "min_distance") == pytest.approx(-0.25)
    assert value(run, "min_distance_logged") == 0.0


def test_logged_jerk_is_the_mean_change_of_the_inertial_magnitude_over_time():
    run = run_of(trajectory([0, 0.5, 1.0, 1.1], 0, acceleration=[0, 1, 1, 3]))
    assert value(run, "jerk_logged") == pytest.approx((2 + 0 + 20) / 3)


def test_jerk_of_constant_acceleration_is_zero_and_of_a_circle_too():
    t = np.arange(0, 2, 0.05)
    assert value(run_of(trajectory(t, t**2, v=2 * t)), "jerk") == pytest.approx(0, abs=1e-9)
    circle = trajectory(t, np.cos(t), np.sin(t), yaw=t + np.pi / 2, v=1, omega=1)
    assert value(run_of(circle), "jerk") == pytest.approx(0, abs=1e-9)


def test_jerk_of_a_sudden_start_is_the_change_of_acceleration_over_the_interval():
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
    assert found["dto"] is None
    assert found["contacts"] is None
    assert found["pl"] == 1.0


@pytest.mark.parametrize("samples", [0, 1, 2])
def test_no_metric_fails_on_a_short_run(samples):
    run = run_of(trajectory(np.arange(samples), 0, humans=[(np.ones(samples), 0)]))
    assert all(found is None or math.isfinite(found) for found in measure(run).values())


def test_a_typo_is_answered_with_the_nearest_metric():
    with pytest.raises(UnknownName, check=nearest("jerk")):
        measure(run_of(trajectory([0, 1], 0)), ["jerkk"])


def test_every_metric_says_its_formula_and_source():
    for info in METRICS.values():
        assert len(info.formula) > 20, info.id
        assert info.source
        assert info.unit


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
