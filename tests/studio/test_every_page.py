"""The main action of every page: on a laptop and a phone, in light and dark, with the keyboard alone.

Every page is checked by axe, too, and must not be wider than its window.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.studio.conftest import (
    HOSTILE,
    PATIENT,
    Server,
    axe_violations,
    confirmed,
    fits,
    press,
    reach,
    ready,
    rewrite,
    waited,
)
from tests.studio.test_worlds import MAP, room_map

import rvsg
from rvsg.app.matrix import Matrix
from rvsg.app.proposal import propose
from rvsg.generation.generator import proposal_json
from rvsg.scenario.builder import load_scenario_in, save_scenario
from rvsg.simulation.archive import runs_text
from rvsg_studio.workspace import notes_of

Open = Callable[[str], Any]
LOOK = (1280, "light")
OTHER_LOOKS = [(1280, "dark"), (390, "light"), (390, "dark")]
TIME = "document.querySelector('[data-studio=replay]').replay.state().t"


@pytest.fixture(
    params=[LOOK, *(pytest.param(look, marks=pytest.mark.exhaustive) for look in OTHER_LOOKS)],
    ids=[f"{width}-{scheme}" for width, scheme in (LOOK, *OTHER_LOOKS)],
)
def opened(request: pytest.FixtureRequest, show: Callable[..., Any]) -> Open:
    width, scheme = request.param
    return partial(show, width=width, color_scheme=scheme, bypass_csp=True)


@pytest.fixture(scope="module")
def more(tmp_path_factory: pytest.TempPathFactory, work: Path) -> Path:
    """What the pages show beside a campaign: four campaigns together, a suite with results, a proposal, runs."""
    folder = tmp_path_factory.mktemp("more")
    shutil.copytree(work / "runs" / "first", folder / "runs" / "second")
    quick = {"simulator": "kinematic", "scenarios": 1, "refinements": 0, "repeats": 2, "confirmations": 2, "jobs": 1}
    listed = {"route": ["route_1", "route_2"], "requirement": ["R1", "R3"], "out": str(folder / "runs" / "all")}
    matrix = Matrix.of(quick | listed, {})
    assert matrix is not None
    list(matrix.run(matrix.create()))
    crossing = rvsg.scenario("warehouse", "route_1", [rvsg.walk("Worker", "E15", "H15")])
    suite = rvsg.Suite.create(folder / "cases").add(crossing, "R3", name="aisle", title=HOSTILE, expected="pass")
    slow = rvsg.Spec("kinematic", {"robot_speed_m_s": 0.1})
    for simulator, version in (("kinematic", "before"), (slow, "now")):
        result = suite.run(simulator=simulator, version=version, runs=2)
        (folder / f"{version}.json").write_text(result.model_dump_json(indent=2))
    (folder / "proposals").mkdir()
    (folder / "proposals" / "good.json").write_text(proposal_json(propose("warehouse", "route_1", "R1", seed=1)))
    save_scenario(crossing, folder / "crossing.json")
    (folder / "runs.jsonl").write_text(runs_text(rvsg.simulate(crossing, range(2), simulator="kinematic")))
    return folder


@pytest.fixture
def full(studio: Server, more: Path) -> Path:
    shutil.copytree(more, studio.folder, dirs_exist_ok=True)
    job = studio.own / "jobs" / "20260101-000000-abcdef"
    job.mkdir(parents=True)
    told = {"kind": "campaign", "title": "Campaign", "command": "rvsg run", "target": "runs/first", "begun_s": 0.0}
    (job / "job.json").write_text(json.dumps(told | {"arguments": {}}))
    (job / "result.json").write_text(json.dumps({"state": "finished", "violated": False}))
    return studio.folder


def is_well(tab: Any) -> None:
    assert axe_violations(tab) == []
    assert fits(tab)
    assert tab.locator("main img[src=x]").count() == 0, "text stays text"


def test_home_leads_to_a_finding(opened: Open) -> None:
    tab = opened("/")
    is_well(tab)
    press(tab, tab.locator(".st-failures a").first)
    tab.wait_for_url("**/finding?**")


def test_world_an_area_is_drawn_and_named(opened: Open, office: Path) -> None:
    tab = opened("/world?world=office2")
    press(tab, tab.get_by_role("button", name="Rectangle"))
    for keys in ("Space", "Shift+ArrowRight", "Shift+ArrowRight", "Shift+ArrowUp", "Space"):
        tab.keyboard.press(keys)
    tab.get_by_label("Name", exact=True).wait_for()
    tab.keyboard.type(HOSTILE)
    tab.keyboard.press("Enter")
    tab.get_by_role("button", name=HOSTILE).wait_for()
    xs, ys = zip(*rvsg.load_world(office).area(HOSTILE).outline, strict=True)
    assert max(xs) - min(xs) == pytest.approx(2.0, abs=0.51)  # both edges may snap by 25 cm
    assert max(ys) - min(ys) == pytest.approx(1.0, abs=0.51)
    drawn = tab.locator(".st-map")
    assert tab.locator(".st-skeleton").count() == 0
    before = drawn.get_attribute("viewBox")
    drawn.hover()
    drawn.focus()
    tab.mouse.wheel(0, -100)
    waited(lambda: drawn.get_attribute("viewBox") != before)
    is_well(tab)


def test_new_world_is_made(opened: Open, studio: Server, tmp_path: Path) -> None:
    (tmp_path / "map.pgm").write_bytes(room_map())
    (tmp_path / "map.yaml").write_text(MAP)
    tab = opened("/world/new")
    press(tab, tab.get_by_role("button", name="Make the world"))
    tab.get_by_role("alert").get_by_text("Give the new world a folder.").wait_for()
    tab.get_by_label("Files").set_input_files([tmp_path / "map.yaml", tmp_path / "map.pgm"])
    tab.get_by_text("Received: map.pgm, map.yaml").wait_for()
    assert tab.get_by_label("Folder").input_value() == "map"
    rewrite(tab, tab.get_by_label("Folder"), "made")
    waited(lambda: tab.get_by_role("alert").inner_text() == "")
    is_well(tab)
    press(tab, tab.get_by_role("button", name="Make the world"))
    tab.wait_for_url("**/world?world=made", timeout=PATIENT)
    ready(tab)
    assert len(rvsg.load_world(studio.folder / "made").grid.valid) > 5


def test_description_is_edited_and_accepted(opened: Open, office: Path) -> None:
    tab = opened("/describe?world=office2")
    rewrite(tab, tab.locator("#text-layout"), "The Lounge lies in the south, not in Office 77.")
    rewrite(tab, tab.locator("#text-grid"), "Rows A to H.")
    tab.locator("mark.st-unknown", has_text="Office 77").wait_for()
    reach(tab, tab.get_by_role("button", name="Lounge"))
    assert tab.evaluate("document.querySelector('polygon.st-chosen').getAttribute('data-area')") == "lounge"
    press(tab, tab.get_by_role("button", name="Accept", exact=True))
    tab.get_by_text("Stored in").wait_for()
    kept = rvsg.load_world(office).description
    assert kept is not None and kept.reviewed and kept.grid == "Rows A to H."
    is_well(tab)


def test_scenario_is_changed_tried_and_saved(opened: Open, studio: Server) -> None:
    tab = opened(f"/scenario?campaign=runs/first&attempt={confirmed(studio.folder)}")
    rewrite(tab, tab.get_by_label("Speed, m/s"), "0.45")
    tab.keyboard.press("Tab")
    tab.get_by_text("of 20 runs violate").wait_for(timeout=PATIENT)
    press(tab, tab.get_by_role("button", name="Save the scenario"))
    tab.get_by_text("Saved as scenarios/edited.json").wait_for()
    saved, _ = load_scenario_in(studio.folder / "scenarios" / "edited.json")
    assert saved.people.humans[0].speed_m_s == 0.45
    is_well(tab)


def test_new_scenario_is_opened(opened: Open) -> None:
    tab = opened("/scenario")
    reach(tab, tab.get_by_label("World"))
    tab.keyboard.type("office")
    press(tab, tab.get_by_role("button", name="Open", exact=True))
    tab.wait_for_url("**/scenario?world=office**")
    ready(tab)
    is_well(tab)


def test_proposal_is_accepted(opened: Open, full: Path) -> None:
    tab = opened("/inbox")
    is_well(tab)
    press(tab, tab.get_by_role("button", name="Accept good"))
    tab.get_by_text("Kept as scenarios/good.json").wait_for()
    scenario, world = load_scenario_in(full / "scenarios" / "good.json")
    assert rvsg.check(scenario, world) == ()


def test_campaign_is_written_started_and_paused(opened: Open, studio: Server) -> None:
    tab = opened("/campaign/new")
    settings = {"world": "warehouse", "simulator": "kinematic", "strategy": "study", "scenarios": 4000}
    rewrite(tab, tab.locator("#yaml"), yaml.safe_dump(settings | {"refinements": 0}))
    tab.wait_for_function("[...document.querySelectorAll('input')].some(each => each.value === '4000')")
    tab.wait_for_timeout(500)  # the form is laid out anew for every keystroke
    rewrite(tab, tab.get_by_label("Folder"), "runs/new")
    tab.wait_for_function("document.getElementById('yaml').value.includes('out: runs/new')")
    is_well(tab)
    press(tab, tab.get_by_role("button", name="Start", exact=True))
    tab.wait_for_url("**/campaign?folder=runs**")
    press(tab, tab.get_by_role("button", name="Pause"))
    tab.get_by_role("button", name="Resume").wait_for(timeout=PATIENT)
    assert 0 <= len(rvsg.Campaign.open(studio.folder / "runs" / "new").attempts()) < 4000
    is_well(tab)


def test_campaign_leads_to_its_candidates(opened: Open) -> None:
    tab = opened("/campaign?folder=runs/first")
    is_well(tab)
    press(tab, tab.locator(".st-row a").first)
    tab.wait_for_url("**/finding?**")


def test_campaigns_together_lead_to_each(opened: Open, full: Path) -> None:
    tab = opened("/matrix?folder=runs/all")
    tab.wait_for_function("document.querySelectorAll('td a').length === 4")
    is_well(tab)
    press(tab, tab.locator("td a").nth(3))
    tab.wait_for_url("**/campaign?folder=runs%2Fall%2F**")


def test_finding_is_replayed_and_noted(opened: Open, studio: Server) -> None:
    folder, index = studio.folder / "runs" / "first", confirmed(studio.folder)
    tab = opened(f"/finding?campaign=runs/first&attempt={index}")
    before = tab.evaluate(TIME)
    tab.keyboard.press("ArrowRight")
    assert tab.evaluate(TIME) > before
    press(tab, tab.get_by_role("tab", name="Events"))
    for _ in range(4):
        tab.keyboard.press("ArrowRight")
    reach(tab, tab.get_by_label("Status"))
    tab.keyboard.type("accepted")
    rewrite(tab, tab.get_by_label("Comment"), HOSTILE)
    scenario = rvsg.Campaign.open(folder).attempts()[index].proposal.scenario
    assert scenario is not None

    def kept() -> bool:
        note = notes_of(folder).findings.get(scenario.id)
        return note is not None and (note.status, note.comment) == ("accepted", HOSTILE)

    waited(kept)
    is_well(tab)


def test_compare_two_campaigns(opened: Open, full: Path) -> None:
    tab = opened("/compare")
    for place, text in enumerate(("runs/first", "runs/second")):
        reach(tab, tab.locator("main select").nth(place))
        tab.keyboard.type(text)
        tab.locator("main select").nth(1).locator("option:enabled", has_text="runs/second").wait_for(state="attached")
    assert tab.locator("option", has_text="the same campaign").is_disabled()
    press(tab, tab.get_by_role("button", name="Compare", exact=True))
    tab.wait_for_url("**/compare?a=runs%2Ffirst&b=runs%2Fsecond")
    assert tab.locator("#scatter circle").count() >= 1
    assert tab.locator("#matrix .chip", has_text="unchanged").count() >= 1
    is_well(tab)
    press(tab, tab.get_by_role("link", name="Replay attempts").first)
    tab.locator("[data-studio=replay][data-ready]").nth(1).wait_for()
    press(tab, tab.get_by_role("button", name="Play both"))
    times = "[...document.querySelectorAll('[data-studio=replay]')].map(e => e.replay.state().t)"
    tab.wait_for_function(f"{times}.every(t => t > 0)")
    is_well(tab)


def test_compare_two_versions(opened: Open, full: Path) -> None:
    tab = opened("/compare/versions")
    chosen = {"Version before": "before.json", "Version now": "now.json", "Suite to replay": "cases"}
    for label, text in chosen.items():
        reach(tab, tab.get_by_label(label))
        tab.keyboard.type(text)
    press(tab, tab.get_by_role("button", name="Compare", exact=True))
    tab.wait_for_url("**first=before.json**suite=cases**")
    press(tab, tab.get_by_role("link", name=HOSTILE))
    ready(tab)
    state = tab.evaluate("document.querySelector('[data-studio=replay]').replay.state()")
    assert state["run"] and state["other"]
    is_well(tab)


def test_conversations_are_searched_and_opened(opened: Open) -> None:
    tab = opened("/conversations")
    press(tab, tab.get_by_role("link", name="runs/first"))
    tab.wait_for_url("**/conversations?folder=**")
    rewrite(tab, tab.get_by_label("Search"), "no such words anywhere")
    tab.get_by_role("status").get_by_text("0 of").wait_for()
    rewrite(tab, tab.get_by_label("Search"), "a")
    tab.locator(".thought").first.wait_for()
    press(tab, tab.locator(".thought > summary").first)
    tab.locator(".thought[open] h3").first.wait_for()
    is_well(tab)


def test_suite_leads_to_the_scenario_of_a_case(opened: Open, full: Path) -> None:
    tab = opened("/suite?suite=cases")
    is_well(tab)
    press(tab, tab.get_by_role("link", name=HOSTILE))
    tab.wait_for_url("**/scenario?suite=cases&case=aisle")
    ready(tab)
    assert tab.get_by_role("button", name="Remove Worker").count() == 1


def test_runs_are_replayed(opened: Open, full: Path) -> None:
    tab = opened("/runs?file=runs.jsonl&scenario=crossing.json")
    before = tab.evaluate(TIME)
    tab.keyboard.press("ArrowRight")
    assert tab.evaluate(TIME) > before
    is_well(tab)


def test_job_leads_to_its_campaign(opened: Open, full: Path) -> None:
    tab = opened("/job?job=20260101-000000-abcdef")
    tab.locator(".st-job", has_text="finished").wait_for()
    is_well(tab)
    press(tab, tab.get_by_role("link", name="Open the campaign"))
    tab.wait_for_url("**/campaign?folder=runs%2Ffirst")
