"""A second tab sees what the first one changes: editors, notes and home."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from tests.studio.conftest import Server, Show, confirmed, ready, waited

import rvsg
from rvsg_studio.workspace import note, notes_of


def beside(tab: Any, studio: Server, path: str) -> Any:
    """Open a page in a second tab of the same browser."""
    other = tab.context.new_page()
    other.goto(studio.base + path)
    other.wait_for_selector("h1")
    return other


def test_a_world_and_its_undo_appear_in_the_other_tab(show: Show, studio: Server, office: Path) -> None:
    first = show("/world?world=office2")
    second = beside(first, studio, "/world?world=office2")
    ready(second)
    second.get_by_role("button", name="Lounge", exact=True).click()  # what is chosen does not keep changes away
    first.get_by_role("button", name="Lounge", exact=True).click()
    first.get_by_label("Name", exact=True).fill("Quiet Room")
    first.keyboard.press("Enter")
    second.get_by_role("button", name="Quiet Room", exact=True).wait_for()
    second.get_by_role("button", name="Undo", exact=True).click()
    first.get_by_role("button", name="Lounge", exact=True).wait_for()
    assert [area.name for area in rvsg.load_world(office).areas].count("Lounge") == 1


def test_a_scenario_appears_in_the_other_tab_once_that_rests(show: Show, studio: Server) -> None:
    path = f"/scenario?campaign=runs/first&attempt={confirmed(studio.folder)}"
    first = show(path)
    second = beside(first, studio, path)
    ready(second)
    speed = [tab.get_by_label("Speed, m/s") for tab in (first, second)]
    speed[1].press_sequentially("0")  # it is being typed in while the other tab changes it
    speed[0].fill("0.45")
    speed[0].press("Tab")
    first.wait_for_timeout(700)
    assert float(speed[1].input_value()) != 0.45
    speed[1].press("Tab")
    waited(lambda: speed[0].input_value() == speed[1].input_value())


def test_a_status_and_a_comment_appear_at_home_and_on_the_finding(show: Show, studio: Server) -> None:
    path = f"/finding?campaign=runs/first&attempt={confirmed(studio.folder)}"
    first = show(path)
    home, other = beside(first, studio, "/"), beside(first, studio, path)
    for tab in (first, other):
        ready(tab)
        tab.get_by_role("tab", name="Notes").click()
    home.get_by_label("Search failures").fill("runs")
    first.get_by_label("Status").select_option("known")
    first.get_by_label("Comment").fill("Seen in the hall, too.")
    home.locator(".st-failures tbody tr td", has_text="known").first.wait_for()
    assert home.get_by_label("Search failures").input_value() == "runs"
    waited(lambda: other.get_by_label("Comment").input_value() == "Seen in the hall, too.")
    assert other.get_by_label("Status").input_value() == "known"
    folder = studio.folder / "runs" / "first"
    (scenario,) = [key for key, each in notes_of(folder).findings.items() if each.status == "known"]
    note(folder, scenario, status="fixed")  # by another studio on the same folder
    waited(lambda: first.get_by_label("Status").input_value() == "fixed")


def test_a_new_campaign_appears_at_home(show: Show, studio: Server) -> None:
    tab = show()
    tab.get_by_role("link", name="runs/first", exact=True).wait_for()
    shutil.copytree(studio.folder / "runs" / "first", studio.folder / "runs" / "second")
    tab.get_by_role("link", name="runs/second", exact=True).wait_for()
    shutil.rmtree(studio.folder / "runs" / "first")
    tab.get_by_role("link", name="runs/first", exact=True).wait_for(state="detached")
