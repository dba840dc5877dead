"""A store of a plug-in keeps a campaign in the place of SQLite."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from tests.cli.commands import rvsg
from tests.cli.json_store import JsonLedger
from tests.cli.test_run import ONE, SMALL, records
from tests.conformance.test_campaign_parts import answered, warehouse

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.strategies import check_ledger
from rvsg.cli import main
from rvsg.core import plugins
from rvsg.core.errors import RvsgError
from rvsg.simulation.kinematic import KinematicSimulator

found = plugins._registered


@pytest.fixture(autouse=True)
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    point = EntryPoint(name="json", group="rvsg.stores", value="tests.cli.json_store:JsonLedger")
    monkeypatch.setattr(plugins, "_registered", lambda kind: found(kind) | ({"json": point} if kind == "store" else {}))


def kept(folder: Path, **options: str) -> list[str]:
    ledger = JsonLedger(folder / "ledger.json", **options)
    attempts = list(ledger.attempts(ledger.campaigns()[0]))
    runs = [ledger.run(m.run_id).trajectory.x.tobytes().hex() for a in attempts for m in a.measurements]
    return [attempt.to_json() for attempt in attempts] + runs


def test_the_store_of_the_tests_keeps_the_promises_of_a_ledger(tmp_path: Path) -> None:
    brief, proposal, scenario = answered()
    attempt = Attempt(campaign="exam", index=0, strategy="study", brief=brief, proposal=proposal)
    run = KinematicSimulator().run(scenario, warehouse(), seed=1)
    check_ledger(lambda: JsonLedger(tmp_path / "store"), attempt, run)


def test_another_store_keeps_the_same_campaign_and_is_registered_again(tmp_path: Path) -> None:
    out = tmp_path / "two"
    rvsg("run", SMALL, "--out", tmp_path / "one")
    rvsg("run", SMALL, "--store json --store-option ending=txt --out", out)
    assert kept(out, ending="txt") == records(tmp_path / "one")
    assert not (out / "ledger.sqlite").exists()
    (out / "report.html").unlink()
    rvsg("report", out)
    assert (out / "report.html").exists()
    for file in sorted((out / "ledger.json").glob("*/0*.txt"))[3:]:
        file.unlink()
    assert main(["run", "--out", str(out)]) == 0
    assert kept(out, ending="txt") == records(tmp_path / "one")


def test_the_next_prompt_of_a_campaign_is_of_what_its_store_keeps(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small, out = [*SMALL, "--strategy", "study", "--store", "json"], tmp_path / "one"
    assert main(["run", *small, "--out", str(out)]) == 0
    assert main(["scenario", "prompt", str(out)]) == 2
    for file in sorted((out / "ledger.json").glob("*/0*.json"))[1:]:
        file.unlink()
    assert main(["scenario", "prompt", str(out)]) == 0
    assert capsys.readouterr().out


def test_a_campaign_file_chooses_the_store(tmp_path: Path) -> None:
    file = tmp_path / "c.yaml"
    file.write_text("store: json\nstore_options: {ending: text}\nscenarios: 1\nout: here\nconfirmations: 0\n")
    assert main(["run", str(file), "--simulator", "kinematic", "--refinements", "0"]) == 0
    assert kept(tmp_path / "here", ending="text")


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
    tmp_path: Path, errors: list[RvsgError], asked: str, code: str
) -> None:
    rvsg("run", SMALL, asked, "--out", tmp_path / "out", code=2)
    assert errors[-1].code == code
    assert not (tmp_path / "out").exists()


def test_a_store_that_fails_when_it_is_made_is_not_taken_for_that_of_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, errors: list[RvsgError]
) -> None:
    def refuse(self: JsonLedger, path: Path, *, ending: str = "json") -> None:
        raise ValueError("the disk of it is away")

    out = tmp_path / "one"
    with monkeypatch.context() as broken:
        broken.setattr(JsonLedger, "__init__", refuse)
        assert main(["run", *ONE, "--store", "json", "--out", str(out)]) == 2
    assert errors[-1].code == "plug-in-options"
    assert main(["run", *ONE, "--out", str(out)]) == 0  # SQLite keeps it now
    assert not (out / "store.json").exists()


def test_a_campaign_stays_in_its_store(tmp_path: Path, errors: list[RvsgError]) -> None:
    out = str(tmp_path / "one")
    main(["run", *ONE, "--out", out])
    assert main(["run", "--out", out, "--store", "json"]) == 2
    assert errors[-1].code == "other-store"
