"""The studio killed at any moment loses at most the last keystroke, and leaves every file whole."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import shapely
from tests.studio.conftest import Server, Show, confirmed, pixel, press, reach, ready, waited

import rvsg
from rvsg_studio.world_editor import History, folder_of_world

Page = tuple[str, Callable[[Any], Any], str]


def kept_anywhere(studio: Server, text: str) -> bool:
    """Whether a text stands in a file of the folder."""
    wanted = json.dumps(text)[1:-1]
    for path in (path for path in studio.folder.rglob("*") if path.suffix in (".json", ".yaml")):
        content = path.read_text(errors="replace")
        if text in content or wanted in content:
            return True
    return False


def labelled(name: str) -> Callable[[Any], Any]:
    return lambda tab: tab.get_by_label(name, exact=True)


def of_area(name: str) -> Callable[[Any], Any]:
    def field(tab: Any) -> Any:
        if tab.locator(".st-typed").count() == 0:
            press(tab, tab.get_by_role("button", name="Lounge", exact=True))
        return tab.get_by_label(name, exact=True)

    return field


def asked(name: str) -> Callable[[Any], Any]:
    def field(tab: Any) -> Any:
        summary = tab.locator("summary", has_text="Ask")
        if summary.evaluate("e => !e.parentElement.open"):
            summary.click()
        return tab.get_by_role("textbox", name=name)

    return field


def comment(tab: Any) -> Any:
    tab.get_by_role("tab", name="Notes").click()
    return tab.get_by_label("Comment")


WORLD, SCENARIO = "/world?world=office2", "/scenario?campaign=runs/first&attempt={confirmed}"
FIELDS: dict[str, Page] = {
    "name of an area": (WORLD, of_area("Name"), "Tea corner"),
    "edge of an area": (WORLD, of_area("x to"), "12.75"),
    "activities": (WORLD, labelled("What people do here, one per line"), "Ann carries tea"),
    "model for names": (WORLD, asked("Model"), "openai-chat:gpt-5"),
    "end of a task": (SCENARIO, labelled("Waypoint where task 1 ends"), "E15"),
    "speed of a person": (SCENARIO, labelled("Speed, m/s"), "0.75"),
    "new person": (SCENARIO, labelled("From waypoint"), "H15"),
    "file of a scenario": (SCENARIO, labelled("As a file"), "scenarios/slow.json"),
    "title of a case": (SCENARIO, labelled("Title of the case"), "Slow walk"),
    "comment": ("/finding?campaign=runs/first&attempt={confirmed}", comment, "seen in May"),
    "description": ("/describe?world=office2", lambda tab: tab.locator("#text-layout"), "In the north"),
    "reason": ("/describe?world=office2", lambda tab: tab.locator("#reason"), "In the south"),
    "campaign file": ("/campaign/new", lambda tab: tab.locator("#yaml"), "world: office"),
    "folder of a campaign": ("/campaign/new", lambda tab: tab.get_by_label("Folder"), "runs/slowly"),
    "folder of a world": ("/world/new", lambda tab: tab.get_by_label("Folder"), "my_place"),
    "proposals": ("/inbox", lambda tab: tab.get_by_role("spinbutton", name="First seed"), "4711"),
}


SECOND = ("edge of an area", "end of a task", "reason", "folder of a campaign")
"""Fields of pages on which another field is tried, too."""


@pytest.mark.parametrize(
    "names",
    [pytest.param([name for name in FIELDS if name not in SECOND], marks=pytest.mark.exhaustive), SECOND],
    ids=["first", "second"],
)
def test_what_is_typed_is_there_after_a_kill(show: Show, studio: Server, office: Path, names: tuple[str, ...]) -> None:
    """In every field, not left: all but the last character is on the disk, the last is typed as the studio dies."""
    place = {"confirmed": confirmed(studio.folder)}
    tabs = {}
    for name in names:
        path, field, text = FIELDS[name]
        tabs[name] = typed_but_one(show, studio, path.format(**place), field, text)
    die_and_return(show, studio, tabs, place)


def typed_but_one(show: Show, studio: Server, path: str, field: Callable[[Any], Any], text: str) -> Any:
    tab = show(path)
    found = field(tab)
    found.focus()
    tab.keyboard.press("Control+a")
    tab.keyboard.type(text[:-1])
    waited(lambda: kept_anywhere(studio, text[:-1]))
    return tab


def die_and_return(show: Show, studio: Server, tabs: dict[str, Any], place: dict[str, int]) -> None:
    for name, tab in tabs.items():
        tab.keyboard.type(FIELDS[name][2][-1])
    studio.kill()
    for tab in tabs.values():
        tab.close()
    studio.start()
    for name in tabs:
        path, field, text = FIELDS[name]
        tab = show(path.format(**place))
        waited(lambda tab=tab, field=field, text=text: field(tab).input_value() in (text, text[:-1]))
        tab.close()


@pytest.mark.exhaustive
def test_what_was_typed_is_stored_with_enter_after_a_kill(show: Show, studio: Server, office: Path) -> None:
    tab = typed_but_one(show, studio, WORLD, of_area("Name"), "Tea corner.")
    tab.close()
    studio.restart()
    tab = show(WORLD)
    tab.get_by_text("is not stored yet").wait_for()
    tab.keyboard.press("Enter")
    tab.get_by_role("button", name="Tea corner").wait_for()
    assert "Tea corner" in [area.name for area in rvsg.load_world(office).areas]
    waited(lambda: not kept_anywhere(studio, "areas/Lounge/Name"))
    tab.reload()
    ready(tab)
    assert tab.locator(".st-typed").count() == 0


def test_corners_that_are_set_are_there_after_a_kill(show: Show, studio: Server, office: Path) -> None:
    tab = show(WORLD)
    tab.get_by_role("button", name="Polygon").click()
    tab.locator(".st-map").scroll_into_view_if_needed()
    corners = [(1.0, 6.6), (3.0, 6.6), (2.0, 7.6)]
    for x, y in corners:
        tab.mouse.click(*pixel(tab, x, y))
    waited(lambda: any(len(json.loads(p.read_text()).get("points", {}).get("points", ())) == 3
                       for p in (studio.own / "typed").glob("*.json")))  # fmt: skip
    tab.close()
    studio.restart()
    tab = show(WORLD)
    tab.locator(".st-draft").wait_for(state="attached")
    tab.keyboard.press("Enter")
    tab.get_by_role("button", name="Area 1").wait_for()
    drawn = shapely.Polygon(rvsg.load_world(office).area("Area 1").outline)
    assert drawn.symmetric_difference(shapely.Polygon(corners)).area < 1.0


def test_a_studio_that_is_gone_is_told_and_what_is_typed_stays(show: Show, studio: Server, office: Path) -> None:
    tab = show(WORLD)
    press(tab, tab.get_by_role("button", name="Lounge", exact=True))
    studio.kill()
    tab.get_by_label("Name", exact=True).fill("Tea corner")
    tab.get_by_text("The studio does not answer").first.wait_for()
    assert tab.get_by_label("Name", exact=True).input_value() == "Tea corner"


def test_files_stay_whole_whenever_it_is_killed(show: Show, studio: Server) -> None:
    """Moves of an area, one after the other; the studio dies at moments drawn from a seed."""
    moments = random.Random(20)
    office = studio.folder / "office2"
    shutil.copytree(folder_of_world("office"), office)
    edges = []
    for _ in range(2):
        tab = show(WORLD)
        ready(tab)
        press(tab, tab.get_by_role("button", name="Lounge", exact=True))
        reach(tab, tab.locator(".st-map"))
        stored = (office / "labels.yaml").read_text()
        tab.keyboard.press("ArrowLeft")
        waited(lambda stored=stored: (office / "labels.yaml").read_text() != stored)
        for _ in range(moments.randint(2, 6)):
            tab.keyboard.press(moments.choice(("ArrowLeft", "ArrowUp")))
        tab.wait_for_timeout(moments.uniform(0, 150))
        studio.kill()
        tab.close()
        world = rvsg.load_world(office)
        edges.append(world.area("Lounge").outline[0])
        for path in studio.own.rglob("*.json"):
            json.loads(path.read_text())
        studio.start()
    assert len(set(edges)) == 2, "every time some moves are stored"
    tab = show(WORLD)
    (undo,) = (studio.own / "undo").glob("*.json")
    for _ in range(History(undo).steps[0]):
        before = (office / "labels.yaml").read_text()
        tab.get_by_role("button", name="Undo").and_(tab.locator(":enabled")).click()
        waited(lambda before=before: (office / "labels.yaml").read_text() != before)
    assert rvsg.load_world(office).area("Lounge").outline == rvsg.load_world("office").area("Lounge").outline
