"""Access to a model for a campaign: at an allowed pace, within a budget, recorded, watched, or replayed."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Literal

from rvsg.core.errors import BudgetSpent, InputError, ModelUnavailable
from rvsg.core.records import Record
from rvsg.generation.vlm.call_log import CALLS, CallLog, Replayed
from rvsg.generation.vlm.client import ModelClient
from rvsg.generation.vlm.model import Access, Answer, Model, Request, Spending, estimated_input_tokens

MOST_DIVERGENCES = 3


class CallNews(Record):
    """Progress of a call: it begins, it waits before another try (`why`), or it is answered; times in s.

    `spent` is what was spent in this sitting; an answer `from_record` cost nothing.
    """

    what: Literal["asked", "waiting", "answered"]
    model: str
    purpose: str
    why: str = ""
    took_s: float = 0.0
    from_record: bool = False
    spent: Spending = Spending()


Tell = Callable[[CallNews], None]


class ModelAccess:
    """A model that is asked by at most `at_once` threads together, with calls at least 60 / `calls_per_minute` s apart.

    It raises BudgetSpent instead of asking once the next call would pass the budget, in which the calls of earlier
    sittings count; tokens and dollars are passed at most by the output of the calls in flight. Every call is kept in
    `recording`, and an answer that the record holds for that very request is taken from there.
    """

    def __init__(
        self,
        model: Model,
        options: Access | None = None,
        recording: CallLog | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.model, self.options, self.recording = model, options or Access(), recording
        self.tell: Tell | None = None
        """Told of every call. Nothing it is told of reaches a record."""
        self.spent = Spending()
        """In this sitting."""
        self.from_record = 0
        """How many answers were taken from the record."""
        self._total = recording.spent() if recording is not None else Spending()
        self._under_way = 0
        self._asking: list[str] = []
        self._places = threading.BoundedSemaphore(self.options.at_once)
        self._next = float("-inf")
        self._apart_s = 60.0 / self.options.calls_per_minute if self.options.calls_per_minute else 0.0
        self._lock = threading.Lock()
        self._clock, self._sleep = clock, sleep
        if isinstance(model, ModelClient):
            model.waiting = lambda why: self._news("waiting", self._asking[-1] if self._asking else "", why=why)

    @property
    def name(self) -> str:
        """The name of the model."""
        return self.model.name

    @property
    def replaying(self) -> bool:
        """Return whether answers come from a record only."""
        return self.options.replay is not None

    def notes(self) -> tuple[str, ...]:
        """Where a replay diverged from its record: each kind of difference once, with the first call that has it."""
        kinds: dict[str, list[str]] = {}
        for key, difference in self.model.divergences if isinstance(self.model, Replayed) else ():
            kinds.setdefault(difference, []).append(key)
        messages = [
            f"Replay: the present prompts differ from the recorded ones at call {keys[0]}"
            f"{f' (and {len(keys) - 1} more)' if len(keys) > 1 else ''}: {what}."
            for what, keys in kinds.items()
        ]
        more = len(messages) - MOST_DIVERGENCES
        return (*messages[:MOST_DIVERGENCES], *([f"Replay: {more} more kinds of differences."] if more > 0 else []))

    def ask(self, request: Request) -> Answer:
        """Ask, or answer from the record, and tell of it."""
        begun = time.monotonic()
        self._news("asked", request.purpose)
        self._asking.append(request.purpose)
        try:
            answer = self.model.ask(request) if self.replaying else self._known(request) or self._asked(request)
        finally:
            self._asking.remove(request.purpose)
        known = answer.source == "record"
        with self._lock:
            self.from_record += known
            if not known:
                self.spent = self.spent.plus(answer.usage)
        self._news("answered", request.purpose, took_s=time.monotonic() - begun, from_record=known)
        return answer

    def _known(self, request: Request) -> Answer | None:
        return self.recording.answered(request.key, request.id, self.name) if self.recording is not None else None

    def _asked(self, request: Request) -> Answer:
        """Ask the model and keep the call; one that failed is kept too."""
        with self._lock:
            self._check_budget(request)
            self._under_way += 1
        try:
            with self._places:
                with self._lock:  # take the next free moment
                    now = self._clock()
                    begin = max(now, self._next)
                    self._next = begin + self._apart_s
                if begin > now:
                    self._sleep(begin - now)
                answer = self.model.ask(request)
        except ModelUnavailable as failure:
            if self.recording is not None:
                self.recording.keep(request, self.name, error=str(failure))
            raise
        finally:
            with self._lock:
                self._under_way -= 1
        with self._lock:
            self._total = self._total.plus(answer.usage)
        if self.recording is not None:
            self.recording.keep(request, self.name, answer=answer)
        return answer

    def _check_budget(self, request: Request) -> None:
        spent, calls, tokens = self._total, self.options.budget_calls, self.options.budget_tokens
        usd = self.options.budget_usd
        if calls is not None and spent.calls + self._under_way >= calls:
            self._stop(f"{spent.calls} of {calls} calls", "budget-calls")
        if tokens is not None and spent.tokens + estimated_input_tokens(request) > tokens:
            self._stop(f"{spent.tokens} of {tokens} tokens", "budget-tokens")
        if usd is not None and (spent.cost_usd >= usd or (spent.unpriced and not spent.cost_usd)):
            unknown = f" ({spent.unpriced} calls of unknown price)" if spent.unpriced else ""
            self._stop(f"{spent.cost_usd:.4f} of {usd:.4f} USD{unknown}", "budget-usd")

    def _stop(self, spent: str, code: str) -> None:
        raise BudgetSpent(
            f"The budget is spent: {spent} (model {self.name}). To go on, run the same command with a larger --{code}.",
            code=code,
        )

    def _news(self, what: Literal["asked", "waiting", "answered"], purpose: str, **more: object) -> None:
        if self.tell is not None:
            news = {"what": what, "model": self.name, "purpose": purpose, "spent": self.spent, **more}
            self.tell(CallNews.model_validate(news))


def model_access(model: str | Model | None, options: Access) -> ModelAccess:
    """Return access to a model, or to a replay. InputError where neither is named."""
    if options.replay is not None:
        recording = CallLog(options.replay)
        if not len(recording):
            what = "holds no whole recorded call" if (recording.folder / CALLS).exists() else "does not exist"
            raise InputError(f"There are no recorded calls in {options.replay}: {CALLS} {what}.", code="replay-empty")
        return ModelAccess(Replayed(recording, strict=options.strict), options, recording)
    if model is None:
        raise InputError(
            "The vlm generator needs a model: give --model PROVIDER:MODEL, for example openai-chat:gpt-4.1 "
            "(with its key in the environment), or --replay FOLDER to answer from recorded calls.",
            code="model-missing",
        )
    recorded = CallLog(options.record) if options.record is not None else None
    if not isinstance(model, str):
        return ModelAccess(model, options, recorded)
    client = ModelClient(model, options)
    if options.budget_usd is not None and not client.knows_price():
        raise InputError(
            f"The price of {model} is not listed, so --budget-usd cannot be kept. Give "
            "--generator-option prices=INPUT,CACHED,OUTPUT in dollars per million tokens (--prices INPUT,CACHED,OUTPUT "
            "for `rvsg world describe`), or use --budget-tokens or --budget-calls.",
            code="price-unknown",
        )
    client.prepare()
    return ModelAccess(client, options, recorded)
