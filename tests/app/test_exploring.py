"""A scenario with ranges is run at points of a Latin hypercube."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.app.parts import crossing
from tests.cli.commands import Terminal

import rvsg
from rvsg.core.errors import FileError, InputError
from rvsg.report.comparison_page import response_page, write_exploration
from rvsg.report.terminal import describe_exploration
from rvsg.scenario.builder import load_family, scenario_json
from rvsg.search.exploration import Exploration, explore, shares_of
from rvsg.search.nearest_violation import nearest_violation

FAST = "kinematic"
SPEED: dict[str, Any] = {"vary": ["Anna.speed_m_s=0.8 to 1.4"], "runs": 24, "simulator": FAST}
LIMIT = rvsg.Requirement(name="near", title="Near", text="Near.", metric="min_distance", worse="smaller", limit=1.0)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = crossing().model_dump(mode="json")
    made["people"]["humans"][0]["start_delay_s"] = "0 to 12"
    path = tmp_path_factory.mktemp("family") / "family.json"
    path.write_text(json.dumps(made))
    return path


@pytest.fixture(scope="module")
def found(file: Path) -> Exploration:
    return explore(file, LIMIT, **SPEED)


def test_the_points_are_a_latin_hypercube_of_the_seed(file: Path, found: Exploration) -> None:
    shares = shares_of(found.ranges, found.points)
    for column in shares.T:  # one point in each of the 24 slices of every range
        assert sorted(np.floor(column * 24 + 1e-6).astype(int)) == list(range(24))
    assert len({point.seed for point in found.points}) == 24
    assert explore(file, LIMIT, **SPEED) == found
    assert explore(file, LIMIT, **SPEED, seed=1).points != found.points


def test_the_worst_point_is_a_scenario_that_repeats_its_run(found: Exploration, tmp_path: Path) -> None:
    (tmp_path / "worst.json").write_text(scenario_json(found.worst_scenario))
    worst = min((p for p in found.points if p.objective is not None), key=lambda p: p.objective or 0.0)
    scenario = rvsg.load_scenario(tmp_path / "worst.json")
    (run,) = rvsg.simulate(scenario, [worst.seed], simulator=FAST)
    judged = rvsg.judge([run], LIMIT)
    assert judged.verdict.objectives == (worst.objective,)


def test_runs_that_do_not_arrive_are_said_first(file: Path, tmp_path: Path) -> None:
    made = json.loads(file.read_text())
    made["mission"]["route"]["time_limit_s"] = 1.0
    late = tmp_path / "late.json"
    late.write_text(json.dumps(made))
    found = explore(late, LIMIT, **SPEED)
    assert (found.arrived, found.runs) == (0, 24)
    assert describe_exploration(found).startswith("0 of 24 runs arrive; near is violated in 0 of 24 runs")
    assert ">0 of 24 runs arrive; near" in response_page(found)
    near = nearest_violation(found.scenario, LIMIT, repeats=2, simulator=FAST)
    assert str(near).startswith("0 of 2 runs arrive; ")
    judged = rvsg.judge(rvsg.simulate(found.scenario, 2, simulator=FAST), LIMIT)
    assert judged.verdict.reason.startswith("0 of 2 runs arrive; 0 of 2 runs violate")
    on_time = rvsg.judge(rvsg.simulate(load_family(file)[0].middle, 2, simulator=FAST), LIMIT)
    assert "arrive" not in on_time.verdict.reason


def test_page_picture_and_numbers_are_written(found: Exploration, tmp_path: Path) -> None:
    for ending in ("html", "svg", "json"):
        write_exploration(tmp_path / f"e.{ending}", found)
    assert (tmp_path / "e.svg").read_text().count("<circle") == found.runs
    assert Exploration.from_json((tmp_path / "e.json").read_text()) == found
    assert "Anna.speed_m_s" in (tmp_path / "e.html").read_text()
    with pytest.raises(InputError):
        write_exploration(tmp_path / "e.gif", found)


def test_one_range_is_drawn_as_a_curve_and_few_runs_give_no_surface(file: Path, tmp_path: Path) -> None:
    write_exploration(tmp_path / "e.svg", explore(file, LIMIT, runs=12, simulator=FAST))
    assert "polyline" in (tmp_path / "e.svg").read_text()
    few = explore(file, LIMIT, runs=4, simulator=FAST)
    assert few.surface is None and few.runs == 4


def test_what_cannot_be_explored_is_refused(file: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError):
        explore(file, LIMIT, vary=["Anna.sped=1 to 2"], simulator=FAST)
    with pytest.raises(InputError):
        explore(file, LIMIT.replace(limit=None), simulator=FAST)
    (tmp_path / "list.json").write_text("[1]")
    with pytest.raises(FileError):
        explore(tmp_path / "list.json", LIMIT, simulator=FAST)


def test_the_verb_writes_and_prints(terminal: Terminal, file: Path) -> None:
    wanted = ["scenario", "explore", str(file), "--requirement", "R1", "--runs", "5", "--simulator", FAST]
    assert len(terminal.json(wanted, "--out e.svg --worst w.json")["points"]) == 5
    assert Path("w.json").exists()
    terminal([*wanted, "--vary", "nobody.speed=1 to 2"], code=2)
