"""`rvsg suite` and `rvsg suite compare` as they are typed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from tests.cli.commands import printed, rvsg

from rvsg import Suite, load_world, scenario, walk
from rvsg.scenario.builder import save_scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Outcome

RUN = "--simulator kinematic"


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    """A suite of one case that the robot of the kinematic simulator masters."""
    save_scenario(scenario(load_world("warehouse"), "route_1", [walk("Anna", "E15", "H15")]), tmp_path / "s.json")
    case = "--requirement R3 --name aisle --expect pass"
    rvsg("suite add", tmp_path / "s.json", "--suite", tmp_path / "suite", case)
    return tmp_path / "suite"


def test_a_suite_is_made_run_and_compared(suite: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    junit, first, second = tmp_path / "junit.xml", tmp_path / "a.json", tmp_path / "b.json"
    result = printed(capsys, "suite run", suite, RUN, "--junit", junit)
    assert [case["state"] for case in result["cases"]] == ["passed"]
    assert junit.read_text().startswith("<?xml")
    for file in (first, second):
        file.write_text(json.dumps(result))
    [pair] = printed(capsys, "suite compare", first, second)["pairs"]
    assert [change["change"] for change in pair["changes"]] == ["unchanged"]
    rvsg("suite update", suite, first)


def test_a_suite_whose_stack_failed_in_every_run_is_no_success(
    suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = KinematicSimulator.run
    failed = {"outcome": Outcome.STACK_FAILED, "details": {"stack": {"fault": "the planner is gone"}}}
    monkeypatch.setattr(KinematicSimulator, "run", lambda *given, **seed: replace(run(*given, **seed), **failed))
    rvsg("suite run", suite, RUN, "--junit", tmp_path / "junit.xml", code=2)
    assert "<skipped" in (tmp_path / "junit.xml").read_text()


def test_a_broken_case_ends_with_exit_code_1(suite: Path, tmp_path: Path) -> None:
    (suite / "far").mkdir()
    (suite / "far" / "far.yaml").write_text(
        "far: {title: Far, text: Far away., metric: min_distance, worse: smaller, limit: 100}\n"
    )
    rvsg("suite add", tmp_path / "s.json", "--suite", suite, "--requirement far/far.yaml --expect pass")
    rvsg("suite run", suite, RUN, code=1)


@pytest.mark.parametrize(
    "command",
    [
        "suite run nowhere",
        "suite run empty",
        "suite add nowhere.json --suite s",
        "suite compare nowhere.json nowhere.json",
        "suite compare embedded:profile embedded --suite nowhere",
    ],
)
def test_bad_input_is_one_message(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Suite.create("empty")
    rvsg(command, code=2)
    assert "Traceback" not in capsys.readouterr().err
