"""Make the pictures of the studio for the documentation: `python docs/studio_pictures.py DIR [NAME ...]`.

DIR is a folder with at least one finished campaign in `runs/` that confirmed a finding. A world to edit is copied into
it. Needs playwright and a Chromium.
"""

from __future__ import annotations

import io
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import urljoin

from PIL import Image
from playwright.sync_api import Browser, sync_playwright

import rvsg
from rvsg.app.matrix import Matrix
from rvsg.app.proposal import propose
from rvsg.generation.generator import proposal_json
from rvsg.scenario.builder import load_scenario_in
from rvsg.simulation.archive import runs_text
from rvsg_studio.listing import Lister
from rvsg_studio.world_editor import folder_of_world

IMAGES = Path(__file__).parent / "images"
LAPTOP, PHONE = (1280, 860), (390, 780)
COLOURS = 96
STACKS = {"nav2-dwb": "runs/stacks/nav2-dwb", "nav2-rpp": "runs/stacks/nav2-rpp"}
"""Two campaigns with the same scenarios and another navigation stack, to compare."""
SEARCHED = {
    "strategy": "unguided", "requirement": "clearance", "scenarios": 12, "refinements": 0, "repeats": 8,
    "confirmations": 0, "humans": 3, "jobs": 1,
}  # fmt: skip
EXAMPLES = Path(__file__).parents[1] / "examples"
PATIENT_MS = 300_000


def pages(folder: Path) -> dict[str, str]:
    """The address of every page that is shown, by the name of its picture."""
    campaigns = [each for each in Lister(folder).listing().campaigns if each.failures]
    if not campaigns:
        raise SystemExit(
            f"{folder}: there is no campaign with a finding; make one with: rvsg demo --out {folder}/runs/demo"
        )
    chosen = max(campaigns, key=lambda each: each.calls)
    attempt = chosen.failures[0].row.confirmation
    traced = next((each for each in campaigns if each.folder.startswith("runs/matrix/")), chosen)
    return {
        "home": "/",
        "new-campaign": "/campaign/new",
        "campaign": f"/campaign?folder={chosen.folder}",
        "finding": f"/finding?campaign={traced.folder}&attempt={traced.failures[0].row.confirmation}",
        "scenario": f"/scenario?campaign={chosen.folder}&attempt={attempt}",
        "world": "/world?world=my_office",
        "new-world": "/world/new",
        "proposals": "/inbox",
        "matrix": "/matrix?folder=runs/matrix",
        "description": "/describe?world=warehouse",
        "compare": f"/compare?a={STACKS['nav2-dwb']}&b={STACKS['nav2-rpp']}",
        "both": f"/compare/runs?a={STACKS['nav2-dwb']}&b={STACKS['nav2-rpp']}&first=0&second=0",
        "versions": "/compare/versions?first=before.json&second=now.json",
        "suite": "/suite?suite=suite",
        "runs": "/runs?file=three-people.jsonl&scenario=three-people.json",
        "conversations": f"/conversations?folder={chosen.folder}",
    }


def picture(browser: Browser, address: str, path: str, name: str, size: tuple[int, int], scheme: str) -> None:
    """Make one picture of a page."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
    context.set_default_timeout(PATIENT_MS)
    tab = context.new_page()
    tab.goto(address)
    tab.goto(urljoin(tab.url, path.partition("#")[0]))
    tab.wait_for_selector("h1")
    if tab.locator("[data-studio]").count():
        tab.wait_for_selector("[data-studio][data-ready]")
    if name == "both":
        tab.locator("#together[data-ready]").wait_for()
    if name == "world":
        tab.get_by_role("button", name="Lounge", exact=True).click()
    if name.startswith("scenario"):
        tab.get_by_text("of 20 runs violate").wait_for()
    if name.startswith("finding"):
        tab.get_by_role("button", name="Trace this run").click()
        tab.get_by_role("button", name="This run is traced").or_(tab.locator(".rp-note:not(:empty)")).first.wait_for()
    if name.startswith("conversations"):
        tab.locator("summary").first.click()
    tab.evaluate("[document.scrollingElement, ...document.querySelectorAll('section')].forEach(e => e.scrollTo(0, 0))")
    tab.wait_for_function("[...document.images].every(each => each.complete)")
    tab.wait_for_timeout(700)
    image = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(IMAGES / f"studio-{name}.png", optimize=True)
    context.close()


def prepare(folder: Path) -> None:
    """Put a world to edit, a few proposals and campaigns on two routes into the folder, where they are missing."""
    if not (folder / "my_office").exists():
        shutil.copytree(folder_of_world("office"), folder / "my_office")
    inbox = folder / "proposals"
    inbox.mkdir(exist_ok=True)
    for seed in range(3):
        path = inbox / f"warehouse-route_1-R1-heuristic-{seed}.json"
        if not path.exists():
            path.write_text(proposal_json(propose("warehouse", "route_1", "R1", seed=seed)), encoding="utf-8")
    for stack, name in STACKS.items():
        if not (folder / name).exists():
            for _ in rvsg.Campaign.create(folder / name, **SEARCHED, stack=stack).run():  # type: ignore[arg-type]
                pass
    if not (folder / "suite").exists():
        shutil.copytree(EXAMPLES / "suites" / "warehouse", folder / "suite")
        suite = rvsg.Suite.open(folder / "suite")
        for version, stack in (("before", None), ("now", EXAMPLES / "stacks" / "wide_inflation.yaml")):
            result = suite.run(stack=stack, version=version, runs=20)
            (folder / f"{version}.json").write_text(result.model_dump_json(indent=2), encoding="utf-8")
    if not (folder / "three-people.json").exists():
        shutil.copy(EXAMPLES / "three_people.json", folder / "three-people.json")
        scenario, world = load_scenario_in(folder / "three-people.json")
        runs = rvsg.simulate(scenario, range(5), world=world)
        (folder / "three-people.jsonl").write_text(runs_text(runs), encoding="utf-8")
    if not (folder / "runs" / "matrix").exists():
        settings = {"scenarios": 2, "refinements": 0, "repeats": 2, "confirmations": 10, "jobs": 1}
        routes = {"route": ["route_1", "route_2"], "requirement": ["R1", "R3"]}
        matrix = Matrix.of(settings | routes | {"out": str(folder / "runs" / "matrix")}, {})
        assert matrix is not None
        for _ in matrix.run(matrix.create()):
            pass


def main(folder: Path, *names: str) -> None:
    """Serve the folder and make the pictures of these names, or all."""
    prepare(folder)
    shown = pages(folder)
    wanted = names or (*shown, "finding-dark-phone")
    command = [sys.executable, "-m", "rvsg", "studio", str(folder), "--no-browser", "--port", "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server, sync_playwright() as driver:
        assert server.stderr is not None
        found = re.search(r"http://\S+", server.stderr.readline())
        if found is None:
            raise SystemExit("The studio did not start.")
        time.sleep(2)
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for name in wanted:
            phone = name == "finding-dark-phone"
            path = shown["finding" if phone else name]
            picture(browser, found.group(), path, name, *((PHONE, "dark") if phone else (LAPTOP, "light")))
        server.terminate()


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), *sys.argv[2:])
