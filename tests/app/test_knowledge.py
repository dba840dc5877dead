"""Knowledge across campaigns: learned once, found by place and words, told to generators."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.cli.commands import Terminal

import rvsg
from rvsg.app.campaign import learn_campaign
from rvsg.core.errors import FileError
from rvsg.generation.generator import Generator, Proposal
from rvsg.scenario.brief import Brief
from rvsg.store.knowledge_base import KnowledgeBase, open_knowledge, read_remembered, search, tell
from rvsg.testing import WalkingGenerator
from rvsg.world.world import World


def test_a_mistyped_base_is_not_made_by_reading(terminal: Terminal) -> None:
    for command in ("status", "search aisle"):
        assert terminal.refused("knowledge", command, "--base mistyped.sqlite").code == "no-base"
    assert not Path("mistyped.sqlite").exists()


SMALL = {"strategy": "study", "simulator": "kinematic", "scenarios": 2, "refinements": 0, "repeats": 2}
SMALL |= {"confirmations": 2}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> rvsg.Campaign:
    made = rvsg.Campaign.create(tmp_path_factory.mktemp("c") / "campaign", generator="heuristic", **SMALL)
    list(made.run(jobs=1))
    return made


@pytest.fixture
def base(tmp_path: Path, campaign: rvsg.Campaign) -> KnowledgeBase:
    known = open_knowledge(tmp_path / "new" / "knowledge.sqlite")
    learn_campaign(known, campaign)
    return known


def test_a_campaign_is_learned_once(base: KnowledgeBase, campaign: rvsg.Campaign) -> None:
    attempts = [each for each in campaign.attempts() if each.purpose == "search"]
    entries = base.entries(kind="attempt")
    assert {each.scenario.id for each in entries if each.scenario} == {
        each.proposal.scenario.id for each in attempts if each.proposal.scenario
    }
    assert learn_campaign(base, campaign.folder) == 0
    assert all(each.place == campaign.world.floor_id for each in entries)


def test_a_search_finds_what_is_most_similar(base: KnowledgeBase) -> None:
    wanted = base.entries(kind="attempt")[0].description
    found = search(base, wanted)
    assert found[0].entry.description == wanted
    assert found[0].similarity == pytest.approx(1.0, abs=1e-3)
    closeness = [each.similarity for each in found]
    assert closeness == sorted(closeness, reverse=True)  # type: ignore[type-var]
    assert search(base, wanted) == found  # from the stored embeddings
    assert len(search(base, limit=1)) == 1


class Listening(WalkingGenerator):
    """Notes what it is told."""

    heard: list[Brief]

    def propose(self, brief: Brief, world: World) -> Proposal:
        self.heard.append(brief)
        return super().propose(brief, world)


def test_a_generator_is_told_and_a_resumed_campaign_reads_its_own_copy(base: KnowledgeBase, tmp_path: Path) -> None:
    told = tmp_path / "told.json"
    count = tell(search(base), told)
    assert len(read_remembered(told)) == count >= 2
    generator: Generator = Listening()
    generator.heard = []  # type: ignore[attr-defined]
    made = rvsg.Campaign.create(tmp_path / "c", generator=generator, knowledge=str(told), **SMALL)
    list(made.run(jobs=1))
    new = [brief for brief in generator.heard if brief.kind == "new"]  # type: ignore[attr-defined]
    known = {each.scenario.id for each in read_remembered(told)}
    assert all(known <= {each.scenario.id for each in brief.memory} for brief in new)
    assert len(new[1].memory) == len(new[0].memory) + 1  # what the campaign itself remembers comes besides
    told.write_text("[]")
    again = rvsg.Campaign.open(tmp_path / "c", generator=generator)
    assert again._wired.generator.earlier == read_remembered(tmp_path / "c" / "knowledge.json")


def test_a_file_that_holds_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "told.json").write_text('[{"a": 1}]')
    with pytest.raises(FileError):
        rvsg.Campaign.create(tmp_path / "c", generator="random", knowledge=str(tmp_path / "told.json"), **SMALL)
    assert not (tmp_path / "c").exists()


def test_the_verb(terminal: Terminal, campaign: rvsg.Campaign) -> None:
    base = "--base k.sqlite"
    terminal("knowledge add", campaign.folder, base)
    terminal("knowledge status", base)
    found = terminal.json("knowledge search --kind attempt --limit 1 --out told.json", base)
    assert len(found) == len(read_remembered(Path("told.json"))) == 1
    terminal("knowledge search --kind atempt", base, code=2)
    terminal("knowledge add nowhere", base, code=2)
    terminal("knowledge status --base mysql://x/y", code=2)
