"""Settings for all tests, and one headless Chromium for all that look at pages."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

EXAMPLES = int(os.environ.get("RVSG_EXAMPLES", "25"))
"""How many examples a property is tried on that names no number of its own; `make test-exhaustive` tries more."""
settings.register_profile("rvsg", deadline=None, max_examples=EXAMPLES, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("rvsg")

CHROMIUM = next((path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


PHONE_PX = 390
SERVICES = {"browser", "studio"}
"""Fixtures that are services: every test that uses one belongs to the tier `service`."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tiers that follow from what a test uses, so that each test is in one tier.

    A test of a service is `service`, one that repeats another on the screen of a phone is `exhaustive`. Both are
    `slow`, too: `not slow` is the fast tier.
    """
    for item in items:
        parameters = getattr(getattr(item, "callspec", None), "params", {})
        if parameters.get("width") == PHONE_PX:
            item.add_marker("exhaustive")
        if SERVICES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("service")
        if any(item.get_closest_marker(tier) for tier in ("exhaustive", "service")):
            item.add_marker("slow")


@pytest.fixture(autouse=True)
def _runs_in_this_process(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a campaign of a fast test that names no number of jobs start no worker: that takes seconds each."""
    if request.node.get_closest_marker("slow") is None:
        monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0}, raising=False)


@pytest.fixture(scope="session", autouse=True)
def _keeps_no_state(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Keep the state of the user out of the tests, and theirs out of it; processes that they start inherit it."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine")
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        yield started
        started.close()
