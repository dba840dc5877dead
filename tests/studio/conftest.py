"""A folder of work, the studio that serves it in a process of its own."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import rvsg

HOSTILE = "<img src=x onerror=alert(1)><script>alert(2)</script>"


class Server:
    """A studio in a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.log = folder.parent / f"{folder.name}.log"
        self.start()

    def start(self) -> None:
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "rvsg", "studio", str(self.folder), "--no-browser", "--port", "0"],
                stdout=log,
                stderr=log,
                env={**os.environ, "NUMBA_NUM_THREADS": "1", "RVSG_API_KEY": "of-a-test"},
            )
        for _ in range(600):
            if found := re.search(r"http://\S+/\?token=\S+", self.log.read_text()):
                self.address = found.group()
                break
            assert self.process.poll() is None, self.log.read_text()
            time.sleep(0.1)
        else:
            raise AssertionError(self.log.read_text())
        self.base = self.address.split("/?")[0]

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


@pytest.fixture(scope="session")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a campaign of the simulator without physics; its finished files are never changed."""
    folder = tmp_path_factory.mktemp("work")
    campaign = rvsg.Campaign.create(
        folder / "runs" / "first", scenarios=2, refinements=1, repeats=3, confirmations=6, simulator="kinematic", jobs=1
    )
    for _ in campaign.run():
        pass
    return folder


@pytest.fixture
def studio(tmp_path: Path, work: Path) -> Iterator[Server]:
    """A studio over a copy of the folder, so that a test may change it."""
    pytest.importorskip("nicegui", reason="nicegui is not installed")
    folder = tmp_path / "work"
    shutil.copytree(work, folder)
    server = Server(folder)
    yield server
    with contextlib.suppress(ProcessLookupError):
        server.kill()


@pytest.fixture
def show(browser: Any, studio: Server) -> Iterator[Callable[..., Any]]:
    """Open a page of the studio in a tab; errors of scripts, dialogs and requests elsewhere fail the test."""
    contexts: list[Any] = []
    wrong: list[str] = []

    def opened(path: str = "/", *, width: int = 1280, **how: Any) -> Any:
        context = browser.new_context(viewport={"width": width, "height": 900}, **how)
        contexts.append(context)
        context.set_default_timeout(120_000)
        tab = context.new_page()
        tab.on("pageerror", lambda error: wrong.append(f"error: {error}"))
        tab.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        tab.on("request", lambda request: None if _inside(request.url, studio) else wrong.append(request.url))
        tab.on("dialog", lambda dialog: (wrong.append(f"dialog: {dialog.message}"), dialog.dismiss()))
        tab.goto(studio.address)
        if path != "/":
            tab.goto(studio.base + path)
        tab.wait_for_selector("h1")
        return tab

    yield opened
    for context in contexts:
        context.close()
    assert wrong == []


def _inside(url: str, studio: Server) -> bool:
    return url.startswith((studio.base, studio.base.replace("http", "ws"), "data:", "blob:"))


def confirmed(folder: Path) -> int:
    """The first confirmation of the campaign of the folder."""
    attempts = rvsg.Campaign.open(folder / "runs" / "first").attempts()
    return next(a.index for a in attempts if a.purpose == "confirmation")


def waited(holds: Callable[[], Any], *, seconds: float = 300.0) -> Any:
    """Return what holds as soon as it does; a slow machine is waited for, a broken page is not for ever."""
    end = time.monotonic() + seconds
    while not (found := holds()):
        assert time.monotonic() < end, "it does not come true"
        time.sleep(0.1)
    return found


def axe_violations(tab: Any) -> list[Any]:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    found = axe.Axe().run(tab).response["violations"]
    return [(each["id"], [node["target"] for node in each["nodes"]][:3]) for each in found]
