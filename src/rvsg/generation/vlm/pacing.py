"""Paced: a model whose calls at once and per minute are limited."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from rvsg.core.errors import InputError
from rvsg.generation.vlm.messages import Answer, Request
from rvsg.generation.vlm.model import Model


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
