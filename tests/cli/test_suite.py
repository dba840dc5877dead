"""`rvsg suite` and `rvsg suite compare` as they are typed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import rvsg
from rvsg.cli import main
from rvsg.scenario.builder import save_scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Outcome


@pytest.fixture
def scenario_file(tmp_path: Path) -> Path:
    world = rvsg.load_world("warehouse")
    made = rvsg.scenario(world, "route_1", [rvsg.walk("Anna", "E15", "H15")])
    save_scenario(made, tmp_path / "scenario.json")
    return tmp_path / "scenario.json"


def test_a_suite_is_made_run_and_compared(
    scenario_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    suite = str(tmp_path / "suite")
    added = ["suite", "add", str(scenario_file), "--suite", suite, "--requirement", "R3", "--name", "aisle"]
    assert main([*added, "--expect", "pass"]) == 0
    capsys.readouterr()
    junit = tmp_path / "junit.xml"
    assert main(["suite", "run", suite, "--simulator", "kinematic", "--junit", str(junit), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [case["state"] for case in result["cases"]] == ["passed"]
    assert junit.read_text().startswith("<?xml")
    (tmp_path / "a.json").write_text(json.dumps(result))
    (tmp_path / "b.json").write_text(json.dumps(result))
    assert main(["suite", "compare", str(tmp_path / "a.json"), str(tmp_path / "b.json"), "--json"]) == 0
    [pair] = json.loads(capsys.readouterr().out)["pairs"]
    assert [change["change"] for change in pair["changes"]] == ["unchanged"]
    assert main(["suite", "update", suite, str(tmp_path / "a.json")]) == 0


def test_a_suite_whose_stack_failed_in_every_run_is_no_success(
    scenario_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    suite = str(tmp_path / "suite")
    added = ["suite", "add", str(scenario_file), "--suite", suite, "--requirement", "R3", "--name", "aisle"]
    assert main([*added, "--expect", "pass"]) == 0
    run = KinematicSimulator.run
    failed = {"outcome": Outcome.STACK_FAILED, "details": {"stack": {"fault": "the planner is gone"}}}
    monkeypatch.setattr(KinematicSimulator, "run", lambda *given, **seed: replace(run(*given, **seed), **failed))
    junit = tmp_path / "junit.xml"
    assert main(["suite", "run", suite, "--simulator", "kinematic", "--junit", str(junit)]) == 2
    assert "<skipped" in junit.read_text()


def test_a_broken_case_ends_with_exit_code_1(scenario_file: Path, tmp_path: Path) -> None:
    suite = tmp_path / "suite"
    suite.mkdir()
    (suite / "far").mkdir()
    (suite / "far" / "far.yaml").write_text(
        "far:\n  title: Far\n  text: Far away.\n  metric: min_distance\n  worse: smaller\n  limit: 100\n"
    )
    added = ["suite", "add", str(scenario_file), "--suite", str(suite), "--requirement", "far/far.yaml"]
    assert main([*added, "--expect", "pass"]) == 0
    assert main(["suite", "run", str(suite), "--simulator", "kinematic"]) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["suite", "run", "nowhere"],
        ["suite", "run", "empty"],
        ["suite", "add", "nowhere.json", "--suite", "s"],
        ["suite", "compare", "nowhere.json", "nowhere.json"],
        ["suite", "compare", "embedded:profile", "embedded", "--suite", "nowhere"],
    ],
)
def test_bad_input_is_one_message(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rvsg.Suite.create("empty")
    assert main(arguments) == 2
    assert "Traceback" not in capsys.readouterr().err
