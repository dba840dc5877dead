"""What goes to a model and what comes back, as plain data."""

from __future__ import annotations

import hashlib
import math
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

from pydantic import field_validator

from rvsg.core.inputs import whole_text
from rvsg.core.records import Record, canonical_json, content_id

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PIECES = re.compile(r" ?[^\W\d_]+|\d{1,3}|\n+| ?[^\w\s]+|_|[ \t]+")
_WHOLE_WORD = 8
_PART_OF_WORD = 5


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A PNG picture under a name that prompts refer to."""

    name: str
    png: bytes

    @cached_property
    def digest(self) -> str:
        """The first 24 hexadecimal digits of the SHA-256 of the PNG."""
        return hashlib.sha256(self.png).hexdigest()[:24]

    @cached_property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels; (0, 0) where the bytes are not a PNG."""
        if not self.png.startswith(PNG_SIGNATURE) or len(self.png) < 24:
            return (0, 0)
        width, height = struct.unpack(">II", self.png[16:24])
        return (int(width), int(height))

    @property
    def reference(self) -> PictureReference:
        """The picture without its bytes, as records keep it."""
        return PictureReference(name=self.name, digest=self.digest, width=self.size[0], height=self.size[1])


class PictureReference(Record):
    """A picture by its name, content and size in pixels."""

    name: str
    digest: str
    width: int
    height: int


class Message(Record):
    """One turn of a conversation. `stable` marks the end of the part that is equal in every call of a campaign."""

    role: Literal["system", "user", "assistant"]
    text: str
    pictures: tuple[PictureReference, ...] = ()
    stable: bool = False


@dataclass(frozen=True, kw_only=True)
class Request:
    """One call: the messages, the bytes of their pictures by digest, and what the answer must look like.

    `session` names what the call belongs to (an attempt), `number` counts the calls of a session from 1, and
    `purpose` says what the call is for: together they are the call's place in a record. `shape` is a JSON schema
    for structured output, or None for free text.
    """

    session: str
    number: int
    purpose: str
    messages: tuple[Message, ...]
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    shape: dict[str, Any] | None = None

    @property
    def key(self) -> str:
        """The place of the call in a record, e.g. `s000-c01/02-P6`."""
        return f"{self.session}/{self.number:02d}-{self.purpose}"

    @cached_property
    def id(self) -> str:
        """Content id of all that the model is given."""
        return content_id(
            "request", {"messages": [m.model_dump(mode="json") for m in self.messages], "shape": self.shape}
        )


class Usage(Record):
    """Tokens, money and time of one call. `estimated` where the service did not count the tokens itself."""

    input_tokens: int = 0
    cached_tokens: int = 0
    output_tokens: int = 0
    cost_usd: float | None = None
    latency_s: float = 0.0
    tries: int = 1
    estimated: bool = False


class Answer(Record):
    """What a model answered. `finish` is how the answer ended; a refusal or an empty answer is an answer too."""

    text: str
    model: str
    finish: Literal["complete", "truncated", "refused", "empty"] = "complete"
    usage: Usage = Usage()
    source: Literal["model", "record"] = "model"

    @field_validator("text")
    @classmethod
    def _can_be_stored(cls, text: str) -> str:
        return whole_text(text)


def estimated_tokens(text: str) -> int:
    """Tokens of a text, estimated where no tokenizer of the model is at hand.

    The text is cut where the tokenizers of the GPT-4 family cut before they merge (words with the space before them,
    up to three digits, runs of marks, line breaks); each piece counts one token, a longer word one for every begun
    five letters. That is nearer than the usual four characters per token for lists of waypoints, which it would
    count at little more than half.
    """
    total = 0
    for piece in _PIECES.finditer(text):
        length = piece.end() - piece.start()
        total += 1 if length <= _WHOLE_WORD else math.ceil(length / _PART_OF_WORD)
    return total


def picture_tokens(width: int, height: int) -> int:
    """Tokens of a picture by the tile rule published for the GPT-4 family at high detail.

    The picture is scaled to fit 2048 x 2048, then its shorter side to at most 768, and every begun tile of
    512 x 512 costs 170 tokens, plus 85 once.
    """
    if width <= 0 or height <= 0:
        return 0
    scale = min(1.0, 2048 / max(width, height))
    scale *= min(1.0, 768 / (min(width, height) * scale))
    return 85 + 170 * math.ceil(width * scale / 512) * math.ceil(height * scale / 512)


def estimated_input_tokens(request: Request) -> int:
    """Estimated input tokens of a request, pictures and schema included."""
    texts = sum(estimated_tokens(m.text) + 4 for m in request.messages)
    pictures = sum(picture_tokens(p.width, p.height) for m in request.messages for p in m.pictures)
    return texts + pictures + (estimated_tokens(canonical_json(request.shape)) if request.shape else 0)
