"""What pages ask for without a browser: repairs, runs, violations, pairs of campaigns, conversations, notes."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

import rvsg
from rvsg.app.comparison import compare_campaigns
from rvsg.app.settings import CampaignConfig
from rvsg.core.errors import FileError, InputError
from rvsg.evaluation.verdict import load_requirement
from rvsg.suites.suite import Change
from rvsg_studio.answers import _answered, scenario_try
from rvsg_studio.listing import FoundCampaign
from rvsg_studio.model_questions import conversation_of, named_in
from rvsg_studio.pages.new_campaign import estimate
from rvsg_studio.scenario_editor import empty_scenario, scenario_of, simulated, try_out, with_person
from rvsg_studio.workspace import FILE, FindingNote, Workspace, note, notes_of


def test_a_scenario_is_built_repaired_and_tried_as_simulate_does() -> None:
    world = rvsg.load_world("warehouse")
    empty = empty_scenario(world, "route_1")
    requirement = load_requirement("R1", empty.mission.route)
    peopled = with_person(with_person(empty, world, ["G12", "G16"]), world, ["F12", "F18"])
    assert [human.name for human in peopled.people.humans] == ["Human 1", "Human 2"]
    value = peopled.model_dump(mode="json")
    value["people"]["humans"][0]["tasks"][0]["path"] = ["G12", "G16"]  # not neighbours: the path is joined
    value["people"]["humans"][0]["tasks"][0]["name"] = "G12 → G16"
    tried = try_out(scenario_of(value), world, requirement, seeds=range(3), simulator="kinematic")
    assert tried.problems == () and tried.repairs
    assert len(tried.scenario.people.humans[0].tasks[0].path) > 2
    runs = rvsg.simulate(tried.scenario, 3, simulator="kinematic")
    judged = rvsg.judge(runs, requirement)
    assert tried.objectives == tuple(m.objective for m in judged.measurements)
    assert tried.violations == judged.verdict.violations == sum(tried.violated)
    assert set(tried.people) == {"Human 1", "Human 2"} and len(tried.robot) > 5


@pytest.mark.timeout(120)
def test_the_runs_of_a_replay_are_simulated_one_request_at_a_time() -> None:
    world = rvsg.load_world("warehouse")
    runs = simulated(empty_scenario(world, "route_1"), world, range(2), "kinematic")
    assert len(runs.runs) == 2


@pytest.mark.parametrize("asked", [{"stops": 5}, {"world": "x" * 5000}, {"campaign": "x" * 5000, "attempt": 1}])
def test_a_request_that_makes_no_sense_gets_one_message(tmp_path: Path, asked: dict[str, Any]) -> None:
    world = rvsg.load_world("warehouse")
    scenario = empty_scenario(world, "route_1").model_dump(mode="json")
    given = json.dumps({"scenario": scenario, "seeds": 1} | asked).encode()
    answer = asyncio.run(_answered(Workspace(tmp_path), scenario_try, given))
    assert answer.status_code == 400 and b"error" in answer.body


def test_what_cannot_be_simulated_says_why() -> None:
    world = rvsg.load_world("warehouse")
    empty = empty_scenario(world, "route_1")
    with pytest.raises(InputError):
        with_person(empty, world, ["G12"])
    value = with_person(empty, world, ["G12", "G16"]).model_dump(mode="json")
    value["people"]["humans"][0]["speed_m_s"] = 99
    with pytest.raises(InputError) as error:
        scenario_of(value)
    assert "speed_m_s" in str(error.value)


def test_two_campaigns_are_paired_by_what_their_people_do(tmp_path: Path) -> None:
    settings = {"strategy": "study", "scenarios": 2, "refinements": 0, "repeats": 3, "confirmations": 0, "jobs": 1}
    settings |= {"simulator": "kinematic"}
    made = []
    for name, seed in (("a", 0), ("b", 0), ("c", 5)):
        campaign = rvsg.Campaign.create(tmp_path / name, seed=seed, **settings)
        list(campaign.run())
        made.append(campaign)
    found = compare_campaigns(made[0], made[1])
    assert [[case.attempt for case in variant.cases] for variant in found.variants] == [[0, 1], [0, 1]]
    assert {each.change for each in found.changes} == {Change.UNCHANGED}
    assert [case.verdict for case in found.variants[0].cases] == [case.verdict for case in found.variants[1].cases]
    assert compare_campaigns(made[0], made[2]).changes == ()
    shown = conversation_of(made[0], lambda digest: digest, lambda attempt: f"/finding?attempt={attempt}")
    scenario = made[0].attempts()[0].proposal.scenario
    assert scenario is not None
    assert shown.count("/finding?attempt=") == 2 and shown.count('class="thought"') == 2
    assert scenario.description[:20] in shown


def test_an_estimate_takes_calls_from_earlier_campaigns() -> None:
    config = CampaignConfig(simulator="kinematic", scenarios=4, refinements=1, repeats=3, confirmations=6, jobs=1)
    free = estimate(config)
    assert (free.runs, free.proposals, free.usd, free.calls_of) == (30, 8, 0.0, "")
    assert free.least == pytest.approx(24 * free.run_s / 60)
    assert free.minutes == pytest.approx((30 + config.shrink_runs) * free.run_s / 60)
    assert FoundCampaign(folder="x", calls=4, calls_s=40.0, model="m", cost_usd=0.2).calls_s == 40.0


def test_names_of_areas_are_found_in_a_text_and_unknown_ones_marked() -> None:
    world = rvsg.load_world("warehouse")
    pieces = named_in("Between Shelf 1 and Shelf 99 lies area 3.", world)
    assert "".join(piece for piece, _ in pieces) == "Between Shelf 1 and Shelf 99 lies area 3."
    assert ("Shelf 1", "known") in pieces and ("Shelf 99", "unknown") in pieces and ("area 3", "known") in pieces


def test_a_note_is_kept_and_changed_in_part(tmp_path: Path) -> None:
    assert notes_of(tmp_path).findings == {}
    note(tmp_path, "scenario-1", status="known", comment='<b>"quoted": [x]\nsecond line')
    note(tmp_path, "scenario-2", status="fixed")
    note(tmp_path, "scenario-1", status="accepted")
    assert notes_of(tmp_path).findings == {
        "scenario-1": FindingNote(status="accepted", comment='<b>"quoted": [x]\nsecond line'),
        "scenario-2": FindingNote(status="fixed"),
    }


def test_a_mistake_in_the_file_is_told_with_its_line_and_the_file_stays(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text("findings:\n  scenario-1:\n    status: nwe\n")
    with pytest.raises(FileError) as error:
        note(tmp_path, "scenario-2", comment="x")
    assert (error.value.path, error.value.line) == (tmp_path / FILE, 3)
    assert "nwe" in (tmp_path / FILE).read_text()
