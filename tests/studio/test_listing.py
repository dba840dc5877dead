"""What lies in a folder of work, and that nothing is read twice."""

from __future__ import annotations

import json
import os
import shutil
import threading
from pathlib import Path

import pytest

import rvsg
from rvsg_studio import listing
from rvsg_studio.listing import Lister


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("listing")
    campaign = rvsg.Campaign.create(
        folder / "runs" / "a", scenarios=1, refinements=0, repeats=2, confirmations=2, simulator="kinematic", jobs=1
    )
    list(campaign.run())
    return folder


@pytest.fixture
def folder(kept: Path, tmp_path: Path) -> Path:
    shutil.copytree(kept, tmp_path / "work")
    return tmp_path / "work"


def test_a_campaign_is_summed_up_as_its_own_summary_says(folder: Path) -> None:
    found = Lister(folder).listing()
    opened = rvsg.Campaign.open(folder / "runs" / "a")
    with opened.result() as result:
        answer = result.answer
    assert [each.folder for each in found.campaigns] == ["runs/a"]
    campaign = found.campaigns[0]
    assert campaign.attempts == result.accounting.search_attempts
    assert campaign.complete == result.complete
    assert (campaign.status, campaign.headline) == (answer.status, answer.headline)
    assert tuple(each.row for each in campaign.failures) == answer.failures


def test_nothing_is_read_again_until_it_changes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = folder / ".index" / "index.json"
    before = Lister(folder, cache).listing()
    read: list[str] = []
    real = listing._read
    monkeypatch.setattr(listing, "_read", lambda path, place: read.append(place) or real(path, place))
    assert Lister(folder, cache).listing() == before and read == []
    shutil.copytree(folder / "runs" / "a", folder / "runs" / "b")
    again = Lister(folder, cache).listing()
    assert read == ["runs/b"] and len(again.campaigns) == 2
    shutil.rmtree(folder / "runs" / "a")
    assert [each.folder for each in Lister(folder, cache).listing().campaigns] == ["runs/b"]
    assert list(json.loads(cache.read_text())["stores"]) == ["runs/b"]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": 3, "stores": {"a": 3}}', '{"format": 99, "stores": {}}'])
def test_a_damaged_index_is_made_anew(folder: Path, text: str) -> None:
    cache = folder / "index.json"
    cache.write_text(text)
    assert len(Lister(folder, cache).listing().campaigns) == 1


def test_what_the_studio_adds_to_the_folder_of_a_campaign_is_listed(folder: Path) -> None:
    top = folder / "runs" / "a"
    shutil.copytree(top, top / "received" / "sent")
    (top / "received" / "results.json").write_text('{"suite": "x"}')
    (top / "inputs" / "world").mkdir(parents=True)
    (top / "inputs" / "world" / "world.yaml").write_text("name: x\n")
    found = Lister(top).listing()
    assert {each.folder: each.shown for each in found.campaigns} == {
        ".": "this folder",
        "received/sent": "received/sent",
    }
    assert found.worlds == () and listing.suite_results_in(top) == ("received/results.json",)


def test_a_damaged_ledger_is_listed_with_its_problem(folder: Path) -> None:
    (folder / "runs" / "bad").mkdir()
    (folder / "runs" / "bad" / "ledger.sqlite").write_bytes(b"no database at all")
    found = {each.folder: each for each in Lister(folder).listing().campaigns}
    assert found["runs/bad"].problem and not found["runs/a"].problem


def test_worlds_and_suites_are_found_and_hidden_folders_are_not(folder: Path) -> None:
    for name in ("world", ".hidden"):
        (folder / name).mkdir()
        (folder / name / "world.yaml").write_text("name: x\n")
    rvsg.Suite.create(folder / "suite")
    found = Lister(folder).listing()
    assert (found.worlds, found.suites) == (("world",), ("suite",))


def test_campaigns_are_listed_before_they_are_read_and_read_in_the_background(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(folder / "runs" / "a", folder / "runs" / "b")
    may_read = threading.Event()
    real = listing._read
    read: list[str] = []

    def reading(path: Path, place: str) -> tuple[listing.FoundCampaign, ...]:
        assert may_read.wait(60)
        read.append(place)
        return real(path, place)

    monkeypatch.setattr(listing, "_read", reading)
    lister = Lister(folder)
    first = lister.listing(wait=False)
    assert sorted(each.folder for each in first.campaigns) == ["runs/a", "runs/b"]
    assert first.unread == 2 and lister.listing(wait=False).unread == 2
    may_read.set()
    whole = lister.listing()
    assert whole.unread == 0 and whole == Lister(folder).listing()
    assert sorted(read[:2]) == ["runs/a", "runs/b"]  # each once, however often it was asked for
    ledger = folder / "runs" / "a" / "ledger.sqlite"
    os.utime(ledger, ns=(1, 1))
    old = lister.listing(wait=False)
    assert [(each.folder, each.unread) for each in old.campaigns if each.unread] == [("runs/a", True)]
    assert {each.attempts for each in old.campaigns} == {each.attempts for each in whole.campaigns}
    assert lister.listing().unread == 0
