"""Drawing on the map of a world, by mouse and by keyboard: what stands in its YAML afterwards."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import shapely
from tests.studio.conftest import PATIENT, Show, pixel, press, reach, ready

import rvsg
from rvsg_studio.world_editor import editable_world

Draw = Callable[[Any, list[tuple[float, float]]], None]
CORNERS = [(1.0, 6.6), (3.0, 6.6), (2.0, 7.6)]


def by_mouse(tab: Any, points: list[tuple[float, float]]) -> None:
    tab.locator(".st-map").scroll_into_view_if_needed()
    for x, y in points:
        tab.mouse.click(*pixel(tab, x, y))


def by_keyboard(tab: Any, points: list[tuple[float, float]]) -> None:
    """Steer the cross to each point, and set it there."""
    tab.keyboard.press("ArrowLeft")
    for point in points:
        said = tab.locator("#world-editor .st-message").inner_text()
        at = [float(word.strip(" ,m.")) for word in said.partition("at ")[2].split(",")]
        for axis, keys in ((0, ("ArrowLeft", "ArrowRight")), (1, ("ArrowDown", "ArrowUp"))):
            steps = round(10 * (point[axis] - at[axis]))
            for key, count in ((f"Shift+{keys[steps > 0]}", abs(steps) // 10), (keys[steps > 0], abs(steps) % 10)):
                for _ in range(count):
                    tab.keyboard.press(key)
        tab.keyboard.press("Space")


def chosen(tab: Any, tool: str, draw: Draw) -> None:
    """Take a tool of the editor."""
    button = tab.get_by_role("button", name=tool, exact=True)
    button.click() if draw is by_mouse else press(tab, button)


def names(folder: Path) -> list[str]:
    return [area.name for area in rvsg.load_world(folder).areas]


WAYS = pytest.mark.parametrize("draw", [by_mouse, by_keyboard])


@pytest.mark.exhaustive
@WAYS
def test_a_polygon_is_drawn_undone_and_made_again(show: Show, office: Path, draw: Draw) -> None:
    labels = office / "labels.yaml"
    before = labels.read_text()
    tab = show("/world?world=office2")
    chosen(tab, "Polygon", draw)
    draw(tab, CORNERS)
    tab.keyboard.press("Enter")
    tab.get_by_role("button", name="Area 1").wait_for()
    outline = rvsg.load_world(office).area("Area 1").outline
    assert shapely.Polygon(outline).symmetric_difference(shapely.Polygon(CORNERS)).area < 1.0
    after = labels.read_text()
    for keys, text in (("Control+z", before), ("Control+Shift+z", after)):
        tab.locator(".st-map").focus()
        with tab.expect_response(lambda answer: "/data/world-" in answer.url and answer.request.method == "POST"):
            tab.keyboard.press(keys)
        assert labels.read_text() == text
    for name, text in (("Undo", before), ("Redo", after)):
        with tab.expect_response(lambda answer: "/data/world-" in answer.url and answer.request.method == "POST"):
            press(tab, tab.get_by_role("button", name=name, exact=True).and_(tab.locator(":enabled")))
        assert labels.read_text() == text


@pytest.mark.exhaustive
@WAYS
def test_an_area_is_split_and_merged_again(show: Show, office: Path, draw: Draw) -> None:
    lounge = shapely.Polygon(rvsg.load_world(office).area("Lounge").outline)
    x0, y0, x1, y1 = lounge.bounds
    tab = show("/world?world=office2")
    press(tab, tab.get_by_role("button", name="Lounge", exact=True))
    chosen(tab, "Split", draw)
    middle = round((x0 + x1) / 2, 1)
    draw(tab, [(middle, y0 + 0.5), (middle, y1 - 0.5)])
    for name in ("Lounge 1", "Lounge 2"):
        tab.get_by_role("button", name=name, exact=True).wait_for()
    parts = [shapely.Polygon(rvsg.load_world(office).area(name).outline) for name in ("Lounge 1", "Lounge 2")]
    assert all(part.area == pytest.approx(lounge.area / 2, rel=0.2) for part in parts)
    assert shapely.union_all(parts).symmetric_difference(lounge).area < 0.1
    press(tab, tab.get_by_role("button", name="Lounge 1", exact=True))
    other = tab.get_by_label("Area to merge with")
    if draw is by_mouse:
        other.select_option("Lounge 2")
        tab.get_by_role("button", name="Merge").click()
    else:
        reach(tab, other)
        tab.keyboard.type("Lounge 2")
        press(tab, tab.get_by_role("button", name="Merge"))
    tab.get_by_role("button", name="Lounge 2", exact=True).wait_for(state="detached")
    merged = rvsg.load_world(office).area("Lounge 1")
    assert shapely.Polygon(merged.outline).symmetric_difference(lounge).area < 0.1
    assert "Lounge 2" not in names(office)


@pytest.mark.exhaustive
@WAYS
def test_a_route_is_drawn_and_the_simulator_drives_it(show: Show, office: Path, draw: Draw) -> None:
    known = rvsg.load_world(office).routes[0]
    ends = [(round(known.start.x, 1), round(known.start.y, 1)), (round(known.goal.x, 1), round(known.goal.y, 1))]
    tab = show("/world?world=office2")
    chosen(tab, "Route", draw)
    draw(tab, ends)
    tab.keyboard.press("Enter")
    tab.get_by_text("With nobody about: ").wait_for(timeout=PATIENT)
    made = rvsg.load_world(office).routes[-1]
    assert made.name not in {route.name for route in rvsg.load_world("office").routes}
    assert (made.start.x, made.start.y, made.goal.x, made.goal.y) == pytest.approx((*ends[0], *ends[1]), abs=0.3)
    assert tab.get_by_text("m wide").count() == 1
    said = tab.get_by_text("With nobody about: ").inner_text()
    assert "the goal was reached" in said
    tab.get_by_label("Stack", exact=True).fill("nav2-rpp")
    tab.keyboard.press("Tab")
    tab.get_by_text(said).wait_for(state="detached", timeout=PATIENT)
    assert tab.get_by_text("With nobody about: ").inner_text() != said


@pytest.mark.exhaustive
def test_escape_drops_what_is_drawn(show: Show, office: Path) -> None:
    before = (office / "labels.yaml").read_text()
    tab = show("/world?world=office2")
    chosen(tab, "Polygon", by_mouse)
    by_mouse(tab, CORNERS)
    tab.keyboard.press("Escape")
    tab.keyboard.press("Enter")
    tab.reload()
    ready(tab)
    assert tab.locator(".st-draft").count() == 0
    assert (office / "labels.yaml").read_text() == before


@pytest.mark.exhaustive
@pytest.mark.parametrize("freely", [False, True])
def test_an_edge_snaps_to_a_wall_unless_alt_is_held(show: Show, office: Path, freely: bool) -> None:
    edges = [e for e in editable_world(office)["edges"] if abs(e[0] - e[2]) < 0.02 and abs(e[1] - e[3]) > 2]
    wall, low, high = edges[0][0], *sorted((edges[0][1], edges[0][3]))
    near = [e[0] for e in edges if e[1] != e[3]]
    at = wall + 0.12 if not any(0 < abs(x - wall - 0.12) < 0.12 for x in near if x != wall) else wall - 0.12
    tab = show("/world?world=office2")
    tab.get_by_role("button", name="Rectangle").click()
    tab.locator(".st-map").scroll_into_view_if_needed()
    if freely:
        tab.keyboard.down("Alt")
    tab.mouse.move(*pixel(tab, at, (low + high) / 2 - 0.4))
    tab.mouse.down()
    tab.mouse.move(*pixel(tab, at + 1.0, (low + high) / 2 + 0.4), steps=4)
    tab.mouse.up()
    tab.keyboard.up("Alt")
    tab.get_by_role("button", name="Area 1").wait_for()
    xs = [x for x, _ in rvsg.load_world(office).area("Area 1").outline]
    assert (min(xs) == pytest.approx(wall, abs=0.011)) is not freely


def test_an_area_and_its_corner_are_dragged(show: Show, office: Path) -> None:
    before = shapely.Polygon(rvsg.load_world(office).area("Lounge").outline)
    x0, y0, x1, y1 = before.bounds
    tab = show("/world?world=office2")
    press(tab, tab.get_by_role("button", name="Lounge", exact=True))
    tab.locator(".st-map").scroll_into_view_if_needed()
    tab.keyboard.down("Alt")

    def dragged(start: tuple[float, float], end: tuple[float, float]) -> tuple[float, ...]:
        with tab.expect_response(lambda answer: "/data/world-edit" in answer.url):
            tab.mouse.move(*pixel(tab, *start))
            tab.mouse.down()
            tab.mouse.move(*pixel(tab, *end), steps=4)
            tab.mouse.up()
        found: tuple[float, ...] = shapely.Polygon(rvsg.load_world(office).area("Lounge").outline).bounds
        return found

    bounds = dragged((x1, y1), (x1 - 0.5, y1 - 0.5))
    assert bounds == pytest.approx((x0, y0, x1 - 0.5, y1 - 0.5), abs=0.1)
    inside = (x0 + 0.4, y0 + 0.4)
    bounds = dragged(inside, (inside[0] + 0.3, inside[1] + 0.2))
    assert bounds == pytest.approx((x0 + 0.3, y0 + 0.2, x1 - 0.2, y1 - 0.3), abs=0.1)


@pytest.mark.exhaustive
@pytest.mark.parametrize("keys", [False, True])
def test_an_area_is_renamed_on_the_map(show: Show, office: Path, keys: bool) -> None:
    labels = office / "labels.yaml"
    labels.write_text(labels.read_text() + "# a comment of mine\n")
    x0, y0, x1, y1 = shapely.Polygon(rvsg.load_world(office).area("Lounge").outline).bounds
    tab = show("/world?world=office2")
    if keys:
        press(tab, tab.get_by_role("button", name="Lounge", exact=True))
        reach(tab, tab.locator(".st-map"))
        tab.keyboard.press("F2")
    else:
        tab.locator(".st-map").scroll_into_view_if_needed()
        tab.mouse.dblclick(*pixel(tab, (x0 + x1) / 2, (y0 + y1) / 2))
    tab.get_by_label("New name of Lounge").wait_for()
    tab.keyboard.type("Tea corner")
    tab.keyboard.press("Enter")
    tab.get_by_role("button", name="Tea corner").wait_for()
    assert "Tea corner" in names(office) and "Lounge" not in names(office)
    assert labels.read_text().endswith("# a comment of mine\n")
