"""`rvsg world diff` and `rvsg scenario migrate` as their user meets them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from tests.cli.commands import printed, rvsg

from rvsg.scenario.builder import save_scenario, scenario, walk
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.world_lookup import world_of
from rvsg.world.world_folder import SHIPPED, load_world


@pytest.fixture
def worlds(tmp_path: Path) -> tuple[Path, Path]:
    """The office in a folder, and a copy to change."""
    old, new = tmp_path / "old", tmp_path / "new"
    for folder in (old, new):
        shutil.copytree(SHIPPED / "office", folder)
    return old, new


def change(folder: Path, file: str, before: str, after: str) -> None:
    text = (folder / file).read_text()
    assert before in text
    (folder / file).write_text(text.replace(before, after, 1))


def test_a_renamed_area_does_not_matter_and_a_new_object_does(
    worlds: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    old, new = worlds
    assert printed(capsys, "world diff", old, new) == []
    change(new, "labels.yaml", "name: Lounge,", "name: Quiet Corner,")
    (renamed,) = [each for each in printed(capsys, "world diff", old, new) if each["part"] == "areas"]
    assert (renamed["part"], renamed["matters"]) == ("areas", False)
    assert "Lounge" in renamed["message"] and "Quiet Corner" in renamed["message"]
    crate = "  - {name: crate, box: {center: [7.5, 1.0, 0.4], size: [0.6, 0.6, 0.8]}}\n"
    change(new, "objects.yaml", "objects:\n", f"objects:\n{crate}")
    found = printed(capsys, "world diff", old, new)
    assert {"map", "objects"} <= {each["part"] for each in found if each["matters"]}


@pytest.mark.slow
def test_a_scenario_moves_to_a_world_whose_grid_has_shifted(
    worlds: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (old, new), kinematic = worlds, "--simulator kinematic"
    saved, moved = tmp_path / "scenario.json", tmp_path / "moved.json"
    place = load_world(old)
    save_scenario(scenario(place, place.routes[0].name, [walk("P", "G8", "G12")]), saved)
    change(new, "world.yaml", "origin: [1.0, 1.1]", "origin: [1.1, 1.1]")
    rvsg("simulate", saved, "--world", new, kinematic, code=2)
    capsys.readouterr()
    rvsg("scenario migrate", saved, "--world", new, "--reach 0.02 --out", moved, code=2)  # too far
    assert not moved.exists()
    rvsg("scenario migrate", saved, "--world", new, "--out", moved)
    assert "0.10 m" in capsys.readouterr().err
    there = Scenario.model_validate({k: v for k, v in json.loads(moved.read_text()).items() if k != "world_folder"})
    assert there.mission.world_id == load_world(new).id
    assert world_of(there.mission, new).id == load_world(new).id
    rvsg("simulate", moved, "--world", new, kinematic, "--out", tmp_path / "r")
