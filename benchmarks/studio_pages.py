"""Measures how fast the studio answers: `python benchmarks/studio_pages.py`. Needs playwright and a Chromium.

Makes a folder of campaigns, opens it in a studio and asks for every page again and again; then follows a campaign that
runs, in a browser. Prints one JSON object, in milliseconds: what a page takes after its first load (on the clock, and
of the studio's processor time, which other work on the machine does not change), and, while the campaign runs, what
other pages take and how long the page that follows it takes to react to a click.
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

import yaml
from playwright.sync_api import Page, sync_playwright

import rvsg

SETTINGS = {
    "generator": "random", "strategy": "random", "simulator": "kinematic", "refinements": 0, "confirmations": 0,
    "humans": 1, "jobs": 1,
}  # fmt: skip
TIMES = 20
CLICK = """() => new Promise(done => {
  const begun = performance.now();
  document.querySelector('.st-commands summary').click();
  requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now() - begun)));
})"""
"""Opens or closes the list of commands; what it returns is the time until that is painted."""


class Asking:
    """Asks a studio for pages with the cookie of a browser."""

    def __init__(self, address: str) -> None:
        self.place = urlsplit(address).netloc
        own = self._get(address.partition(self.place)[2])[1]["location"]
        host = urlsplit(own).netloc
        headers = self._get(own.partition(host)[2], host=host)[1]
        self.cookie = headers["set-cookie"].partition(";")[0]

    def _get(self, path: str, **headers: str) -> tuple[int, dict[str, str]]:
        connection = http.client.HTTPConnection(self.place, timeout=600)
        connection.request("GET", path, headers=headers)
        with connection.getresponse() as answer:
            answer.read()
            found = {key.lower(): value for key, value in answer.getheaders()}
        connection.close()
        return answer.status, found

    def took_ms(self, path: str) -> float:
        """Milliseconds until a page is there whole."""
        begun = time.perf_counter()
        status, _ = self._get(path, cookie=self.cookie)
        assert status == 200, (path, status)
        return 1000 * (time.perf_counter() - begun)


def processor_ms(pid: int) -> float:
    """Processor time that a process has spent so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return 1000 * (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def figures(values: list[float]) -> dict[str, float]:
    """Median and largest, rounded."""
    return {"median": round(statistics.median(values), 1), "most": round(max(values), 1)}


def followed(tab: Page, asking: Asking) -> dict[str, object]:
    """Follow the campaign that the page shows until it is finished."""
    others: list[float] = []
    clicks: list[float] = []
    while tab.locator(".chip", has_text="finished").count() == 0:
        others.append(asking.took_ms("/"))
        clicks.append(tab.evaluate(CLICK))
        tab.wait_for_timeout(100)
    return {"looks": len(clicks), "home_ms": figures(others), "click_ms": figures(clicks)}


def main() -> int:
    """Make the folder, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=50)
    parser.add_argument("--attempts", type=int, default=500)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        first = folder / "runs" / "c00"
        for _ in rvsg.Campaign.create(first, **SETTINGS, scenarios=options.attempts, repeats=1).run():  # type: ignore[arg-type]
            pass
        for k in range(1, options.campaigns):
            shutil.copytree(first, folder / "runs" / f"c{k:02d}")
        command = [sys.executable, "-m", "rvsg", "studio", str(folder), "--no-browser", "--port", "0"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server, sync_playwright() as driver:
            try:
                assert server.stderr is not None
                found = re.search(r"http://\S+", server.stderr.readline())
                assert found is not None, "the studio did not start"
                browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
                print(json.dumps(measured(found.group(), browser.new_page(), server.pid, options), indent=2))
            finally:
                server.terminate()
    return 0


def measured(address: str, tab: Page, pid: int, options: argparse.Namespace) -> dict[str, object]:
    """Return the figures of a studio."""
    asking, base = Asking(address), address.split("/?")[0]
    tab.set_default_timeout(900_000)
    begun = time.perf_counter()
    tab.goto(address)
    tab.wait_for_function("!document.body.innerText.includes('being read')")
    read_s = time.perf_counter() - begun
    shown = {
        "home": "/",
        "new campaign": "/campaign/new",
        "proposals": "/inbox",
        "compare": "/compare",
        "compare two": "/compare?a=runs/c00&b=runs/c01",
        "conversations": "/conversations",
        "conversation": "/conversations?folder=runs/c00",
        "campaign": "/campaign?folder=runs/c00",
        "finding": "/finding?campaign=runs/c00&attempt=0",
    }
    pages = {}
    for name, path in shown.items():
        first = asking.took_ms(path)
        before = processor_ms(pid)
        pages[name] = {"first": round(first, 1)} | figures([asking.took_ms(path) for _ in range(TIMES)])
        pages[name]["processor"] = round((processor_ms(pid) - before) / TIMES, 1)
    tab.goto(f"{base}/campaign/new")
    live = SETTINGS | {"scenarios": options.attempts, "repeats": 4, "out": "runs/live"}
    tab.locator("#yaml").fill(yaml.safe_dump(live))
    tab.wait_for_function("[...document.querySelectorAll('input')].some(e => e.value === 'runs/live')")
    tab.get_by_role("button", name="Start", exact=True).click()
    tab.wait_for_url("**/campaign?folder=runs%2Flive**")
    return {
        "campaigns": options.campaigns,
        "attempts": options.attempts,
        "all_read_s": round(read_s, 1),
        "pages_ms": pages,
        "live": {"runs": 4 * options.attempts} | followed(tab, asking),
    }


if __name__ == "__main__":
    sys.exit(main())
