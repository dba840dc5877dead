"""The fidelity benchmark reads the published runs as documented and gives the same whatever the number of jobs."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from tests.published_data import published_data

from rvsg.world.world_folder import load_world

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import fidelity
from fidelity import ceiling, part_a, rank_p, spearman, spread_within_routes
from fidelity_runs import route_of, session_of, simulate, simulate_all
from published_runs import Configuration, LeftOut, clock_ratios, repeated, routes_in, singles
from published_world import as_seen


@pytest.fixture(scope="module")
def folder() -> Path:
    data = published_data()
    if data is None:
        pytest.skip("the published data is not here")
    return data / "published"


def configuration(key: str, values: list[float], route: str = "route_1") -> Configuration:
    return Configuration(
        key=key,
        method="distance",
        route=route,
        agents=(),
        runs=tuple({"dto": value} for value in values),
        completed=(True,) * len(values),
    )


def test_a_perfect_simulator_scores_perfectly() -> None:
    rng = np.random.default_rng(1)
    scenarios = [
        configuration(f"{route}/{i}", list(i + rng.normal(0, 0.1, 29)), route)
        for route in ("route_1", "route_2")
        for i in range(6)
    ]
    results = {c.key: list(c.runs) for c in scenarios}
    figures = part_a(scenarios, results, "dto", spread_within_routes(scenarios, "dto"))
    assert figures["spearman"] == pytest.approx(1.0)
    assert figures["bias_sd"] == pytest.approx(0.0)
    assert figures["sd_ratio"] == pytest.approx(1.0)
    assert figures["a12_distance"] == pytest.approx(0.0)
    assert figures["ks_share"] == 0.0


def test_a_simulator_that_turns_the_order_round_scores_the_opposite() -> None:
    scenarios = [configuration(f"s{i}", [float(i), i + 0.1]) for i in range(6)]
    results = {c.key: [{"dto": -run["dto"]} for run in c.runs] for c in scenarios}
    assert part_a(scenarios, results, "dto", 1.0)["spearman"] == pytest.approx(-1.0)


def test_a_correlation_without_spread_is_none() -> None:
    assert spearman([1, 1, 1], [1, 2, 3]) is None
    assert spearman([1, 2], [1, 2]) is None


def test_the_ceiling_falls_where_means_are_hidden_in_noise() -> None:
    rng = np.random.default_rng(2)

    def scenarios(noise: float) -> list[Configuration]:
        return [configuration(f"s{i}", list(i + rng.normal(0, noise, 29))) for i in range(6)]

    clear, hidden = ceiling(scenarios(0.1), "dto"), ceiling(scenarios(20.0), "dto")
    assert clear == pytest.approx(1.0)
    assert hidden is not None
    assert hidden < 0.85


def test_ranks_are_uniform_only_where_both_sides_draw_alike() -> None:
    rng = np.random.default_rng(3)
    singles_ = [configuration(f"s{i}", [rng.normal()]) for i in range(300)]
    alike = {c.key: [{"dto": rng.normal()} for _ in range(4)] for c in singles_}
    shifted = {c.key: [{"dto": rng.normal() + 0.5} for _ in range(4)] for c in singles_}
    constant = {c.key: [{"dto": c.runs[0]["dto"]}] * 4 for c in singles_}
    fair, unfair = rank_p(singles_, alike, "dto"), rank_p(singles_, shifted, "dto")
    assert fair is not None
    assert unfair is not None
    assert fair > 0.01
    assert unfair < 1e-4
    assert rank_p(singles_, constant, "dto") == pytest.approx(1.0)


def test_a_run_takes_the_clock_of_its_session() -> None:
    plain = configuration("a", [1.0])
    assert session_of(plain, 0) == {}
    again = replace(plain, clocks=(0.97, 0.99), repeated=True)
    drawn = [session_of(again, index) for index in range(40)]
    assert {options["clock_ratio"] for options in drawn} == {0.97, 0.99}
    assert all(options["human_early_start"] < 0.05 for options in drawn)
    assert [session_of(again, index, seed=1) for index in range(40)] != drawn


def test_the_clock_is_read_off_straight_driving(tmp_path: Path) -> None:
    header = "timestamp,robot_x,robot_y,robot_speed,robot_angular_velocity_z"
    rows = [f"{0.5 * k},{0.5 * 0.5 * 0.98 * k},0.0,0.5,0.0" for k in range(9)]
    turning = [f"{0.5 * k},{0.1 * k},0.0,0.5,0.5" for k in range(9)]
    for name, lines in (("log_0", rows), ("log_1", turning), ("log_2", rows[:3])):
        (tmp_path / f"{name}.csv").write_text("\n".join([header, *lines]) + "\n")
    assert clock_ratios(tmp_path) == pytest.approx((0.98,))
    assert clock_ratios(tmp_path, 1) == ()


def test_the_published_runs_are_all_there(folder: Path) -> None:
    grid = load_world("warehouse").grid
    routes = routes_in(folder)
    single = list(singles(folder, routes, grid))
    again = [entry for entry in repeated(folder, routes, grid) if isinstance(entry, Configuration)]
    assert len(single) == 170 * len(routes)
    assert len(again) == 6 * len(routes)
    assert {len(entry.runs) for entry in again} == {29}
    left_out = {entry.key for entry in single if isinstance(entry, LeftOut)}
    assert {"distance/route_3/7/0", "distance/route_3/7/2", "reach/route_3/3/4"} <= left_out


def test_the_robot_rests_where_the_logs_show_it(folder: Path) -> None:
    start = route_of(folder, "route_1").start
    assert (start.x, start.y) == pytest.approx((-0.099258, -0.349499), abs=1e-5)


@pytest.mark.exhaustive
def test_the_results_do_not_depend_on_the_number_of_jobs(folder: Path) -> None:
    grid = load_world("warehouse").grid
    some = [c for c in singles(folder, ["route_1"], grid) if isinstance(c, Configuration)][:2]
    alone = {c.key: simulate(folder, c, range(2)) for c in some}
    assert simulate_all(folder, some, 2, 2) == alone
    assert simulate_all(folder, some, 2, 1) == alone


def test_the_racks_that_the_lidars_saw_stand_where_the_panels_of_the_collision_meshes_stand() -> None:
    racks = [thing for thing in load_world("warehouse").objects if thing.kind.startswith("Shelf")]
    assert len(racks) == 7
    for rack in racks:
        panels = shapely.MultiPolygon([shapely.Polygon(panel) for panel in rack.slices])
        posts = [shapely.Polygon(post) for post in as_seen(rack)]
        assert len(posts) > len(rack.slices)
        assert all(panels.buffer(0.02).covers(post) for post in posts)
        assert sum(post.area for post in posts) < 0.3 * panels.area


def test_the_quick_form_fails_where_a_figure_falls_clearly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    metrics = ("dto", "por", "trg", "rpc", "chc", "pl")

    def result(level: float) -> dict[str, object]:
        return {
            "routes": ["route_1"],
            "part_a": {m: {"spearman_route_centred": level} for m in metrics},
            "part_b": {m: {"spearman": level} for m in metrics},
        }

    monkeypatch.setattr(fidelity, "ACCEPTED", tmp_path / "accepted.json")
    assert fidelity.judge_quick(result(0.8), accept=False) == 0
    assert fidelity.judge_quick(result(0.8), accept=True) == 0
    assert fidelity.judge_quick(result(0.75), accept=False) == 0
    assert fidelity.judge_quick(result(0.6), accept=False) == 1
