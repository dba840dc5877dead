"""The pages that a browser looks at."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.campaign.parts import MemoryLedger, warehouse
from tests.report.test_overview import reported
from tests.report.test_page import NastyGenerator, campaign, page
from tests.report.test_trace_view import made

from rvsg.report.overview import Pin, render_overview
from rvsg.report.trace_view import trace_json, trace_view


@pytest.fixture(scope="session")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Pages by name: `contacts` passes although robot and people touch; `crowd` has 30 people; `hostile` attacks."""
    folder = tmp_path_factory.mktemp("pages")
    wanted = {
        "contacts": {},
        "crowd": {"humans": 30, "scenarios": 1, "refinements": 0, "confirmations": 3},
        "hostile": {"generator": NastyGenerator()},
    }
    found = {}
    for name, changes in wanted.items():
        ledger = MemoryLedger()
        found[name] = folder / f"{name}.html"
        the_plan, attempts = campaign(ledger, **changes)
        found[name].write_text(page(the_plan, attempts, ledger), encoding="utf-8")
        if name == "contacts":
            run = ledger.run(attempts[0].measurements[0].run_id)
            found["traced"] = folder / "traced.html"
            view = trace_view(made(run), warehouse())
            found["traced"].write_text(page(the_plan, attempts, ledger, traces=[view]), encoding="utf-8")
            (folder / "one.trace.json").write_text(trace_json(made(run), warehouse()), encoding="utf-8")
    link, the_plan, summary = reported()
    row = {
        "campaign": "route_1, R1",
        "scenario": "1. Two people",
        "where": "Shelf 1",
        "happens": "A person stands.",
        "chip": "FAIL",
    }
    row |= {"violated": "15 of 15", "contacts": "0 of 15", "people": "yes"}
    pin = Pin(
        link=link, address="#run=a&t=1.0", name="route_1, R1, scenario 1", x=1.0, y=2.0, world=warehouse(), row=row
    )
    found["overview"] = folder / "overview.html"
    several = [(link, the_plan, summary), ("route_3-R3/report.html", the_plan, summary)]
    text = render_overview(several, command="rvsg run", pins=[pin])
    found["overview"].write_text(text, encoding="utf-8")
    return found


@pytest.fixture
def show(browser: Any, pages: dict[str, Path]) -> Iterator[Callable[..., Any]]:
    """Open a page by its name; errors of its scripts, requests and dialogs fail the test."""
    contexts: list[Any] = []
    wrong: list[str] = []

    def opened(name: str, *, width: int = 1280, clock: bool = False, at: str = "", **how: Any) -> Any:
        context = browser.new_context(viewport={"width": width, "height": 900}, **how)
        contexts.append(context)
        tab = context.new_page()
        tab.on("pageerror", lambda error: wrong.append(f"error: {error}"))
        tab.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        tab.on("request", lambda request: wrong.append(request.url) if not request.url.startswith("file:") else None)
        tab.on("dialog", lambda dialog: (wrong.append(f"dialog: {dialog.message}"), dialog.dismiss()))
        if clock:
            tab.clock.install(time=0)
        tab.goto(pages[name].as_uri() + at)
        if how.get("java_script_enabled", True):
            tab.evaluate("window.replay && window.replay.ready()")
        if clock:
            tab.clock.pause_at(1_000_000)  # from here on time passes only where a test says so
        return tab

    yield opened
    for context in contexts:
        context.close()
    assert wrong == []
