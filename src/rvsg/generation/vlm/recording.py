"""Record of all calls of a model in a folder, and replay from it.

The folder holds
- `calls.jsonl`: one line for each call: its place, its messages by content id, the answer and its cost, or the error;
- `messages.jsonl`: every message and schema once;
- `pictures/`: every picture once, named by its content;
- `histories.jsonl`: conversations to go on from, by a name the caller gives;
- `measured.jsonl` (`told.jsonl` in records of earlier versions): what the prompts of a session were written from.

Lines are only ever appended. A last line that a crash cut off is left out when reading.
"""

from __future__ import annotations

import json
import os
import re
import threading
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rvsg.core.errors import FileError, ModelUnavailable, NotRecorded, ReplayDiverged, StoreError
from rvsg.core.records import Record, canonical_json, content_id
from rvsg.generation.vlm.model import Answer, Message, Model, Request, Spending

CALLS, MESSAGES, HISTORIES, PICTURES = "calls.jsonl", "messages.jsonl", "histories.jsonl", "pictures"
MEASURED, MEASURED_BEFORE = "measured.jsonl", ("told.jsonl", "told")


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


class Recording:
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
                first = error.errors()[0]
                place = ".".join(str(part) for part in first["loc"])
                raise FileError(
                    self.folder / CALLS, f"not a recorded call: {place}: {first['msg']}", line=line
                ) from None

        self._histories = {
            str(value.get("name")): tuple(value.get("messages", ())) for _, value in _lines(self.folder / HISTORIES)
        }
        before, key = MEASURED_BEFORE
        self._measured = {str(value.get("session")): value.get(key) for _, value in _lines(self.folder / before)}
        for _, value in _lines(self.folder / MEASURED):
            self._measured[str(value.get("session"))] = value.get("measured")

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

    def answered(self, key: str, request_id: str, model: str) -> RecordedCall | None:
        """The call that this model answered at that place for that very request."""
        asked = (key, request_id, model)
        found = (c for c in self._calls if (c.key, c.request, c.model) == asked and c.answer is not None)
        return next(found, None)

    def spent(self) -> Spending:
        """What all the answered calls of the record cost together."""
        spent = Spending()
        for call in self._calls:
            if call.answer is not None:
                spent = spent.plus(call.answer.usage)
        return spent

    def keep(self, request: Request, model: str, *, answer: Answer | None = None, error: str | None = None) -> None:
        """Append a call with its messages and pictures; on return it is on the disk."""
        with self._lock:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                for picture in request.pictures.values():
                    self._keep_picture(picture.digest, picture.png)
                ids = [self._keep_text("message", m.model_dump(mode="json")) for m in request.messages]
                shape = self._keep_text("shape", request.shape) if request.shape is not None else None
                call = RecordedCall(
                    key=request.key,
                    session=request.session,
                    number=request.number,
                    purpose=request.purpose,
                    model=model,
                    request=request.id,
                    messages=tuple(ids),
                    shape=shape,
                    answer=answer,
                    error=error,
                )
                _append(self.folder / CALLS, call.model_dump(mode="json"))
            except OSError as failure:
                raise StoreError(f"The call cannot be recorded in {self.folder}: {failure}") from None
            self._calls.append(call)

    def history(self, name: str) -> tuple[Message, ...] | None:
        """The conversation kept under a name, or None."""
        ids = self._histories.get(name)
        return tuple(self.message(message_id) for message_id in ids) if ids is not None else None

    def keep_history(self, name: str, messages: Iterable[Message]) -> None:
        """Keep a conversation to go on from."""
        with self._lock:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                ids = tuple(self._keep_text("message", m.model_dump(mode="json")) for m in messages)
                if self._histories.get(name) != ids:
                    _append(self.folder / HISTORIES, {"name": name, "messages": list(ids)})
            except OSError as failure:
                raise StoreError(f"The conversation cannot be recorded in {self.folder}: {failure}") from None
            self._histories[name] = ids

    def measured(self, session: str) -> Any:
        """What the prompts of a session were written from, or of one at the same place; None where it is not kept."""
        if session in self._measured:
            return self._measured[session]
        return next((value for name, value in self._measured.items() if place_of(name) == place_of(session)), None)

    def keep_measured(self, session: str, measured: Any) -> None:
        """Keep what the prompts of a session are written from."""
        with self._lock:
            if self._measured.get(session) == measured:
                return
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                _append(self.folder / MEASURED, {"session": session, "measured": measured})
            except OSError as failure:
                raise StoreError(f"The call cannot be recorded in {self.folder}: {failure}") from None
            self._measured[session] = measured

    def _keep_text(self, kind: str, value: Any) -> str:
        text_id = content_id(kind, value)
        if text_id not in self._texts:
            line = {"id": text_id, kind: value}
            _append(self.folder / MESSAGES, line)
            self._texts[text_id] = line
        return text_id

    def _keep_picture(self, digest: str, png: bytes) -> None:
        path = self.folder / PICTURES / f"{digest}.png"
        if not path.exists():
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(png)


