"""MPPI: its parts against the formulas of Nav2, and what it does with an obstacle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from tests.simulation.parts import route

from rvsg.core.references import refer
from rvsg.simulation.costmap import outline_hits
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.stacks import mppi as k
from rvsg.simulation.stacks import mppi_critics
from rvsg.simulation.stacks.mppi import Mppi
from rvsg.stacks import StackChoice

SQUARE = np.array([(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)])
PLAN = np.column_stack([np.linspace(1.5, 4.0, 101), np.full(101, 1.5)])


def prepared(samples: int = 400, **options: Any) -> tuple[Any, mppi_critics.Work]:
    stack = Mppi(batch_size=samples, **options)
    p = stack._of(SQUARE, 100.0, 0.05)
    work = mppi_critics.new_work(stack.settings.time_steps, samples, p)
    mppi_critics.start_again(work, np.random.default_rng(1), p)
    return refer(p), work


def drive(
    p: Any, m: mppi_critics.Work, cells: np.ndarray[Any, Any], *, ticks: int = 60
) -> list[tuple[float, float, bool]]:
    """Follow the plan for some ticks in a costmap that stays; return the places, and whether each had a command."""
    x, y, yaw, v, w = 1.5, 1.5, 0.0, 0.0, 0.0
    track = []
    for _ in range(ticks):
        valid, v, w = k.optimise(m, PLAN, cells, 0.0, 0.0, 0.05, x, y, yaw, v, w, 0.0, 1, p)
        assert not valid or (v, w) == tuple(m.history[:, 3]), "the filter comes last"
        yaw += w * 0.05
        x, y = x + v * math.cos(yaw) * 0.05, y + v * math.sin(yaw) * 0.05
        track.append((x, y, valid))
    return track


@pytest.fixture(scope="module")
def free() -> np.ndarray[Any, Any]:
    return np.zeros((60, 100), np.uint8)


def test_the_rollout_integrates_the_sampled_controls() -> None:
    p, m = prepared(50)
    m.control[0], m.control[1] = 0.4, 0.3
    k.roll_out(m, 0, 50, 0.7, 0.2, -0.1, p)
    for b in (0, 49):
        v, w, x, y, yaw = 0.2, -0.1, 0.0, 0.0, 0.7
        for step in range(56):
            x, y = x + v * math.cos(yaw) * 0.05, y + v * math.sin(yaw) * 0.05
            yaw += w * 0.05
            assert (m.x[step, b], m.y[step, b], m.yaw[step, b]) == pytest.approx((x, y, yaw), abs=2e-4)
            v = min(v + 0.15, max(v - 0.15, 0.4 + float(m.noise_v[step, b])))
            if step == 55:
                assert m.v[56, b] == pytest.approx(0.4 + m.noise_v[55, b]), "it moves nothing, and is not limited"
            w = min(w + 0.175, max(w - 0.175, 0.3 + float(m.noise_w[step, b])))


def test_the_mean_is_weighted_by_the_scores() -> None:
    p, m = prepared(64, gamma=0.0)
    k.roll_out(m, 0, 64, 0.0, 0.0, 0.0, p)
    m.costs[:] = np.linspace(0.0, 2.0, 64, dtype=np.float32)
    weights = np.exp(-m.costs.astype(float) / 0.3)
    k.average(m, p)
    assert m.control[0] == pytest.approx((m.v[1:] @ weights) / weights.sum(), abs=1e-4)


def test_the_sequence_keeps_to_the_limits() -> None:
    p, m = prepared()
    m.control[0], m.control[1] = 9.0, -9.0
    m.control[0, 0] = m.control[1, 0] = 0.0
    k.constrain(m, p)
    assert m.control[0, 1] == pytest.approx(0.15) and m.control[0].max() == 0.5
    assert np.abs(np.diff(m.control[1])).max() <= 0.175 + 1e-9 and m.control[1].min() == -1.9


def test_the_filter_is_savitzky_golay() -> None:
    from scipy.signal import savgol_coeffs

    assert np.allclose(k.FILTER, savgol_coeffs(9, 2))


def test_it_follows_a_free_plan_at_its_speed(free: np.ndarray[Any, Any]) -> None:
    track = drive(*prepared(), free)
    assert all(valid for _, _, valid in track)
    assert track[-1][0] > 2.4 and max(abs(y - 1.5) for _, y, _ in track) < 0.1


def test_it_drives_through_no_wall(free: np.ndarray[Any, Any]) -> None:
    wall = free.copy()
    wall[:, 42:44] = 254
    assert max(x for x, _, _ in drive(*prepared(), wall, ticks=120)) < 2.1


def test_where_every_trajectory_collides_there_is_no_command(free: np.ndarray[Any, Any]) -> None:
    p, m = prepared()
    assert not k.optimise(m, PLAN, np.full_like(free, 254), 0.0, 0.0, 0.05, 1.5, 1.5, 0.0, 0.0, 0.0, 0.0, 1, p)[0]


def test_it_starts_again_with_other_noise() -> None:
    _, m = prepared()
    before = m.noise_v.copy()
    m.control[:] = m.history[:] = 0.3
    mppi_critics.start_again(m, np.random.default_rng(2), Mppi()._of(SQUARE, 100.0, 0.05))
    assert not m.control.any() and not m.history.any() and (m.noise_v != before).mean() > 0.99
    assert m.noise_v.std() == pytest.approx(0.2, rel=0.02) and m.noise_w.std() == pytest.approx(0.4, rel=0.02)


def test_speeds_beyond_those_of_vx_and_vy_are_punished() -> None:
    p, m = prepared(10, gamma=0.0)
    m.v[:, :3] = np.array([0.6, 0.72, -0.62], np.float32)
    mppi_critics.score_speeds(m, 0, 3, 0.0, p)
    beyond = [0.0, 0.72 - math.hypot(0.5, 0.5), 0.62 - math.hypot(0.35, 0.5)]
    assert m.costs[:3] == pytest.approx([4.0 * 56 * 0.05 * each for each in beyond], abs=1e-4)


def test_it_cruises_nearly_at_vx_max_as_vy_max_leaves_room_beyond_it(free: np.ndarray[Any, Any]) -> None:
    tracks = {vy_max: drive(*prepared(1000, vy_max=vy_max), free, ticks=45) for vy_max in (0.0, 0.5)}
    speeds = {vy_max: track[-1][0] - track[-21][0] for vy_max, track in tracks.items()}
    assert speeds[0.0] < 0.45 and 0.46 < speeds[0.5] <= 0.5


def test_the_local_path_ends_at_the_border_of_the_costmap(free: np.ndarray[Any, Any]) -> None:
    assert k.local_path(PLAN, free, 0.0, 0.0, 0.05, 2.0, 1.5, 1.5)[-1] == pytest.approx((1.5, 0.0))
    assert k.local_path(PLAN, free[:, :50], 0.0, 0.0, 0.05, 2.0, 1.5, 1.5)[-1] == pytest.approx((0.475, 0.0))


@pytest.mark.parametrize("yaw", [0.0, 0.4, 2.2])
def test_the_outline_is_checked_as_point_by_point(yaw: float) -> None:
    rng = np.random.default_rng(3)
    cells = np.where(rng.random((40, 50)) < 0.01, 254, 100).astype(np.uint8)
    away, points = mppi_critics.clearances(cells), mppi_critics.rim(SQUARE, 0.05)
    lethal = np.argwhere(np.pad(np.where(cells == 254, 1, 0), 1, constant_values=1))
    assert away[7, 9] == min(np.abs(lethal - (7, 9)).max(axis=1))
    found = []
    for x, y in rng.uniform(2.0, 38.0, (300, 2)):
        found.append(mppi_critics.rim_hits(away, points, x, y, yaw))
        assert found[-1] == outline_hits(cells, SQUARE, x, y, yaw, 0.05)
    assert 0 < sum(found) < 300


def test_a_trajectory_is_aligned_with_the_nearest_point_along_the_path() -> None:
    path = np.column_stack([np.cumsum(np.random.default_rng(5).uniform(0.001, 0.06, 40)), np.zeros(40)])
    nearest, middles = mppi_critics.nearest_along(path, 40)
    along = path[:, 0] - path[0, 0]
    for driven in np.linspace(0.0, along[-1] + 0.2, 500):
        near = nearest[min(int(driven / mppi_critics.BIN_M), nearest.size - 1)]
        while driven >= middles[near]:
            near += 1
        assert near == np.argmin(np.abs(along - driven))


def test_critics_are_options_by_their_names() -> None:
    record = StackChoice.of("nav2-mppi", {"PathAlignCritic": {"cost_weight": 0.0}, "batch_size": 500}).record
    assert record.options["PathAlignCritic"]["cost_weight"] == 0.0
    assert record.options["PathAlignCritic"]["offset_from_furthest"] == 20


def test_speeds_drift_towards_the_larger_of_two_unequal_limits_as_in_nav2(free: np.ndarray[Any, Any]) -> None:
    """Issue 5465 of ros-navigation/navigation2; the same limits the other way round speed the robot up."""
    went = [drive(*prepared(ax_max=up, ax_min=-down), free)[-1][0] for up, down in ((0.8, 1.2), (0.8, 0.8), (1.2, 0.8))]
    assert went[0] < 1.5 < went[1] < went[2]


def test_in_open_loop_the_samples_begin_at_the_last_command() -> None:
    closed, opened = (
        simulate_agents(
            empty_room(), route((-2.0, 0.0), (2.0, 0.0)), [], seed=1,
            stack=StackChoice.of("nav2-mppi", {"batch_size": 200, **given}),
        )
        for given in ({}, {"open_loop": True})
    )  # fmt: skip
    assert closed.completed and opened.completed
    assert not np.array_equal(closed.trajectory.x, opened.trajectory.x)
    assert "open_loop" not in closed.options["stack"]["options"]  # type: ignore[index]
