"""The door for foreign files and text."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.coded import coded

from rvsg.core.errors import FileError, InputError
from rvsg.core.inputs import exists, is_dir, is_too_deep, parse_json, read_bytes, read_text, whole_text

HERE = Path("a.json")
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**64), 2**64) | st.floats(-1e12, 1e12, allow_nan=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@given(plain)
def test_proper_json_is_read_as_python_reads_it(value: object) -> None:
    text = json.dumps(value)
    assert parse_json(text, HERE) == json.loads(text)


@given(st.text())
def test_any_text_is_read_or_refused_with_its_file(text: str) -> None:
    try:
        parse_json(text, HERE)
    except FileError as error:
        assert error.path == HERE


@pytest.mark.parametrize(
    "text",
    [
        *(
            '{"a": NaN}',
            "Infinity",
            "9" * 5000,
            "9" * 30,
            "1e308",
            "-1e13",
            "1e" + "9" * 500,
            '"\\ud800"',
            '{"\\udfff": 1}',
            '"\ud800"',
            "",
        ),
        *("[" * 100_000, "[" * 90 + "]" * 90, '{"a":' * 100_000, "{'a': 1}", "1 2"),
    ],
    ids=lambda text: ascii(text)[:20],
)
def test_what_no_record_can_hold_is_refused(text: str) -> None:
    with pytest.raises(FileError):
        parse_json(text, HERE)


def test_the_line_of_a_mistake_is_named() -> None:
    with pytest.raises(FileError) as error:
        parse_json('{\n"a": 1,\n"b" 2}', HERE)
    assert error.value.line == 3
    with pytest.raises(FileError) as error:
        parse_json("{", HERE, line=7)
    assert error.value.line == 7


@pytest.mark.parametrize(
    "name",
    ["absent", "a" * 5000, "a/" * 3000, "with\0nul", "half\ud800", "."],
    ids=["absent", "name", "path", "nul", "half", "."],
)
def test_a_path_that_cannot_be_read_is_an_input_error(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError):
        read_text(tmp_path / name)
    assert exists(tmp_path / name) == is_dir(tmp_path / name) == (name == ".")


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there is no /dev/zero here")
def test_a_device_without_end_is_refused() -> None:
    with pytest.raises(FileError, check=coded("file-too-large")):
        read_bytes(Path("/dev/zero"), largest=1_000_000)


def test_text_that_is_no_utf8_is_refused_and_a_byte_order_mark_skipped(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"\xef\xbb\xbfa\xc3\xa4")
    assert read_text(path) == "aä"
    path.write_bytes(b"a\xff")
    with pytest.raises(FileError, check=coded("file-not-text")):
        read_text(path)


@given(st.text(st.characters()))
def test_any_text_can_be_made_whole(text: str) -> None:
    assert whole_text(text).encode().decode() == whole_text(text)
    assert whole_text(text + "\ud83d") == whole_text(text) + "�"


def test_depth_is_measured_without_recursion() -> None:
    deep: list[object] = []
    for _ in range(100_000):
        deep = [deep]
    assert is_too_deep(deep) and not is_too_deep([[{"a": [1]}]])
    while deep:  # else Python frees it recursively
        deep = deep.pop()  # type: ignore[assignment]
