"""`rvsg suite` and `rvsg suite compare` as they are typed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from tests.cli.commands import Terminal

from rvsg import Campaign, Suite, load_world, scenario, walk
from rvsg.scenario.builder import save_scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Outcome

RUN = "--simulator kinematic"


@pytest.fixture(autouse=True)
def suite(terminal: Terminal) -> None:
    """A suite of one case, which the robot of the kinematic simulator masters."""
    save_scenario(scenario(load_world("warehouse"), "route_1", [walk("Anna", "E15", "H15")]), Path("s.json"))
    terminal("suite add s.json --suite suite --requirement R3 --name aisle --expect pass")


def test_a_suite_is_made_run_and_compared(terminal: Terminal) -> None:
    result = terminal.json("suite run suite", RUN, "--junit junit.xml")
    assert [case["state"] for case in result["cases"]] == ["passed"]
    assert "aisle, R3 (tiago_omni): " in terminal.err and "(robot-" in result["cases"][0]["robot"]
    assert Path("junit.xml").read_text().startswith("<?xml")
    for file in ("a.json", "b.json"):
        Path(file).write_text(json.dumps(result))
    [pair] = terminal.json("suite compare a.json b.json")["pairs"]
    assert [change["change"] for change in pair["changes"]] == ["unchanged"]
    terminal("suite update suite a.json")


def test_a_suite_whose_stack_failed_in_every_run_is_no_success(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = KinematicSimulator.run
    failed = {"outcome": Outcome.STACK_FAILED, "details": {"stack": {"fault": "the planner is gone"}}}
    monkeypatch.setattr(KinematicSimulator, "run", lambda *given, **seed: replace(run(*given, **seed), **failed))
    terminal("suite run suite", RUN, "--junit junit.xml", code=2)
    assert "<skipped" in Path("junit.xml").read_text()


def test_a_broken_case_ends_with_exit_code_1(terminal: Terminal) -> None:
    Path("suite/far").mkdir()
    Path("suite/far/far.yaml").write_text(
        "far: {title: Far, text: Far away., metric: min_distance, worse: smaller, limit: 100}\n"
    )
    terminal("suite add s.json --suite suite --requirement far/far.yaml --expect pass")
    terminal("suite run suite", RUN, code=1)


def test_the_confirmed_failures_of_a_campaign_are_kept_as_they_were_found(terminal: Terminal) -> None:
    settings = {
        "scenarios": 2,
        "refinements": 1,
        "repeats": 3,
        "confirmations": 12,
        "simulator": "kinematic",
        "jobs": 1,
    }
    campaign = Campaign.create(Path("found"), requirement="R3", **settings)
    list(campaign.run())
    failures = campaign.answer.failures
    assert failures
    for _ in range(2):
        assert f"holds {len(failures)} case" in terminal("suite add found --suite kept")
    kept = Suite.open("kept").cases
    assert {each.title for each in kept} == {each.name for each in failures}
    assert {each.expectations[0].requirement for each in kept} <= {"R3", "any_contact"}
    assert "Leave --name, --simulator-option out" in terminal(
        "suite add found --suite kept --name one --simulator-option a=1", code=2
    )


def test_a_group_of_commands_alone_shows_its_help(terminal: Terminal) -> None:
    for group in ("suite", "knowledge"):
        terminal(group, code=2)
        assert "Usage" in terminal.out + terminal.err and "Missing command" not in terminal.err


def test_an_update_without_a_change_says_so(terminal: Terminal) -> None:
    Path("a.json").write_text(json.dumps(terminal.json("suite run suite", RUN)))
    assert "stays as it is" in terminal("suite update suite a.json")


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
def test_bad_input_is_one_message(terminal: Terminal, command: str) -> None:
    Suite.create("empty")
    terminal(command, code=2)
