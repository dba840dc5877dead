"""A dialogue with a model: its messages so far, its pictures, and every call made in it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rvsg.generation.generator import Call
from rvsg.generation.prompts import Prompts
from rvsg.generation.vlm.messages import Answer, Message, Picture, Request
from rvsg.generation.vlm.model import Model


class Dialogue:
    """Asks a model turn by turn. Prompts are rendered from `facts`; the calls are numbered from 1 within `session`."""

    def __init__(
        self,
        model: Model,
        prompts: Prompts,
        session: str,
        facts: Mapping[str, Any],
        *,
        messages: Iterable[Message] = (),
        pictures: Iterable[Picture] = (),
    ) -> None:
        self.model = model
        self.prompts = prompts
        self.session = session
        self.facts = dict(facts)
        self.messages = list(messages)
        self.pictures = {picture.digest: picture for picture in pictures}
        self.calls: list[Call] = []

    def tell(self, template: str, *, role: str = "user", shown: Iterable[Picture] = (), stable: bool = False) -> None:
        """Add a message without asking yet."""
        text = self.prompts.render(template, self.facts)
        self._add(role, text, shown, stable)

    def tell_text(self, role: str, text: str) -> None:
        """Add a message as it stands."""
        self._add(role, text)

    def ask(
        self,
        purpose: str,
        template: str,
        *,
        shown: Iterable[Picture] = (),
        shape: dict[str, Any] | None = None,
        **more: Any,
    ) -> Answer:
        """Add a prompt, ask, and add the answer."""
        text = self.prompts.render(template, {**self.facts, **more})
        self._add("user", text, shown)
        return self.answered(purpose, shape)

    def answered(self, purpose: str, shape: dict[str, Any] | None = None) -> Answer:
        """Ask for the answer to the messages so far, and add it."""
        request = self.request(purpose, shape)
        answer = self.model.ask(request)
        self.calls.append(_call(request, answer))
        self._add("assistant", answer.text or "(no answer)")
        return answer

    def request(self, purpose: str, shape: dict[str, Any] | None = None) -> Request:
        """The dialogue so far as the next call."""
        return Request(
            session=self.session,
            number=len(self.calls) + 1,
            purpose=purpose,
            messages=tuple(self.messages),
            pictures=self.pictures,
            shape=shape,
        )

    def _add(self, role: str, text: str, shown: Iterable[Picture] = (), stable: bool = False) -> None:
        references = tuple(picture.reference for picture in shown)
        self.messages.append(
            Message.model_validate({"role": role, "text": text, "pictures": references, "stable": stable})
        )


def _call(request: Request, answer: Answer) -> Call:
    usage = answer.usage
    return Call(
        purpose=request.purpose,
        model=answer.model,
        input_tokens=usage.input_tokens,
        cached_tokens=usage.cached_tokens,
        output_tokens=usage.output_tokens,
        cost_usd=usage.cost_usd,
        latency_s=usage.latency_s,
        recording=request.key,
        error=None if answer.finish == "complete" else answer.finish,
        estimated=usage.estimated,
    )
