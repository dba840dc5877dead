"""What a person asks of a model in the studio: a description revised for a reason, names of areas one by one."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from tests.generation.loopback import LoopbackServer, says, serving
from tests.studio.conftest import HOSTILE, PATIENT, Server, Show, axe_violations, fits, waited

import rvsg
from rvsg.world.passages import doorway

pytestmark = pytest.mark.exhaustive


def name_model(tab: Any, server: LoopbackServer) -> None:
    tab.get_by_role("textbox", name=re.compile("^Model")).fill("openai-chat:vision-1")
    tab.get_by_role("textbox", name=re.compile("^Server")).fill(server.url)


def test_a_rejected_description_goes_back_to_the_model_and_the_difference_is_shown(
    show: Show, studio: Server, office: Path
) -> None:
    revised = {"layout": f"The Lounge lies in the south. {HOSTILE}", "grid": "Rows A to H."}
    tab = show("/describe?world=office2", width=390, color_scheme="dark", bypass_csp=True)
    tab.locator("#text-layout").fill("The Lounge lies in the north, behind Office 77.")
    tab.locator("#text-grid").fill("Rows A to H.")
    tab.locator("mark.st-unknown", has_text="Office 77").wait_for()
    tab.locator("#reason").fill("It lies in the south.")
    waited(lambda: "in the south" in "".join(p.read_text() for p in studio.own.rglob("*.json")))
    tab.close()
    studio.restart()
    with serving(says(json.dumps(revised))) as server:
        tab = show("/describe?world=office2", width=390, color_scheme="dark", bypass_csp=True)
        assert tab.locator("#text-layout").input_value().endswith("behind Office 77.")
        tab.get_by_role("button", name="Reject").click()
        tab.get_by_text("Name a model first").wait_for()
        name_model(tab, server)
        waited(lambda: server.url in (studio.own / "model.json").read_text())
        tab.get_by_role("button", name="Reject").focus()
        tab.keyboard.press("Enter")
        tab.locator("#difference").wait_for(timeout=PATIENT)
    sent = json.dumps(server.requests[-1]["messages"])
    assert "It lies in the south." in sent and "behind Office 77" in sent and "image_url" in sent
    assert "north" in tab.locator("#difference del").first.inner_text()
    assert "south" in tab.locator("#difference ins").first.inner_text()
    tab.wait_for_function("document.getElementById('text-layout').value.includes('south')")
    assert tab.locator("main img").count() == 0
    assert axe_violations(tab) == []
    assert fits(tab)
    tab.get_by_role("button", name="Accept", exact=True).click()
    tab.get_by_text("Stored in").wait_for(timeout=PATIENT)
    kept = rvsg.load_world(office).description
    assert kept is not None and kept.reviewed and kept.layout == revised["layout"]


def test_names_of_areas_by_a_model_are_accepted_one_by_one(show: Show, office: Path) -> None:
    labels = office / "labels.yaml"
    labels.write_text(labels.read_text() + "# a comment of mine\n")
    first, second = (area.name for area in rvsg.load_world(office).areas[:2])
    names = [
        {"area": first, "name": "Tea corner", "kind": "Pantry", "why": HOSTILE},
        {"area": second, "name": "Post room", "why": "Shelves."},
        {"area": "Nowhere", "name": "X", "why": ""},
    ]
    Image.new("RGB", (40, 30), (200, 30, 30)).save(office.parent / "hall.jpg")
    world = rvsg.load_world(office)
    between = next(hop for hop in world.grid.hops if (place := doorway(world, *hop)) and math.dist(*place) < 2.5)
    doors = [{"name": "Door of the kitchen", "between": between, "kind": "swing", "why": HOSTILE}]
    tab = show("/world?world=office2", bypass_csp=True)
    tab.locator("summary", has_text="Ask a model").click()
    with serving(says(json.dumps({"names": names, "doors": doors}))) as server:
        name_model(tab, server)
        tab.get_by_role("textbox", name="Photographs or plans").fill("hall.jpg")
        tab.get_by_role("button", name="Propose names").click()
        tab.get_by_role("button", name="Accept Tea corner").wait_for(timeout=PATIENT)
    assert json.dumps(server.requests[-1]["messages"]).count('"image_url"}') == 4, (
        "the map, the office from above, its grid, the photograph"
    )
    assert axe_violations(tab) == []
    assert fits(tab)
    assert tab.locator("main img").count() == 0
    tab.get_by_role("button", name="Drop Post room").click()
    tab.get_by_role("button", name="Drop Post room").wait_for(state="detached")
    tab.get_by_role("button", name="Accept Tea corner").focus()
    tab.keyboard.press("Enter")
    tab.get_by_role("button", name="Accept Tea corner").wait_for(state="detached", timeout=PATIENT)
    tab.get_by_role("button", name="Accept Door of the kitchen").click()
    tab.get_by_role("button", name="Accept Door of the kitchen").wait_for(state="detached", timeout=PATIENT)
    assert [door.name for door in rvsg.load_world(office).doors][-1] == "Door of the kitchen"
    areas = rvsg.load_world(office).areas
    assert [area.name for area in areas[:2]] == ["Tea corner", second] and areas[0].kind == "pantry"
    assert labels.read_text().endswith("# a comment of mine\n")
    tab.reload()
    tab.get_by_text("No proposal is left.").wait_for(timeout=PATIENT)
