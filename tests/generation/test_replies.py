from __future__ import annotations

import json
import string
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rvsg.generation.facts import world_facts
from rvsg.generation.people_sampler import box
from rvsg.generation.prompts import Prompts
from rvsg.generation.replies import (
    MOST_MOVED,
    Reply,
    read_configuration,
    read_description,
    read_object,
    read_path_lines,
)
from rvsg.generation.reply_json import MAX_DEPTH, configuration_schema, find_json
from rvsg.generation.result_facts import configuration_object
from rvsg.scenario.scenario import LIMITS, TROLLEY_LENGTHS_M, TROLLEY_SPEEDS_M_S, Behaviour, PersonKind, Trolley
from rvsg.world.world_folder import load_world

NAMES = ("Human 1", "Human 2")
TWO = {
    "humans": [
        {"name": "Human 1", "tasks": [{"task": "Area 2 → Area 3", "path": ["G10", "G11"]}]},
        {"name": "Human 2", "tasks": [{"task": "Area 3 → Area 4", "path": ["G14", "G15"]}]},
    ]
}


def rules(reply: Reply) -> list[str]:
    return [finding.rule for finding in reply.findings]


def paths(reply: Reply) -> list[list[tuple[str, ...]]]:
    return [[task.path for task in human.tasks] for human in reply.people.humans]


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=20,
)


@given(st.dictionaries(st.text(max_size=8), json_values, max_size=4), st.sampled_from(["", "Sure!\n\n", "```json\n"]))
def test_proper_json_is_found_as_it_is_wherever_it_stands(value: dict[str, object], before: str) -> None:
    found = find_json(f"{before}{json.dumps(value)}\n``` and more words")
    assert [one.value for one in found] == [value]
    assert not found[0].repaired


@given(st.text(alphabet=string.printable, max_size=400))
def test_no_text_makes_the_reader_fail(text: str) -> None:
    for one in find_json(text):
        assert 0 <= one.start < one.end <= len(text)
    read_configuration(text, NAMES)


@given(st.integers(min_value=30, max_value=len(json.dumps(TWO)) - 1))
@settings(max_examples=60)
def test_a_cut_off_reply_is_read_as_far_as_it_goes_and_said_to_be_cut_off(length: int) -> None:
    found = find_json(json.dumps(TWO)[:length])
    assert len(found) == 1
    assert not found[0].complete
    names = [h["name"] for h in found[0].value.get("humans", []) if isinstance(h, dict) and "name" in h]
    assert all("Human 1".startswith(n) or "Human 2".startswith(n) for n in names)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("{'a': 'b',}", {"a": "b"}),
        ('{"a": {"b": [1, 2}}', {"a": {"b": [1, 2]}}),
        ('{"a": "5" tall", "b": 1}', {"a": '5" tall', "b": 1}),
        ('{"a": 1 // why\n, /* and */ b: True, # so\n c: None}', {"a": 1, "b": True, "c": None}),
        ("{“a”: “b”}", {"a": "b"}),
        ('{"a": "he said "no" to it", "b": 2}', {"a": 'he said "no" to it', "b": 2}),
        ('{"a": [1, 2 "b": 3}', {"a": [1, 2], "b": 3}),
        ('{"path": ["A1", "A2"}]', {"path": ["A1", "A2"]}),
        ('{"path": [G7, G8, ...]}', {"path": ["G7", "G8"]}),
        ('{"a": 1 "b": 2}', {"a": 1, "b": 2}),
        ('{"a": NaN, "b": 1e999}', {"a": "NaN", "b": "out of range"}),
        ('{"a": "line\nbreak"}', {"a": "line\nbreak"}),
    ],
)
def test_half_broken_json_is_repaired_and_said_to_be(text: str, value: object) -> None:
    found = find_json(f"Here: {text} Good luck.")
    assert [one.value for one in found] == [value]
    assert found[0].repaired and found[0].complete


@pytest.mark.parametrize(
    "text",
    ["{" * 200_000, "[" * 200_000, '{"' * 100_000, '{"a":[' * 30_000, "[{" * 100_000,
     "He walks [G7, G8, G9] and {then} rests, see [1]."],
)  # fmt: skip
def test_hostile_brackets_are_given_up_quickly_and_those_in_prose_are_no_data(text: str) -> None:
    assert find_json(text) == ()
    deep = "'" + '{"a":' * (MAX_DEPTH + 5) + "'x'" + "}" * (MAX_DEPTH + 5)
    assert all(not str(one.value).count("{") > MAX_DEPTH + 1 for one in find_json(deep))


def test_the_last_configuration_of_a_reply_counts_and_extra_humans_are_left_out() -> None:
    first = json.dumps(TWO).replace("G10", "G9")
    assert paths(read_configuration(f"{first} wait, better: {json.dumps(TWO)}", NAMES))[0] == [("G10", "G11")]
    one, two = TWO["humans"]
    extra = read_configuration(json.dumps({"humans": [one, two, {**two, "name": "Boss"}]}), NAMES)
    assert (rules(extra), len(extra.people.humans)) == (["extra-human"], 2)
    assert [r.human for r in extra.repairs] == ["Boss"]
    missing = read_configuration(json.dumps({"humans": [one]}), NAMES)
    assert rules(missing) == ["missing-human"] and missing.fatal


