"""Make the pictures of a report's first screen in `states/`: `python docs/images/states.py [DIR]` (needs chromium).

DIR keeps the campaigns, so that another call only makes the pages and pictures anew.
"""

from __future__ import annotations

import io
import shutil
import sys
import tempfile
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

import rvsg
from rvsg.cli import main as command
from rvsg.generation.generator import Generator, Proposal
from rvsg.scenario.brief import Brief
from rvsg.scenario.rules import Finding

OUT = Path(__file__).parent / "states"
SMALL = {"scenarios": 2, "refinements": 1, "repeats": 2, "confirmations": 60, "strategy": "random", "shrink_runs": 0}
LIMIT = (
    "{title: Mean distance to the nearest person, text: Keep away from people., metric: dto, worse: smaller, "
    "limit: %s, unit: m, source: a picture}"
)
NONE = {"confirmations": 0}
ONE = {"scenarios": 1, "refinements": 0, "repeats": 1}
STATES: dict[str, dict[str, Any]] = {
    "one-person": {"humans": 1, "limit": 4.0},
    "two-people": {"humans": 2, "limit": 3.0},
    "five-people": {"humans": 5, "limit": 2.5},
    "twenty-people": {"humans": 20, "limit": 2.0},
    "ten-failures": {"limit": 3.5, "scenarios": 16, "refinements": 0, "confirmations": 400},
    "hundred-failures": {"limit": 8.0, **ONE, "scenarios": 105, "confirmations": 1700, "simulator": "kinematic"},
    "passed": {"limit": 0.1},
    "nothing-found": {"humans": 1, "limit": 0.01, **NONE},
    "nothing-valid": {"limit": 3.0},
    "one-run": {"humans": 1, "limit": 3.0, **ONE, **NONE},
    "aborted": {"limit": 3.0, "events": 20},
    "not-confirmed": {"limit": 3.0, **NONE},
}


class Invalid(Generator):
    """A generator that proposes nothing valid."""

    name = "invalid"

    def propose(self, brief: Brief, world: rvsg.World) -> Proposal:
        """Propose nothing, with the reason."""
        missing = Finding(rule="unknown-waypoint", reason=f"{world.title} has no waypoint Z99.")
        return Proposal(generator=self.name, scenario=None, problems=(missing,))


def campaigns(folder: Path) -> Iterator[tuple[str, Path]]:
    """Run a small campaign for each state, where it is missing; yield the page of each."""
    for name, state in STATES.items():
        rules = folder / f"{name}.yaml"
        rules.write_text(f"distance: {LIMIT % state['limit']}\n")
        asked = SMALL | {key: value for key, value in state.items() if key not in ("limit", "events")}
        given = {"generator": Invalid()} if name == "nothing-valid" else {}
        out, requirement = folder / name, f"{rules}#distance"
        campaign = (
            rvsg.Campaign.open(out, **given)
            if out.exists()
            else rvsg.Campaign.create(out, requirement=requirement, **given, **asked)
        )
        if not campaign.attempts():
            for _ in islice(campaign.run(), state.get("events")):
                pass
        yield name, campaign.report()


def judged(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield the pages of imported people, and of a recording."""
    best, place = folder / "two-people" / "best_scenario.json", ["--world", "warehouse", "--route", "route_1"]
    agents, imported = folder / "agents.yaml", folder / "imported.json"
    runs, bag = folder / "imported.jsonl", folder / "run.mcap"
    command(["export", str(best), "--to", "hunav", "--out", str(agents)])
    command(["import", "agents", str(agents), *place, "--out", str(imported)])
    command(["simulate", str(imported), "--repeats", "5", "--out", str(runs)])
    command(["simulate", str(best), "--bag", str(bag)])
    for name, given in {"imported": [str(runs), "--scenario", str(imported)], "recording": [str(bag), *place]}.items():
        page = folder / f"{name}.html"
        command(["evaluate", *given, "--html", str(page)])
        yield name, page


def main(folder: Path) -> None:
    """Photograph the top of the page of every state."""
    OUT.mkdir(exist_ok=True)
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium)
        for make in (campaigns, judged):
            for name, path in make(folder):
                page = browser.new_page(viewport={"width": 1280, "height": 720})
                page.goto(path.as_uri())
                page.wait_for_timeout(500)
                with Image.open(io.BytesIO(page.screenshot())) as picture:
                    small = picture.convert("RGB").quantize(128, dither=Image.Dither.NONE)
                    small.save(OUT / f"{name}.png", optimize=True)
                page.close()


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]).resolve())
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
