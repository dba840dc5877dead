"""Traces of stored runs through the command line."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest
from tests.app.parts import crossing
from tests.cli.commands import Terminal
from tests.coded import coded

import rvsg
from rvsg.app.playback import trace_source
from rvsg.core.errors import FileError, InputError, UnknownName
from rvsg.scenario.builder import save_scenario
from rvsg.simulation.embedded.trace import trace_again


@pytest.fixture
def scenario(terminal: Terminal) -> Path:
    """A scenario in `s.json`."""
    save_scenario(crossing(pauses_s={"H15": 2.0}), Path("s.json"))
    return Path("s.json")


@pytest.mark.usefixtures("scenario")
@pytest.mark.parametrize(
    "command",
    [
        "replay s.json --trace",  # where to?
        "replay s.json --trace --out x.bag",
        "replay s.json --trace --out x.json --run run-1",
        "replay nowhere --trace --out x.json",
        "simulate s.json --bag x.mcap --repeats 2",
        "simulate s.json --bag x.json",
    ],
)
def test_what_cannot_be_traced_is_refused_before_the_work(terminal: Terminal, command: str) -> None:
    terminal(command, code=2)


def test_a_file_of_runs_needs_its_scenario_and_a_simulator_that_records(terminal: Terminal, scenario: Path) -> None:
    terminal("simulate s.json --simulator kinematic --out runs.jsonl")
    for known in (None, scenario):
        with pytest.raises(InputError):
            trace_source(Path("runs.jsonl"), scenario=known)
    with pytest.raises(UnknownName):
        trace_source(Path("runs.jsonl"), scenario=scenario, run="run-0")


@pytest.mark.slow
def test_a_stored_run_is_traced_and_one_that_is_not_the_same_is_refused(terminal: Terminal, scenario: Path) -> None:
    runs = Path("runs.jsonl")
    terminal("simulate s.json --seed 3 --out runs.jsonl")
    terminal("replay runs.jsonl --trace --scenario s.json --out made/one.trace.json")
    view, stored = json.loads(Path("made/one.trace.json").read_text()), json.loads(runs.read_text())
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


def test_a_trace_in_the_folder_of_a_campaign_is_on_its_page(terminal: Terminal) -> None:
    small = "--scenarios 1 --refinements 0 --repeats 2 --confirmations 0 --jobs 1"
    terminal("run --generator random --out c", small)
    terminal("replay c --trace")
    (file,) = Path("c/traces").iterdir()
    assert f'"run":"{file.name.removesuffix(".trace.json")}"' in Path("c/report.html").read_text()
    with pytest.raises(UnknownName):
        trace_source(Path("c"), run="run-0")
    file.write_text('{"format": "rvsg-trace"}')
    with pytest.raises(FileError):
        rvsg.Campaign.open("c").report()
