"""Messages, requests and answers, the Model protocol, and budgets of calls, tokens and dollars."""

from __future__ import annotations

import hashlib
import math
import re
import struct
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Literal, Protocol

from pydantic import Field, field_validator

from rvsg.core.errors import BudgetSpent, ModelUnavailable
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
    """Answers from a list of texts (or of functions of the request), in order: for tests and demonstrations.

    `asked` holds the requests it saw. When the script ends it raises ModelUnavailable.
    """

    def __init__(self, replies: Iterable[str | Answer | Callable[[Request], str]], name: str = "scripted") -> None:
        self._replies = list(replies)
        self._name = name
        self.asked: list[Request] = []

    @property
    def name(self) -> str:
        """The name it was given."""
        return self._name

    def ask(self, request: Request) -> Answer:
        """The next reply of the script."""
        self.asked.append(request)
        if not self._replies:
            raise ModelUnavailable(f"The script of model {self._name} has ended; call {request.key} has no reply.")
        reply = self._replies.pop(0)
        if isinstance(reply, Answer):
            return reply
        text = reply(request) if callable(reply) else reply
        usage = Usage(
            input_tokens=estimated_input_tokens(request), output_tokens=estimated_tokens(text), estimated=True
        )
        return Answer(text=text, model=self._name, finish="complete" if text.strip() else "empty", usage=usage)


NO_CALL = (
    "a budget of 0 allows no call. Leave it out for no limit; without a model --replay answers from recorded calls, "
    "and the heuristic generator needs none"
)


class Budget(Record):
    """What may be spent in a campaign, calls of earlier sittings included; None is no limit."""

    calls: Annotated[int | None, Field(default=None, ge=0)] = None
    tokens: Annotated[int | None, Field(default=None, ge=0)] = None
    usd: Annotated[float | None, Field(default=None, ge=0)] = None


class Spending(Record):
    """What was spent. `unpriced` counts calls whose cost is not known; `tokens` is input and output together."""

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


class Budgeted:
    """A model that raises BudgetSpent instead of asking, once the next call would pass the budget.

    Calls are counted exactly. Tokens and dollars are checked with what is spent plus the estimated input of the
    next call, so that a budget is passed at most by the output of one call (per call in flight).
    """

    def __init__(self, model: Model, budget: Budget, spent: Spending | None = None) -> None:
        self._model = model
        self.budget = budget
        self.spent = spent or Spending()
        self._under_way = 0
        self._lock = threading.Lock()

    @property
    def name(self) -> str:
        """The name of the model."""
        return self._model.name

    def ask(self, request: Request) -> Answer:
        """Ask, if the budget allows."""
        with self._lock:
            self._check(request)
            self._under_way += 1
        try:
            answer = self._model.ask(request)
        finally:
            with self._lock:
                self._under_way -= 1
        with self._lock:
            self.spent = self.spent.plus(answer.usage)
        return answer

    def _check(self, request: Request) -> None:
        budget, spent = self.budget, self.spent
        if budget.calls is not None and spent.calls + self._under_way >= budget.calls:
            self._stop(f"{spent.calls} of {budget.calls} calls", "--budget-calls")
        if budget.tokens is not None and spent.tokens + estimated_input_tokens(request) > budget.tokens:
            self._stop(f"{spent.tokens} of {budget.tokens} tokens", "--budget-tokens")
        if budget.usd is not None and (spent.cost_usd >= budget.usd or (spent.unpriced and not spent.cost_usd)):
            unknown = f" ({spent.unpriced} calls of unknown price)" if spent.unpriced else ""
            self._stop(f"{spent.cost_usd:.4f} of {budget.usd:.4f} USD{unknown}", "--budget-usd")

    def _stop(self, spent: str, option: str) -> None:
        raise BudgetSpent(
            f"The budget is spent: {spent} (model {self.name}). What is finished is kept; to go on, run the same "
            f"command with a larger {option}.",
            code=option.removeprefix("--"),
        )
