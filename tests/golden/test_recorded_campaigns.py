"""Recorded conversations of a real vision language model: what was read from them then is read from them now."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.recordings import CAMPAIGNS, FOLDERS

from rvsg.core.errors import ReplayDiverged
from rvsg.evaluation.signals import aim_of, moved_by
from rvsg.generation.conversation import DRIVE, VlmGenerator
from rvsg.generation.environment import EnvironmentDialogue
from rvsg.generation.facts import human_names
from rvsg.generation.prompts import Prompts
from rvsg.generation.replies import read_configuration
from rvsg.generation.result_facts import configuration_object
from rvsg.generation.vlm.call_log import CallLog, Replayed
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import load_requirement
from rvsg.scenario.rules import read_ends
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.scenario.validity import check
from rvsg.world.world import World
from rvsg.world.world_folder import load_world

GOLDEN = Path(__file__).parent / "recorded_configurations.json"
RECORD_AGAIN = (
    "A prompt or a picture is not what it was when the shipped demonstrations were recorded, so `rvsg demo --strict` "
    "stops. Either undo the change, or record them again with a vision language model: benchmarks/ship_recording.py "
    "says how. Then renew recorded_configurations.json and the numbers of benchmarks/results/models.md. (If only the "
    "digest of a picture differs, compare the versions of Pillow and numpy with constraints.txt first.)"
)


@pytest.fixture(scope="module")
def warehouse() -> World:
    return load_world("warehouse")


def settings_of(name: str) -> dict[str, Any]:
    return dict(yaml.safe_load((FOLDERS[name] / "campaign.yaml").read_text()))


def configurations(name: str, world: World) -> list[dict[str, object]]:
    """What is read from every answer that should hold a configuration, and what the checker says of it."""
    config = settings_of(name)
    mission = Mission(world="warehouse", world_id=world.id, route=world.route(config["route"]))
    read = []
    for call in CallLog(FOLDERS[name]):
        if call.answer is None or call.purpose not in ("new", "refine", "correct", "P7"):
            continue
        reply = read_configuration(call.answer.text, human_names(config.get("humans", 2)))
        assert reply.people is not None
        found = [*reply.findings, *check(read_ends(reply.people, world), mission, world)]
        read.append({
            "place": "-".join(call.key.split("-")[:2]), "purpose": call.purpose, "repaired": reply.repaired_json,
            "paths": [[" ".join(task.path) for task in human.tasks] for human in reply.people.humans],
            "findings": [finding.rule for finding in found],
        })  # fmt: skip
    return read


def test_every_recorded_answer_is_read_as_it_was_when_it_was_recorded(warehouse: World) -> None:
    # To renew after recording: write `now` to the file, and look at the difference.
    now = {name: configurations(name, warehouse) for name in CAMPAIGNS}
    assert now == json.loads(GOLDEN.read_text())


def briefs(name: str, world: World) -> list[Brief]:
    """Every brief of a recorded campaign, with what was measured then: no simulator is needed."""
    config = settings_of(name)
    route = world.route(config["route"])
    requirement = load_requirement(config["requirement"]).for_time_limit(route.time_limit_s)
    recording = CallLog(FOLDERS[name])
    found = []
    for session in dict.fromkeys(call.session for call in recording):
        place = re.fullmatch(r"s(\d+)-c(\d+)-([0-9a-f]{8})", session)
        assert place is not None
        told = {k: v for k, v in (recording.measured(session) or {}).items() if k != DRIVE}
        given = {
            "mission": Mission(world="warehouse", world_id=world.id, route=route), "requirement": requirement,
            "aim": aim_of(requirement), "moved_by": moved_by(requirement),
            "kind": "refine" if told.get("feedback") else "new", "humans": config.get("humans", 2),
            "seed": int(place[3], 16), "scenario_index": int(place[1]), "configuration_index": int(place[2]),
        }  # fmt: skip
        found.append(Brief.model_validate(given | told))
    return found


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_every_recorded_call_is_asked_today_as_it_was_then(name: str, warehouse: World) -> None:
    config = settings_of(name)
    generator = VlmGenerator(replay=FOLDERS[name], strict=True, conversation=config["conversation"])
    before: dict[int, Scenario] = {}
    asked = briefs(name, warehouse)
    assert len(asked) == config["scenarios"] * (1 + config["refinements"])
    for brief in asked:
        try:
            proposal = generator.propose(brief, warehouse)
        except ReplayDiverged as diverged:
            pytest.fail(f"{RECORD_AGAIN}\n\n{diverged}")
        if brief.feedback is not None:
            told = configuration_object(brief.feedback.scenario.people)
            read = configuration_object(before[brief.scenario_index].people)
            assert told == read, "an answer is read or repaired otherwise"
        assert proposal.scenario is not None
        assert check(proposal.scenario.people, brief.mission, warehouse) == ()
        assert len(proposal.scenario.description) > 100
        assert all(call.model == "vision-assistant" for call in proposal.calls)
        before[brief.scenario_index] = proposal.scenario
    assert generator.notes == ()


@pytest.mark.parametrize("name", [name for name in CAMPAIGNS if settings_of(name)["conversation"] == "compact"])
def test_no_recorded_request_is_longer_than_three_thousand_words(name: str) -> None:
    recording = CallLog(FOLDERS[name])
    for call in recording:
        assert sum(len(recording.message(each).text.split()) for each in call.messages) <= 3000, call.key


def test_a_changed_prompt_is_found_by_the_test_above(tmp_path: Path, warehouse: World) -> None:
    (tmp_path / "compact-new.md.j2").write_text("{# declares: memory #}\nSurprise me.\n")
    name = "warehouse-route_1-R1-draws"
    generator = VlmGenerator(replay=FOLDERS[name], strict=True, prompts=tmp_path)
    with pytest.raises(ReplayDiverged):
        generator.propose(briefs(name, warehouse)[0], warehouse)


def test_other_measured_values_are_told_and_change_no_prompt(warehouse: World) -> None:
    refine = next(b for b in briefs("warehouse-route_1-R1", warehouse) if b.feedback)
    assert refine.feedback is not None
    moved = refine.replace(feedback=refine.feedback.replace(mean=refine.feedback.mean + 0.5))
    generator = VlmGenerator(replay=FOLDERS["warehouse-route_1-R1"])
    generator.propose(moved, warehouse)
    assert [note for note in generator.notes if "1 recorded answer was" in note]


def test_the_shipped_description_is_the_one_the_model_gave(warehouse: World) -> None:
    replayed = Replayed(CallLog(FOLDERS["describe-warehouse"]), strict=True)
    dialogue = EnvironmentDialogue(warehouse, replayed, Prompts())
    try:
        described = dialogue.describe()
    except ReplayDiverged as diverged:
        pytest.fail(f"{RECORD_AGAIN}\n\n{diverged}")
    assert warehouse.description is not None
    assert (described.layout, described.grid) == (warehouse.description.layout, warehouse.description.grid)