class Recorded:
    """A model whose calls are kept, and whose answer is taken from the record where it gave it there already.

    That makes a campaign that was stopped between two calls go on where it was, at no cost.
    """

    def __init__(self, model: Model, recording: Recording) -> None:
        self._model = model
        self.recording = recording

    @property
    def name(self) -> str:
        """The name of the model."""
        return self._model.name

    def ask(self, request: Request) -> Answer:
        """The recorded answer, or the model's, which is then kept. A failed call is kept too."""
        known = self.recording.answered(request.key, request.id, self.name)
        if known is not None and known.answer is not None:
            return known.answer.model_copy(update={"source": "record"})
        failure: ModelUnavailable | None = None
        try:
            answer = self._model.ask(request)
        except ModelUnavailable as error:
            failure = error
        if failure is not None:
            self.recording.keep(request, self._model.name, error=str(failure))
            raise failure
        self.recording.keep(request, self._model.name, answer=answer)
        return answer


def place_of(session: str) -> str:
    """A session without what differs from seed to seed: `s000-c01` of `s000-c01-5f3a...`."""
    found = re.match(r"s\d+-c\d+", session)
    return found.group(0) if found else session


def _append(path: Path, value: Any) -> None:
    """Append one line in one write, and wait until it is on the disk."""
    data = (canonical_json(value) + "\n").encode()
    cut_off = path.exists() and path.stat().st_size > 0 and not _ends_line(path)
    with path.open("ab") as file:
        file.write(b"\n" + data if cut_off else data)
        file.flush()
        os.fsync(file.fileno())


