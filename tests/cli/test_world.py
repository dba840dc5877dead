"""`rvsg world` as its user meets it."""

from __future__ import annotations

import json
import re
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.cli.commands import Terminal

from rvsg.app.settings import read_campaign_file
from rvsg.world.occupancy import read_map
from rvsg.world.world_folder import load_world


def write_map(folder: Path, **header: object) -> Path:
    pixels = np.full((120, 160), 254, np.uint8)
    pixels[:2] = pixels[-2:] = 0
    pixels[:, :2] = pixels[:, -2:] = 0
    pixels[50:70, 60:100] = 0
    Image.fromarray(pixels).save(folder / "m.pgm")
    given = {"image": "m.pgm", "resolution": 0.05, "origin": "[0, 0, 0]", "negate": 0, "occupied_thresh": 0.65,
             "free_thresh": 0.196, **header}  # fmt: skip
    (folder / "m.yaml").write_text("".join(f"{k}: {v}\n" for k, v in given.items()))
    return folder / "m.yaml"


@pytest.fixture
def hall(terminal: Terminal) -> str:
    """What makes the world `hall` of a map."""
    write_map(Path())
    return "world new hall --map m.yaml"


def names_in(folder: str) -> set[str]:
    return {path.name for path in Path(folder).iterdir()}


def test_from_a_map_to_a_checked_and_drawn_world(terminal: Terminal, hall: str) -> None:
    assert terminal.json(hall, "--title Hall")["title"] == "Hall"
    assert "rvsg world draw" in terminal.err
    assert names_in("hall") == {"README.md", "labels.yaml", "map.png", "map.yaml", "routes.yaml", "world.yaml"}
    terminal("world check hall")
    terminal("world draw hall --route route_1 --width 600")
    assert names_in("hall/pictures") >= {"labels_route_1.png", "grid_route_1.png", "birdseye_route_1.png"}
    terminal("world draw hall --what svg --out .")
    assert Path("plan.svg").read_text().lstrip().startswith("<")
    assert "The robot starts at" in terminal("world show hall")


def test_a_large_grid_is_also_drawn_in_parts(terminal: Terminal, hall: str) -> None:
    terminal(hall, "--spacing 0.2 --no-simulation")
    terminal("world draw hall --what grid --width 500")
    assert len(list(Path("hall/pictures").glob("grid_part_*.png"))) > 1


def test_the_check_ends_with_2_if_something_is_wrong_and_says_where(terminal: Terminal, hall: str) -> None:
    terminal(hall, "--no-simulation")
    Path("hall/labels.yaml").write_text("areas:\n  - {name: Far, rectangle: [90, 90, 95, 95]}\n")
    assert "labels.yaml:2" in terminal("world check hall --json", code=2)
    assert any(remark["serious"] and remark["line"] == 2 for remark in json.loads(terminal.out))


def test_shipped_worlds_are_listed_and_shown_by_name(terminal: Terminal) -> None:
    assert {"hospital", "office", "warehouse"} <= {world["name"] for world in terminal.json("world list")}
    terminal("world list")
    assert terminal.json("world check office --no-simulation") == []
    assert "Next: rvsg run --world office --route route_1\n" in terminal("world check office --no-simulation")
    assert terminal.json("world show office")["routes"][0]["description"].startswith("The robot starts")


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("new made", "world-source"),
        ("new made --map m.yaml --sdf w.sdf", "world-source"),
        ("new made --map gone.yaml", "file-missing"),
        ("new made --sdf gone.world", "file-missing"),
        ("new made --objects gone.yaml", "file-missing"),
        ("new made --map m.yaml --spacing 0", "options"),
        ("new made --map m.yaml --human-clearance 4", "grid-no-room"),
        ("new made --map m.yaml --robot-clearance -1", "options"),
        ("new made --objects boxes.yaml --resolution 0", "resolution"),
        ("new made --objects boxes.yaml --resolution nan", "resolution"),
        ("new made --objects boxes.yaml --lidar-height nan", "lidar-height"),
        ("new made --objects boxes.yaml --lidar-height 9", "lidar-height"),
        ("new made --map m.yaml --without robot --resolution 0.1", "option-unused"),
        ("draw offfice", "unknown-name"),
        ("draw office --route route_9", "unknown-name"),
        ("draw office --width 10", "picture-width"),
        ("draw office --colours pink", "unknown-name"),
        ("draw office --window 1,2,3", "window-form"),
        ("draw office --out made --window 100,100,120,120", "window-outside"),
        ("show nowhere", "unknown-name"),
        ("check nowhere", "unknown-name"),
        ("check m.yaml", "world-is-file"),
    ],
)
def test_a_mistake_is_one_message_and_leaves_nothing(terminal: Terminal, hall: str, command: str, code: str) -> None:
    Path("boxes.yaml").write_text("objects:\n  - {name: Hut, box: {center: [0, 0, 1], size: [8, 8, 2], yaw: 0}}\n")
    assert terminal.refused("world", command).code == code
    assert not Path("made").exists()


