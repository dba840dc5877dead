"""The editors of worlds and scenarios, and what they leave on the disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.studio.conftest import PATIENT, Server, Show, ready

import rvsg
from rvsg.scenario.builder import load_scenario_in


def posted(answer: Any) -> str:
    return answer.request.post_data or ""


@pytest.mark.exhaustive
def test_the_keyboard_moves_and_removes_an_area_and_the_check_follows(show: Show, office: Path) -> None:
    tab = show("/world?world=office2")
    before = rvsg.load_world(office).area("Lounge").outline
    tab.get_by_role("button", name="Lounge").focus()
    tab.keyboard.press("Enter")
    tab.locator(".st-map").focus()
    tab.keyboard.press("Shift+ArrowLeft")
    tab.wait_for_function("document.querySelector('[data-studio] button:enabled') && true")
    tab.get_by_role("button", name="Undo").and_(tab.locator(":enabled")).wait_for(timeout=PATIENT)
    assert rvsg.load_world(office).area("Lounge").outline[0][0] == pytest.approx(before[0][0] - 1.0)
    field = tab.get_by_label("x to")
    field.fill("900")
    field.press("Tab")
    tab.locator(".st-remarks li").first.wait_for(timeout=PATIENT)
    assert tab.locator(".st-pin").count() >= 1
    tab.locator(".st-map").focus()
    tab.keyboard.press("Delete")
    tab.wait_for_function("![...document.querySelectorAll('.st-names button')].some(b => b.textContent === 'Lounge')")
    assert "Lounge" not in [area.name for area in rvsg.load_world(office).areas]


def test_a_shipped_world_is_copied_before_it_is_changed(show: Show, studio: Server) -> None:
    tab = show("/world?world=office")
    assert tab.get_by_label("What people do here").is_disabled()
    tab.get_by_role("button", name="Copy into this folder").click()
    tab.wait_for_url("**world=.%2Foffice**")
    ready(tab)
    assert tab.get_by_label("What people do here").is_enabled()
    assert rvsg.load_world(studio.folder / "office").id == rvsg.load_world("office").id


@pytest.mark.exhaustive
def test_a_scenario_is_changed_simulated_and_saved(show: Show, studio: Server) -> None:
    attempts = rvsg.Campaign.open(studio.folder / "runs" / "first").attempts()
    index = next(a.index for a in attempts if a.purpose == "search" and a.proposal.scenario)
    path = f"/scenario?campaign=runs/first&attempt={index}"
    tab = show(path)
    tab.get_by_text("of 20 runs violate").wait_for(timeout=PATIENT)
    speed = tab.get_by_label("Speed, m/s")
    speed.fill("0.45")
    speed.press("Tab")
    tab.get_by_text("One run:").or_(tab.get_by_text("of 20 runs violate")).first.wait_for(timeout=PATIENT)
    handle = tab.locator("circle.st-handle").first
    before = handle.get_attribute("data-waypoint")
    box = handle.bounding_box()
    assert box is not None
    with tab.expect_response(lambda answer: "scenario-try" in answer.url and '"seeds":20' in posted(answer)):
        tab.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        tab.mouse.down()
        tab.mouse.move(box["x"] + 60, box["y"] + 10, steps=6)
        tab.mouse.up()
    tab.wait_for_function(
        "was => document.querySelector('circle.st-handle').getAttribute('data-waypoint') !== was", arg=before
    )
    tab.get_by_text("of 20 runs violate").wait_for(timeout=PATIENT)
    tab.close()
    studio.restart()
    tab = show(path)
    tab.get_by_text("Changes that were not saved are shown.").wait_for(timeout=PATIENT)
    assert tab.get_by_label("Speed, m/s").input_value() == "0.45"
    tab.get_by_role("button", name="Save the scenario").click()
    tab.get_by_text("Saved as scenarios/edited.json").wait_for(timeout=PATIENT)
    saved, world = load_scenario_in(studio.folder / "scenarios" / "edited.json")
    assert saved.people.humans[0].speed_m_s == 0.45 and rvsg.check(saved, world) == ()
    tab.get_by_label("Title of the case").fill("Slow walk")
    tab.get_by_role("button", name="Add to the suite").click()
    tab.get_by_text("suite holds 1 case.").wait_for(timeout=PATIENT)
    assert rvsg.Suite.open(studio.folder / "suite").cases[0].title == "Slow walk"


def test_a_point_that_is_dragged_is_repaired_with_its_reason_or_kept(show: Show, studio: Server) -> None:
    attempts = rvsg.Campaign.open(studio.folder / "runs" / "first").attempts()
    index = next(a.index for a in attempts if a.purpose == "search" and a.proposal.scenario)
    tab = show(f"/scenario?campaign=runs/first&attempt={index}")
    tab.get_by_text("of 20 runs violate").wait_for(timeout=PATIENT)
    handles = tab.locator("circle.st-handle[tabindex='0']")
    box = handles.nth(1).bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    assert tab.evaluate("([x, y]) => document.elementFromPoint(x, y).matches('.st-handle')", [x, y])
    far = max((handle.bounding_box() for handle in handles.all()), key=lambda each: abs(each["x"] - x))
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(far["x"] + 200 if far["x"] > x else far["x"] - 120, y + 150, steps=6)
    tab.mouse.up()
    keep = tab.get_by_role("button", name="Keep my point")
    keep.wait_for(timeout=PATIENT)
    said = tab.locator("#editor .st-message").inner_text()
    assert said.startswith("Repaired: ") and said.count("rerouted") == 1
    assert tab.locator(".st-flash").count() >= 1
    keep.click()
    tab.get_by_text("are not neighbours").first.wait_for(timeout=PATIENT)
    tab.get_by_text("now not possible").wait_for()
