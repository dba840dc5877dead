"""The Model protocol, and Scripted: a model that answers from a list."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

from rvsg.core.errors import ModelUnavailable
from rvsg.generation.vlm.messages import Answer, Request, Usage, estimated_input_tokens, estimated_tokens


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
