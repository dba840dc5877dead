"""What a robot can do: measured in a hall, kept with a campaign, and told in few words."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.campaign.parts import warehouse

from rvsg.app.wiring import let_rehearse
from rvsg.generation.conversation import VlmGenerator
from rvsg.generation.generator import Abilities
from rvsg.generation.vlm.model import Scripted
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import load_requirement
from rvsg.scenario.scenario import Mission
from rvsg.search.abilities import abilities_of
from rvsg.simulation.simulators import make_simulator


@pytest.fixture(scope="module")
def mission() -> Mission:
    return Mission.of(warehouse(), warehouse().route("route_1"))


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("campaign") / "abilities.json"


@pytest.fixture(scope="module")
def able(mission: Mission, kept: Path) -> Abilities:
    found = abilities_of(mission, make_simulator("embedded"), kept)
    assert found is not None
    return found


def test_it_drives_through_a_gap_a_little_wider_than_itself_and_no_narrower_one(able: Abilities) -> None:
    assert able.gap_m is not None and able.blocked_m is not None
    assert 0.497 < able.gap_m < able.doorway_m and able.gap_m - able.blocked_m == pytest.approx(0.05)


def test_it_keeps_more_room_beside_who_walks_and_counts_are_of_the_runs_made(able: Abilities) -> None:
    assert able.walker_m is not None and able.stander_m is not None
    assert able.walker_m > able.stander_m > 0.4  # a person's radius and a part of the robot's width
    assert max(able.arriving, able.pushing, able.passing) <= able.blocked and able.touching <= able.met


def test_another_stack_has_abilities_of_its_own(able: Abilities, mission: Mission, kept: Path) -> None:
    other = abilities_of(mission, make_simulator("embedded", "nav2-rpp"), kept.with_name("other.json"))
    assert other is not None and other.setting != able.setting
    assert other.gap_m is not None and able.gap_m is not None and other.gap_m > able.gap_m


def test_the_prompt_tells_what_was_kept_in_sixty_words(able: Abilities, mission: Mission, kept: Path) -> None:
    recoveries = ("clear_costmaps", "spin", "wait", "back_up")
    marked = able.replace(walker_m=7.77, recoveries=recoveries)  # so what is told was not measured again
    kept.write_text(marked.to_json())
    generator = VlmGenerator(Scripted([]))
    let_rehearse(generator, make_simulator("embedded"), warehouse(), seed=1, kept=kept)
    brief = Brief(mission=mission, requirement=load_requirement("R1"), seed=1)
    drive = generator.undisturbed_drive(brief)
    assert drive is not None and drive.abilities == marked
    text = generator.first_prompts(brief, warehouse())[1].text
    (said,) = re.findall(r"Measured in a hall: .*?backs up\.", text)
    assert f"through a {able.gap_m:g} m gap, not {able.blocked_m:g} m; 7.77 m from walkers" in said
    assert f"arrived {able.arriving} of 3, pushing {able.pushing}" in said
    assert len(said.split()) <= 60 and "It may push past somebody" not in text
