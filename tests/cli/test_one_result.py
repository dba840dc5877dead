"""One result of a stored campaign, whichever door shows it."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from html import unescape
from pathlib import Path

import pytest
from tests.cli.commands import Terminal

from rvsg_studio.listing import Lister

CAMPAIGN = (
    "run --out one --requirement always.yaml#always --simulator kinematic --strategy random --scenarios 2 "
    "--refinements 0 --repeats 2 --confirmations 2 --shrink-runs 0 --seed 7"
)
ALWAYS = "always: {title: T, text: Keep away., metric: dto, worse: smaller, limit: 99.0}\n"


@pytest.mark.parametrize(("error_rate", "violated"), [(0.2, True), (0.05, True), (0.001, False)])
def test_every_door_tells_the_same_under_any_error_rate(terminal: Terminal, error_rate: float, violated: bool) -> None:
    Path("always.yaml").write_text(ALWAYS, encoding="utf-8")
    told = terminal.json(CAMPAIGN, "--error-rate", error_rate, "--junit one.xml")
    page, cases = Path("one/report.html").read_text(encoding="utf-8"), list(ET.parse("one.xml").iter("testcase"))
    confirmed, answer = told["confirmed"], told["answer"]
    rows = {row["confirmation"]: row for row in answer["rows"] if row["state"] == "confirmed"}
    assert [finding["violated"] for finding in confirmed] == [violated] * len(rows) and rows
    for finding in confirmed:
        row = rows[finding["confirmation"]]
        shares = finding["verdict"]["violations"], finding["verdict"]["runs"]
        assert (row["violations"], row["runs"]) == shares and row["violated"] == ("yes" if violated else "open")
        (case,) = (case for case in cases if case.get("name", "").startswith(f"{row['number']} "))
        properties = {each.get("name"): each.get("value") for each in case.iter("property")}
        assert (case.find("failure") is not None) is violated and properties["violated"] == row["share"]
        (line,) = re.findall(rf'<tr><td data-label="#">{re.escape(row["number"])}</td>.*?</tr>', page, re.DOTALL)
        cells = [unescape(re.sub("<[^>]*>", "", cell)).strip() for cell in re.findall("<td.*?</td>", line, re.DOTALL)]
        assert [cells[2], cells[-1]] == [row["status"], row["cause"]] and row["share"] in cells[3]
    first, head = answer["rows"][0], " ".join(terminal.err.split())
    assert f"{answer['status']} {answer['title']}" in head and f"{first['share']} runs violate" in head
    assert f"cause {first['cause']} ({first['caused']})" in head
    assert all(unescape(page).count(text) for text in (answer["headline"], first["caused"]))
    (listed,) = Lister(Path.cwd()).listing().campaigns
    assert (listed.status, listed.tone, listed.headline) == (answer["status"], answer["tone"], answer["headline"])
    failures = [row for row in answer["rows"] if row["state"] == "confirmed" and (violated or row["contacts"])]
    assert [each.row.model_dump(mode="json") for each in listed.failures] == failures
    assert told["violated"] is violated
