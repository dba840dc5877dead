"""New worlds from dropped files, what the check finds mended with a button, and the pages of suites and jobs."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.studio.conftest import PATIENT, Server, Show, ready

import rvsg
from rvsg_studio.world_editor import folder_of_world

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


@pytest.mark.exhaustive
def test_a_world_is_made_of_a_dropped_gazebo_file(show: Show, studio: Server) -> None:
    tab = show("/world/new")
    tab.get_by_label("Folder").fill("made")
    drop(tab, "room.sdf", sdf())
    tab.get_by_text("Received: room.sdf").wait_for()
    tab.get_by_role("button", name="Make the world").click()
    tab.wait_for_url("**/world?world=made", timeout=PATIENT)
    ready(tab)
    assert rvsg.load_world(studio.folder / "made").areas
    assert (studio.folder / "made" / "README.md").is_file()
    tab.goto(f"{studio.base}/world/new")
    ready(tab)
    assert tab.get_by_label("Folder").input_value() == "" and tab.get_by_text("Received").count() == 0


def drop(tab: Any, name: str, text: str) -> None:
    """Drop a file on the page, beside the field for files."""
    made = "([name, text]) => { const d = new DataTransfer(); d.items.add(new File([text], name)); return d; }"
    data = tab.evaluate_handle(made, [name, text])
    ready(tab)
    tab.dispatch_event("h1", "drop", {"dataTransfer": data})


@pytest.mark.exhaustive
def test_large_maps_are_received_over_a_restart_and_removed(show: Show, studio: Server, tmp_path: Path) -> None:
    studio.refuses = True
    (tmp_path / "large.pgm").write_bytes(b"P5\n4000 4000\n255\n" + bytes(16_000_000))
    tab = show("/world/new")
    tab.get_by_label("Files").set_input_files([tmp_path / "large.pgm"])
    tab.get_by_text("Received: large.pgm").wait_for(timeout=PATIENT)
    tab.close()
    studio.restart()
    tab = show("/world/new")
    tab.get_by_text("Received: large.pgm").wait_for()
    drop(tab, "notes.txt", "no map")
    tab.get_by_text("expected a file that ends in").wait_for()
    tab.get_by_role("button", name="Remove the files").click()
    tab.get_by_text("Received").wait_for(state="detached")
    assert list(studio.own.rglob("large.pgm")) == []


def test_a_file_with_a_path_in_its_name_stays_in_the_folder(show: Show, studio: Server, tmp_path: Path) -> None:
    tab = show("/world/new")
    tab.get_by_label("Folder").fill("../beside")
    evil = {"name": "../../../evil.sdf", "mimeType": "text/xml", "buffer": sdf().encode()}
    tab.get_by_label("Files").set_input_files([evil])
    tab.get_by_text("Received: evil.sdf").wait_for(timeout=PATIENT)
    tab.get_by_role("button", name="Make the world").click()
    tab.get_by_text("outside the folder of the studio").wait_for(timeout=PATIENT)
    assert [path for path in studio.folder.parent.rglob("evil.sdf") if studio.folder not in path.parents] == []
    assert not (studio.folder.parent / "beside").exists()


@pytest.mark.exhaustive
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


@pytest.mark.parametrize(
    ("path", "told"),
    [
        *((f"/job?job={job}", "There is no job") for job in ("..", "nowhere", "../..")),
        ("/suite?suite=../cases", "outside the folder"),
        ("/compare/versions?first=../secret.json&second=other.json", "outside the folder"),
        ("/compare/versions?first=other.json&second=other.json", "other.json"),
    ],
)
def test_what_does_not_exist_or_cannot_be_read_is_refused_in_one_message(
    show: Show, studio: Server, path: str, told: str
) -> None:
    (studio.folder / "other.json").write_text('{"suite": 3}')
    assert told in show(path).locator(".st-wrong").first.inner_text()
