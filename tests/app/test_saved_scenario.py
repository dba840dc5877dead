"""A finding becomes a run again with what it was found with, at every verb; every command that pages print runs."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from tests.app.parts import RPP, crossing
from tests.app.test_moved_objects import PALLET
from tests.campaign.parts import WalkGenerator
from tests.cli.commands import Terminal

import rvsg
from rvsg.app.commands import next_commands, runs_command, shrink_command
from rvsg.app.playback import shot_of, trace_source
from rvsg.generation.generator import Proposal
from rvsg.scenario.brief import Brief
from rvsg.scenario.builder import load_saved, save_scenario

OWN = "far: {title: Far, text: The robot stays far away., metric: min_distance, worse: smaller, limit: 100, unit: m}\n"
SMALL = "--scenarios 1 --refinements 0 --repeats 2 --confirmations 4 --shrink-runs 0 --jobs 1"


@pytest.fixture
def campaign(terminal: Terminal) -> rvsg.Campaign:
    """A small campaign with an own parameter file, an own requirement, a shipped robot that is not the default."""
    Path("nav2_params.yaml").write_text(RPP)
    Path("own.yaml").write_text(OWN)
    what = "--stack nav2_params.yaml --requirement own.yaml#far --robot turtlebot3_waffle"
    terminal("run --generator random --humans 1 --out c", what, SMALL)
    return rvsg.Campaign.open("c")


def test_every_verb_runs_a_finding_with_what_it_was_found_with(campaign: rvsg.Campaign, terminal: Terminal) -> None:
    _, _, found = load_saved("c/best_scenario.json")
    assert found == campaign.found_with and found.stack_file == str(Path("nav2_params.yaml").absolute())
    Path("nav2_params.yaml").write_text(RPP.replace("0.31", "0.1"))
    stored = {run.id: run for run in campaign.runs()}
    seed = next(iter(stored.values())).seed
    verbs = {
        f"simulate c/best_scenario.json --seed {seed} --out runs.jsonl": "",
        "scenario shrink c/best_scenario.json --repeats 1 --confirmations 1 --out small.json": "far",
        "scenario nearest c/best_scenario.json --repeats 1": "far",
        "scenario explore c/best_scenario.json --vary 'start_delay_s=0 to 1' --runs 1 --worst worst.json": "far",
        f"replay c/best_scenario.json --trace --seed {seed} --out one.trace.json": "",
        f"export c/best_scenario.json --to csv --seed {seed} --out runs.csv": "",
        "suite add c/best_scenario.json --suite suite --name mine": "",
        "suite run suite --runs 1": "",
    }
    name = campaign.attempts()[0].proposal.scenario.people.humans[0].name  # type: ignore[union-attr]
    for command, judged in verbs.items():
        said = terminal(shlex.split(command.replace("start_delay_s", f"{name}.start_delay_s")))
        if "suite add" not in command:
            assert "nav2-rpp" in said and judged in said, command
    again = rvsg.load_runs("runs.jsonl")[0]
    assert again.trajectory.x.tolist() == stored[again.id].trajectory.x.tolist()
    assert load_saved("small.json")[2] == load_saved("worst.json")[2] == found
    [case] = rvsg.Suite.open("suite").cases
    assert case.expectations[0].definition == found.requirement and case.simulator == found.simulator
    said = terminal("simulate c/best_scenario.json --stack nav2-dwb --robot tiago_omni --out other.jsonl")
    assert "tiago_omni with nav2-dwb" in said and "found with nav2-rpp" in said
    assert "To test the file: --stack nav2_params.yaml" in terminal("suite run suite --runs 1")
    assert "\nnav2_params.yaml, nav2-rpp" in terminal("suite run suite --runs 1 --stack nav2_params.yaml")


def test_every_command_that_a_campaign_prints_runs(campaign: rvsg.Campaign, terminal: Terminal) -> None:
    row, answer = campaign.answer.rows[0], campaign.answer
    with campaign.result() as result:
        printed = next_commands(campaign.config, result)
    assert {step.command.split(" --run")[0] for step in answer.next} <= {*printed.values()}
    printed |= {"planner": f"{printed['planner']} --run {row.run}"}
    made = {"scenario": "c/best_scenario.json", "config": campaign.config}
    printed |= {
        "runs": runs_command(**made, seed=0, repeats=1, out="r.jsonl"),
        "again": campaign.command + " --out again",
    }
    printed |= {"shrink": shrink_command(**made, out="s.json") + " --repeats 1 --confirmations 1"}
    del printed["confirm"], printed["more"]  # nothing is left to confirm; more runs are the same command with a number
    for what, command in printed.items():
        words = shlex.split(command)
        terminal(words[1:], ["--out", what] if what in ("contact", "repeat") else [])
    assert rvsg.Suite.open("suite").cases[0].stack_file == "../nav2_params.yaml"


class LeavesAPallet(WalkGenerator):
    """Moves an object into the robot's map with every scenario."""

    def propose(self, brief: Brief, world: rvsg.World) -> Proposal:
        made = super().propose(brief, world)
        assert made.scenario is not None
        pallet = rvsg.scenario(world, "route_1", moved=Path("pallet.yaml")).mission.moved
        mission = made.scenario.mission.replace(moved=pallet)
        return made.replace(scenario=made.scenario.replace(mission=mission))


@pytest.mark.usefixtures("terminal")
def test_a_scenario_with_a_moved_object_is_traced_and_filmed_where_it_took_place() -> None:
    Path("pallet.yaml").write_text(PALLET % (3.0, 3.0))
    campaign = rvsg.Campaign.create(
        "c", generator=LeavesAPallet(), scenarios=1, refinements=0, repeats=1, confirmations=0, strategy="study"
    )
    list(campaign.run(jobs=1))
    campaign.report()
    assert trace_source(Path("c")).world.moved == shot_of(Path("c")).world.moved != ()


def test_a_requirement_of_the_current_folder_is_kept_by_content(terminal: Terminal) -> None:
    save_scenario(crossing(), "s.json")
    Path("own.yaml").write_text(OWN)
    terminal("suite add s.json --suite deep/suite --requirement own.yaml#far")
    [expectation] = rvsg.Suite.open("deep/suite").cases[0].expectations
    assert expectation.requirement == "../../own.yaml#far"
    Path("own.yaml").unlink()
    assert rvsg.Suite.open("deep/suite").run(simulator="kinematic", runs=1).cases[0].verdict.violations == 1
