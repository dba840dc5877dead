"""Options of access to a model, and the model they make: paced, budgeted, watched, recorded or replayed."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, field_validator

from rvsg.core.documents import keys_of
from rvsg.core.errors import InputError, InvalidOptions, UnknownName
from rvsg.core.records import Record
from rvsg.generation.vlm.client import Limits, ModelAccess
from rvsg.generation.vlm.model import NO_CALL, Answer, Budget, Budgeted, Model, Request, Spending
from rvsg.generation.vlm.recording import Recorded, Recording, Replayed


class CallNews(Record):
    """What happens in a call: it begins, it waits before another try (`why`), or it is answered.

    `spent` is what was spent in this sitting, this call included once it is answered; an answer `from_record` cost
    nothing. Times in s.
    """

    what: Literal["asked", "waiting", "answered"]
    model: str
    purpose: str
    why: str = ""
    took_s: float = 0.0
    from_record: bool = False
    spent: Spending = Spending()


Tell = Callable[[CallNews], None]


class Watched:
    """Tells `tell`, where somebody set it, of every call. Nothing it tells of reaches a record."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._lock = threading.Lock()
        self._asking: list[str] = []
        self.spent = Spending()
        self.from_record = 0
        self.tell: Tell | None = None

    @property
    def name(self) -> str:
        """The name of the model."""
        return self._model.name

    def ask(self, request: Request) -> Answer:
        """Ask, and tell of it."""
        begun = time.monotonic()
        self._news("asked", request.purpose)
        self._asking.append(request.purpose)
        try:
            answer = self._model.ask(request)
        finally:
            self._asking.remove(request.purpose)
        known = answer.source == "record"
        with self._lock:
            if known:
                self.from_record += 1
            else:
                self.spent = self.spent.plus(answer.usage)
        self._news("answered", request.purpose, took_s=time.monotonic() - begun, from_record=known)
        return answer

    def waiting(self, why: str) -> None:
        """Told by the access to the model that it waits before another try."""
        self._news("waiting", self._asking[-1] if self._asking else "", why=why)

    def _news(self, what: Literal["asked", "waiting", "answered"], purpose: str, **more: object) -> None:
        if self.tell is not None:
            news = {"what": what, "model": self.name, "purpose": purpose, "spent": self.spent, **more}
            self.tell(CallNews.model_validate(news))


