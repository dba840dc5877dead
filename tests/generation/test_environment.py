from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from tests.coded import coded

from rvsg.core.errors import FileError, GenerationError, InputError
from rvsg.generation.conversation import VlmGenerator
from rvsg.generation.environment import (
    LONGEST_NAME,
    EnvironmentDialogue,
    description_of,
    editable,
    edited,
    propose_area_names,
    read_description_file,
    read_photograph,
    store_description,
    stored_path,
)
from rvsg.generation.prompts import Prompts
from rvsg.generation.vlm.model import Picture, Scripted
from rvsg.scenario.brief import Brief
from rvsg.world.schema import save_world
from rvsg.world.world import Description, World
from rvsg.world.world_folder import SHIPPED, load_world

TEXTS = {"layout": "Shelves in the north: six of them.\nBoxes # left.", "grid": "Row E is the main way: E1 to E22."}
CLEAN = {key: " ".join(text.split()) for key, text in TEXTS.items()}


ANSWERS = ["layout analysis", "grid analysis", json.dumps(TEXTS)]


def describing(world: World, *answers: str) -> tuple[EnvironmentDialogue, Scripted]:
    model = Scripted(list(answers))
    return EnvironmentDialogue(world, model, Prompts()), model


def test_three_turns_show_the_map_then_grid_and_map_then_sum_up(warehouse: World) -> None:
    dialogue, model = describing(warehouse, *ANSWERS)
    description = dialogue.describe()
    assert (description.layout, description.grid, description.reviewed) == (CLEAN["layout"], CLEAN["grid"], False)
    assert [call.purpose for call in dialogue.calls] == ["layout", "grid", "summary"]
    shown = [[p.name for p in m.pictures] for m in model.asked[2].messages if m.role == "user"]
    assert shown == [["labelled map", "bird's-eye view"], ["grid of waypoints", "labelled map"], []]
    assert "slantingly" in model.asked[0].messages[1].text
    dialogue, model = describing(replace(warehouse, objects=()), *ANSWERS)  # a bare map knows no heights
    dialogue.describe()
    first = model.asked[0].messages[1]
    assert [p.name for p in first.pictures] == ["labelled map"] and "slantingly" not in first.text


CORRECTED = json.dumps({**TEXTS, "grid": "Corrected."})


def test_a_reason_goes_into_one_more_turn(warehouse: World) -> None:
    dialogue, model = describing(warehouse, *ANSWERS, CORRECTED)
    dialogue.describe()
    assert dialogue.revise("There is no door at E1.").grid == "Corrected."
    assert "There is no door at E1." in model.asked[3].messages[-1].text


def test_a_reason_about_a_given_text_costs_one_call_with_text_and_pictures(warehouse: World) -> None:
    dialogue, model = describing(warehouse, CORRECTED)
    dialogue.begin_with(Description(layout="By hand: no exit.", grid="One row."))
    assert dialogue.revise("There is an exit.").grid == "Corrected."
    messages = model.asked[0].messages
    assert [m.role for m in messages] == ["system", "user", "assistant", "user"]
    assert {p.name for p in messages[1].pictures} >= {"labelled map", "grid of waypoints"}
    assert "By hand: no exit." in messages[2].text and "There is an exit." in messages[3].text


def test_an_unreadable_summary_is_asked_for_again_and_then_an_error(warehouse: World) -> None:
    assert describing(warehouse, "a", "b", "prose", json.dumps(TEXTS))[0].describe().grid == CLEAN["grid"]
    with pytest.raises(GenerationError, check=coded("no-description")):
        describing(warehouse, "a", "b", "prose", "prose")[0].describe()


def test_a_description_is_stored_in_the_worlds_own_file(warehouse: World, tmp_path: Path) -> None:
    save_world(warehouse, tmp_path)
    file = tmp_path / "world.yaml"
    file.write_text(file.read_text() + "# a comment of mine\n")
    first = Description(**CLEAN)
    assert store_description(warehouse, first, tmp_path) == file
    second = first.model_copy(update={"reviewed": True, "reviewer": "Ada: L.", "reviewed_on": "2026-01-02"})
    store_description(warehouse, second, tmp_path)
    again = load_world(tmp_path)
    assert again.description == second
    assert file.read_text().count("description:") == 1
    assert again.routes == warehouse.routes
    assert "map:" in file.read_text()


def test_the_description_of_a_shipped_world_goes_to_the_users_folder(brief: Brief, warehouse: World) -> None:
    bare = replace(warehouse, description=None)
    assert description_of(bare) is None
    written = store_description(bare, Description(**CLEAN))
    assert written == stored_path(bare)
    assert description_of(bare) == Description(**CLEAN)
    assert CLEAN["grid"] in VlmGenerator(Scripted([])).first_prompts(brief, bare)[1].text
    assert description_of(warehouse) == Description(**CLEAN)
    with pytest.raises(InputError, check=coded("world-shipped")):
        store_description(bare, Description(**CLEAN), SHIPPED / "warehouse")


@pytest.mark.parametrize(
    ("text", "code"),
    [("layout: [", "yaml"), ("layout: a\n", "description-file"), ("layout: a\ngrid: b\nc: d\n", "description-file")],
)
def test_a_description_file_that_cannot_be_used_is_told_with_its_line(tmp_path: Path, text: str, code: str) -> None:
    (tmp_path / "d.yaml").write_text(text)
    with pytest.raises(FileError, check=coded(code)):
        read_description_file(tmp_path / "d.yaml")


