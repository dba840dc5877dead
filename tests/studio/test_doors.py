"""Ten campaigns at every door: terminal, JSON, report, overview, JUnit and studio say the same."""

from __future__ import annotations

import html
import json
import re
import xml.etree.ElementTree as ET
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import rvsg
from rvsg.app.matrix import overview, write_junit
from rvsg.cli import tables
from rvsg_studio.listing import Lister

SMALL = {"scenarios": 2, "refinements": 1, "repeats": 3, "confirmations": 12, "simulator": "kinematic", "jobs": 1}
CAMPAIGNS: dict[str, dict[str, Any]] = {
    "usual": {},
    "seed": {"seed": 3},
    "time": {"requirement": "R3"},
    "contact": {"requirement": "no_contact", "humans": 4},
    "clearance": {"requirement": "clearance", "humans": 3},
    "jerk": {"requirement": "R2", "route": "route_3"},
    "alone": {"humans": 1, "scenarios": 1, "refinements": 0},
    "searched": {"confirmations": 0},
    "office": {"world": "office"},
    "aborted": {"events": 4},
}


def words(text: str) -> str:
    """The words of a page or a terminal, without tags, line breaks and ellipses."""
    plain = html.unescape(re.sub(r"<[^>]+>", " ", text)).replace("\N{NO-BREAK SPACE}", " ")
    return " ".join(plain.split())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("doors")
    for name, changes in CAMPAIGNS.items():
        asked = SMALL | {key: value for key, value in changes.items() if key != "events"}
        if asked.get("world") == "office":
            asked["route"] = rvsg.load_world("office").routes[0].name
        for _ in islice(rvsg.Campaign.create(made / name, **asked).run(), changes.get("events")):
            pass
    return made


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMPAIGNS)
def test_every_door_says_the_same_of_a_campaign(
    folder: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign = rvsg.Campaign.open(folder / name)
    with campaign.result() as result:
        told = result.answer
        page = words(campaign.report(result=result).read_text(encoding="utf-8"))
        answer = json.loads(json.dumps(campaign.data(result)))["answer"]
        write_junit(folder / f"{name}.xml", [result])
    monkeypatch.setattr(tables, "console", lambda: Console(width=400))
    monkeypatch.setenv("COLUMNS", "400")
    tables.show_answer(told, page="report.html", again=campaign.command)
    terminal = words(capsys.readouterr().err)
    every = words(overview(folder, [campaign])[0].read_text(encoding="utf-8"))
    cases = {each.attrib["name"]: each for each in ET.parse(folder / f"{name}.xml").iter("testcase")}
    (found,) = [each for each in Lister(folder).listing().campaigns if each.folder == name]
    assert (found.status, found.headline) == (told.status, told.headline) == (answer["status"], answer["headline"])
    assert answer == told.model_dump(mode="json")
    assert [each.row for each in found.failures] == list(told.failures)
    for door in (terminal, page, every):
        assert words(told.status) in door and words(told.headline) in door and words(told.title) in door
    for place, row in enumerate(told.rows):
        facts = {
            each.attrib["name"]: each.attrib["value"] for each in cases[f"{row.number} {row.name}"].iter("property")
        }
        assert facts["violated"] == f"{row.violations}/{row.runs}" and facts["state"] == row.state
        assert row.number in page and words(row.name) in page and row.share in page and words(row.measured) in page
        if row.state != "not violated" and place < tables.MOST_ROWS:
            assert row.number in terminal and words(row.name) in terminal and row.share in terminal
    for each in told.figures:
        assert words(each.value) in terminal and words(each.value) in page and words(each.note) in page
    assert len(cases) == len(told.rows)