def _ends_line(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"


def _lines(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """The JSON objects of a file with their line numbers; a line cut off by a crash is left out."""
    if not path.exists():
        return
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").split("\n")
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror}") from None
    whole = len(lines) - 1
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            value = json.loads(line)
        except ValueError:
            # Only a write that was cut off leaves a broken line: the last one, or one that was later continued
            # on a line of its own. Anything shorter than a record is not worth more.
            if number >= whole or len(line) < 2 or not line.endswith("}"):
                continue
            raise FileError(path, "not a line of JSON", line=number) from None
        if not isinstance(value, dict):
            raise FileError(path, "expected an object of JSON", line=number)
        yield number, value


SHOWN_CHARACTERS = 160
TELLS_A_REHEARSAL = "rehearse"
"""The purpose of a call whose last message tells what was simulated; like all measurements it may differ today."""


class Divergence(Record):
    """The first difference between a call as it is asked now and as it was recorded."""

    key: str
    what: str

    def __str__(self) -> str:
        return f"call {self.key}: {self.what}"


class Replayed:
    """A model that answers each call with the answer recorded at the same place (attempt, number, purpose).

    Where the request differs from the recorded one, the difference is noted in `divergences`; with `strict` it is
    an error. A call that the record does not hold is always an error. The place of an attempt is its session up to
    the seed (`s000-c01` of `s000-c01-5f3a...`), so that a record can be replayed under another seed; an attempt that
    is asked more than once takes the recorded ones in turn.
    """

    def __init__(self, recording: Recording, *, strict: bool = False) -> None:
        self._recording = recording
        self._strict = strict
        self._sessions: dict[str, list[str]] = defaultdict(list)
        self._taken: dict[str, str] = {}
        self._calls: dict[str, RecordedCall] = {}
        self.divergences: list[Divergence] = []
        for call in recording:
            if call.answer is None:
                continue
            self._calls[call.key] = call
            sessions = self._sessions[place_of(call.session)]
            if call.session not in sessions:
                sessions.append(call.session)

    @property
    def name(self) -> str:
        """The name of the recorded model."""
        return next((call.model for call in self._recording), "recorded")

    def ask(self, request: Request) -> Answer:
        """The recorded answer; ReplayDiverged where there is none, or where it is strict and the requests differ."""
        session = self._session(request)
        call = self._calls.get(f"{session}/{request.number:02d}-{request.purpose}") if session else None
        if call is None or call.answer is None:
            ended = session is None and not self._strict
            raise (NotRecorded if ended else ReplayDiverged)(self._told_missing(request, session))
        if call.request != request.id and not self._differs_in_the_rehearsal(request, call):
            divergence = Divergence(key=request.key, what=self._difference(request, call))
            self.divergences.append(divergence)
            if self._strict:
                raise ReplayDiverged(
                    f"The present prompts diverge from the record at {divergence}. Without strict replay the recorded "
                    "answer is used and the difference reported.",
                    code="replay-prompts",
                )
        return call.answer.model_copy(update={"source": "record"})

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

    def _differs_in_the_rehearsal(self, request: Request, call: RecordedCall) -> bool:
        """Return whether the requests are equal but for the last message, which tells a rehearsal."""
        recorded = [self._recording.message(i) for i in call.messages]
        return request.purpose == TELLS_A_REHEARSAL and list(request.messages[:-1]) == recorded[:-1]

    def _told_missing(self, request: Request, session: str | None) -> str:
        if session is None:
            return (
                f"The record in {self._recording.folder} holds no answer for attempt {place_of(request.session)} "
                f"(it is asked for the call {request.purpose}). It holds {len(self._sessions)} attempts: ask for no "
                "more scenarios and refinements than were recorded, or record the rest with a model."
            )
        held = [c.key.split("/")[1] for c in self._calls.values() if c.session == session]
        return (
            f"The record in {self._recording.folder} diverges at call {request.key}: the attempt's recorded calls are "
            f"{', '.join(held)}. The checker or the prompts have changed since; record it again with a model."
        )

    def _difference(self, request: Request, call: RecordedCall) -> str:
        """Return where the present request first differs, in words."""
        recorded = [self._recording.message(i) for i in call.messages]
        for index, (now, then) in enumerate(zip(request.messages, recorded, strict=False), start=1):
            if now != then:
                return f"message {index} ({now.role}): {_message_difference(now, then)}"
        if len(recorded) != len(request.messages):
            return f"{len(request.messages)} messages instead of {len(recorded)}"
        return "the shape of the reply that is asked for"


def _message_difference(now: Message, then: Message) -> str:
    if now.text != then.text:
        lines_now, lines_then = now.text.splitlines(), then.text.splitlines()
        for number, (a, b) in enumerate(zip(lines_now, lines_then, strict=False), start=1):
            if a != b:
                return f"line {number} is {_shown(a)}, recorded {_shown(b)}"
        return f"{len(lines_now)} lines instead of {len(lines_then)}"
    for a_picture, b_picture in zip(now.pictures, then.pictures, strict=False):
        if a_picture != b_picture:
            return f'picture "{a_picture.name}" is {a_picture.digest}, recorded {b_picture.digest}'
    if now.role != then.role:
        return f"its role is {now.role}, recorded {then.role}"
    return "its pictures"


def _shown(line: str) -> str:
    return repr(line if len(line) <= SHOWN_CHARACTERS else line[:SHOWN_CHARACTERS] + "...")
