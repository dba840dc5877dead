"""New campaign, its live page, and a finding: what a person does there, and what is on the disk afterwards."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
import yaml
from tests.studio.conftest import PATIENT, Server, Show, axe_violations, fits, waited

import rvsg

SETTINGS = {"simulator": "kinematic", "strategy": "study", "scenarios": 2, "refinements": 0, "repeats": 2}
SETTINGS |= {"confirmations": 2, "out": "runs/new"}


@pytest.mark.exhaustive
def test_a_campaign_is_written_estimated_started_and_followed(show: Show, studio: Server) -> None:
    tab = show("/campaign/new", width=390, bypass_csp=True)
    tab.get_by_role("spinbutton", name="Scenarios").fill("3")
    tab.wait_for_function("document.getElementById('yaml').value.includes('scenarios: 3')")
    tab.locator("#yaml").fill("scenarios: many\n")
    tab.get_by_text("scenarios", exact=False).and_(tab.locator("[role=alert]")).wait_for()
    tab.locator("#yaml").fill(yaml.safe_dump(SETTINGS))
    tab.wait_for_function("document.querySelector('[role=alert]').textContent === ''")
    tab.wait_for_function("document.querySelector('.st-field input[type=number]') !== null")
    assert tab.get_by_role("spinbutton", name="Scenarios").input_value() == "2"
    tab.get_by_role("button", name="Estimate time and cost").click()
    tab.get_by_text("No model is called").wait_for(timeout=PATIENT)
    tab.get_by_role("button", name="Start", exact=True).click()
    tab.wait_for_url("**/campaign?folder=runs**")
    tab.locator(".chip", has_text="finished").first.wait_for(timeout=PATIENT)
    campaign = rvsg.Campaign.open(studio.folder / "runs" / "new")
    assert campaign.finished and sum(a.purpose == "search" for a in campaign.attempts()) == 2
    tab.locator("#worst-replay .rp-map svg").wait_for(timeout=PATIENT)
    tab.wait_for_function("document.getElementById('worst-replay').replay.state().t > 0", timeout=PATIENT)
    tab.wait_for_function("document.querySelectorAll('.chart-box svg circle').length === 2", timeout=PATIENT)
    assert axe_violations(tab) == []
    assert fits(tab)


def test_a_running_campaign_outlives_the_studio_and_pauses_and_resumes(show: Show, studio: Server) -> None:
    tab = show("/campaign/new")
    tab.locator("#yaml").fill(yaml.safe_dump(SETTINGS | {"scenarios": 4000, "repeats": 3, "jobs": 1}))
    tab.wait_for_function("[...document.querySelectorAll('input')].some(each => each.value === '4000')")
    tab.get_by_role("button", name="Start", exact=True).click()
    tab.wait_for_url("**/campaign?folder=runs**")
    tab.get_by_role("button", name="Pause").wait_for(timeout=PATIENT)
    address = tab.url.removeprefix(studio.base)
    tab.close()
    studio.restart()
    tab = show(address)
    tab.get_by_text("search").and_(tab.get_by_text("/12000")).first.wait_for(timeout=PATIENT)
    tab.get_by_role("button", name="Pause").click()
    tab.get_by_role("button", name="Resume").wait_for(timeout=PATIENT)
    folder = studio.folder / "runs" / "new"
    before = rvsg.Campaign.open(folder).attempts()
    assert 0 < len(before) < 4000
    tab.get_by_role("button", name="Resume").click()
    tab.get_by_role("button", name="Pause").click(timeout=PATIENT)
    tab.get_by_role("button", name="Resume").wait_for(timeout=PATIENT)
    assert rvsg.Campaign.open(folder).attempts()[: len(before)] == before


def test_a_campaign_of_the_command_line_is_followed(show: Show, studio: Server) -> None:
    settings = SETTINGS | {"scenarios": 4000, "jobs": 1, "out": str(studio.folder / "runs" / "typed")}
    campaign = rvsg.Campaign.create(**settings)  # type: ignore[arg-type]
    tab = show("/campaign?folder=runs/typed")
    tab.locator(".chip", has_text="not finished").wait_for()
    running = subprocess.Popen(
        [sys.executable, "-m", "rvsg", "run", "--out", str(campaign.folder)], stderr=subprocess.DEVNULL
    )
    try:
        tab.get_by_text("search · another process").wait_for(timeout=PATIENT)
        assert tab.locator(".chip", has_text="running").count() == 1
        assert tab.get_by_role("button", name="Resume").count() == 0
        tried = tab.get_by_text("configurations tried")
        before = tried.inner_text()
        waited(lambda: tried.inner_text() != before)
    finally:
        running.send_signal(signal.SIGINT)
        running.wait()
    tab.get_by_role("button", name="Resume").wait_for(timeout=PATIENT)
    assert tab.get_by_text("another process").count() == 0


def test_files_outside_the_folder_are_never_shown(show: Show, studio: Server) -> None:
    outside = studio.folder.parent / "outside"
    (studio.folder / "runs" / "first").rename(outside)
    (studio.folder / "runs" / "link").symlink_to(outside)
    tab = show()
    for path in ("../outside", str(outside), "runs/link", "runs/../../outside", str(studio.own)):
        answer = tab.request.get(f"{studio.direct}/data/replay?campaign={path}&attempt=0", headers=studio.cookie)
        assert answer.status == 400
        assert "outside the folder" in answer.json()["error"]
    tab.goto(f"{studio.base}/campaign?folder=../outside")
    assert "outside the folder" in tab.locator("main").inner_text()