def test_an_edit_changes_the_texts_and_must_keep_them() -> None:
    description = Description(**CLEAN)
    assert edited(description, editable(description)) == description
    assert (
        edited(description, editable(description).replace("main", "only")).grid == "Row E is the only way: E1 to E22."
    )
    for text in ("", "layout: a", "layout: a\ngrid: ''", ": ["):
        with pytest.raises(InputError):
            edited(description, text)


def said(*names: Any) -> str:
    return f"Here they are:\n```json\n{json.dumps({'names': names})}\n```"


def test_names_are_proposed_with_a_reason_from_the_labelled_map(warehouse: World) -> None:
    first, second = (area.name for area in warehouse.areas[:2])
    model = Scripted([said({"area": first, "name": "Packing", "why": "A table\nstands there."})])
    found = propose_area_names(warehouse, model, Prompts())
    assert [(n.area, n.name, n.why) for n in found.names] == [(first, "Packing", "A table stands there.")]
    assert found.unusable == () and len(found.calls) == 1
    asked = model.asked[0].messages[-1]
    assert "labelled map" in [p.name for p in asked.pictures]
    assert first in asked.text and second in asked.text


def test_what_cannot_be_accepted_is_left_out_and_told(warehouse: World) -> None:
    first, second, third = (area.name for area in warehouse.areas[:3])
    answer = said(
        {"area": "Nowhere", "name": "X"},
        {"area": first, "name": "x" * (LONGEST_NAME + 1)},
        {"area": first, "name": second.upper()},
        {"area": second, "name": "Packing"},
        {"area": third, "name": "packing"},
        {"area": third, "name": third},
        "text",
    )
    found = propose_area_names(warehouse, Scripted([answer]), Prompts())
    assert [(n.area, n.name) for n in found.names] == [(second, "Packing")]
    assert len(found.unusable) == 5


def test_kinds_regions_and_activities_are_proposed_where_they_differ(warehouse: World) -> None:
    first, second = warehouse.areas[:2]
    entries = [
        {"area": first.name, "name": first.name, "kind": "Packing table", "region": first.region or ""},
        {"area": second.name, "name": second.name, "kind": second.kind, "region": second.region or ""},
    ]
    activities = [warehouse.activities[0].upper(), "Somebody  wraps\npallets.", "Somebody wraps pallets.", ""]
    answer = json.dumps({"names": entries, "activities": activities})
    found = propose_area_names(warehouse, Scripted([answer]), Prompts())
    assert [(n.area, n.values) for n in found.names] == [(first.name, {"kind": "packing table"})]
    assert found.activities == ("Somebody wraps pallets.",)


def test_doors_are_proposed_where_there_is_a_doorway() -> None:
    world = load_world("hospital")
    door = {"name": "Door of Room 1", "between": ["D5", "E5"], "kind": "swing", "why": "It is a\nroom."}
    doors = [
        door,
        {**door, "name": "door of room 1"},
        {**door, "name": "B", "between": ["D5", "Z9"]},
        {**door, "name": "C", "between": ["M12"]},
        {**door, "name": "D", "between": ["G23", "H23"]},
        {**door, "name": "E", "kind": ["revolving"]},
        "text",
    ]
    model = Scripted([json.dumps({"names": [], "doors": doors})])
    photograph = Picture(name="photograph 1", png=b"any")
    found = propose_area_names(world, model, Prompts(), [photograph])
    (made,) = found.doors
    assert (made.door.name, made.between, made.why) == ("Door of Room 1", ("D5", "E5"), "It is a room.")
    assert 0.8 <= made.door.width_m <= 1.6 and len(found.unusable) == 6
    middle, (x, y), (u, v) = made.door.middle, world.grid.position("D5"), world.grid.position("E5")
    assert min(x, u) - 0.5 <= middle[0] <= max(x, u) + 0.5 and min(y, v) <= middle[1] <= max(y, v)
    asked = model.asked[0].messages[-1]
    assert [p.name for p in asked.pictures][-2:] == ["grid of waypoints", "photograph 1"]
    assert 'given by a person who knows the place: "photograph 1", of' in asked.text


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_a_photograph_is_sent_small_and_what_is_none_is_refused(tmp_path: Path, kind: str) -> None:
    Image.new("RGB", (4000, 1000), "red").save(tmp_path / "photo", kind)
    assert (read := read_photograph(tmp_path / "photo", "plan").reference).name == "plan"
    assert (read.width, read.height) == (1600, 400)
    Image.new("RGB", (40, 40)).save(tmp_path / "photo", "GIF")
    for name in ("photo", "none.png"):
        with pytest.raises(InputError, check=coded("photo-file")):
            read_photograph(tmp_path / name, "plan")
    (tmp_path / "photo").write_bytes(bytes(20_000_001))
    with pytest.raises(InputError, check=coded("photo-large")):
        read_photograph(tmp_path / "photo", "plan")


def test_an_unreadable_answer_is_asked_for_again_and_then_an_error(warehouse: World) -> None:
    assert propose_area_names(warehouse, Scripted(["prose", said()]), Prompts()).names == ()
    with pytest.raises(GenerationError):
        propose_area_names(warehouse, Scripted(["prose", '{"names": "none"}']), Prompts())
