from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from tests.campaign.parts import WalkGenerator, plan, warehouse

from rvsg.cli import main
from rvsg.scenario.brief import Brief


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    brief = Brief(mission=plan().mission, requirement=plan().requirement, seed=1)
    made = WalkGenerator().propose(brief, warehouse()).scenario
    assert made is not None
    path = tmp_path / "scenario.json"
    path.write_text(made.to_json(), encoding="utf-8")
    return path


@pytest.mark.exhaustive
def test_a_scenario_and_its_runs_become_strips(scenario: Path, tmp_path: Path) -> None:
    kinematic = ["--simulator", "kinematic"]
    one, two, runs = tmp_path / "one.png", tmp_path / "two.png", tmp_path / "runs.jsonl"
    assert main(["replay", str(scenario), "--out", str(one), "--width", "800", "--seed", "3", *kinematic]) == 0
    assert main(["simulate", str(scenario), "--out", str(runs), "--seed", "3", *kinematic]) == 0
    assert main(["replay", str(runs), "--out", str(two), "--width", "800"]) == 2  # in which world?
    assert main(["replay", str(runs), "--out", str(two), "--width", "800", "--world", "warehouse"]) == 0
    with Image.open(one) as first, Image.open(two) as second:
        assert first.size == second.size


@pytest.mark.slow
def test_a_run_of_a_campaign_is_shown_by_its_id(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, film = tmp_path / "campaign", tmp_path / "film.png"
    small = ["--scenarios", "1", "--refinements", "0", "--repeats", "2", "--confirmations", "2", "--jobs", "1"]
    assert main(["run", "--simulator", "kinematic", "--generator", "random", *small, "--out", str(out)]) == 0
    assert main(["replay", str(out), "--out", str(film), "--run", "run-0"]) == 2
    capsys.readouterr()
    assert main(["replay", str(out), "--out", str(film)]) == 0
    run = capsys.readouterr().err.split("Replay of ")[1].split(",")[0]
    assert main(["replay", str(out), "--out", str(film), "--run", run]) == 0
