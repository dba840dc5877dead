"""Two versions of the robot compared by results of a suite."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests.studio.conftest import Server

Show = Callable[..., Any]
PATIENT = 300_000


def test_results_that_cannot_be_read_are_refused_in_one_message(show: Show, studio: Server) -> None:
    (studio.folder / "other.json").write_text('{"suite": 3}')
    tab = show("/compare/versions?first=other.json&second=other.json")
    assert "other.json" in tab.locator(".st-wrong").inner_text()
    tab = show("/compare/versions?first=../secret.json&second=other.json")
    assert "outside" in tab.locator(".st-wrong").inner_text()