def test_a_folder_with_a_world_is_only_replaced_when_told(terminal: Terminal, hall: str) -> None:
    terminal(hall)
    Path("hall/labels.yaml").write_text("areas: []\n")
    assert terminal.refused(hall).code == "world-exists"
    assert Path("hall/labels.yaml").read_text() == "areas: []\n"
    terminal(hall, "--force")
    Path("busy").mkdir()
    Path("busy/thesis.txt").write_text("x")
    assert terminal.refused("world new busy --map m.yaml").code == "folder-not-empty"


def test_a_picture_that_cannot_show_a_window_says_so(terminal: Terminal) -> None:
    asked = "world draw office --out . --width 500 --window 1,1,9,9 --what"
    assert "birdseye.png\n  shows the whole world" in terminal(asked, "birdseye")
    assert "whole world" not in terminal(asked, "labels")


def test_a_copy_is_the_same_world_with_the_map_for_a_navigation_stack(terminal: Terminal) -> None:
    terminal("world copy warehouse own")
    shipped, copied = load_world("warehouse"), load_world(Path("own"))
    assert copied.id == shipped.id
    assert np.array_equal(read_map(Path("own/map.yaml")).cells, shipped.occupancy.cells)
    Path("own/labels.yaml").write_text("mine")
    terminal("world copy bookstore own", code=2)
    assert Path("own/labels.yaml").read_text() == "mine"


@pytest.mark.parametrize("room", [0, 60, 400, 1000, 1200])
def test_a_full_disk_leaves_a_whole_world_or_none(hall: str, room: int) -> None:
    """No file can be longer than `room` bytes; -B: neither could a compiled module of RVSG, which others then read."""

    def full() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    made = subprocess.run([sys.executable, "-B", "-m", "rvsg", *hall.split(), "--no-simulation"],
                          preexec_fn=full, capture_output=True, text=True, check=False)  # fmt: skip
    assert (made.returncode, "Traceback" in made.stderr) == (2, False), made.stderr
    assert sorted(path.name for path in Path().iterdir()) == ["m.pgm", "m.yaml"]


def test_the_name_of_a_shipped_world_means_one_thing_everywhere(terminal: Terminal) -> None:
    said = terminal("world copy office office")
    assert "run --world ./office" in said
    Path("office/routes.yaml").write_text("routes: []\n")
    Path("office/labels.yaml").write_text("areas: []\n")
    for verb in ("check office --no-simulation", "draw office --what svg", "show office"):
        assert "the world that ships with RVSG. For the folder here, write ./office" in terminal("world", verb)
    assert not Path("office/pictures").exists() and Path("plan.svg").exists()
    terminal("world draw ./office --what svg")
    assert Path("office/pictures/plan.svg").exists()
    assert terminal.json("world show office")["routes"] and not terminal.json("world show ./office")["routes"]
    assert "no routes" in terminal("world check ./office --no-simulation", code=2)
    Path("mine.yaml").write_text("world: office\n")
    assert read_campaign_file(Path("mine.yaml"))["world"] == "office"
    Path("mine.yaml").write_text("world: ./office\n")
    assert load_world(read_campaign_file(Path("mine.yaml"))["world"]).routes == ()


def test_every_line_of_a_check_has_a_code_that_is_explained(terminal: Terminal, hall: str) -> None:
    terminal(hall, "--no-simulation")
    Path("hall/routes.yaml").write_text("routes: []\n", encoding="utf-8")
    told = terminal("world check hall --no-simulation", code=2)
    *found, last = [line for line in told.splitlines() if re.match(r"(error|warning)\b|\d+ error", line)]
    codes = [match[1] for line in found if (match := re.match(r"(?:error|warning) \[([a-z-]+)\]: hall/", line))]
    assert len(codes) == len(found) > 0 and "1 error, " in last and f"--explain {codes[0]}" in last
    for code in codes:
        terminal("--explain", code)
