"""Watched: a model that reports its calls while they are made, and what was spent so far."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Literal

from rvsg.core.records import Record
from rvsg.generation.vlm.budget import Spending
from rvsg.generation.vlm.messages import Answer, Request
from rvsg.generation.vlm.model import Model


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
