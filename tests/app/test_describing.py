"""The review of a description outside the terminal: reasons one after the other, and what they changed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.generation.loopback import says, serving

import rvsg
from rvsg.generation.environment import open_session
from rvsg.world.world import Description
from rvsg_studio.model_questions import difference


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        ("", "", []),
        ("a b c", "a b c", [("same", "a b c")]),
        ("a b c", "a x c", [("same", "a "), ("removed", "b "), ("added", "x "), ("same", "c")]),
        ("a", "a b", [("same", "a "), ("added", "b")]),
        ("a b", "", [("removed", "a b")]),
    ],
)
def test_a_difference_is_shown_word_by_word(before: str, after: str, expected: list[tuple[str, str]]) -> None:
    assert difference(before, after) == expected


def test_only_the_last_reason_costs_a_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    warehouse = rvsg.load_world("warehouse")
    monkeypatch.setenv("RVSG_API_KEY", "none")
    answers = [json.dumps({"layout": text, "grid": "rows"}) for text in ("first", "second")]
    start = Description(layout="mine", grid="rows")
    with serving(*(says(answer) for answer in answers)) as server:
        for reasons, expected in ((["too short"], "first"), (["too short", "still"], "second")):
            session = open_session(
                warehouse, "openai-chat:vision-1", tmp_path / "kept", None, base_url=server.url, prices=(1, 1, 1)
            )
            assert session is not None
            assert session.revised(start, reasons).layout == expected
        assert len(server.requests) == 2
