"""Replayed: answers from a record alone, and says at which call the present prompts diverge from the recorded ones."""

from __future__ import annotations

from collections import defaultdict

from rvsg.core.errors import NotRecorded, ReplayDiverged
from rvsg.core.records import Record
from rvsg.generation.vlm.messages import Answer, Message, Request
from rvsg.generation.vlm.recording import RecordedCall, Recording, place_of

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
