"""Record of all calls of a model in a folder, and replay from it.

The folder holds
- `calls.jsonl`: one line for each call: its place, its messages by content id, the answer and its cost, or the error;
- `messages.jsonl`: every message and schema once;
- `pictures/`: every picture once, named by its content;
- `histories.jsonl`: conversations to go on from, by a name the caller gives;
- `measured.jsonl`: what the prompts of a session were written from.

Lines are only ever appended. A last line that a crash cut off is left out when reading.
"""

from __future__ import annotations

import json
import os
import re
import threading
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import reduce
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rvsg.core.documents import mistakes_of
from rvsg.core.errors import FileError, NotRecorded, ReplayDiverged, StoreError
from rvsg.core.records import Record, canonical_json, content_id
from rvsg.generation.vlm.model import Answer, Message, Request, Spending

CALLS, MESSAGES, HISTORIES, PICTURES = "calls.jsonl", "messages.jsonl", "histories.jsonl", "pictures"
MEASURED = "measured.jsonl"
SHOWN_CHARACTERS = 160
TELLS_A_REHEARSAL = "rehearse"
"""The purpose of a call whose last message tells what was simulated; like all measurements it may differ today."""


def recorded_files(folder: Path) -> list[Path]:
    """Return the files of the record in a folder, which may hold others."""
    return sorted([*folder.glob("*.jsonl"), *folder.glob(f"{PICTURES}/*.png")])


class RecordedCall(Record):
    """One call as it is kept. `request` is the content id of all the model was given."""

    key: str
    session: str
    number: int
    purpose: str
    model: str
    request: str
    messages: tuple[str, ...]
    shape: str | None = None
    answer: Answer | None = None
    error: str | None = None


