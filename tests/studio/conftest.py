"""A folder of work, one studio that serves it to all tests, and the browser's side of a test."""

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
from urllib.parse import urlsplit

import pytest

import rvsg
from rvsg_studio.server import Guard
from rvsg_studio.workspace import Jobs, own_folder
from rvsg_studio.world_editor import folder_of_world

Show = Callable[..., Any]
"""Opens a page of the studio in a tab."""
PATIENT = 600_000
"""Milliseconds after which something is broken rather than slow."""
HOSTILE = "<img src=x onerror=alert(1)><script>alert(2)</script>"


class Server:
    """A studio in a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.own = own_folder(folder)
        self.log = folder.parent / f"{folder.name}.log"
        self.killed = False
        """Whether the present test has killed it; lost connections are expected then."""
        self.refuses = False
        """Whether the present test asks for what is refused (400)."""
        self.start()

    def start(self) -> None:
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "rvsg", "studio", str(self.folder), "--no-browser", "--port", "0"],
                stdout=log,
                stderr=log,
                env={**os.environ, "NUMBA_NUM_THREADS": "1", "RVSG_API_KEY": "of-a-test"},
            )
        for _ in range(3000):
            if found := re.search(r"http://\S+/\?token=\S+", self.log.read_text()):
                self.address = found.group()
                break
            assert self.process.poll() is None, self.log.read_text()
            time.sleep(0.1)
        else:
            raise AssertionError(self.log.read_text())
        at = urlsplit(self.address)
        token = at.query.removeprefix("token=")
        self.direct, self.cookie = f"http://{at.netloc}", {"cookie": f"rvsg-studio-{at.port}={token}"}
        """For requests outside of the browser, whose resolver may not know names below `localhost`."""
        self.base = f"http://{Guard(None, token=token, port=at.port).own}"  # type: ignore[arg-type]

    def kill(self) -> None:
        self.killed = True
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def restart(self) -> None:
        """Kill it at this moment and start another on the same folder."""
        self.kill()
        self.start()

    def renew(self, work: Path) -> None:
        """Put the folder back to what it was; jobs of the test before are ended."""
        jobs = Jobs(self.own / "jobs", self.folder)
        for job in jobs.all():
            if job.running:
                jobs.stop(job.id)
                waited(lambda job=job: not jobs.get(job.id).running)
        for path in (*self.folder.iterdir(), *self.own.iterdir(), *(self.own / "jobs").iterdir()):
            if path not in (self.own / "jobs", self.own / "nicegui", self.own / "token"):
                shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        shutil.copytree(work, self.folder, dirs_exist_ok=True)
        self.killed = self.refuses = False
        if self.process.poll() is not None:
            self.start()


@pytest.fixture(scope="session")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a campaign of the simulator without physics; it is only ever copied."""
    folder = tmp_path_factory.mktemp("work")
    campaign = rvsg.Campaign.create(
        folder / "runs" / "first", scenarios=2, refinements=1, repeats=3, confirmations=6, simulator="kinematic", jobs=1
    )
    list(campaign.run())
    return folder


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    pytest.importorskip("nicegui", reason="nicegui is not installed")
    folder = tmp_path_factory.mktemp("served") / "work"
    folder.mkdir()
    made = Server(folder)
    yield made
    made.kill()


@pytest.fixture
def studio(server: Server, work: Path) -> Server:
    """The studio, its folder as every test finds it. A test may change and kill what it likes."""
    server.renew(work)
    return server


@pytest.fixture
def office(studio: Server) -> Path:
    """A world that can be edited."""
    shutil.copytree(folder_of_world("office"), studio.folder / "office2")
    return studio.folder / "office2"


@pytest.fixture
def show(browser: Any, studio: Server) -> Iterator[Show]:
    """Open a page of the studio in a tab; errors of scripts, dialogs and requests elsewhere fail the test."""
    contexts: list[Any] = []
    wrong: list[str] = []

    def opened(path: str = "/", *, width: int = 1280, **how: Any) -> Any:
        context = browser.new_context(viewport={"width": width, "height": 900}, **how)
        contexts.append(context)
        context.set_default_timeout(120_000)
        tab = context.new_page()
        tab.on("pageerror", lambda error: wrong.append(f"error: {error}"))
        tab.on("console", lambda message: wrong.append(message.text) if _is_wrong(message, studio) else None)
        tab.on("request", lambda request: None if _inside(request.url, studio) else wrong.append(request.url))
        tab.on("dialog", lambda dialog: (wrong.append(f"dialog: {dialog.message}"), dialog.dismiss()))
        tab.goto(studio.address)
        if path != "/":
            tab.goto(studio.base + path)
        tab.wait_for_selector("h1")
        if path.startswith(("/world", "/scenario", "/describe", "/finding", "/runs")):
            ready(tab)
        return tab

    yield opened
    for context in contexts:
        context.close()
    assert wrong == []


def _is_wrong(message: Any, studio: Server) -> bool:
    lost = studio.killed and ("net::ERR_" in message.text or "WebSocket connection" in message.text)
    refused = studio.refuses and "status of 400" in message.text
    return message.type == "error" and not lost and not refused


def _inside(url: str, studio: Server) -> bool:
    return url.startswith((studio.address, studio.base, studio.base.replace("http", "ws"), "data:", "blob:"))


def ready(tab: Any) -> None:
    """Wait until the editor or replay of a page is there."""
    tab.locator("[data-studio][data-ready]").first.wait_for(timeout=600_000)


def confirmed(folder: Path) -> int:
    """The first confirmation of the campaign of the folder."""
    attempts = rvsg.Campaign.open(folder / "runs" / "first").attempts()
    return next(a.index for a in attempts if a.purpose == "confirmation")


def waited(holds: Callable[[], Any], *, seconds: float = 300.0) -> Any:
    """Return what holds as soon as it does; a slow machine is waited for, a broken page is not for ever."""
    end = time.monotonic() + seconds
    while not (found := holds()):
        assert time.monotonic() < end, "it does not come true"
        time.sleep(0.05)
    return found


def axe_violations(tab: Any) -> list[Any]:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    found = axe.Axe().run(tab).response["violations"]
    return [(each["id"], [node["target"] for node in each["nodes"]][:3]) for each in found]


def fits(tab: Any) -> bool:
    """Whether nothing of the page lies beside the window."""
    held: bool = tab.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    return held


def pixel(tab: Any, x: float, y: float) -> tuple[float, float]:
    """Where a point of the world (metres) is on the screen."""
    group = "document.querySelector('.st-map > g[transform]').getScreenCTM()"
    script = f"([x, y]) => {{ const p = new DOMPoint(x, y).matrixTransform({group}); return [p.x, p.y]; }}"
    found = tab.evaluate(script, [x, y])
    return found[0], found[1]


def reach(tab: Any, target: Any, *, most: int = 250) -> None:
    """Go to an element with the Tab key alone."""
    target.wait_for()
    for _ in range(most):
        if target.evaluate("e => e === document.activeElement"):
            return
        tab.keyboard.press("Tab")
    raise AssertionError(f"{most} Tabs do not reach {target}")


def press(tab: Any, target: Any) -> None:
    """Press a button or follow a link with the keyboard alone."""
    reach(tab, target)
    tab.keyboard.press("Enter")


def rewrite(tab: Any, target: Any, text: str) -> None:
    """Write into a field with the keyboard alone, over what stands in it."""
    reach(tab, target)
    tab.keyboard.press("Control+a")
    tab.keyboard.type(text)
