"""Two versions of the robot compared by results of a suite."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from tests.studio.conftest import HOSTILE, Server

import rvsg

Show = Callable[..., Any]
PATIENT = 300_000


@pytest.mark.exhaustive
def test_what_a_version_broke_is_listed_and_replayed(show: Show, studio: Server) -> None:
    crossing = rvsg.scenario("warehouse", "route_1", [rvsg.walk(HOSTILE, "E15", "H15")])
    suite = rvsg.Suite.create(studio.folder / "suite").add(crossing, "R3", name="aisle", title=HOSTILE, expected="pass")
    slow = rvsg.Spec("kinematic", {"robot_speed_m_s": 0.1})
    before = suite.run(simulator="kinematic", version="before", runs=2)
    for result in (before, suite.run(simulator=slow, version="now", runs=2)):
        (studio.folder / f"{result.version}.json").write_text(result.model_dump_json(indent=2))
    (studio.folder / "other.json").write_text('{"suite": 3}')

    tab = show("/compare")
    tab.get_by_role("link", name="Compare two versions").focus()
    tab.keyboard.press("Enter")
    tab.get_by_label("Version before").select_option("before.json")
    tab.get_by_label("Version now").select_option("now.json")
    tab.get_by_label("Suite to replay").select_option("suite")
    tab.get_by_role("button", name="Compare", exact=True).click()
    tab.get_by_role("link", name=HOSTILE).click()
    tab.locator("#replay [data-ready]").wait_for(timeout=PATIENT)
    state = tab.evaluate("document.querySelector('#replay [data-studio]').replay.state()")
    assert state["run"] and state["other"]
    assert tab.locator("main img").count() == 0


def test_results_that_cannot_be_read_are_refused_in_one_message(show: Show, studio: Server) -> None:
    (studio.folder / "other.json").write_text('{"suite": 3}')
    tab = show("/compare/versions?first=other.json&second=other.json")
    assert "other.json" in tab.locator(".st-wrong").inner_text()
    tab = show("/compare/versions?first=../secret.json&second=other.json")
    assert "outside" in tab.locator(".st-wrong").inner_text()
