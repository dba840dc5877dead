from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from tests.recordings import FOLDERS

from rvsg.cli import main
from rvsg.core.errors import RvsgError
from rvsg.world.schema import save_world
from rvsg.world.world_folder import load_world


@pytest.fixture(autouse=True)
def _own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RVSG_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.chdir(tmp_path)


def test_a_prompt_is_printed_without_calling_a_model(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenario", "prompt", "--route", "route_2", "--requirement", "R3", "--conversation", "study"]) == 0
    printed = capsys.readouterr()
    assert "Step 1: describe a scenario" in printed.out
    assert "Efficiency" in printed.out
    assert "route_2" in printed.out
    assert "input tokens, 2 pictures" in printed.err
    assert not Path("runs").exists()


def test_the_prompt_of_a_campaign_file_has_its_own_templates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "c.yaml").write_text("route: route_3\nprompts: mine\n")
    assert main(["scenario", "prompt", "--copy", "compact-new", "--to", "mine"]) == 0
    assert main(["scenario", "prompt", "--copy", "compact-new", "--to", "mine"]) == 2
    override = tmp_path / "mine" / "compact-new.md.j2"
    override.write_text("{# declares: memory #}\nSurprise me.\n")
    capsys.readouterr()
    assert main(["scenario", "prompt", "c.yaml", "--json", "--pictures", "shown"]) == 0
    messages = json.loads(capsys.readouterr().out)
    assert messages[-1]["text"] == "Surprise me.\n"
    assert "route_3" in messages[1]["text"]
    assert {path.name for path in Path("shown").iterdir()} == {"labelled_map.png", "grid_of_waypoints.png"}


def test_a_proposal_from_a_record_shows_what_the_checker_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenario", "propose", "--replay", str(FOLDERS["warehouse-route_1-R1"])]) == 0
    proposal = json.loads(capsys.readouterr().out)
    assert proposal["calls"][0]["model"] == "vision-assistant"
    assert proposal["scenario"] is not None and proposal["first_findings"] == []


def test_a_world_is_described_from_a_record_accepted_and_stored(
    errors: list[RvsgError], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_world(replace(load_world("warehouse"), description=None), tmp_path / "mine")
    answers = iter(["x", "r", "a"])
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(answers))
    assert main(["world", "describe", str(tmp_path / "mine")]) == 2
    assert errors[-1].code == "no-description"
    replay = str(FOLDERS["describe-warehouse"])
    assert main(["world", "describe", str(tmp_path / "mine"), "--replay", replay]) == 0
    assert load_world(tmp_path / "mine").description is not None
    assert main(["world", "describe", str(tmp_path / "mine"), "--review", "--reviewer", "Ada"]) == 0
    reviewed = load_world(tmp_path / "mine").description
    assert reviewed is not None
    assert (reviewed.reviewed, reviewed.reviewer) == (True, "Ada")
    assert reviewed.reviewed_on


def test_a_description_is_edited_in_the_editor_and_a_broken_edit_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    editor = tmp_path / "editor.py"
    editor.write_text(
        "import pathlib, sys\n"
        "done = pathlib.Path('edited_once')\n"
        "text = 'layout: A new layout.\\ngrid: A new grid.' if done.exists() else 'layout: only this'\n"
        "done.touch()\n"
        "pathlib.Path(sys.argv[1]).write_text(text)\n"
    )
    monkeypatch.delenv("VISUAL", raising=False)
    monkeypatch.setenv("EDITOR", f"{sys.executable} {editor}")
    answers = iter(["e", "e", "a"])
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(answers))
    assert main(["world", "describe", "warehouse", "--review", "--out", "mine.yaml", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["layout"] == "A new layout."
    assert yaml.safe_load(Path("mine.yaml").read_text())["grid"] == "A new grid."
