"""New worlds from dropped files, what the check finds mended with a button, and the pages of suites and jobs."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.studio.conftest import Server, axe_violations, confirmed, waited

import rvsg
from rvsg.api.editing import folder_of_world
from rvsg.api.requirements import load_requirement

pytestmark = pytest.mark.slow
Show = Callable[..., Any]
PATIENT = 600_000
WALLS = [(0, 3, 8, 0.2), (0, -3, 8, 0.2), (4, 0, 0.2, 6), (-4, 0, 0.2, 6), (1, 1, 1.2, 0.8)]


def sdf() -> str:
    """A room of 8 x 6 m with a table in it, as Gazebo writes it."""
    boxes = "".join(
        f'<model name="wall_{k}"><static>true</static><pose>{x} {y} 0.5 0 0 0</pose><link name="link">'
        f'<collision name="c"><geometry><box><size>{w} {h} 1</size></box></geometry></collision></link></model>'
        for k, (x, y, w, h) in enumerate(WALLS)
    )
    return f'<?xml version="1.0"?><sdf version="1.7"><world name="room">{boxes}</world></sdf>'


MAP = "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"


def room_map() -> bytes:
    """A room of 9 x 7 m with a table in it, as Nav2's map server reads it."""
    rows, columns = 140, 180
    cells = [[254] * columns for _ in range(rows)]
    for r in range(rows):
        for c in range(columns):
            if min(r, c, rows - 1 - r, columns - 1 - c) < 4 or (60 <= r < 76 and 80 <= c < 110):
                cells[r][c] = 0
    return f"P5\n{columns} {rows}\n255\n".encode() + bytes(cell for row in cells for cell in row)


@pytest.mark.parametrize(("kind", "width", "scheme"), [("nav2", 1280, "light"), ("sdf", 390, "dark")])
def test_a_world_is_made_of_dropped_files(
    show: Show, studio: Server, tmp_path: Path, kind: str, width: int, scheme: str
) -> None:
    if kind == "nav2":
        (tmp_path / "map.pgm").write_bytes(room_map())
        (tmp_path / "map.yaml").write_text(MAP)
        files = [tmp_path / "map.yaml", tmp_path / "map.pgm"]
    else:
        (tmp_path / "room.sdf").write_text(sdf())
        files = [tmp_path / "room.sdf"]
    tab = show("/world/new", width=width, color_scheme=scheme, bypass_csp=True)
    assert axe_violations(tab) == []
    tab.get_by_label("Folder").fill("made")
    tab.get_by_label("Files").set_input_files(files)
    tab.get_by_text(f"Received: {sorted(file.name for file in files)[0]}").wait_for(timeout=PATIENT)
    tab.get_by_role("button", name="Make the world").focus()
    tab.keyboard.press("Enter")
    tab.wait_for_url("**/world?world=made", timeout=PATIENT)
    tab.locator("[data-studio][data-ready]").wait_for(timeout=PATIENT)
    made = rvsg.load_world(studio.folder / "made")
    assert made.areas and len(made.grid.valid) > 5
    assert (studio.folder / "made" / "README.md").is_file()


def test_a_file_with_a_path_in_its_name_stays_in_the_folder(show: Show, studio: Server, tmp_path: Path) -> None:
    tab = show("/world/new")
    tab.get_by_label("Folder").fill("../outside")
    evil = {"name": "../../../evil.sdf", "mimeType": "text/xml", "buffer": sdf().encode()}
    tab.get_by_label("Files").set_input_files([evil])
    tab.get_by_text("Received: evil.sdf").wait_for(timeout=PATIENT)
    tab.get_by_role("button", name="Make the world").click()
    tab.get_by_text("outside the folder of the studio").wait_for(timeout=PATIENT)
    assert [path for path in studio.folder.parent.rglob("evil.sdf") if studio.folder not in path.parents] == []
    assert not (studio.folder.parent / "outside").exists()


def test_a_finding_of_the_check_is_mended_with_a_button(show: Show, studio: Server) -> None:
    folder = studio.folder / "office2"
    shutil.copytree(folder_of_world("office"), folder)
    routes = yaml.safe_load((folder / "routes.yaml").read_text())
    name = routes["routes"][0]["name"]
    text = (folder / "routes.yaml").read_text()
    routes["routes"][0]["time_limit_s"] = 1.0
    (folder / "routes.yaml").write_text("# a comment of mine\n" + yaml.safe_dump(routes, sort_keys=False))
    assert text != (folder / "routes.yaml").read_text()
    tab = show("/world?world=office2")
    tab.locator("[data-studio][data-ready]").wait_for(timeout=PATIENT)
    fix = tab.get_by_role("button", name="Fix: Set the time limit")
    fix.wait_for(timeout=PATIENT)
    assert tab.locator(".st-pin").count() >= 1
    fix.focus()
    tab.keyboard.press("Enter")
    fix.wait_for(state="detached", timeout=PATIENT)
    assert rvsg.load_world(folder).route(name).time_limit_s > 10
    assert (folder / "routes.yaml").read_text().startswith("# a comment of mine\n")
    tab.get_by_role("button", name="Undo").click()
    fix.wait_for(timeout=PATIENT)


@pytest.mark.parametrize(("width", "scheme"), [(1280, "dark"), (390, "light")])
def test_suites_and_jobs_have_pages(show: Show, studio: Server, width: int, scheme: str) -> None:
    index = confirmed(studio.folder)
    scenario = rvsg.Campaign.open(studio.folder / "runs" / "first").attempts()[index].proposal.scenario
    assert scenario is not None
    suite = rvsg.Suite.create(studio.folder / "cases").add(scenario, load_requirement("R1").name, title="A <b>case</b>")
    tab = show("/", width=width, color_scheme=scheme, bypass_csp=True)
    tab.get_by_role("link", name="cases").focus()
    tab.keyboard.press("Enter")
    tab.get_by_text("A <b>case</b>").wait_for(timeout=PATIENT)
    assert len(suite.cases) == 1
    assert axe_violations(tab) == []
    tab.goto(f"{studio.base}/finding?campaign=runs/first&attempt={index}")
    tab.get_by_role("button", name="30 more runs").click()
    tab.locator(".st-job").first.wait_for(timeout=PATIENT)
    jobs = studio.folder / ".rvsg-studio" / "jobs"
    job = waited(lambda: next((path.name for path in jobs.iterdir()), ""))
    tab.goto(f"{studio.base}/job?job={job}")
    tab.locator(".st-job", has_text="finished").wait_for(timeout=PATIENT)
    assert axe_violations(tab) == []
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    for wrong in ("..", "nowhere", "../.."):
        tab.goto(f"{studio.base}/job?job={wrong}")
        tab.get_by_text("There is no job").wait_for(timeout=PATIENT)
