"""The page as people meet it: in a browser, on a phone, with the keyboard, without JavaScript."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest

Show = Callable[..., Any]

TEXTS = """() => [...document.querySelectorAll(".map text, .still text")]
  .filter(node => node.checkVisibility() && getComputedStyle(node).display !== "none")
  .map(node => {
    const box = node.ownerSVGElement, m = node.getScreenCTM();
    const shown = node.getBoundingClientRect(), frame = box.getBoundingClientRect();
    const across = shown.right > frame.left && shown.left < frame.right;
    const inside = across && shown.bottom > frame.top && shown.top < frame.bottom;
    const scale = Math.sqrt(Math.abs(m.a * m.d - m.b * m.c));
    return { text: node.textContent, inside, px: parseFloat(getComputedStyle(node).fontSize) * scale };
  }).filter(each => each.inside)"""


def state(tab: Any) -> dict[str, Any]:
    return tab.evaluate("window.replay.state()")


def open_address(tab: Any, address: str) -> dict[str, Any]:
    tab.evaluate("address => { location.hash = address; }", address)
    tab.wait_for_function(
        "() => new Promise(done => setTimeout(() => window.replay.ready().then(() => done(true)), 0))"
    )
    return state(tab)


@pytest.mark.parametrize("width", [1280, 390])
def test_a_page_that_passes_with_contacts_says_so_above_the_fold(show: Show, width: int) -> None:
    tab = show("contacts", width=width)
    chip = tab.locator(".lead .chip")
    assert chip.inner_text() == "PASS" and "warn" in str(chip.get_attribute("class"))
    box = tab.locator(".strip.warn", has_text="Contact in").bounding_box()
    assert box is not None and box["y"] + box["height"] < 900


def test_every_number_of_runs_in_the_answer_opens_those_runs(show: Show) -> None:
    tab = show("contacts")
    answer = tab.locator(".lead, .card")
    known = set(tab.evaluate("window.replay.runs()"))
    addresses = answer.locator("a").evaluate_all("links => links.map(link => link.getAttribute('href'))")
    addresses += tab.locator(".ranking a").evaluate_all("links => links.map(link => link.getAttribute('href'))")
    assert addresses
    for address in addresses:
        runs = address.split("=", 1)[1].split("&")[0].split(",")
        assert set(runs) <= known
        assert open_address(tab, address)["run"] in runs
        if address.startswith("#runs="):
            assert state(tab)["marked"] == runs
            assert 1 <= tab.locator(".rp-marked").count() <= len(runs)


def test_every_recorded_run_opens_by_its_address_with_its_limit(show: Show) -> None:
    tab = show("contacts")
    runs = tab.evaluate("window.replay.runs()")
    assert len(runs) > 20
    for run in runs:
        found = open_address(tab, f"#run={run}&t=1.5")
        assert (found["run"], found["t"]) == (run, 1.5)
        assert tab.locator(".rp-limit-text").first.text_content() == "limit 1\u00a0m"
        assert tab.locator(".rp-charts .rp-limit").count() == 1


def test_an_address_opens_the_run_when_the_page_is_loaded(show: Show) -> None:
    run = show("contacts").evaluate("window.replay.runs()")[9]
    found = state(show("contacts", at=f"#run={run}&t=2.5"))
    assert (found["run"], found["t"]) == (run, 2.5)


@pytest.mark.parametrize("speed", [pytest.param(0.5, marks=pytest.mark.exhaustive), 5])
def test_playback_is_as_fast_as_it_says(show: Show, speed: float) -> None:
    tab = show("contacts", clock=True)
    tab.evaluate("speed => { replay.setSpeed(speed); replay.seek(0); replay.play(); }", speed)
    tab.clock.run_for(100)
    before = state(tab)["t"]
    tab.clock.run_for(1000)
    found = state(tab)
    assert found["playing"]
    assert found["t"] - before == pytest.approx(speed, rel=0.05)


def test_playback_ends_with_the_run(show: Show) -> None:
    tab = show("contacts", clock=True)
    tab.evaluate("() => { replay.setSpeed(10); replay.seek(0); replay.play(); }")
    tab.clock.run_for(20_000)
    found = state(tab)
    assert not found["playing"] and found["t"] == pytest.approx(found["end"])


def test_the_keyboard_plays_steps_and_chooses(show: Show) -> None:
    tab = show("contacts", clock=True)
    first = state(tab)
    tab.keyboard.press("ArrowRight")
    assert state(tab)["t"] == pytest.approx(first["t"] + 0.1)
    tab.keyboard.press("Shift+ArrowLeft")
    assert state(tab)["t"] == pytest.approx(first["t"] - 0.9)
    assert f"run={first['run']}&t=" in tab.url
    tab.keyboard.press("]")
    tab.evaluate("window.replay.ready()")
    assert state(tab)["run"] != first["run"]
    tab.keyboard.press("+")
    tab.keyboard.press("Space")
    assert state(tab)["playing"] and state(tab)["speed"] == 2
    tab.keyboard.press("Space")
    assert not state(tab)["playing"]


def test_a_dot_of_the_strip_selects_its_run(show: Show) -> None:
    tab = show("contacts")
    dot = tab.locator(".rp-dot").last
    run = dot.get_attribute("data-run")
    dot.click()
    tab.evaluate("window.replay.ready()")
    assert state(tab)["run"] == run
    assert tab.locator(".rp-dot[aria-checked=true]").get_attribute("data-run") == run


def test_two_runs_compared_say_when_they_part(show: Show) -> None:
    tab = show("contacts")
    other = tab.locator(".rp-field select").nth(1).locator("option").nth(2).get_attribute("value")
    tab.evaluate("id => replay.compare(id)", other)
    assert state(tab)["other"] == other
    assert re.search(r"The two runs (part at \d+\.\d s|are alike)", tab.locator(".rp-about").inner_text())
    assert tab.locator(".rp-drawn .rp-robot").count() == 2


@pytest.mark.parametrize(("name", "script"), [("contacts", True), ("contacts", False), ("overview", True)])
def test_text_on_the_maps_can_be_read_on_a_phone(show: Show, name: str, script: bool) -> None:
    tab = show(name, width=390, java_script_enabled=script)
    texts = tab.evaluate(TEXTS)
    assert len(texts) > 4
    assert [each for each in texts if each["px"] < 11] == []


@pytest.mark.parametrize("width", [1280, 390])
def test_no_line_breaks_inside_a_number(show: Show, width: int) -> None:
    tab = show("contacts", width=width)
    words = tab.evaluate(
        """() => [...document.querySelectorAll(".ranking td.n, .card a")].map(node => {
          const range = document.createRange(), walker = document.createTreeWalker(node, NodeFilter.SHOW_TEXT);
          const tops = new Set();
          while (walker.nextNode()) {
            range.selectNodeContents(walker.currentNode);
            [...range.getClientRects()].filter(r => r.width > 0).forEach(r => tops.add(Math.round(r.top)));
          }
          return { text: node.textContent.trim(), tops: tops.size }; })"""
    )
    assert len(words) > 10
    assert [each for each in words if each["tops"] > 1 and " runs" not in each["text"]] == []


@pytest.mark.parametrize("name", ["contacts", "overview"])
def test_the_page_is_not_wider_than_a_phone(show: Show, name: str) -> None:
    tab = show(name, width=390)
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390


@pytest.mark.exhaustive
def test_no_two_involved_people_share_a_colour(show: Show) -> None:
    tab = show("crowd")
    groups = tab.evaluate("JSON.parse(document.getElementById('data').textContent).groups")
    colours = [person["colour"] for person in groups[0]["people"] if person["colour"]]
    assert len(groups[0]["people"]) == 30 and len(colours) > 8
    assert len(set(colours)) == len(colours)
    shown = tab.locator(".rp-drawn .rp-person:not(.rp-uninvolved)").evaluate_all(
        "all => all.map(a => getComputedStyle(a).color)"
    )
    assert len(set(shown)) == len(shown) == len(colours)


@pytest.mark.parametrize(
    "name",
    ["contacts", "overview", *(pytest.param(name, marks=pytest.mark.exhaustive) for name in ("hostile", "traced"))],
)
@pytest.mark.parametrize(
    ("width", "scheme"),
    [(1280, "light"), pytest.param(1280, "dark", marks=pytest.mark.exhaustive), (390, "light")],
)
def test_axe_finds_no_violation(show: Show, name: str, width: int, scheme: str) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    tab = show(name, width=width, color_scheme=scheme, bypass_csp=True)
    tab.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    found = axe.Axe().run(tab).response["violations"]
    assert [(each["id"], [node["target"] for node in each["nodes"]][:3]) for each in found] == []


def test_hostile_text_stays_text(show: Show) -> None:
    tab = show("hostile", width=1280)
    for run in tab.evaluate("window.replay.runs()")[:3]:
        open_address(tab, f"#run={run}")
    tab.evaluate("document.querySelectorAll('details').forEach(each => { each.open = true; })")
    assert tab.locator("body img").count() == 0
    assert "<script>alert(1)" in tab.locator("main").inner_text()


def test_without_javascript_the_page_tells_what_happens(show: Show) -> None:
    tab = show("contacts", java_script_enabled=False)
    assert tab.locator(".story li").count() >= 3
    assert tab.locator(".card svg.still").count() >= 1
    for frame in tab.locator(".card svg.still").all():
        box = frame.bounding_box()
        assert box is not None and box["height"] > 80


def test_the_first_screen_shows_verdict_figures_encounter_and_next_steps(show: Show) -> None:
    tab = show("contacts")
    for part in (".lead h1", ".lead .tiles", "#stage .map", "#stage .rp-lanes", "#stage .rp-play"):
        box = tab.locator(part).first.bounding_box()
        assert box is not None and box["y"] + box["height"] <= 720, part
    assert len(tab.locator(".lead h1, .lead .strip").all_inner_texts()) and state(tab)["playing"] is False
    words = " ".join(tab.locator(".lead h1, .lead .strip, .lead .next span").all_inner_texts()).split()
    assert len(words) <= 60
    shown = [float(v) for v in tab.locator("#map").get_attribute("viewBox").split()]
    tab.get_by_role("button", name="Fit").click()
    whole = [float(v) for v in tab.locator("#map").get_attribute("viewBox").split()]
    assert shown[2] < 0.8 * whole[2], "cropped to the encounter"


def test_another_run_changes_what_people_are_asked_to_do_and_tables_are_filtered_and_sorted(show: Show) -> None:
    tab = show("contacts")
    before = tab.locator(".rp-tasks").text_content()
    other = tab.locator(".ranking tbody tr").last.locator("td a").first.get_attribute("href")
    open_address(tab, str(other))
    assert tab.locator(".rp-tasks").text_content() != before
    rows = tab.locator(".ranking tbody tr")
    heads = tab.locator(".ranking th button")
    heads.first.click()
    numbers = rows.evaluate_all("rows => rows.map(row => row.cells[0].textContent)")
    assert numbers == sorted(numbers, key=lambda number: [int(part) for part in number.split(".")])
    tab.locator(".ranking").locator("xpath=../..").locator("input").fill(f"{numbers[0]}")
    assert 1 <= rows.locator("visible=true").count() < len(numbers) * 8


def test_a_second_replay_with_a_layer_can_be_mounted_and_removed(show: Show) -> None:
    tab = show("contacts")
    tab.evaluate(
        """() => {
          const data = JSON.parse(document.getElementById("data").textContent);
          data.floor = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="-9 -9 18 18"/>';
          const host = document.body.appendChild(document.createElement("div"));
          host.id = "second";
          window.second = rvsgReplay.mount(host, data);
          window.second.addLayer({ id: "mine", label: "Mine", shown: true, has: () => true,
            draw: (group, view) => { group.textContent = "";
              view.node(group, "circle", { r: 0.1, transform: view.matrix(1, 2), "data-t": view.t }); },
            say: () => "Mine is on." });
          return window.second.ready();
        }"""
    )
    tab.evaluate("second.seek(1)")
    mine = tab.locator("#second .rp-layer-mine circle")
    assert mine.get_attribute("data-t") == "1"
    assert "Mine is on." in tab.locator("#second .rp-now").inner_text()
    assert state(tab)["t"] != 1
    tab.locator("#second .rp-layer-switches input").click()
    assert not tab.locator("#second .rp-layer-mine").is_visible()
    tab.evaluate("second.destroy()")
    assert tab.locator("#second").inner_html() == ""


def test_a_trace_is_shown_as_layers_that_can_be_switched(show: Show) -> None:
    tab = show("traced")
    run = tab.evaluate("traces.runs()")[0]
    open_address(tab, f"#run={run}&t=0.3")
    tab.evaluate("traces.ready()")
    assert tab.locator(".rp-layer-switches .rp-switch:visible").count() == 6
    assert "Behaviour tree: spin. Last: Spin RUNNING at 0.3 s." in tab.locator(".rp-now").inner_text()
    assert (
        "Local planner: 0.50 m/s, 0.00 rad/s, score 4.2 (PathDist 4.0, GoalDist 0.2)."
        in tab.locator(".rp-now").inner_text()
    )
    assert tab.locator(".rp-layer-plan path").get_attribute("d") == "M1.00 2.00L2.00 2.00"
    assert tab.locator(".rp-best").get_attribute("d") == "M1.00 2.00L1.80 2.00"
    assert tab.locator(".rp-forbidden").get_attribute("d").startswith("M1.00 2.00A")
    assert tab.locator(".rp-hits").first.get_attribute("d").startswith("M")
    assert tab.locator(".rp-layer-local-costmap image").get_attribute("href").startswith("data:image/png")
    switch = tab.locator(".rp-layer-switches input").nth(1)
    switch.click()
    assert not tab.locator(".rp-layer-local-costmap").is_visible()
    other = next(each for each in tab.evaluate("replay.runs()") if each != run)
    open_address(tab, f"#run={other}")
    assert tab.locator(".rp-layer-switches .rp-switch:visible").count() == 0


def test_a_trace_is_opened_from_its_file_and_another_file_is_refused(show: Show, pages: dict[str, Any]) -> None:
    tab = show("contacts")
    file = pages["traced"].parent / "one.trace.json"
    assert tab.locator(".rp-layer-switches .rp-switch:visible").count() == 0
    tab.locator(".rp-open input").set_input_files(file)
    tab.wait_for_function("() => traces.runs().length === 1")
    tab.evaluate("replay.ready().then(traces.ready)")
    assert state(tab)["run"] == tab.evaluate("traces.runs()[0]")
    assert tab.locator(".rp-layer-switches .rp-switch:visible").count() == 6
    for content in (
        "[]",
        "no JSON",
        '{"format": "rvsg-trace", "version": 9}',
        '{"format": "rvsg-trace", "version": 1}',
    ):
        other = pages["contacts"].parent / "other.json"
        other.write_text(content)
        tab.locator(".rp-open input").set_input_files(other)
        tab.wait_for_function("() => document.querySelector('.rp-note').textContent !== ''")
        tab.evaluate("document.querySelector('.rp-note').textContent = ''")
    assert tab.evaluate("traces.runs().length") == 1


NAMES = """() => { const map = document.getElementById("map").getBoundingClientRect();
  return [...document.querySelectorAll("#map text")].filter(each => each.checkVisibility()).map(each => {
    const box = each.getBoundingClientRect(), air = 0.15 * box.height;
    return { text: each.textContent, box: [box.left, box.top + air, box.right, box.bottom - air],
      cut: box.left < map.left || box.right > map.right || box.top < map.top || box.bottom > map.bottom };
  }); }"""


@pytest.mark.parametrize("name", ["contacts", pytest.param("crowd", marks=pytest.mark.exhaustive)])
def test_no_name_on_the_map_is_cut_or_covers_another_one(show: Show, name: str) -> None:
    tab = show(name)
    for share in (0.2, 0.5, 0.8):
        tab.evaluate("share => replay.seek(share * replay.state().end)", share)
        names = tab.evaluate(NAMES)
        assert len(names) > 2 and [each["text"] for each in names if each["cut"]] == []
        over = [
            (one["text"], two["text"])
            for k, one in enumerate(names)
            for two in names[:k]
            if one["box"][0] < two["box"][2] and two["box"][0] < one["box"][2]
            if one["box"][1] < two["box"][3] and two["box"][1] < one["box"][3]
        ]
        assert over == []


def test_the_film_strip_goes_to_the_moment_that_is_clicked(show: Show) -> None:
    tab = show("contacts")
    film = tab.locator(".rp-film")
    box = film.bounding_box()
    assert box is not None and film.locator("svg .rp-robot").count() >= 3
    tab.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 5)
    assert state(tab)["t"] == pytest.approx(0.75 * state(tab)["end"], abs=0.3)


def test_the_manager_reads_two_printed_pages_before_the_tables(show: Show) -> None:
    tab = show("contacts", width=718)
    tab.emulate_media(media="print")
    assert tab.evaluate("document.getElementById('all').getBoundingClientRect().top + scrollY") <= 2 * 1047
    assert not tab.locator(".rp-play").is_visible() and not tab.locator(".rp-zoom").is_visible()