class Paced:
    """A model asked by at most `at_once` threads together, with calls at least 60 / `per_minute` seconds apart."""

    def __init__(
        self,
        model: Model,
        *,
        at_once: int = 2,
        per_minute: float | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if at_once < 1:
            raise InputError(f"At least one call at once is needed, got {at_once}.")
        if per_minute is not None and not per_minute > 0:
            raise InputError(f"Calls per minute must be positive, got {per_minute}.")
        self._model = model
        self._places = threading.BoundedSemaphore(at_once)
        self._gap_s = 60.0 / per_minute if per_minute is not None else 0.0
        self._lock = threading.Lock()
        self._next = float("-inf")
        self._clock = clock
        self._sleep = sleep

    @property
    def name(self) -> str:
        """The name of the model."""
        return self._model.name

    def ask(self, request: Request) -> Answer:
        """Ask as soon as there is a place."""
        with self._places:
            wait = self._turn()
            if wait > 0:
                self._sleep(wait)
            return self._model.ask(request)

    def _turn(self) -> float:
        """Take the next free moment; how long it is away, in seconds."""
        with self._lock:
            now = self._clock()
            begin = max(now, self._next)
            self._next = begin + self._gap_s
            return begin - now


MOST_DIVERGENCES = 3


class Access(Record):
    """How a model is reached, and within what bounds.

    `prices` are dollars per million input, cached and output tokens, for models whose price is not listed.
    `replay` is a folder of recorded calls to answer from; `strict` makes every divergence from it an error.
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
            problems = [f"{'.'.join(str(part) for part in e['loc'])}: {_problem(e)}" for e in error.errors()]
            told = "The vlm generator cannot use its options: " + "; ".join(problems)
            raise InvalidOptions(told, keys_of(error)) from None


def _problem(error: Any) -> str:
    nothing = str(error["loc"][0]).startswith("budget_") and error["input"] in (0, "0")
    return NO_CALL if nothing else str(error["msg"])


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """A model ready to be asked, the record it writes or reads, and its parts that can tell something."""

    model: Watched
    recording: Recording | None = None
    replayed: Replayed | None = None

    @property
    def replaying(self) -> bool:
        """Return whether answers come from a record only."""
        return self.replayed is not None

    def notes(self) -> tuple[str, ...]:
        """Where a replay diverged from its record: each kind of difference once, with the first call that has it."""
        kinds: dict[str, list[str]] = {}
        for divergence in self.replayed.divergences if self.replayed else []:
            kinds.setdefault(divergence.what, []).append(divergence.key)
        messages = [
            f"Replay: the present prompts differ from the recorded ones at call {keys[0]}"
            f"{f' (and {len(keys) - 1} more)' if len(keys) > 1 else ''}: {what}."
            for what, keys in kinds.items()
        ]
        more = len(messages) - MOST_DIVERGENCES
        return (*messages[:MOST_DIVERGENCES], *([f"Replay: {more} more kinds of differences."] if more > 0 else []))


def wired(model: str | Model | None, access: Access) -> Wiring:
    """The model behind everything that guards it. InputError where neither a model nor a replay is named."""
    if access.replay is not None:
        recording = Recording(access.replay)
        if not len(recording):
            there = Path(access.replay) / "calls.jsonl"
            what = "holds no whole recorded call" if there.exists() else "does not exist"
            raise InputError(
                f"There are no recorded calls in {access.replay}: {there.name} {what}.", code="replay-empty"
            )
        replayed = Replayed(recording, strict=access.strict)
        return Wiring(model=Watched(replayed), recording=recording, replayed=replayed)
    if model is None:
        raise InputError(
            "The vlm generator needs a model: give --model PROVIDER:MODEL, for example openai-chat:gpt-4.1 "
            "(with its key in the environment), or --replay FOLDER to answer from recorded calls.",
            code="model-missing",
        )
    recorded = Recording(access.record) if access.record is not None else None
    reached = _reached(model, access) if isinstance(model, str) else model
    paced = Paced(reached, at_once=access.at_once, per_minute=access.calls_per_minute)
    budget = Budget(calls=access.budget_calls, tokens=access.budget_tokens, usd=access.budget_usd)
    budgeted = Budgeted(paced, budget, recorded.spent() if recorded is not None else None)
    watched = Watched(budgeted if recorded is None else Recorded(budgeted, recorded))
    if isinstance(reached, ModelAccess):
        reached.waiting = watched.waiting
    return Wiring(model=watched, recording=recorded)


def _reached(name: str, access: Access) -> ModelAccess:
    limits = Limits(
        timeout_s=access.call_timeout_s,
        tries=access.tries,
        first_wait_s=access.first_wait_s,
        longest_wait_s=access.longest_wait_s,
        max_output_tokens=access.max_output_tokens,
    )
    reached = ModelAccess(
        name,
        base_url=access.base_url,
        limits=limits,
        temperature=access.temperature,
        structured=access.structured,
        prices=access.prices,
    )
    if access.budget_usd is not None and not reached.knows_price():
        raise InputError(
            f"The price of {name} is not listed, so --budget-usd cannot be kept. Give "
            "--generator-option prices=INPUT,CACHED,OUTPUT in dollars per million tokens (--prices INPUT,CACHED,OUTPUT "
            "for `rvsg describe`), or use --budget-tokens or --budget-calls.",
            code="price-unknown",
        )
    reached.prepare()
    return reached
