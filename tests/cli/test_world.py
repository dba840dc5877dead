"""`rvsg world` as its user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.cli.commands import printed, rvsg

from rvsg.cli import main
from rvsg.core.errors import RvsgError
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


def test_from_a_map_to_a_checked_and_drawn_world(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    world = tmp_path / "hall"
    assert main(["world", "new", str(world), "--map", str(write_map(tmp_path)), "--title", "Hall", "--json"]) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["title"] == "Hall"
    assert "rvsg world draw" in told.err
    assert {p.name for p in world.iterdir()} == {
        "README.md", "labels.yaml", "map.png", "map.yaml", "routes.yaml", "world.yaml"}  # fmt: skip
    assert main(["world", "check", str(world)]) == 0
    assert main(["world", "draw", str(world), "--route", "route_1", "--width", "600"]) == 0
    assert {p.name for p in (world / "pictures").iterdir()} >= {
        "labels_route_1.png", "grid_route_1.png", "birdseye_route_1.png"}  # fmt: skip
    assert main(["world", "draw", str(world), "--what", "svg", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "plan.svg").read_text().lstrip().startswith("<")
    assert main(["world", "show", str(world)]) == 0
    assert "The robot starts at" in capsys.readouterr().err


def test_a_large_grid_is_also_drawn_in_parts(tmp_path: Path) -> None:
    world = tmp_path / "fine"
    rvsg("world new", world, "--map", write_map(tmp_path), "--spacing 0.2 --no-simulation")
    rvsg("world draw", world, "--what grid --width 500")
    assert len(list((world / "pictures").glob("grid_part_*.png"))) > 1


def test_the_check_ends_with_2_if_something_is_wrong_and_says_where(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world = tmp_path / "hall"
    main(["world", "new", str(world), "--map", str(write_map(tmp_path)), "--no-simulation"])
    (world / "labels.yaml").write_text("areas:\n  - {name: Far, rectangle: [90, 90, 95, 95]}\n")
    capsys.readouterr()
    assert main(["world", "check", str(world), "--json"]) == 2
    told = capsys.readouterr()
    assert "labels.yaml:2" in told.err
    assert any(remark["serious"] and remark["line"] == 2 for remark in json.loads(told.out))


def test_shipped_worlds_are_listed_and_shown_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert {"hospital", "office", "warehouse"} <= {world["name"] for world in printed(capsys, "world list")}
    rvsg("world list")
    assert printed(capsys, "world check office --no-simulation") == []
    assert printed(capsys, "world show office")["routes"][0]["description"].startswith("The robot starts")


MISTAKES = [
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
]


@pytest.mark.parametrize(("command", "code"), MISTAKES)
def test_a_mistake_is_one_message_and_leaves_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    errors: list[RvsgError],
    command: str,
    code: str,
) -> None:
    write_map(tmp_path)
    (tmp_path / "boxes.yaml").write_text(
        "objects:\n  - {name: Hut, box: {center: [0, 0, 1], size: [8, 8, 2], yaw: 0}}\n"
    )
    monkeypatch.chdir(tmp_path)
    rvsg("world", command, code=2)
    assert errors[-1].code == code
    assert "Traceback" not in capsys.readouterr().err
    assert not (tmp_path / "made").exists()


def test_a_folder_with_a_world_is_only_replaced_when_told(errors: list[RvsgError], tmp_path: Path) -> None:
    command = ["world", "new", str(tmp_path / "w"), "--map", str(write_map(tmp_path))]
    assert main(command) == 0
    (tmp_path / "w" / "labels.yaml").write_text("areas: []\n")
    assert main(command) == 2
    assert errors[-1].code == "world-exists"
    assert (tmp_path / "w" / "labels.yaml").read_text() == "areas: []\n"
    assert main([*command, "--force"]) == 0
    (tmp_path / "busy").mkdir()
    (tmp_path / "busy" / "thesis.txt").write_text("x")
    assert main(["world", "new", str(tmp_path / "busy"), "--map", str(tmp_path / "m.yaml")]) == 2
    assert errors[-1].code == "folder-not-empty"


def test_a_picture_that_cannot_show_a_window_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["world", "draw", "office", "--out", str(tmp_path), "--width", "500", "--window", "1,1,9,9", "--what"]
    assert main([*asked, "birdseye"]) == 0
    assert "birdseye.png\n  shows the whole world" in capsys.readouterr().err
    assert main([*asked, "labels"]) == 0
    assert "whole world" not in capsys.readouterr().err


def test_a_copy_is_the_same_world_with_the_map_for_a_navigation_stack(tmp_path: Path) -> None:
    folder = tmp_path / "own"
    assert main(["world", "copy", "warehouse", str(folder)]) == 0
    shipped, copied = load_world("warehouse"), load_world(folder)
    assert copied.id == shipped.id
    occupancy = read_map(folder / "map.yaml")
    assert np.array_equal(occupancy.cells, shipped.occupancy.cells)
    (folder / "labels.yaml").write_text("mine")
    assert main(["world", "copy", "bookstore", str(folder)]) != 0
    assert (folder / "labels.yaml").read_text() == "mine"
