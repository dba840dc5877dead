"""Comparisons of methods: rows, resuming, contrasts and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from benchmarks.search_methods import (
    Row,
    contrasts,
    read_rows,
    run_comparison,
    split_method,
    table,
    write_figure,
    write_rows,
)

from rvsg.app.settings import CampaignConfig
from rvsg.core.errors import InputError, UnknownName

BASE = CampaignConfig(simulator="kinematic", budget_runs=12, repeats=2, scenarios=3, refinements=1, jobs=1)
METHODS = ("heuristic:study", "random:random")


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    return run_comparison(BASE, METHODS, ["route_1"], ["R1"], [0])


def row(method: str, seed: int, value: float, *, worse: str = "smaller", **more: object) -> Row:
    given = {
        "route": "route_1", "requirement": "R1", "search_mean": None, "violation_probability": None,
        "distinct_failures": 1, "runs": 12, "confirmation_runs": 20, "configurations": 6,
    }  # fmt: skip
    return Row(method=method, seed=seed, confirmed_mean=value, worse=worse, **{**given, **more})  # type: ignore[arg-type]


def test_every_method_gets_the_same_runs_and_is_confirmed_in_fresh_ones(rows: list[Row]) -> None:
    assert [each.method for each in rows] == list(METHODS)
    for each in rows:
        assert each.runs == 12
        assert each.confirmation_runs >= 20
        assert each.confirmed_mean is not None
        assert each.confirmed_mean != each.search_mean
        assert each.curve[-1][0] <= 12
        assert len(each.failures) == each.distinct_failures
        assert each.cells is not None and each.broken_cells is not None
        assert 1 <= each.cells <= each.configurations and 0 <= each.broken_cells <= each.cells
        assert each.sdd is None or 0.0 <= each.sdd <= 1.0


def test_guidance_beats_chance_here(rows: list[Row]) -> None:
    study, chance = rows
    assert study.confirmed_mean is not None
    assert chance.confirmed_mean is not None
    assert study.confirmed_mean < chance.confirmed_mean  # R1: smaller is worse for the robot


def test_rows_that_are_known_are_not_made_again(rows: list[Row], tmp_path: Path) -> None:
    file = tmp_path / "rows.json"
    write_rows(file, rows[:1])
    made: list[Row] = []
    again = run_comparison(BASE, METHODS, ["route_1"], ["R1"], [0], rows=read_rows(file), report=made.append)
    assert made == rows[1:]
    assert again == rows


def test_rows_of_another_budget_are_refused(rows: list[Row]) -> None:
    with pytest.raises(InputError):
        run_comparison(BASE.model_copy(update={"budget_runs": 20}), METHODS, ["route_1"], ["R1"], [0], rows=rows)


@pytest.mark.parametrize(("methods", "route"), [(("heuristic:none",), "route_1"), (("heuristic:study",), "route_99")])
def test_what_does_not_exist_is_refused_before_the_first_run(methods: tuple[str, ...], route: str) -> None:
    made: list[Row] = []
    with pytest.raises((InputError, UnknownName)):
        run_comparison(BASE, ("heuristic:study", *methods), ["route_1", route], ["R1"], [0], report=made.append)
    assert made == []


@pytest.mark.parametrize("text", ["heuristic", ":study", "heuristic:"])
def test_a_method_is_generator_and_strategy(text: str) -> None:
    with pytest.raises(InputError):
        split_method(text)


@pytest.mark.parametrize("text", ["{", "[1]", '[{"method": "a:b"}]'])
def test_a_damaged_file_of_rows_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "rows.json").write_text(text)
    with pytest.raises(InputError):
        read_rows(tmp_path / "rows.json")


@pytest.mark.parametrize(("worse", "a12"), [("smaller", 1.0), ("larger", 0.0)])
def test_a_larger_a12_is_worse_for_the_robot(worse: str, a12: float) -> None:
    made = [row("a:x", s, 1.0 + 0.01 * s, worse=worse) for s in range(4)]
    made += [row("b:y", s, 2.0 + 0.01 * s, worse=worse, distinct_failures=2) for s in range(4)]
    (found,) = contrasts(made, "a:x")
    assert (found.method, found.against, found.value.a12) == ("a:x", "b:y", a12)
    assert found.failures == 0.5


def test_the_table_means_over_seeds_and_the_figure_names_every_method(tmp_path: Path) -> None:
    made = [row("a:x", s, float(s), curve=((1, 2.0), (5, 1.0))) for s in range(3)] + [row("b:y", 0, 4.0)]
    first, second = table(made)
    assert (first["seeds"], first["confirmed"]) == (3, 1.0)
    assert (second["seeds"], second["confirmed"]) == (1, 4.0)
    write_figure(tmp_path / "figure.svg", made)
    picture = (tmp_path / "figure.svg").read_text()
    assert picture.startswith("<svg")
    assert "a:x" in picture and "b:y" in picture
