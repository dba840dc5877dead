"""Recorded conversations of a real vision language model: what was read from them then is read from them now."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from rvsg.app.demos import CAMPAIGN, demo_folder, demos, recorded_description
from rvsg.generation.conversation import VlmGenerator
from rvsg.generation.environment import EnvironmentDialogue
from rvsg.generation.facts import human_names
from rvsg.generation.prompts import Prompts
from rvsg.generation.replies import read_configuration
from rvsg.generation.vlm.recording import Recording
from rvsg.generation.vlm.replay import Replayed
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirements import load_requirement
from rvsg.scenario.scenario import Mission
from rvsg.scenario.validity import check
from rvsg.world.load import load_world
from rvsg.world.world import World

GOLDEN = Path(__file__).parent / "recorded_configurations.json"


@pytest.fixture(scope="module")
def warehouse() -> World:
    return load_world("warehouse")


def configurations(name: str, world: World) -> list[dict[str, object]]:
    """What is read from every answer that should hold a configuration, and what the checker says of it."""
    config = yaml.safe_load((demo_folder(name) / CAMPAIGN).read_text())
    mission = Mission(world="warehouse", world_id=world.id, route=world.route(config["route"]))
    read = []
    for call in Recording(demo_folder(name)):
        if call.answer is None or call.purpose not in ("new", "refine", "correct", "P7"):
            continue
        reply = read_configuration(call.answer.text, human_names(2))
        assert reply.people is not None
        found = [*reply.findings, *check(reply.people, mission, world)]
        read.append(
            {
                "place": call.key.split("-")[0] + "-" + call.key.split("-")[1],
                "purpose": call.purpose,
                "paths": [[" ".join(task.path) for task in human.tasks] for human in reply.people.humans],
                "findings": [finding.rule for finding in found],
                "mended": list(reply.mended),
            }
        )
    return read


def test_every_recorded_answer_is_read_as_it_was_when_it_was_recorded(warehouse: World) -> None:
    # To renew after recording: write `now` to the file, and look at the difference.
    now = {name: configurations(name, warehouse) for name in demos()}
    assert now == json.loads(GOLDEN.read_text())


@pytest.mark.parametrize("name", demos())
def test_the_first_configuration_of_a_recorded_campaign_is_proposed_again(name: str, warehouse: World) -> None:
    config = yaml.safe_load((demo_folder(name) / CAMPAIGN).read_text())
    mission = Mission(world="warehouse", world_id=warehouse.id, route=warehouse.route(config["route"]))
    brief = Brief(mission=mission, requirement=load_requirement(config["requirement"]), seed=0)
    generator = VlmGenerator(replay=demo_folder(name), conversation=config["conversation"])
    proposal = generator.propose(brief, warehouse)
    assert proposal.scenario is not None
    assert check(proposal.scenario.people, mission, warehouse) == ()
    assert len(proposal.scenario.description) > 100
    assert all(call.model == "vision-assistant" for call in proposal.calls)


def test_the_shipped_description_is_the_one_the_model_gave(warehouse: World) -> None:
    replayed = Replayed(Recording(recorded_description("warehouse")))
    dialogue = EnvironmentDialogue(warehouse, replayed, Prompts())
    described = dialogue.describe()
    assert warehouse.description is not None
    assert (described.layout, described.grid) == (warehouse.description.layout, warehouse.description.grid)
