"""Make the pictures of a report's first screen in `states/`: `python docs/images/states.py` (needs chromium)."""

from __future__ import annotations

import io
import shutil
import tempfile
from itertools import islice
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

import rvsg

OUT = Path(__file__).parent / "states"
SMALL = {"scenarios": 2, "refinements": 1, "repeats": 2, "confirmations": 60, "strategy": "random", "shrink_runs": 0}
LIMIT = "{title: Near, text: Keep away., metric: dto, worse: smaller, limit: %s, unit: m, source: a picture}"
STATES: dict[str, dict[str, Any]] = {
    "one-person": {"humans": 1, "limit": 4.0},
    "two-people": {"humans": 2, "limit": 3.0},
    "five-people": {"humans": 5, "limit": 2.5},
    "twenty-people": {"humans": 20, "limit": 2.0},
    "passed": {"humans": 2, "limit": 0.1},
    "aborted": {"humans": 2, "limit": 3.0, "events": 20},
    "not-confirmed": {"humans": 2, "limit": 3.0, "confirmations": 0},
}


def main() -> None:
    """Run a small campaign for each state and photograph the top of its page."""
    OUT.mkdir(exist_ok=True)
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium)
        for name, state in STATES.items():
            rules = Path(folder) / f"{name}.yaml"
            rules.write_text(f"near: {LIMIT % state['limit']}\n")
            asked = SMALL | {key: value for key, value in state.items() if key not in ("limit", "events")}
            campaign = rvsg.Campaign.create(Path(folder) / name, requirement=f"{rules}#near", **asked)
            for _ in islice(campaign.run(), state.get("events")):
                pass
            page = browser.new_page(viewport={"width": 1280, "height": 720})
            page.goto(campaign.report().as_uri())
            page.wait_for_timeout(500)
            with Image.open(io.BytesIO(page.screenshot())) as picture:
                picture.convert("P", palette=Image.Palette.ADAPTIVE, colors=64).save(OUT / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
