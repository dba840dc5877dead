"""Campaigns on several routes and requirements from the form, as one job, and a candidate confirmed at once."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from tests.studio.conftest import PATIENT, Server, Show, axe_violations, waited

import rvsg
from rvsg.app.matrix import Matrix
from rvsg_studio.workspace import Jobs

SETTINGS = {"simulator": "kinematic", "scenarios": 1, "refinements": 0, "repeats": 2, "confirmations": 2, "jobs": 1}


@pytest.mark.exhaustive
def test_every_route_with_every_requirement_is_a_campaign(show: Show, studio: Server) -> None:
    tab = show("/campaign/new", bypass_csp=True)
    tab.locator("#yaml").fill(yaml.safe_dump(SETTINGS | {"out": "runs/all"}))
    tab.wait_for_function("[...document.querySelectorAll('.st-field input')].some(e => e.value === 'runs/all')")
    tab.get_by_label("route_2", exact=True).check()
    tab.wait_for_function("document.getElementById('yaml').value.includes('- route_2')")
    tab.get_by_label("R3:").focus()
    tab.keyboard.press("Space")
    tab.get_by_text("4 campaigns, one for each route and requirement.").wait_for(timeout=PATIENT)
    assert axe_violations(tab) == []
    tab.get_by_role("button", name="Estimate time and cost").click()
    tab.get_by_text("16 runs").wait_for(timeout=PATIENT)
    tab.get_by_role("button", name="Start", exact=True).click()
    tab.wait_for_url("**/matrix?folder=runs%2Fall", timeout=PATIENT)
    tab.locator(".chip", has_text="finished").wait_for(timeout=PATIENT)
    matrix = Matrix.open(studio.folder / "runs" / "all")
    assert set(matrix.pairs) == {(route, name) for route in ("route_1", "route_2") for name in ("R1", "R3")}
    assert [each.finished for each in matrix.campaigns()] == [True] * 4
    tab.wait_for_function("document.querySelectorAll('td a').length === 4")
    tab.locator("td a").first.click()
    tab.locator(".chip", has_text="finished").first.wait_for(timeout=PATIENT)


def test_campaigns_together_pause_and_resume(show: Show, studio: Server) -> None:
    tab = show("/campaign/new")
    many = SETTINGS | {"scenarios": 2000, "confirmations": 0, "out": "runs/all", "route": ["route_1", "route_2"]}
    tab.locator("#yaml").fill(yaml.safe_dump(many))
    tab.get_by_text("2 campaigns, one for each").wait_for(timeout=PATIENT)
    tab.get_by_role("button", name="Start", exact=True).click()
    tab.wait_for_url("**/matrix?folder=runs%2Fall", timeout=PATIENT)
    tab.wait_for_function("/[1-9]\\d* of 2000/.test(document.querySelector('td a')?.textContent)", timeout=PATIENT)
    tab.get_by_role("button", name="Pause").click()
    tab.get_by_role("button", name="Resume").wait_for(timeout=PATIENT)
    tab.locator(".chip", has_text="paused").wait_for(timeout=PATIENT)
    before = [each.attempts() for each in Matrix.open(studio.folder / "runs" / "all").campaigns()]
    assert 0 < sum(len(each) for each in before) < 4000
    tab.get_by_role("button", name="Resume").click()
    tab.get_by_role("button", name="Stop now").click(timeout=PATIENT)
    tab.get_by_role("button", name="Resume").wait_for(timeout=PATIENT)
    after = [each.attempts() for each in Matrix.open(studio.folder / "runs" / "all").campaigns()]
    for old, new in zip(before, after, strict=False):
        assert new[: len(old)] == old


@pytest.mark.exhaustive
def test_a_job_that_has_not_begun_yet_is_paused(tmp_path: Path) -> None:
    settings = SETTINGS | {"scenarios": 2000, "confirmations": 0}
    rvsg.Campaign.create(tmp_path / "runs", **settings)  # type: ignore[arg-type]
    jobs = Jobs(tmp_path / "jobs", tmp_path)
    job = jobs.start("campaign", title="Campaign", command="", target="runs", folder="runs", name=None)
    jobs.pause(job.id)
    waited(lambda: not jobs.get(job.id).running and not jobs._children)
    assert jobs.get(job.id).state in ("paused", "ended")
    assert len(rvsg.Campaign.open(tmp_path / "runs").attempts()) < 3


def test_a_candidate_is_confirmed_now(show: Show, studio: Server) -> None:
    folder = studio.folder / "runs" / "more"
    campaign = rvsg.Campaign.create(
        folder, scenarios=8, refinements=0, repeats=3, confirmations=0, simulator="kinematic", jobs=1
    )
    list(campaign.run())
    tab = show("/campaign?folder=runs/more")
    tab.locator(".st-row", has_text="candidate").first.get_by_role("link").click()
    tab.wait_for_url("**/finding?**", timeout=PATIENT)
    candidate = int(tab.url.partition("attempt=")[2])
    tab.get_by_role("button", name="Confirm now").click()
    tab.get_by_role("link", name="Open the finding").wait_for(timeout=PATIENT)
    found = [a for a in rvsg.Campaign.open(folder).attempts() if a.purpose == "confirmation"]
    assert [a.confirms for a in found] == [candidate]
