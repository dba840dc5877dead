"""Children, wheelchairs, trolleys and moved objects in prompts and replies, where a world allows them."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from rvsg.generation.facts import configuration_object, world_facts
from rvsg.generation.people_sampler import box
from rvsg.generation.prompts import Prompts
from rvsg.generation.replies import MOST_MOVED, read_configuration
from rvsg.generation.reply_json import configuration_schema
from rvsg.scenario.scenario import LIMITS, TROLLEY_LENGTHS_M, TROLLEY_SPEEDS_M_S, PersonKind, Trolley
from rvsg.world.world_folder import load_world

ALL = ("trolley", "child", "wheelchair", "moved_object")
TASKS = [{"task": "A → B", "path": ["A1", "A2"]}, {"task": "B → A", "path": ["A2", "A1"]}]


def answer(moved: object = None, **person: object) -> str:
    given: dict[str, object] = {"humans": [{"name": "Human 1", "tasks": TASKS, **person}]}
    return json.dumps(given | ({"moved": moved} if moved is not None else {}))


def test_a_child_and_a_trolley_are_read() -> None:
    child = read_configuration(answer(kind="child"), actors=ALL).people
    pushing = read_configuration(answer(trolley={"length_m": 1.2, "width_m": 0.6}, kind="adult"), actors=ALL).people
    assert (child.humans[0].kind, child.humans[0].radius_m, child.humans[0].speed_m_s) == (PersonKind.CHILD, 0.25, 1.1)
    assert pushing.humans[0].trolley == Trolley(length_m=1.2, width_m=0.6)


def test_objects_are_read_and_written_in_one_form() -> None:
    thing = {"name": "pallet", "x": 1.5, "y": 2.0, "length_m": 1.2, "width_m": 0.8, "height_m": 0.9, "yaw": 0.3}
    reply = read_configuration(answer([thing]), actors=ALL)
    assert reply.moved == (box("pallet", (1.5, 2.0), (1.2, 0.8, 0.9), 0.3, 0.21),)
    assert configuration_object(reply.people, moved=reply.moved)["moved"] == [thing]
    assert read_configuration(answer(), actors=ALL).moved is None
    assert read_configuration(answer([]), actors=ALL).moved == ()


@pytest.mark.parametrize(
    ("rule", "text"),
    [
        ("unknown-kind", answer(kind="dog")),
        ("bad-trolley", answer(trolley={"length_m": 99})),
        ("bad-trolley", answer(trolley="big")),
        ("bad-moved-object", answer([{"name": "pallet", "x": "here"}])),
        ("bad-moved-object", answer("a pallet")),
        ("too-many-moved", answer([{"x": 1, "y": k} for k in range(9)])),
    ],
)
def test_what_cannot_be_read_goes_back_to_the_model(rule: str, text: str) -> None:
    reply = read_configuration(text, actors=ALL)
    assert rule in [finding.rule for finding in reply.findings]
    assert reply.people is not None


def test_a_world_without_actors_reads_and_asks_as_before() -> None:
    plain = read_configuration(answer([{"x": 1, "y": 1}], kind="child", trolley={}))
    assert plain.people is not None and plain.moved is None
    assert (plain.people.humans[0].kind, plain.people.humans[0].trolley) == (PersonKind.ADULT, None)
    assert [repair.what for repair in plain.repairs if '"kind"' in repair.what]
    assert configuration_schema(rich=True) == configuration_schema(rich=True, actors=())
    human = configuration_schema(rich=True, actors=ALL)["properties"]["humans"]["items"]["properties"]
    assert human["kind"]["enum"] == ["adult", "child", "wheelchair"] and "trolley" in human


def test_the_prompt_names_only_what_the_world_has() -> None:
    warehouse = load_world("warehouse")
    part = Prompts().render("_actors", world_facts(replace(warehouse, actors=("trolley",))))
    assert '"trolley"' in part and "wheelchair" not in part and "moved" not in part
    assert world_facts(warehouse)["actors"] == []


def test_the_prompt_names_the_limits_that_the_checker_keeps() -> None:
    part = Prompts().render("_actors", world_facts(replace(load_world("warehouse"), actors=ALL)))
    low, high = LIMITS[PersonKind.WHEELCHAIR].speeds_m_s
    assert f'wheelchairs, 1.1 x 0.66 m: "kind": "wheelchair" in a person, at {low:g} to {high:g} m/s' in part
    assert f"at {TROLLEY_SPEEDS_M_S[0]:g} to {TROLLEY_SPEEDS_M_S[1]:g} m/s" in part
    assert f"{TROLLEY_LENGTHS_M[0]:g} to {TROLLEY_LENGTHS_M[1]:g} m long" in part
    assert f"at most {MOST_MOVED}:" in part
