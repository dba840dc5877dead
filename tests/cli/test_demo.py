from __future__ import annotations

import lzma
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.cli.commands import Terminal
from tests.recordings import CAMPAIGNS, FOLDERS

import rvsg
from rvsg.app.settings import read_campaign_file
from rvsg.cli import main
from rvsg.cli.demo import STORED, recording_folder, shipped_recordings, what_it_means
from rvsg.evaluation.verdict import DEFAULT, Status
from rvsg.scenario.requirement import load_requirement


@pytest.mark.slow
def test_a_recorded_campaign_runs_strictly_without_a_model_and_says_what_its_verdict_means(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RVSG_DATA_DIR", "data")
    few = "--repeats 1 --confirmations 1 --jobs 1"
    result = terminal.json("demo warehouse-route_1-R1 --strict --out demo", few)
    assert result["accounting"]["calls"] == 9
    assert len(result["ranking"]) == 3
    assert not Path("demo/vlm").exists()
    assert result["confirmed"][0]["verdict"]["status"] == "INCONCLUSIVE"


@pytest.mark.slow
def test_a_demo_shows_its_stored_runs_and_compiles_nothing(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    command = [sys.executable, "-m", "rvsg", "demo"]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60, check=True
    )
    assert "its runs are stored, made by RVSG" in done.stderr and "15/15 runs violate" in done.stderr
    page = (tmp_path / "runs" / "demo-warehouse-route_1-R1" / "report.html").read_text()
    assert "Human 2" in page and "Play" in page
    assert not [path for name in ("kernels", "cache") for path in (tmp_path / name).rglob("*") if path.is_file()]


@pytest.mark.slow
def test_the_loop_of_the_readme_shows_the_demo() -> None:
    script = Path(__file__).parents[2] / "docs" / "contact_loop.py"
    done = subprocess.run([sys.executable, str(script), "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_demos_are_listed_and_a_wrong_name_is_answered(terminal: Terminal) -> None:
    terminal("demo --list")
    assert terminal.out.split() == list(shipped_recordings()) == ["warehouse-route_1-R1"]
    assert recording_folder(str(FOLDERS["warehouse-route_3-R3"])) == FOLDERS["warehouse-route_3-R3"]
    assert terminal.refused("demo warehouse-route_1-R7").code == "unknown-name"


def test_recorded_campaigns_hold_no_pictures_keys_or_paths_of_a_machine() -> None:
    for name in CAMPAIGNS:
        folder = FOLDERS[name]
        found = {path.name for path in folder.iterdir()}
        stored = lzma.decompress((folder / STORED).read_bytes()) if STORED in found else b""
        assert not re.search(rb"sk-|/home/|/root/|/work|127\.0\.0\.1", stored)
        assert found - {"histories.jsonl", "measured.jsonl", STORED} == {
            "campaign.yaml",
            "calls.jsonl",
            "messages.jsonl",
        }
        text = "".join(path.read_text() for path in folder.iterdir() if path.name != STORED)
        assert not re.search(r"sk-|/home/|/root/|/work|127\.0\.0\.1", text)
        assert len(text) < 400_000


def test_a_demo_that_was_begun_is_not_shown_as_a_finished_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = recording_folder(None)
    rvsg.Campaign.create(tmp_path / "begun", file=read_campaign_file(folder / "campaign.yaml"), replay=str(folder))
    assert main(["demo", "--out", str(tmp_path / "begun")]) == 2
    assert "demo-unfinished" in capsys.readouterr().err


def test_a_demo_keeps_its_conversation_and_its_next_step_is_short(terminal: Terminal) -> None:
    terminal("demo --out shown")
    (step,) = (line for line in terminal.err.splitlines() if line.startswith("  next "))
    assert step.split("rvsg ")[1] == "run --requirement no_contact --seed 1"
    page = Path("shown/report.html").read_text()
    assert 'id="conversation"' in page and "VIOLATED: a one-sided test rules out" in page
    terminal("export shown --to view --out sent.rvsg")
    terminal("report sent.rvsg")
    assert Path("sent/inputs/replay/warehouse-route_1-R1/calls.jsonl").is_file()
    assert 'id="conversation"' in Path("sent/report.html").read_text()


def test_a_campaign_that_replays_calls_is_complete_without_the_folder_they_came_from(tmp_path: Path) -> None:
    folder, calls = recording_folder(None), tmp_path / "calls"
    shutil.copytree(folder, calls)
    rvsg.Campaign.create(tmp_path / "first", file=read_campaign_file(calls / "campaign.yaml"), replay=str(calls))
    shutil.rmtree(calls)
    kept = rvsg.Campaign.open(tmp_path / "first").recording
    assert kept is not None and len(kept) == 9
    assert STORED not in {path.name for path in kept.folder.iterdir()}


def test_options_that_make_runs_are_refused_in_the_folder_of_a_shown_demo(terminal: Terminal) -> None:
    terminal("demo --out shown")
    assert terminal.refused("demo --out shown --confirmations 20").code == "demo-shown"


MEANING = {
    Status.PASS: "the model's 3 scenarios did not violate the requirement, but another scenario may",
    Status.FAIL: "makes the robot violate R1 (1.2 m) reliably, in 15 of 15 confirmation runs",
    Status.FLAKY: "in some runs, 15 of 15, and not in others",
    Status.INCONCLUSIVE: "in 15 of 15 confirmation runs, which does not decide between always and sometimes",
    None: "nothing was confirmed",
}


@pytest.mark.parametrize(("status", "told"), MEANING.items())
def test_a_demo_says_what_its_verdict_means(status: Status | None, told: str) -> None:
    verdict = SimpleNamespace(status=status, runs=15, violations=15, judged_by=DEFAULT)
    confirmed = SimpleNamespace(verdict=verdict) if status is not None else None
    result: Any = SimpleNamespace(confirmed=confirmed, ranking=[1, 2, 3], requirement=load_requirement("R1"))
    said = what_it_means(result)
    assert told in said and ("What VIOLATED means" in said) == (status is Status.INCONCLUSIVE)