class CallLog:
    """The calls kept in a folder; made when the first call is kept."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self._lock = threading.Lock()
        self._texts: dict[str, dict[str, Any]] = {}
        self._calls: list[RecordedCall] = []
        for line, value in _lines(self.folder / MESSAGES):
            if not isinstance(value.get("id"), str):
                raise FileError(self.folder / MESSAGES, "expected a message with an id", line=line)
            self._texts[value["id"]] = value
        for line, value in _lines(self.folder / CALLS):
            try:
                self._calls.append(RecordedCall.model_validate(value))
            except ValidationError as error:
                mistakes = "; ".join(mistakes_of(error, RecordedCall))
                raise FileError(self.folder / CALLS, f"not a recorded call: {mistakes}", line=line) from None
        histories, measured = (_lines(self.folder / name) for name in (HISTORIES, MEASURED))
        self._histories = {str(value.get("name")): tuple(value.get("messages", ())) for _, value in histories}
        self._measured = {str(value.get("session")): value.get("measured") for _, value in measured}

    def __len__(self) -> int:
        return len(self._calls)

    def __iter__(self) -> Iterator[RecordedCall]:
        return iter(self._calls)

    def message(self, message_id: str) -> Message:
        """A message of the record, by its id."""
        try:
            return Message.model_validate(self._texts[message_id]["message"])
        except (KeyError, ValidationError):
            raise StoreError(
                f"{self.folder / MESSAGES} holds no message {message_id}; the record is damaged."
            ) from None

    def answered(self, key: str, request_id: str, model: str) -> Answer | None:
        """The answer that this model gave at that place to that very request."""
        for call in self._calls:
            if (call.key, call.request, call.model) == (key, request_id, model) and call.answer is not None:
                return call.answer.replace(source="record")
        return None

    def spent(self) -> Spending:
        """What all the answered calls of the record cost together."""
        usages = (call.answer.usage for call in self._calls if call.answer is not None)
        return reduce(Spending.plus, usages, Spending())

    def keep(self, request: Request, model: str, *, answer: Answer | None = None, error: str | None = None) -> None:
        """Append a call with its messages and pictures; on return it is on the disk."""
        with self._writing("call"):
            for picture in request.pictures.values():
                path = self.folder / PICTURES / f"{picture.digest}.png"
                if not path.exists():
                    path.parent.mkdir(exist_ok=True)
                    path.write_bytes(picture.png)
            messages = self._keep_messages(request.messages)
            call = RecordedCall(
                key=request.key,
                session=request.session,
                number=request.number,
                purpose=request.purpose,
                model=model,
                request=request.id,
                messages=messages,
                shape=self._keep_text("shape", request.shape) if request.shape is not None else None,
                answer=answer,
                error=error,
            )
            _append(self.folder / CALLS, call.model_dump(mode="json"))
            self._calls.append(call)

    def history(self, name: str) -> tuple[Message, ...] | None:
        """The conversation kept under a name, or None."""
        ids = self._histories.get(name)
        return tuple(self.message(message_id) for message_id in ids) if ids is not None else None

    def keep_history(self, name: str, messages: Iterable[Message]) -> None:
        """Keep a conversation to go on from."""
        with self._writing("conversation"):
            ids = self._keep_messages(messages)
            if self._histories.get(name) != ids:
                _append(self.folder / HISTORIES, {"name": name, "messages": list(ids)})
            self._histories[name] = ids

    def measured(self, session: str) -> dict[str, Any]:
        """What the prompts of a session were written from, or of one at the same place; empty where it is not kept."""
        found = self._measured.get(session)
        if session not in self._measured:
            place = place_of(session)
            found = next((value for name, value in self._measured.items() if place_of(name) == place), None)
        return found if isinstance(found, dict) else {}

    def keep_measured(self, session: str, measured: Any) -> None:
        """Keep what the prompts of a session are written from."""
        with self._writing("call"):
            if self._measured.get(session) != measured:
                _append(self.folder / MEASURED, {"session": session, "measured": measured})
                self._measured[session] = measured

    @contextmanager
    def _writing(self, what: str) -> Iterator[None]:
        with self._lock:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                yield
            except OSError as failure:
                raise StoreError(f"The {what} cannot be recorded in {self.folder}: {failure}") from None

    def _keep_messages(self, messages: Iterable[Message]) -> tuple[str, ...]:
        return tuple(self._keep_text("message", message.model_dump(mode="json")) for message in messages)

    def _keep_text(self, kind: str, value: Any) -> str:
        text_id = content_id(kind, value)
        if text_id not in self._texts:
            line = {"id": text_id, kind: value}
            _append(self.folder / MESSAGES, line)
            self._texts[text_id] = line
        return text_id


def place_of(session: str) -> str:
    """A session without what differs from seed to seed: `s000-c01` of `s000-c01-5f3a...`."""
    found = re.match(r"s\d+-c\d+", session)
    return found.group(0) if found else session


def _append(path: Path, value: Any) -> None:
    """Append one line in one write, on a line of its own after one that was cut off; wait until it is on the disk."""
    with path.open("ab+") as file:
        cut_off = b""
        if file.tell():
            file.seek(-1, os.SEEK_END)
            cut_off = b"" if file.read(1) == b"\n" else b"\n"
        file.write(cut_off + (canonical_json(value) + "\n").encode())
        file.flush()
        os.fsync(file.fileno())


def _lines(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """The JSON objects of a file with their line numbers; a line cut off by a crash is left out."""
    if not path.exists():
        return
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").split("\n")
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror}") from None
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            value = json.loads(line)
        except ValueError:
            # Only a write that was cut off leaves a broken line: the last one, or one that was later continued
            # on a line of its own. Anything shorter than a record is not worth more.
            if number >= len(lines) - 1 or len(line) < 2 or not line.endswith("}"):
                continue
            raise FileError(path, "not a line of JSON", line=number) from None
        if not isinstance(value, dict):
            raise FileError(path, "expected an object of JSON", line=number)
        yield number, value


class Replayed:
    """A model that answers each call with the answer recorded at the same place (attempt, number, purpose).

    A difference from the recorded request is noted in `divergences`; with `strict` it is an error, as is a call that
    the record does not hold. The place of an attempt is its session up to the seed (`s000-c01` of `s000-c01-5f3a...`),
    so that a record replays under another seed; an attempt asked again takes the recorded ones in turn.
    """

    def __init__(self, recording: CallLog, *, strict: bool = False) -> None:
        self._recording = recording
        self._strict = strict
        self._calls = {call.key: call for call in recording if call.answer is not None}
        self._sessions: dict[str, list[str]] = defaultdict(list)
        for session in dict.fromkeys(call.session for call in self._calls.values()):
            self._sessions[place_of(session)].append(session)
        self._taken: dict[str, str] = {}
        self.divergences: list[tuple[str, str]] = []
        """The calls that are asked otherwise than they were recorded, each with the first difference."""
        self.name = next((call.model for call in recording), "recorded")

    def ask(self, request: Request) -> Answer:
        """The recorded answer; ReplayDiverged where there is none, or where it is strict and the requests differ."""
        session = self._session(request)
        call = self._calls.get(f"{session}/{request.number:02d}-{request.purpose}") if session else None
        if call is None or call.answer is None:
            raise self._missing(request, session)
        recorded = [self._recording.message(i) for i in call.messages]
        rehearsed = request.purpose == TELLS_A_REHEARSAL and list(request.messages[:-1]) == recorded[:-1]
        if call.request != request.id and not rehearsed:
            difference = _difference(request, recorded)
            self.divergences.append((request.key, difference))
            if self._strict:
                raise ReplayDiverged(
                    f"The present prompts diverge from the record at call {request.key}: {difference}. Without strict "
                    "replay the recorded answer is used and the difference reported.",
                    code="replay-prompts",
                )
        return call.answer.replace(source="record")

    def _session(self, request: Request) -> str | None:
        """The recorded session that stands for the asked one."""
        if request.session not in self._taken:
            recorded = self._sessions.get(place_of(request.session), [])
            free = [s for s in recorded if s not in self._taken.values()]
            chosen = request.session if request.session in free else next(iter(free), None)
            if chosen is None:
                return None
            self._taken[request.session] = chosen
        return self._taken[request.session]

    def _missing(self, request: Request, session: str | None) -> ReplayDiverged:
        folder = self._recording.folder
        if session is None:
            return (ReplayDiverged if self._strict else NotRecorded)(
                f"The record in {folder} holds no answer for attempt {place_of(request.session)} "
                f"(it is asked for the call {request.purpose}). It holds {len(self._sessions)} attempts: ask for no "
                "more scenarios and refinements than were recorded, or record the rest with a model."
            )
        held = ", ".join(call.key.split("/")[1] for call in self._calls.values() if call.session == session)
        return ReplayDiverged(
            f"The record in {folder} diverges at call {request.key}: the attempt's recorded calls are "
            f"{held}. The checker or the prompts have changed since; record it again with a model."
        )


def _difference(request: Request, recorded: list[Message]) -> str:
    """Return where the present request first differs from the recorded messages, in words."""
    for index, (now, then) in enumerate(zip(request.messages, recorded, strict=False), start=1):
        if now != then:
            return f"message {index} ({now.role}): {_message_difference(now, then)}"
    if len(recorded) != len(request.messages):
        return f"{len(request.messages)} messages instead of {len(recorded)}"
    return "the shape of the reply that is asked for"


def _message_difference(now: Message, then: Message) -> str:
    lines_now, lines_then = now.text.splitlines(), then.text.splitlines()
    for number, (a, b) in enumerate(zip(lines_now, lines_then, strict=False), start=1):
        if a != b:
            return f"line {number} is {_shown(a)}, recorded {_shown(b)}"
    if len(lines_now) != len(lines_then):
        return f"{len(lines_now)} lines instead of {len(lines_then)}"
    for shown, kept in zip(now.pictures, then.pictures, strict=False):
        if shown != kept:
            return f'picture "{shown.name}" is {shown.digest}, recorded {kept.digest}'
    return f"its role is {now.role}, recorded {then.role}" if now.role != then.role else "its pictures"


def _shown(line: str) -> str:
    return repr(line if len(line) <= SHOWN_CHARACTERS else line[:SHOWN_CHARACTERS] + "...")
