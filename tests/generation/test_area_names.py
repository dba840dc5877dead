"""Names of areas by a model: what is taken from its answer, and what is refused."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rvsg.core.errors import GenerationError
from rvsg.generation.environment import LONGEST_NAME, propose_area_names
from rvsg.generation.prompts import Prompts
from rvsg.generation.vlm.model import Scripted
from rvsg.world.world import World


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


def test_an_unreadable_answer_is_asked_for_again_and_then_an_error(warehouse: World) -> None:
    assert propose_area_names(warehouse, Scripted(["prose", said()]), Prompts()).names == ()
    with pytest.raises(GenerationError):
        propose_area_names(warehouse, Scripted(["prose", '{"names": "none"}']), Prompts())
