"""The text of the calls of a model, as it is kept beside a campaign, for the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rvsg.generation.generator import Call
from rvsg.generation.vlm.recording import RecordedCall, Recording

MOST_CHARACTERS = 600_000
"""Characters of conversations that a page holds; the record beside the campaign holds all."""


class Conversations:
    """What was said in the calls of a campaign. Every message is given once, where it is said first."""

    def __init__(self, recording: Recording | None) -> None:
        self._recording = recording
        self._calls: Mapping[str, RecordedCall] = {
            call.key: call for call in recording or () if call.answer is not None
        }
        self._failed = {call.key: call for call in recording or () if call.answer is None}
        self._said: set[str] = set()
        self._answers: set[str] = set()
        self._left = MOST_CHARACTERS

    def of(self, calls: Sequence[Call]) -> list[dict[str, Any]]:
        """Return purpose, new messages and answer of each call that is on record."""
        found = []
        for call in calls:
            kept = self._calls.get(call.recording or "") or self._failed.get(call.recording or "")
            if kept is not None and self._recording is not None:
                found.append(self._one(kept, self._recording))
        return found

    def _one(self, call: RecordedCall, recording: Recording) -> dict[str, Any]:
        said = []
        for message_id in call.messages:
            if message_id in self._said:
                continue
            self._said.add(message_id)
            message = recording.message(message_id)
            if message.role == "assistant" and message.text in self._answers:
                continue
            said.append({"role": message.role, "text": self._room(message.text), "pictures": len(message.pictures)})
        self._answers |= {call.answer.text} if call.answer is not None else set()
        answer = call.answer.text if call.answer is not None else f"No answer: {call.error}"
        return {"purpose": call.purpose, "said": said, "answer": self._room(answer)}

    def _room(self, text: str) -> str:
        """Return the text, cut where the page has no room left for it."""
        kept = text[: max(0, self._left)]
        self._left -= len(kept)
        return kept if len(kept) == len(text) else f"{kept} … ({len(text) - len(kept)} more characters in the record)"
