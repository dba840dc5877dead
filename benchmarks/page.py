"""Time to open the page of a large campaign: `python benchmarks/page.py --attempts 500`.

A campaign with the kinematic simulator, or `--campaign DIR`, is told on its page, and headless Chromium opens the file.
Prints one JSON object: the size of the page, the processor time of writing it, the time until the browser has loaded
it and answers a question after the next two frames (`opens_s`), and how much of that the page's own thread worked
(`browser_cpu_s`, processor time), which holds on a busy machine, too. The browser is started before the clock.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

from rvsg import Campaign

ANSWERS = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(document.title))))"


def main() -> int:
    """Write the page, open it, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--attempts", type=int, default=500)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--campaign", type=Path, help="tell of this finished campaign")
    parser.add_argument("--browser", default=os.environ.get("CHROMIUM", "/usr/bin/chromium"))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.campaign:
            campaign = Campaign.open(options.campaign)
        else:
            campaign = Campaign.create(
                Path(folder) / "c", generator="random", strategy="study", simulator="kinematic",
                scenarios=options.attempts // 2, refinements=1, repeats=options.repeats, confirmations=0,
            )  # fmt: skip
            for _ in campaign.run(jobs=1):
                pass
        began = time.process_time()
        page = Path(str(campaign.report()))
        wrote = time.process_time() - began
        attempts = len(list(campaign.attempts()))
        figures = {"attempts": attempts, "page_mb": round(page.stat().st_size / 1e6, 2), "write_cpu_s": round(wrote, 1)}
        figures |= opened(page, options.browser)
    print(json.dumps(figures, indent=2))
    return 0


def opened(page: Path, executable: str) -> dict[str, float]:
    """Open a page in a browser that runs already, and return how long that takes."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        tab = browser.new_page()
        tab.goto("about:blank")
        watched = tab.context.new_cdp_session(tab)
        watched.send("Performance.enable", {"timeDomain": "threadTicks"})
        began = time.monotonic()
        tab.goto(page.as_uri(), wait_until="load")
        loaded = time.monotonic() - began
        tab.evaluate(ANSWERS)
        answered = time.monotonic() - began
        metrics = {each["name"]: each["value"] for each in watched.send("Performance.getMetrics")["metrics"]}
        browser.close()
    return {
        "loads_s": round(loaded, 2),
        "opens_s": round(answered, 2),
        "browser_cpu_s": round(metrics["TaskDuration"], 2),
        "load_average": round(os.getloadavg()[0], 1),
    }


if __name__ == "__main__":
    sys.exit(main())