def test_values_out_of_range_are_found_and_put_right() -> None:
    one, two = TWO["humans"]
    pauses = [{"at": "G10", "duration_s": 9000}, {"at": "G11"}]
    tasks = [{"task": "t", "path": ["G10", "G11"], "pauses": pauses}]
    odd = {**one, "speed_m_s": 7, "start_delay_s": "soon", "behaviour": "Furious", "group": "x", "tasks": tasks}
    reply = read_configuration(json.dumps({"humans": [odd, two]}), NAMES)
    assert sorted(rules(reply)) == [
        "bad-group", "bad-pause", "long-pause", "not-a-number", "speed-out-of-range", "unknown-behaviour"
    ]  # fmt: skip
    human = reply.people.humans[0]
    assert (human.speed_m_s, human.start_delay_s, human.behaviour) == (2.0, 0.0, Behaviour.REGULAR)
    assert [(p.at, p.duration_s) for p in human.tasks[0].pauses] == [("G10", 600.0)]
    assert len(reply.repairs) == len(reply.findings)


@pytest.mark.parametrize(
    "text", ["", "   \n", "I cannot help with that.", '{"weather": "fine"}', "[1, 2]", '{"humans": []}']
)
def test_a_reply_without_a_configuration_says_so(text: str) -> None:
    reply = read_configuration(text, NAMES)
    assert reply.people is None and reply.fatal and reply.findings


def test_our_form_the_studys_form_and_wrapped_forms_mean_the_same() -> None:
    study = {
        "Worker 1 Tasks": [{"Task": "Area 2 → Area 3", "Start": "G10", "End": "G11", "Path": ["G10", "G11"]}],
        "Worker 2 Tasks": [{"Task": "Area 3 → Area 4", "Start": "G14", "End": "G15", "Path": ["G14", "G15"]}],
    }
    mapped = {"people": {human["name"]: {"tasks": human["tasks"]} for human in TWO["humans"]}}
    texts = {"humans": [{"tasks": [{"task": "Area 2 → Area 3", "path": "G10 → G11"}]}, TWO["humans"][1]]}
    for value in (TWO, study, {"configuration": TWO}, mapped, TWO["humans"], texts):
        reply = read_configuration(f"As asked:\n```json\n{json.dumps(value)}\n```", NAMES)
        assert paths(reply) == [[("G10", "G11")], [("G14", "G15")]], value
        assert [h.name for h in reply.people.humans] == list(NAMES) if reply.people else False
        assert not reply.findings
        assert not reply.fatal


def test_descriptions_and_texts_are_read_from_the_last_object() -> None:
    assert read_description('bla {"scenario": "first"} bla ```json\n{"scenario": " second "}\n```') == "second"
    assert read_description("no object") == ""
    assert read_object('{"layout": "a", "grid": "b"}', ("layout", "grid")) == {"layout": "a", "grid": "b"}
    assert read_object('{"layout": "a"}', ("layout", "grid")) is None


def test_path_lines_are_read_and_a_later_block_replaces_an_earlier() -> None:
    text = """
    Human 1 | Area 2 → Area 3 | G9, G10, G11
    Human 2 | Area 3 → Area 4 | G14, G15
    Better:
    ```
    | Human 1 | Area 2 → Area 3 | G10 → G11 |
    Human 1 | Area 3 → Area 2 | G11 G10
    ```
    """
    people = read_path_lines(text, NAMES)
    assert [[t.path for t in h.tasks] for h in people.humans] == [[("G10", "G11"), ("G11", "G10")], [("G14", "G15")]]
    assert read_path_lines("Human 1 | a | G1, G2", NAMES) is None


ALL = ("trolley", "child", "wheelchair", "moved_object")
TASKS = [{"task": "A → B", "path": ["A1", "A2"]}, {"task": "B → A", "path": ["A2", "A1"]}]


def answer(moved: object = None, **person: object) -> str:
    given: dict[str, object] = {"humans": [{"name": "Human 1", "tasks": TASKS, **person}]}
    return json.dumps(given | ({"moved": moved} if moved is not None else {}))


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


def test_children_trolleys_and_objects_are_read_and_written_in_one_form() -> None:
    child = read_configuration(answer(kind="child"), actors=ALL).people
    pushing = read_configuration(answer(trolley={"length_m": 1.2, "width_m": 0.6}, kind="adult"), actors=ALL).people
    assert (child.humans[0].kind, child.humans[0].radius_m, child.humans[0].speed_m_s) == (PersonKind.CHILD, 0.25, 1.1)
    assert pushing.humans[0].trolley == Trolley(length_m=1.2, width_m=0.6)
    thing = {"name": "pallet", "x": 1.5, "y": 2.0, "length_m": 1.2, "width_m": 0.8, "height_m": 0.9, "yaw": 0.3}
    reply = read_configuration(answer([thing]), actors=ALL)
    assert reply.moved == (box("pallet", (1.5, 2.0), (1.2, 0.8, 0.9), 0.3, 0.21),)
    assert configuration_object(reply.people, moved=reply.moved)["moved"] == [thing]
    assert read_configuration(answer(), actors=ALL).moved is None
    assert read_configuration(answer([]), actors=ALL).moved == ()


def test_the_prompt_names_what_the_world_has_and_the_limits_that_the_checker_keeps() -> None:
    warehouse = load_world("warehouse")
    part = Prompts().render("_actors", world_facts(replace(warehouse, actors=("trolley",))))
    assert '"trolley"' in part and "wheelchair" not in part and "moved" not in part
    assert world_facts(warehouse)["actors"] == []
    part = Prompts().render("_actors", world_facts(replace(warehouse, actors=ALL)))
    low, high = LIMITS[PersonKind.WHEELCHAIR].speeds_m_s
    for words in (
        f'wheelchairs, 1.1 x 0.66 m: "kind": "wheelchair" in a person, at {low:g} to {high:g} m/s',
        "at {:g} to {:g} m/s".format(*TROLLEY_SPEEDS_M_S),
        "{:g} to {:g} m long".format(*TROLLEY_LENGTHS_M),
        f"at most {MOST_MOVED}:",
    ):
        assert words in part
