"""The Model protocol, its messages, requests and answers, the options of access to one, and estimates of tokens."""

from __future__ import annotations

import hashlib
import math
import re
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, Self

from pydantic import Field, ValidationError, field_validator

from rvsg.core.documents import keys_of
from rvsg.core.errors import InvalidOptions, ModelUnavailable, UnknownName
from rvsg.core.inputs import whole_text
from rvsg.core.records import Record, canonical_json, content_id

NO_CALL = (
    "a budget of 0 allows no call. Leave it out for no limit; without a model --replay answers from recorded calls, "
    "and the heuristic generator needs none"
)
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A PNG picture under a name that prompts refer to."""

    name: str
    png: bytes

    @cached_property
    def reference(self) -> PictureReference:
        """The picture without its bytes, as records keep it; its size is 0 where the bytes are not a PNG."""
        is_png = self.png.startswith(PNG_SIGNATURE) and len(self.png) >= 24
        width, height = struct.unpack(">II", self.png[16:24]) if is_png else (0, 0)
        return PictureReference(name=self.name, digest=self.digest, width=width, height=height)

    @cached_property
    def digest(self) -> str:
        """The first 24 hexadecimal digits of the SHA-256 of the PNG."""
        return hashlib.sha256(self.png).hexdigest()[:24]


class PictureReference(Record):
    """A picture by its name, content and size in pixels."""

    name: str
    digest: str
    width: int
    height: int


Role = Literal["system", "user", "assistant"]


class Message(Record):
    """One turn of a conversation. `stable` marks the end of the part that is equal in every call of a campaign."""

    role: Role
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
        messages = [message.model_dump(mode="json") for message in self.messages]
        return content_id("request", {"messages": messages, "shape": self.shape})


class Usage(Record):
    """Tokens, money and time of one call. `estimated` where the service did not count the tokens itself."""

    input_tokens: int = 0
    cached_tokens: int = 0
    output_tokens: int = 0
    cost_usd: float | None = None
    latency_s: float = 0.0
    tries: int = 1
    estimated: bool = False


class Spending(Record):
    """What several calls cost together. `unpriced` counts calls whose cost is not known."""

    calls: int = 0
    input_tokens: int = 0
    cached_tokens: int = 0
    output_tokens: int = 0
    cost_usd: float = 0.0
    unpriced: int = 0

    @property
    def tokens(self) -> int:
        """Input and output tokens."""
        return self.input_tokens + self.output_tokens

    def plus(self, usage: Usage) -> Spending:
        """With one more call."""
        return Spending(
            calls=self.calls + 1,
            input_tokens=self.input_tokens + usage.input_tokens,
            cached_tokens=self.cached_tokens + usage.cached_tokens,
            output_tokens=self.output_tokens + usage.output_tokens,
            cost_usd=self.cost_usd + (usage.cost_usd or 0.0),
            unpriced=self.unpriced + (usage.cost_usd is None),
        )


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


class Model(Protocol):
    """Anything that answers a request."""

    @property
    def name(self) -> str:
        """The model's name as the user gave it, e.g. `openai-chat:gpt-4.1`."""
        ...

    def ask(self, request: Request) -> Answer:
        """Answer; raises ModelUnavailable or BudgetSpent where no answer can be had."""
        ...


class Scripted:
    """Answers from a list of texts (or of functions of the request) in order; ModelUnavailable when the script ends."""

    def __init__(self, replies: Iterable[str | Answer | Callable[[Request], str]], name: str = "scripted") -> None:
        self._replies = list(replies)
        self.name = name
        self.asked: list[Request] = []

    def ask(self, request: Request) -> Answer:
        """The next reply of the script."""
        self.asked.append(request)
        if not self._replies:
            raise ModelUnavailable(f"The script of model {self.name} has ended; call {request.key} has no reply.")
        reply = self._replies.pop(0)
        if isinstance(reply, Answer):
            return reply
        text = reply(request) if callable(reply) else reply
        usage = Usage(
            input_tokens=estimated_input_tokens(request), output_tokens=estimated_tokens(text), estimated=True
        )
        return Answer(text=text, model=self.name, finish="complete" if text.strip() else "empty", usage=usage)


