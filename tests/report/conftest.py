"""The pages that a browser looks at."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.campaign.parts import MemoryLedger, warehouse
from tests.report.test_overview import reported
from tests.report.test_page import NastyGenerator, campaign, default_campaign, page
from tests.report.test_payload import traced

from rvsg.report.overview import Pin, render_overview
from rvsg.report.replay_data import trace_json, trace_view
from rvsg.runs.runner import Evaluator


class Pages(dict[str, Path]):
    """Pages by name, each made when it is asked for first.

    `contacts` passes although robot and people touch, `traced` is the same with a trace, `crowd` has 30 people,
    `hostile` attacks, `overview` shows several campaigns.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder

    def __missing__(self, name: str) -> Path:
        text = overview() if name == "overview" else self.of_campaign(name)
        self[name] = self.folder / f"{name}.html"
        self[name].write_text(text, encoding="utf-8")
        return self[name]

    def of_campaign(self, name: str) -> str:
        changes: dict[str, Any] = {
            "contacts": {"confirmations": 15},
            "crowd": {"humans": 30, "scenarios": 1, "refinements": 0, "confirmations": 3},
            "hostile": {"generator": NastyGenerator()},
        }
        the_plan, attempts, ledger = default_campaign()
        if name in changes:
            ledger = MemoryLedger()
            the_plan, attempts = campaign(ledger, **changes[name])
        if name == "contacts":  # with every metric, as a real campaign measures them
            judge = Evaluator(the_plan.requirement, warehouse())
            attempts = [
                a.replace(measurements=tuple(judge.measure(ledger.run(m.run_id)) for m in a.measurements))
                for a in attempts
            ]
        traces = []
        if name == "traced":
            run = traced(ledger.run(attempts[0].measurements[0].run_id))
            (self.folder / "one.trace.json").write_text(trace_json(run, warehouse()), encoding="utf-8")
            traces = [trace_view(run, warehouse())]
        return page(the_plan, attempts, ledger, traces=traces)


def overview() -> str:
    link, result = reported()
    pin = Pin(link=link, campaign="route_1, R1", x=1.0, y=2.0, world=warehouse(), row=result.answer.rows[0])
    return render_overview([(link, result), ("route_3-R3/report.html", result)], command="rvsg run", pins=[pin])


@pytest.fixture(scope="session")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Pages:
    return Pages(tmp_path_factory.mktemp("pages"))


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
