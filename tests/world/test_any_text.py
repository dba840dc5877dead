"""Whatever stands in a world's files, the answer is a world or one message."""

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.coded import at_key
from tests.world.test_load import LABELS, OBJECTS, ROUTES, WORLD

from rvsg.core.documents import DocumentError, parse_yaml, validated
from rvsg.core.errors import RvsgError
from rvsg.world.schema import LabelsFile
from rvsg.world.world_folder import load_world

FILES = {"world.yaml": WORLD, "objects.yaml": OBJECTS, "labels.yaml": LABELS, "routes.yaml": ROUTES}
STRANGE = [
    "-1",
    "1e308",
    ".nan",
    ".inf",
    "null",
    "[]",
    "{}",
    "''",
    "{a: 1}",
    "9" * 30,
    "~",
    "2001-01-01",
    "&a",
    "*a",
    "|",
    "-",
]


@st.composite
def damaged(draw: st.DrawFn) -> dict[str, str]:
    name = draw(st.sampled_from(sorted(FILES)))
    text = FILES[name]
    way = draw(st.sampled_from(["word", "line", "sign"]))
    if way == "word":
        words = list(re.finditer(r"[\w.+-]+", text))
        word = draw(st.sampled_from(words))
        text = text[: word.start()] + draw(st.sampled_from(STRANGE)) + text[word.end() :]
    elif way == "line":
        lines = text.splitlines(keepends=True)
        at = draw(st.integers(0, len(lines) - 1))
        lines[at : at + 1] = [lines[at]] * draw(st.sampled_from([0, 2]))
        text = "".join(lines)
    else:
        at = draw(st.integers(0, len(text) - 1))
        text = text[:at] + draw(st.sampled_from(list("[]{}:,-#'\"&*!|>%@`\t\n\x00é9"))) + text[at + 1 :]
    return {**FILES, name: text}


@settings(deadline=None, max_examples=120, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(damaged())
def test_a_damaged_world_is_read_or_refused_with_a_message(tmp_path: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    try:
        assert load_world(tmp_path).grid.valid
    except RvsgError as error:
        assert str(error)


@pytest.mark.parametrize("name", ["no", "12", "2001-01-01"])
def test_a_name_that_yaml_reads_as_something_else_is_told_to_be_quoted(name: str) -> None:
    text = f"areas:\n  - {{name: {name}, rectangle: [0, 0, 1, 1]}}\n"
    with pytest.raises(DocumentError, check=at_key("areas", 0, "name")) as caught:
        validated(parse_yaml(text, Path("labels.yaml")), LabelsFile)
    assert "quotes" in caught.value.reason  # what to do
