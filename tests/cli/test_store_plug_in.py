"""A store of a plug-in keeps a campaign in the place of SQLite."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from tests.cli.commands import Terminal
from tests.cli.json_store import JsonLedger
from tests.cli.test_run import ONE, SMALL, records
from tests.conformance.test_campaign_parts import answered, warehouse

from rvsg.core import plugins
from rvsg.runs.attempt import Attempt
from rvsg.search.strategies import check_ledger
from rvsg.simulation.kinematic import KinematicSimulator

found = plugins._registered


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint(name="json", group="rvsg.stores", value="tests.cli.json_store:JsonLedger")
    monkeypatch.setattr(plugins, "_registered", lambda kind: found(kind) | ({"json": point} if kind == "store" else {}))


def kept(folder: str, ending: str) -> list[str]:
    ledger = JsonLedger(Path(folder) / "ledger.json", ending=ending)
    attempts = list(ledger.attempts(ledger.campaigns()[0]))
    runs = [ledger.run(m.run_id).trajectory.x.tobytes().hex() for a in attempts for m in a.measurements]
    return [attempt.to_json() for attempt in attempts] + runs


def test_the_store_of_the_tests_keeps_the_promises_of_a_ledger(tmp_path: Path) -> None:
    brief, proposal, scenario = answered()
    attempt = Attempt(campaign="exam", index=0, strategy="study", brief=brief, proposal=proposal)
    run = KinematicSimulator().run(scenario, warehouse(), seed=1)
    check_ledger(lambda: JsonLedger(tmp_path / "store"), attempt, run)


def test_another_store_keeps_the_same_campaign_and_is_registered_again(terminal: Terminal) -> None:
    terminal("run", SMALL, "--out one")
    terminal("run", SMALL, "--store json --store-option ending=txt --out two")
    assert kept("two", "txt") == records(Path("one"))
    assert not Path("two/ledger.sqlite").exists()
    Path("two/report.html").unlink()
    terminal("report two")
    assert Path("two/report.html").exists()
    for file in sorted(Path("two/ledger.json").glob("*/0*.txt"))[3:]:
        file.unlink()
    terminal("run --out two")
    assert kept("two", "txt") == records(Path("one"))


def test_the_next_prompt_of_a_campaign_is_of_what_its_store_keeps(terminal: Terminal) -> None:
    terminal("run", SMALL, "--strategy study --store json --out one")
    terminal("scenario prompt one", code=2)
    for file in sorted(Path("one/ledger.json").glob("*/0*.json"))[1:]:
        file.unlink()
    terminal("scenario prompt one")
    assert terminal.out


def test_a_campaign_file_chooses_the_store(terminal: Terminal) -> None:
    Path("c.yaml").write_text("store: json\nstore_options: {ending: text}\nout: here\n")
    terminal("run c.yaml", ONE)
    assert kept("here", "text")


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        ("--store jsn", "unknown-name"),
        ("--store json --store-option endng=x", "unknown-option"),
        ("--store sqlite --store-option fast=1", "unknown-option"),
        ("--store-option create=5", "unknown-option"),
    ],
)
def test_a_store_that_cannot_be_made_is_told_before_anything_is_written(
    terminal: Terminal, asked: str, code: str
) -> None:
    assert terminal.refused("run", SMALL, asked, "--out one").code == code
    assert not Path("one").exists()


def test_a_store_that_fails_when_it_is_made_is_not_taken_for_that_of_the_folder(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: JsonLedger, path: Path, *, ending: str = "json") -> None:
        raise ValueError("the disk of it is away")

    with monkeypatch.context() as broken:
        broken.setattr(JsonLedger, "__init__", refuse)
        assert terminal.refused("run", ONE, "--store json --out one").code == "plug-in-options"
    terminal("run", ONE, "--out one")  # SQLite keeps it now
    assert not Path("one/store.json").exists()
    assert terminal.refused("run --out one --store json").code == "other-store"
