from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from tests.cli.commands import Terminal
from tests.recordings import FOLDERS

from rvsg.generation.environment import propose_area_names
from rvsg.generation.prompts import Prompts
from rvsg.generation.vlm.access import ModelAccess
from rvsg.generation.vlm.call_log import CallLog
from rvsg.generation.vlm.model import Scripted
from rvsg.world.passages import doorway
from rvsg.world.schema import save_world
from rvsg.world.world_folder import load_world


@pytest.fixture(autouse=True)
def _own_folder(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RVSG_DATA_DIR", "data")


def test_a_prompt_is_printed_without_calling_a_model(terminal: Terminal) -> None:
    said = terminal("scenario prompt --route route_2 --requirement R3 --conversation study")
    for text in ("Step 1: describe a scenario", "Time to reach the goal", "route_2"):
        assert text in terminal.out
    assert "input tokens, 2 pictures" in said
    assert not Path("runs").exists()


def test_the_prompt_of_a_campaign_file_has_its_own_templates(terminal: Terminal) -> None:
    Path("c.yaml").write_text("route: route_3\nprompts: mine\n")
    terminal("scenario prompt --copy compact-new --to mine")
    terminal("scenario prompt --copy compact-new --to mine", code=2)
    Path("mine/compact-new.md.j2").write_text("{# declares: memory #}\nSurprise me.\n")
    messages = terminal.json("scenario prompt c.yaml --pictures shown")
    assert messages[-1]["text"] == "Surprise me.\n"
    assert "route_3" in messages[1]["text"]
    assert {path.name for path in Path("shown").iterdir()} == {"labelled_map.png", "grid_of_waypoints.png"}


def test_a_proposal_from_a_record_shows_what_the_checker_said(terminal: Terminal) -> None:
    terminal("scenario propose --replay", FOLDERS["warehouse-route_1-R1"])
    proposal = json.loads(terminal.out)
    assert proposal["calls"][0]["model"] == "vision-assistant"
    assert proposal["scenario"] is not None and proposal["first_findings"] == []


def test_labels_of_a_model_are_accepted_one_by_one(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    save_world(load_world("warehouse"), Path("mine"))
    world = load_world(Path("mine"))
    first, second = (area.name for area in world.areas[:2])
    names = [
        {"area": area, "name": new, "kind": "desk", "why": "A"} for area, new in ((first, "Desk 1"), (second, "X"))
    ]
    between = next([a, b] for a, b in world.grid.hops if (ends := doorway(world, a, b)) and math.dist(*ends) < 2.9)
    doors = [{"name": name, "between": between, "kind": "sliding", "why": "B"} for name in ("Gate", "Old gate", "No")]
    activities = ["Somebody writes at Desk 1.", "Somebody sleeps."]
    answer = json.dumps({"names": names, "activities": activities, "doors": doors})
    access = ModelAccess(Scripted([answer]), recording=CallLog("record"))
    propose_area_names(world, access, Prompts())
    answers = iter([True, False, True, True, False, True, False])
    monkeypatch.setattr("typer.confirm", lambda *_, **__: next(answers))
    said = terminal("world label mine --replay record")
    assert f"{first}: name Desk 1, kind desk. A" in said
    assert f"Gate: a door between {between[0]} and {between[1]}, " in said
    after = load_world(Path("mine"))
    assert (after.areas[0].name, after.areas[0].kind) == ("Desk 1", "desk")
    assert after.areas[1:] == world.areas[1:]
    assert [(door.name, door.kind, door.state) for door in after.doors] == [
        ("Gate", "sliding", "automatic"),
        ("Old gate", "sliding", "automatic"),
    ]
    Path("photo.png").write_text("text")
    refused = terminal.refused("world label mine --replay record --photo photo.png")
    assert refused.code == "photo-file"
    assert after.activities == (*world.activities, "Somebody writes at Desk 1.")


def test_a_world_is_described_from_a_record_accepted_and_stored(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_world(replace(load_world("warehouse"), description=None), Path("mine"))
    answers = iter(["x", "r", "a"])
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(answers))
    assert terminal.refused("world describe mine").code == "no-description"
    terminal.refused("world describe mine --generator-option sped=1 --replay", FOLDERS["describe-warehouse"])
    terminal("world describe mine --generator-option call_timeout_s=9 --replay", FOLDERS["describe-warehouse"])
    assert load_world(Path("mine")).description is not None
    terminal("world describe mine --review --reviewer Ada")
    reviewed = load_world(Path("mine")).description
    assert reviewed is not None and reviewed.reviewed_on
    assert (reviewed.reviewed, reviewed.reviewer) == (True, "Ada")


def test_a_description_is_edited_in_the_editor_and_a_broken_edit_told(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("editor.py").write_text(
        "import pathlib, sys\n"
        "done = pathlib.Path('edited_once')\n"
        "text = 'layout: A new layout.\\ngrid: A new grid.' if done.exists() else 'layout: only this'\n"
        "done.touch()\n"
        "pathlib.Path(sys.argv[1]).write_text(text)\n"
    )
    monkeypatch.delenv("VISUAL", raising=False)
    monkeypatch.setenv("EDITOR", f"{sys.executable} editor.py")
    answers = iter(["e", "e", "a"])
    monkeypatch.setattr("typer.prompt", lambda *_, **__: next(answers))
    told = terminal.json("world describe warehouse --review --out mine.yaml")
    assert told["layout"] == "A new layout."
    assert yaml.safe_load(Path("mine.yaml").read_text())["grid"] == "A new grid."
