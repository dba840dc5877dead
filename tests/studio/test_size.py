"""Large folders: 50 campaigns of 500 attempts, and a campaign of 2,000 runs that is followed while it runs.

Seconds on a clock say nothing on a busy machine. What is asserted is the processor time that the studio spends on an
answer, and that pages answer while a campaign still runs.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
import yaml
from tests.studio.conftest import Server, Show

import rvsg

pytestmark = pytest.mark.exhaustive
PATIENT = 900_000
ANSWER_S = 0.3
CAMPAIGNS, ATTEMPTS = 50, 500
LISTED = "[...document.querySelectorAll('td a')].map(each => each.textContent)"
MANY = {
    "generator": "random", "strategy": "random", "simulator": "kinematic", "scenarios": ATTEMPTS, "refinements": 0,
    "confirmations": 0, "humans": 1, "jobs": 1,
}  # fmt: skip


def processor_s(server: Server) -> float:
    """Processor time that the studio has spent so far, all threads together."""
    fields = Path(f"/proc/{server.process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("large") / "campaign"
    list(rvsg.Campaign.create(folder, **MANY, repeats=1).run())
    return folder


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processor time is read from /proc")
def test_fifty_campaigns_are_listed_at_once_and_answer_quickly(show: Show, studio: Server, large: Path) -> None:
    for k in range(CAMPAIGNS):
        shutil.copytree(large, studio.folder / "runs" / f"c{k:02d}")
    tab = show()
    assert len(tab.evaluate(LISTED)) == CAMPAIGNS + 1  # listed, read or not
    tab.wait_for_function("!document.body.innerText.includes('being read')", timeout=PATIENT)
    assert tab.get_by_text(f"{ATTEMPTS} of {ATTEMPTS}").count() == CAMPAIGNS
    for path in ("/", "/campaign/new", "/compare", "/conversations", "/campaign?folder=runs/c07"):
        tab.request.get(studio.direct + path, headers=studio.cookie)  # the first load
        spent = []
        for _ in range(5):
            before = processor_s(studio)
            assert tab.request.get(studio.direct + path, headers=studio.cookie).status == 200
            spent.append(processor_s(studio) - before)
        assert min(spent) < ANSWER_S, (path, spent)


def test_a_page_that_follows_2000_runs_stays_responsive(show: Show, studio: Server) -> None:
    tab = show("/campaign/new")
    tab.locator("#yaml").fill(yaml.safe_dump(MANY | {"repeats": 4, "out": "runs/live"}))
    tab.wait_for_function("[...document.querySelectorAll('input')].some(e => e.value === 'runs/live')")
    tab.get_by_role("button", name="Start", exact=True).click()
    tab.wait_for_url("**/campaign?folder=runs%2Flive**", timeout=PATIENT)
    seen: set[int] = set()
    answered = 0
    while tab.locator(".chip", has_text="finished").count() == 0:
        seen.add(tab.locator(".chart-box svg circle").count())
        running = tab.get_by_role("button", name="Pause").count()
        other = tab.request.get(f"{studio.direct}/", headers=studio.cookie)
        answered += other.status == 200 and running
        tab.locator("summary", has_text="The same on the command line").click()
        tab.wait_for_timeout(500)
    assert len(rvsg.Campaign.open(studio.folder / "runs" / "live").attempts()) == ATTEMPTS
    assert len(seen) > 3, "the course of the search is drawn while it runs"
    assert answered > 3, "other pages answer while it runs"
    assert tab.evaluate("document.querySelectorAll('*').length") < 6000
