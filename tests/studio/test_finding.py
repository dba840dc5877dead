"""What can be done with a finding: traces, shrinking, runs without people, exports, status."""

from __future__ import annotations

import json
import shutil
from functools import partial
from pathlib import Path

import pytest
import yaml
from tests.studio.conftest import PATIENT, Server, Show, axe_violations, confirmed, fits, waited

import rvsg
from rvsg.scenario.builder import load_scenario_in
from rvsg_studio.listing import Lister


def test_the_page_fills_the_window_and_another_run_changes_everything(show: Show, studio: Server) -> None:
    index = confirmed(studio.folder)
    row = rvsg.Campaign.open(studio.folder / "runs" / "first").answer.row(index)
    tab = show(f"/finding?campaign=runs/first&attempt={index}")
    assert tab.locator("h1").inner_text() == row.name
    assert row.share in tab.locator(".st-head").inner_text()
    assert tab.evaluate("document.documentElement.scrollHeight <= innerHeight")
    state = "document.getElementById('replay').replay.state()"
    chosen, told = tab.locator(".st-run-list [aria-pressed=true]"), tab.locator(".rp-about")
    assert (tab.evaluate(state)["run"], tab.evaluate(state)["t"]) == (row.run, row.moment_s)
    before = tab.evaluate(state)["run"], chosen.get_attribute("title"), told.inner_text()
    assert str(chosen.get_attribute("title")).rpartition(" ")[2] in before[2]
    tab.keyboard.press("]")
    waited(lambda: tab.evaluate(state)["run"] != before[0])
    after = tab.evaluate(state)["run"], chosen.get_attribute("title"), told.inner_text()
    assert all(x != y for x, y in zip(before, after, strict=True))
    assert str(after[1]).rpartition(" ")[2] in after[2]


