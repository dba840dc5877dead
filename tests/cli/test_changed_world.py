"""`rvsg world diff` and `rvsg scenario migrate` as their user meets them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from tests.cli.commands import Terminal

from rvsg.scenario.builder import save_scenario, scenario, walk
from rvsg.scenario.scenario import Scenario
from rvsg.scenario.world_lookup import world_of
from rvsg.world.world_folder import SHIPPED, load_world


@pytest.fixture(autouse=True)
def worlds(terminal: Terminal) -> None:
    """The office in the folder `old`, and a copy to change in `new`."""
    for folder in ("old", "new"):
        shutil.copytree(SHIPPED / "office", folder)


def change(file: str, before: str, after: str) -> None:
    path = Path("new", file)
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after, 1))


def test_a_renamed_area_does_not_matter_and_a_new_object_does(terminal: Terminal) -> None:
    assert terminal.json("world diff old new") == []
    change("labels.yaml", "name: Lounge,", "name: Quiet Corner,")
    (renamed,) = [each for each in terminal.json("world diff old new") if each["part"] == "areas"]
    assert (renamed["part"], renamed["matters"]) == ("areas", False)
    assert "Lounge" in renamed["message"] and "Quiet Corner" in renamed["message"]
    crate = "  - {name: crate, box: {center: [7.5, 1.0, 0.4], size: [0.6, 0.6, 0.8]}}\n"
    change("objects.yaml", "objects:\n", f"objects:\n{crate}")
    assert {"map", "objects"} <= {each["part"] for each in terminal.json("world diff old new") if each["matters"]}


@pytest.mark.slow
def test_a_scenario_moves_to_a_world_whose_grid_has_shifted(terminal: Terminal) -> None:
    place, moved = load_world(Path("old")), Path("moved.json")
    save_scenario(scenario(place, place.routes[0].name, [walk("P", "G8", "G12")]), Path("s.json"))
    change("world.yaml", "origin: [1.0, 1.1]", "origin: [1.1, 1.1]")
    terminal("simulate s.json --world new --simulator kinematic", code=2)
    terminal("scenario migrate s.json --world new --reach 0.02 --out moved.json", code=2)  # too far
    assert not moved.exists()
    assert "0.10 m" in terminal("scenario migrate s.json --world new --out moved.json")
    there = Scenario.model_validate({k: v for k, v in json.loads(moved.read_text()).items() if k != "world_folder"})
    new = load_world(Path("new"))
    assert there.mission.world_id == new.id == world_of(there.mission, Path("new")).id
    terminal("simulate moved.json --world new --simulator kinematic --out r.jsonl")


def test_a_barred_way_is_repaired_where_asked(terminal: Terminal) -> None:
    place = load_world(Path("old"))
    save_scenario(scenario(place, place.routes[0].name, [walk("P", "G4", "H4")]), Path("s.json"))
    (x, y), (across, up) = place.grid.position("G4"), place.grid.position("H4")
    middle = f"center: [{(x + across) / 2}, {(y + up) / 2}, 0.4]"
    change("objects.yaml", "objects:\n", f"objects:\n  - {{name: crate, box: {{{middle}, size: [0.2, 0.2, 0.8]}}}}\n")
    assert "--repair" in terminal("scenario migrate s.json --world new --out moved.json", code=2)
    assert "P" in terminal("scenario migrate s.json --world new --repair --out moved.json")
    terminal("simulate moved.json --world new --simulator kinematic --out r.jsonl")


def test_a_campaign_whose_world_has_another_content_says_so_by_the_name_that_was_typed(terminal: Terminal) -> None:
    command = "run --world new --simulator kinematic --strategy random --scenarios 1 --refinements 0 --repeats 1 "
    terminal(f"{command} --confirmations 0 --out runs")
    change("labels.yaml", "name: Lounge,", "name: Quiet Corner,")
    said = terminal(f"{command} --confirmations 0 --out runs", code=2)
    assert "world: 'new', whose content has changed since" in said
