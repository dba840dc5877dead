"""The conversation with a model on the page."""

from __future__ import annotations

from pathlib import Path

from rvsg.generation.generator import Call
from rvsg.generation.vlm.model import Answer, Message, Request
from rvsg.generation.vlm.recording import Recording
from rvsg.report import page_contents
from rvsg.report.page_contents import Conversations


def call(recording: Recording, number: int, *texts: tuple[str, str], answer: str | None) -> Call:
    messages = tuple(Message(role=role, text=text) for role, text in texts)  # type: ignore[arg-type]
    request = Request(session="s000-c00", number=number, purpose=f"step {number}", messages=messages)
    given = Answer(text=answer, model="m") if answer is not None else None
    recording.keep(request, "m", answer=given, error=None if answer is not None else "no connection")
    return Call(purpose=request.purpose, model="m", recording=request.key)


def test_every_message_is_shown_once_and_every_answer(tmp_path: Path) -> None:
    recording = Recording(tmp_path)
    first = call(recording, 1, ("system", "You test."), ("user", "One?"), answer="Two.")
    second = call(
        recording, 2, ("system", "You test."), ("user", "One?"), ("assistant", "Two."), ("user", "Again?"), answer="No."
    )
    shown = Conversations(recording).of([first, second])
    assert [[(m["role"], m["text"]) for m in each["said"]] for each in shown] == [
        [("system", "You test."), ("user", "One?")],
        [("user", "Again?")],
    ]
    assert [each["answer"] for each in shown] == ["Two.", "No."]


def test_a_failed_call_and_one_that_is_not_kept(tmp_path: Path) -> None:
    recording = Recording(tmp_path)
    failed = call(recording, 1, ("user", "One?"), answer=None)
    other = Call(purpose="x", model="m", recording="another")
    (shown,) = Conversations(recording).of([failed, other])
    assert "no connection" in shown["answer"]
    assert Conversations(None).of([failed]) == []


def test_a_long_conversation_is_cut_with_a_word(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr(page_contents, "MOST_CHARACTERS", 10)
    recording = Recording(tmp_path)
    made = call(recording, 1, ("user", "0123456"), answer="789abcdef")
    (shown,) = Conversations(recording).of([made])
    assert shown["said"][0]["text"] == "0123456"
    assert shown["answer"].startswith("789 …") and "6 more" in shown["answer"]
