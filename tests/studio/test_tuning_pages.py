"""A stack is tuned in the studio: the form, the live front, another setting, the file, and a kill in between."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from tests.app.test_tuning import PLANNER, STILL, made_tuning, suite_of
from tests.studio.conftest import (
    HOSTILE,
    PATIENT,
    Server,
    Show,
    axe_violations,
    confirmed,
    fits,
    press,
    reach,
    waited,
)

import rvsg
from rvsg.tune.tuner import RUNS
from rvsg.tune.tuning import Choice, Tuning
from rvsg.tune.tuning_page import headline
from rvsg_studio.workspace import Jobs

LOOKS = pytest.mark.parametrize("look", [(1280, "light"), pytest.param((390, "dark"), marks=pytest.mark.exhaustive)])
EXAMPLES = Path(__file__).parents[2] / "examples" / "stacks"


@pytest.fixture
def folder(studio: Server) -> Path:
    """A suite in which a planner of a Python file fails."""
    (studio.folder / "planner.py").write_text(PLANNER)
    (studio.folder / "still.yaml").write_text(STILL)
    shutil.copy(EXAMPLES / "follow_the_plan.py", studio.folder)
    suite_of(str(studio.folder / "cases"), cases=1)
    return studio.folder


def is_well(tab: Any) -> None:
    assert axe_violations(tab) == []
    assert fits(tab)


def write(tab: Any, **fields: str) -> None:
    for key, text in fields.items():
        tab.locator(f"#{key}").fill(text)


@pytest.mark.slow
def test_a_tuning_is_followed_killed_resumed_chosen_and_saved(show: Show, studio: Server, folder: Path) -> None:
    tab = show("/suite?suite=cases")
    tab.get_by_role("link", name="Tune a stack on it").click()
    tab.wait_for_url("**/tune?suite=cases")
    write(tab, stack="planner.py:Waits", budget_runs="60", attack_runs="0", out="runs/tuned")
    tab.get_by_role("button", name="Tune", exact=True).click()
    tab.wait_for_url("**/tuning?folder=runs%2Ftuned")
    tab.get_by_text(re.compile("search: [0-9]+ of 60 runs")).wait_for(timeout=PATIENT)
    tab.get_by_role("region", name="Front").get_by_role("row").nth(1).wait_for()
    jobs = Jobs(studio.own / "jobs", studio.folder)
    (job,) = jobs.all()
    tab.close()
    studio.restart()
    assert jobs.get(job.id).running, "a tuning outlives the studio"
    jobs.stop(job.id)
    stored = (folder / "runs" / "tuned" / RUNS).read_text()
    assert len(stored.splitlines()) >= 6

    tab = show("/tuning?folder=runs/tuned", bypass_csp=True)
    tab.get_by_role("button", name="Resume").click()
    save = tab.get_by_role("link", name="Save stack.json")
    save.wait_for(timeout=PATIENT)
    assert (folder / "runs" / "tuned" / RUNS).read_text().startswith(stored)
    found = Tuning.from_json((folder / "runs" / "tuned" / "tuning.json").read_text())
    tab.locator("strong", has_text=headline(found)).wait_for()
    is_well(tab)
    with tab.expect_download() as saved:
        save.click()
    assert Path(saved.value.path()).read_bytes() == (folder / "runs" / "tuned" / "stack.json").read_bytes()
    for other in (each.number for each in found.front if each.number not in (0, found.proposal)):
        tab.get_by_role("button", name=f"Propose setting {other}").click()
        row = tab.locator("tr", has_text="proposed")
        row.get_by_role("cell", name=str(other), exact=True).wait_for(timeout=PATIENT)
        break
    tab = show("/data/tuning?folder=runs/tuned")
    assert tab.locator("h1").inner_text() and tab.evaluate("origin") == "null", "scripts of a file stay outside"
    tab = show("/suite?suite=cases")
    tab.get_by_role("link", name="Tuning of planner.py:Waits").click()
    tab.wait_for_url("**/tuning?folder=runs%2Ftuned")


@LOOKS
def test_a_result_can_be_read_on_any_screen(show: Show, studio: Server, folder: Path, look: tuple[int, str]) -> None:
    suite = rvsg.Suite.open(folder / "cases")
    cases = [suite.tested(case.name) for case in suite.cases]
    front = tuple(Choice(number=k, values={"wait_s": 9.0 - k}, score=made_tuning(cases).before) for k in (3, 4))
    found = made_tuning(cases, front=front, proposal=3, file="stack.json", failed=(HOSTILE,))
    job = studio.own / "jobs" / "20260101-000000-abcdef"
    for place in (job, folder / "runs" / "read"):
        place.mkdir(parents=True)
    (folder / "runs" / "read" / "tuning.json").write_text(found.to_json())
    told = {"kind": "tuning", "title": "Tuning", "command": "rvsg tune", "target": "runs/read", "begun_s": 0.0}
    (job / "job.json").write_text(json.dumps(told | {"arguments": {"suite": "cases"}}))
    (job / "result.json").write_text(json.dumps({"state": "paused", "reason": HOSTILE}))
    tab = show("/job?job=20260101-000000-abcdef", width=look[0], color_scheme=look[1], bypass_csp=True)
    press(tab, tab.get_by_role("link", name="Open the tuning"))
    tab.get_by_text("Not shown to help").wait_for()
    for name in ("Resume", "Propose setting 4"):
        reach(tab, tab.get_by_role("button", name=name))
    assert tab.get_by_role("row").filter(has_text="proposed").inner_text().startswith("3")
    is_well(tab)
    assert tab.locator("main img[src=x]").count() == 0, "text stays text"


@LOOKS
def test_each_mistake_is_told_beside_its_field(show: Show, folder: Path, look: tuple[int, str]) -> None:
    tab = show("/tune?suite=cases", width=look[0], color_scheme=look[1], bypass_csp=True)
    good = {"stack": "nav2-dwb", "budget_minutes": "", "attack_runs": "0", "suite": "cases", "budget_runs": "60"}
    for key, text, said in (
        ("stack", "nav2-dbw", "nav2-dwb"),
        ("stack", "missing.yaml", "missing.yaml"),
        ("budget_minutes", "soon", "expected a number from 0.1 on"),
        ("attack_runs", "1.5", "expected a whole number from 0 on"),
        ("suite", "../elsewhere", "outside the folder"),
        ("suite", "runs", "there is no suite here"),
        ("budget_runs", "5", "Give at least 6."),
        ("out", "../elsewhere", "outside the folder"),
    ):
        write(tab, **{**good, key: text})
        tab.get_by_role("button", name="Tune", exact=True).click()
        tab.locator(f"#wrong-{key}", has_text=said).wait_for()
        told = [each for each in tab.get_by_role("alert").all_inner_texts() if each]
        assert len(told) == 1
    is_well(tab)
    tab.reload()
    assert tab.locator("#out").input_value() == "../elsewhere", "what is typed is kept"


def test_a_finding_is_kept_in_a_suite_and_tuned_and_its_job_says_why_not(show: Show, studio: Server) -> None:
    tab = show(f"/finding?campaign=runs/first&attempt={confirmed(studio.folder)}")
    tab.get_by_role("link", name="Tune", exact=True).click()
    tab.get_by_text("The finding is first kept as a case of the suite").wait_for()
    write(tab, suite="mine", stack="nav2-dwb", budget_runs="5")
    tab.get_by_role("button", name="Tune", exact=True).click()
    tab.locator("#wrong-budget_runs", has_text="Give at least 6.").wait_for()
    write(tab, budget_runs="6", budget_minutes="0.1", stack="stay.py:Still")
    tab.get_by_role("button", name="Tune", exact=True).click()
    tab.get_by_text("stay.py: there is no such file").first.wait_for(timeout=PATIENT)
    assert len(rvsg.Suite.open(studio.folder / "mine").cases) == 1
    tab.get_by_role("link", name="Change the settings").click()
    tab.wait_for_url("**/tune?suite=mine")


def test_a_folder_without_a_tuning_says_so(show: Show, studio: Server) -> None:
    tab = show("/tuning?folder=runs/first")
    tab.get_by_text("runs/first: there is no tuning here.").wait_for()
    waited(lambda: show("/tune?campaign=runs/first&attempt=9999").get_by_text("is no confirmed failure").count())