def test_keys_go_through_the_findings_in_the_order_of_home(show: Show, studio: Server) -> None:
    shutil.copytree(studio.folder / "runs" / "first", studio.folder / "runs" / "second")
    found = Lister(studio.folder).listing().failures
    tab = show()
    waited(lambda: tab.locator(".st-failures tbody tr").count() == len(found) > 1)
    tab.locator(".st-failures a").first.click()
    tab.wait_for_url("**/finding?**")
    for key, place in (("j", 1), ("k", 0)):
        campaign, failure = found[place]
        tab.wait_for_selector("[data-ready]")
        tab.keyboard.press(key)
        folder = campaign.folder.replace("/", "%2F")
        tab.wait_for_url(f"**/finding?campaign={folder}&**attempt={failure.row.confirmation}")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of the simulator with physics, which records traces: one configuration, one run."""
    folder = tmp_path_factory.mktemp("made") / "driven"
    campaign = rvsg.Campaign.create(folder, scenarios=1, refinements=0, repeats=1, confirmations=0, humans=1, jobs=1)
    list(campaign.run())
    return folder


@pytest.fixture
def driven(studio: Server, made: Path) -> str:
    shutil.copytree(made, studio.folder / "runs" / "driven")
    return "runs/driven"


@pytest.mark.exhaustive
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_a_run_is_traced_on_demand_and_its_layers_are_switched(
    show: Show, studio: Server, driven: str, width: int, scheme: str
) -> None:
    tab = show(f"/finding?campaign={driven}&attempt=0", width=width, color_scheme=scheme, bypass_csp=True)
    layers = tab.get_by_role("group", name="Layers")
    assert not layers.is_visible()
    make = tab.get_by_role("button", name="Trace this run")
    make.focus()
    make.press("Enter")
    tab.get_by_role("button", name="This run is traced").wait_for(timeout=PATIENT)
    names = [label.inner_text().strip() for label in layers.locator("label").all()]
    assert names == ["Global costmap", "Local costmap", "Plan", "Local trajectories", "Lidar", "Behaviour tree"]
    drawn = "document.querySelectorAll('.rp-layer-lidar path').length"
    tab.evaluate("document.getElementById('replay').replay.seek(2)")
    assert tab.evaluate(drawn) >= 1
    assert tab.locator(".rp-layer-plan path").get_attribute("d").count("L") > 5
    layers.get_by_label("Lidar").uncheck()
    assert tab.locator(".rp-layer-lidar").evaluate("e => e.style.display") == "none"
    layers.get_by_label("Global costmap").check()
    assert tab.locator(".rp-layer-global-costmap image").get_attribute("href").startswith("data:image/png")
    assert fits(tab)
    assert axe_violations(tab) == []
    run = tab.evaluate("document.getElementById('replay').replay.state().run")
    kept = json.loads((studio.folder / driven / "traces" / f"{run}.trace.json").read_text())
    assert kept["run"] == run


def test_a_run_of_a_simulator_without_traces_says_so(show: Show, studio: Server) -> None:
    tab = show(f"/finding?campaign=runs/first&attempt={confirmed(studio.folder)}")
    run = tab.evaluate("document.getElementById('replay').replay.state().run")
    trace = partial(tab.request.post, f"{studio.direct}/data/trace", headers=studio.cookie)
    answer = trace(data={"campaign": "runs/first", "run": run})
    assert (answer.status, '"kinematic"' in answer.json()["error"]) == (400, True)
    answer = trace(data={"campaign": "runs/first", "run": "../../ledger"})
    assert answer.status == 400


@pytest.mark.exhaustive
def test_a_finding_is_shrunk(show: Show, studio: Server) -> None:
    index = confirmed(studio.folder)
    tab = show(f"/finding?campaign=runs/first&attempt={index}")
    tab.get_by_role("button", name="Shrink").click()
    line = tab.locator(".st-job", has_text="Shrink")
    line.get_by_role("link", name="Open the smallest scenario").wait_for(timeout=PATIENT)
    found, world = load_scenario_in(studio.folder / f"runs/first/attempt-{index}-smallest.json")
    attempts = rvsg.Campaign.open(studio.folder / "runs" / "first").attempts()
    original = attempts[index].proposal.scenario
    assert original is not None
    assert sum(len(each.tasks) for each in found.people.humans) <= sum(
        len(each.tasks) for each in original.people.humans
    )
    assert rvsg.check(found, world) == ()
    line.get_by_role("link", name="Open the smallest scenario").click()
    tab.locator("[data-studio=scenario][data-ready]").wait_for(timeout=PATIENT)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("button", "job", "file"),
    [("30 more runs", "30 more runs", ""), ("Without people", "Runs without people", "-alone")],
)
def test_a_finding_is_run_again_with_and_without_people(
    show: Show, studio: Server, button: str, job: str, file: str
) -> None:
    index = confirmed(studio.folder)
    tab = show(f"/finding?campaign=runs/first&attempt={index}", width=390)
    tab.get_by_role("button", name=button).focus()
    tab.keyboard.press("Enter")
    line = tab.locator(".st-job", has_text=job)
    line.get_by_role("link", name="Replay these runs").wait_for(timeout=PATIENT)
    runs = rvsg.load_runs(studio.folder / f"runs/first/attempt-{index}{file}-runs.jsonl")
    assert sorted(run.seed for run in runs) == list(range(900_000, 900_030))
    assert all((run.human_names == ()) is bool(file) for run in runs)
    line.get_by_role("link", name="Replay these runs").click()
    tab.locator("#replay[data-ready]").wait_for(timeout=PATIENT)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("kind", "suffix"), [("hunav", "yaml"), ("csv", "csv"), ("osc", "osc")])
def test_a_finding_is_exported(show: Show, studio: Server, kind: str, suffix: str) -> None:
    index = confirmed(studio.folder)
    tab = show(f"/finding?campaign=runs/first&attempt={index}")
    tab.get_by_label("Format of the export").select_option(kind)
    tab.get_by_role("button", name="Export").click()
    tab.get_by_text("Written: runs/first/").wait_for(timeout=PATIENT)
    text = (studio.folder / f"runs/first/attempt-{index}-{kind}.{suffix}").read_text()
    people = rvsg.Campaign.open(studio.folder / "runs" / "first").attempts()[index].proposal.scenario.people.humans  # type: ignore[union-attr]
    assert text.strip()
    if kind == "hunav":
        agents = yaml.safe_load(text)["hunav_loader"]["ros__parameters"]["agents"]
        assert len(agents) == len(people)