class Access(Record):
    """How a model is reached, and within what bounds.

    `tries` counts the first one too. A wait between tries is `first_wait_s` doubled each time, at most
    `longest_wait_s`, or what the service's Retry-After asks for; a service that asks for more than `longest_wait_s`
    ends the call. `prices` are dollars per million input, cached and output tokens, for models whose price is not
    listed. `replay` is a folder of recorded calls to answer from; `strict` makes every divergence from it an error.
    `record` is the folder that calls are kept in.
    """

    base_url: str | None = None
    temperature: Annotated[float | None, Field(ge=0, le=2)] = None
    call_timeout_s: Annotated[float, Field(gt=0, le=3600)] = 180.0
    tries: Annotated[int, Field(ge=1, le=20)] = 4
    first_wait_s: Annotated[float, Field(ge=0, le=60)] = 2.0
    longest_wait_s: Annotated[float, Field(ge=0, le=3600)] = 90.0
    at_once: Annotated[int, Field(ge=1, le=64)] = 2
    calls_per_minute: Annotated[float | None, Field(gt=0)] = None
    max_output_tokens: Annotated[int | None, Field(ge=256)] = 16_000
    structured: bool = True
    prices: tuple[float, float, float] | None = None
    budget_calls: Annotated[int | None, Field(ge=1)] = None
    budget_tokens: Annotated[int | None, Field(ge=1)] = None
    budget_usd: Annotated[float | None, Field(gt=0)] = None
    replay: Path | None = None
    strict: bool = False
    record: Path | None = None

    @field_validator("prices", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        """`2.0,0.5,8.0` is three prices, `2.0,8.0` two: input and output, the cached ones as the input."""
        parts = value.split(",") if isinstance(value, str) else value
        if isinstance(parts, (list, tuple)) and len(parts) == 2:
            parts = (parts[0], parts[0], parts[1])
        return parts

    @classmethod
    def of(cls, options: Mapping[str, Any], *, record: Path | None = None) -> Self:
        """The options of a user; InputError naming every one that is unknown or out of range."""
        for name in options:
            if name not in cls.model_fields:
                known = [known for known in cls.model_fields if known != "record"]
                raise UnknownName("option of the vlm generator", name, [*known, "conversation", "corrections", "model"])
        try:
            return cls.model_validate({"record": record, **options})
        except ValidationError as error:
            problems = []
            for each in error.errors():
                key = ".".join(str(part) for part in each["loc"])
                no_call = key.startswith("budget_") and each["input"] in (0, "0")
                problems.append(f"{key}: {NO_CALL if no_call else each['msg']}")
            message = f"The vlm generator cannot use its options: {'; '.join(problems)}"
            raise InvalidOptions(message, keys_of(error)) from None


_PIECES = re.compile(r" ?[^\W\d_]+|\d{1,3}|\n+| ?[^\w\s]+|_|[ \t]+")
_WHOLE_WORD = 8
_PART_OF_WORD = 5


def estimated_tokens(text: str) -> int:
    """Return the tokens of a text, estimated where no tokenizer of the model is at hand.

    The text is cut where the tokenizers of the GPT-4 family cut before they merge; a piece counts one token, a longer
    word one for every begun five letters. Four characters per token count half of a list of waypoints.
    """
    lengths = (piece.end() - piece.start() for piece in _PIECES.finditer(text))
    return sum(1 if length <= _WHOLE_WORD else math.ceil(length / _PART_OF_WORD) for length in lengths)


def picture_tokens(width: int, height: int) -> int:
    """Return the tokens of a picture by the tile rule published for the GPT-4 family at high detail.

    Scaled to fit 2048 x 2048, then its shorter side to at most 768: 170 tokens per 512 x 512 tile begun, plus 85.
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
