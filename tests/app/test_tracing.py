"""Traces of stored runs through the command line."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
from tests.app.parts import crossing
from tests.coded import coded

import rvsg
from rvsg.app.playback import trace_source
from rvsg.cli import main
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.scenario.builder import save_scenario
from rvsg.simulation.embedded.trace import trace_again


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    save_scenario(crossing(pauses_s={"H15": 2.0}), tmp_path / "scenario.json")
    return tmp_path / "scenario.json"


@pytest.mark.parametrize(
    "command",
    [
        "replay {} --trace",  # where to?
        "replay {} --trace --out x.bag",
        "replay {} --trace --out x.json --run run-1",
        "replay nowhere --trace --out x.json",
        "simulate {} --bag x.mcap --repeats 2",
        "simulate {} --bag x.json",
    ],
)
def test_what_cannot_be_traced_is_refused_before_the_work(scenario: Path, command: str) -> None:
    assert main(command.format(scenario).split()) == 2


def test_a_file_of_runs_needs_its_scenario_and_a_simulator_that_records(scenario: Path, tmp_path: Path) -> None:
    runs = tmp_path / "runs.jsonl"
    assert main(["simulate", str(scenario), "--simulator", "kinematic", "--out", str(runs)]) == 0
    with pytest.raises(InputError):
        trace_source(runs)
    with pytest.raises(InputError):
        trace_source(runs, scenario=scenario)
    with pytest.raises(UnknownName):
        trace_source(runs, scenario=scenario, run="run-0")


@pytest.mark.slow
def test_a_stored_run_is_traced_and_one_that_is_not_the_same_is_refused(scenario: Path, tmp_path: Path) -> None:
    runs, file = tmp_path / "runs.jsonl", tmp_path / "made" / "one.trace.json"
    assert main(["simulate", str(scenario), "--seed", "3", "--out", str(runs)]) == 0
    assert main(["replay", str(runs), "--trace", "--scenario", str(scenario), "--out", str(file)]) == 0
    view = json.loads(file.read_text())
    stored = json.loads(runs.read_text())
    assert view["seed"] == 3 and view["scenario"] == stored["scenario_id"]
    assert view["phases"][0] == [0.0, "drive"]
    assert view["nodes"][-1][1:] == ["NavigateThroughPoses", "RUNNING", "SUCCESS"]
    stored["arrays"]["trajectory.x"][5] += 0.001
    runs.write_text(json.dumps(stored) + "\n")
    with pytest.raises(InputError):
        trace_source(runs, scenario=scenario)


@pytest.mark.slow
def test_a_run_of_a_real_system_is_refused(scenario: Path) -> None:
    asked = rvsg.load_scenario(scenario)
    (run,) = rvsg.simulate(asked, 1, simulator="kinematic")
    live = dataclasses.replace(run, simulator="embedded", details={"stack": {"repeatable": False}})
    with pytest.raises(InputError, check=coded("run-not-repeatable")):
        trace_again(live, asked, rvsg.load_world("warehouse"))


def test_a_trace_in_the_folder_of_a_campaign_is_on_its_page(tmp_path: Path) -> None:
    out = tmp_path / "campaign"
    small = ["--scenarios", "1", "--refinements", "0", "--repeats", "2", "--confirmations", "0", "--jobs", "1"]
    assert main(["run", "--generator", "random", "--out", str(out), *small]) == 0
    assert main(["replay", str(out), "--trace"]) == 0
    (file,) = (out / "traces").iterdir()
    assert f'"run":"{file.name.removesuffix(".trace.json")}"' in (out / "report.html").read_text()
    with pytest.raises(UnknownName):
        trace_source(out, run="run-0")
    file.write_text('{"format": "rvsg-trace"}')
    with pytest.raises(FileError):
        rvsg.Campaign.open(out).report()
