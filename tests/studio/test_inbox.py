"""The inbox of proposals: asked for, judged by the checker, opened, accepted and dropped."""

from __future__ import annotations

import json

import pytest
from tests.studio.conftest import HOSTILE, PATIENT, Server, Show, waited

import rvsg
from rvsg.app.proposal import propose
from rvsg.generation.generator import proposal_json
from rvsg.scenario.builder import load_scenario_in


@pytest.mark.exhaustive
def test_proposals_are_asked_for_and_accepted(show: Show, studio: Server) -> None:
    tab = show("/inbox")
    tab.get_by_role("spinbutton", name="How many").fill("2")
    tab.get_by_role("spinbutton", name="First seed").fill("5")
    tab.get_by_role("button", name="Ask", exact=True).focus()
    tab.keyboard.press("Enter")
    tab.wait_for_function("document.querySelectorAll('.st-proposal').length === 2", timeout=PATIENT)
    name = "warehouse-route_1-R1-heuristic-5"
    expected = propose("warehouse", "route_1", "R1", seed=5).scenario
    assert expected is not None
    assert load_scenario_in(studio.folder / "proposals" / f"{name}.json")[0].people == expected.people
    tab.get_by_role("button", name=f"Accept {name}").click()
    tab.get_by_text(f"Kept as scenarios/{name}.json").wait_for(timeout=PATIENT)
    kept, world = load_scenario_in(studio.folder / "scenarios" / f"{name}.json")
    assert kept.people == expected.people and rvsg.check(kept, world) == ()
    tab.get_by_role("button", name="Drop warehouse").click()
    tab.get_by_text("No proposal is in the inbox.").wait_for(timeout=PATIENT)
    assert len(list((studio.folder / "proposals" / "dropped").iterdir())) == 2


def test_the_verdict_of_the_checker_stands_with_a_proposal(show: Show, studio: Server) -> None:
    studio.refuses = True  # the editor may still ask for the proposal that is deleted at the end
    folder = studio.folder / "proposals"
    folder.mkdir()
    good = json.loads(proposal_json(propose("warehouse", "route_1", "R1", seed=1)))
    finding = {"rule": "R1", "human": "Human 1", "task": "t", "reason": HOSTILE}
    bad = json.loads(json.dumps(good))
    bad["scenario"]["people"]["humans"][0]["tasks"][0]["path"] = ["A1", "Z99"]
    none = good | {"scenario": None, "problems": [finding], "first_findings": [finding]}
    for name, value in (("good", good), ("bad", bad), ("none", none), ("broken", {"x": 1})):
        (folder / f"{name}.json").write_text(json.dumps(value))
    tab = show("/inbox")
    for name, verdict in (("good", "valid"), ("bad", "invalid"), ("none", "invalid"), ("broken", "invalid")):
        card = tab.get_by_role("region", name=name, exact=True)
        assert card.locator(".chip").inner_text() == verdict
        assert card.get_by_role("button", name=f"Accept {name}").count() == (verdict == "valid")
    assert "Z99" in tab.get_by_role("region", name="bad").inner_text()
    assert HOSTILE in tab.get_by_role("region", name="none").inner_text()
    assert tab.locator("main img").count() == 0
    tab.get_by_role("region", name="good", exact=True).get_by_role("link", name="Open in the editor").click()
    tab.locator("[data-studio=scenario][data-ready]").wait_for(timeout=PATIENT)
    (folder / "good.json").unlink()
    tab.goto(f"{studio.base}/inbox")
    waited(lambda: tab.locator(".st-proposal").count() == 3)
