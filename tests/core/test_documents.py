from pathlib import Path

import pytest
from tests.coded import coded

from rvsg.core.documents import DocumentError, parse_yaml, validated
from rvsg.core.errors import FileError
from rvsg.world.schema import LabelsFile, RoutesFile, WorldFile

HERE = Path("labels.yaml")


def problems(text: str, model: type = LabelsFile) -> list[str]:
    with pytest.raises(DocumentError) as caught:
        validated(parse_yaml(text, HERE), model)
    return [str(problem) for problem in caught.value.problems]


def test_every_mistake_is_told_at_once_with_its_line() -> None:
    text = """areas:
  - name: Shelf
    rectangel: [0, 0, 1, 1]
  - name: Desk
    rectangle: [0, 0, high, 1]
  - rectangle: [0, 0, 1, 1]
"""
    found = problems(text)
    assert found[0].startswith('labels.yaml:3: there is no key "rectangel" in areas[0]. Did you mean "rectangle"?')
    assert found[1] == "labels.yaml:5: areas[1].rectangle[2]: expected a number, got 'high'"
    assert found[2] == 'labels.yaml:6: areas[2]: "name" is missing'
    assert len(found) == 3


ROUTE = "routes:\n  - {{name: r, start: {}, goal: G5, time_limit_s: 3}}\n"
SHORT = 'areas:\n  - {name: "", rectangle: [0, 0, 1, 1]}\n  - {name: A, outline: [[0, 0], [1, 1]]}\n'


@pytest.mark.parametrize(
    ("model", "text", "found"),
    [
        # Of a name or a pose only the form that was written is judged.
        (RoutesFile, ROUTE.format("{x: 1}"), ['2: routes[0].start: "y" is missing']),
        (RoutesFile, ROUTE.format("[1, 2]"), ["2: routes[0].start: expected a name, or keys and values, got [1, 2]"]),
        (LabelsFile, "- a\n", ["1: expected keys and values (areas), got ['a']"]),
        (LabelsFile, SHORT, ["2: areas[0].name: expected some text, got ''",
                             "3: areas[1].outline: expected at least 3 values, got [[0, 0], [1, 1]]"]),
    ],
)  # fmt: skip
def test_mistakes_are_told_in_words_of_the_file(model: type, text: str, found: list[str]) -> None:
    assert problems(text, model) == [f"labels.yaml:{each}" for each in found]


def test_one_mistake_reads_as_one_line() -> None:
    with pytest.raises(DocumentError) as caught:
        validated(parse_yaml("areas:\n  - {name: A, rectangle: [3, 0, 1, 1]}\n", HERE), LabelsFile)
    assert str(caught.value).startswith("labels.yaml:2: areas[0]: the rectangle [x_min, y_min, x_max, y_max] is empty")


def test_a_misspelt_key_of_an_alternative_form_is_suggested_as_it_is_written() -> None:
    found = problems("name: w\nmap: {form: objects}\n", WorldFile)
    assert 'labels.yaml:2: there is no key "form" in map. Did you mean "from"? Known: from, resolution_m' in found


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("", "file-empty"),
        ("areas: {a: 1, a: 2}", "yaml-key-twice"),
        ("\tareas: 1", "yaml"),
        ("areas: [1, 2", "yaml"),
        ("areas: 2001-13-45", "yaml"),
        ("areas: &x [*x]", "yaml-nested"),
        ("areas: !!python/object/apply:os.system ['true']", "yaml"),
        ("- 1\n---\n- 2\n", "yaml"),
        *(("x: 1.0e+308", "number-too-large"), ("x: 1e308", "number-too-large"), ("x: [-1e13]", "number-too-large")),
        ("x: 99999999999999999999999", "number-too-large"),
    ],
)
def test_text_that_is_no_sound_yaml_is_refused_with_a_code(text: str, code: str) -> None:
    with pytest.raises(FileError, check=coded(code)):
        parse_yaml(text, HERE)


def test_a_bomb_of_aliases_is_refused_quickly() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    with pytest.raises(FileError, check=coded("yaml-nested")):
        parse_yaml("\n".join(lines), HERE)


def test_of_very_many_mistakes_the_first_fifty_are_listed_and_the_rest_counted() -> None:
    text = "areas:\n" + "  - {nmae: x}\n" * 3000
    with pytest.raises(DocumentError) as caught:
        validated(parse_yaml(text, HERE), LabelsFile)
    lines = str(caught.value).splitlines()
    assert len(lines) == 52
    assert lines[-1].startswith("  and ") and len(caught.value.problems) >= 6000
