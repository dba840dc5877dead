"""One call of a vision language model, any provider: the only module that imports pydantic-ai.

Foreign errors are translated here. What a service can recover from (a limit of calls, an overload, a broken
connection, a reply that is not the protocol) is tried again a bounded number of times, as late as the service asks;
what it cannot recover from (a wrong key, an unknown model) ends at once with what to do. No message carries a key:
errors are raised outside the handler of the foreign one, so that nothing of it hangs on them.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
import time
import warnings
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from rvsg.core.errors import InputError, ModelUnavailable
from rvsg.generation.vlm.faults import KEY_VARIABLE, LATER, Called, Fault, named_model, translated
from rvsg.generation.vlm.messages import Answer, Request, Usage, estimated_input_tokens, estimated_tokens
from rvsg.generation.vlm.secrets import hide_secrets

NO_KEY = "no-key-set"
LOCAL_OLLAMA = "http://localhost:11434/v1"
COMPATIBLE = ("openai-chat", "openai", "openai-responses", "ollama", "vllm")


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How patient one call is. Seconds; `tries` counts the first one too.

    A wait between tries is `first_wait_s` doubled each time, at most `longest_wait_s`, or what the service's
    Retry-After asks for; a service that asks for more than `longest_wait_s` ends the call.
    """

    timeout_s: float = 180.0
    tries: int = 4
    first_wait_s: float = 2.0
    longest_wait_s: float = 90.0
    max_output_tokens: int | None = 16_000


class _Loop:
    """One event loop in a thread of its own, on which all calls of all threads run side by side.

    A client's connections belong to the loop they were opened on; a loop for each asking thread would leave them
    open when the thread ends.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: asyncio.AbstractEventLoop | None = None

    def result_of(self, call: Coroutine[Any, Any, Any]) -> Any:
        """Run a coroutine to its end and return what it returns; interrupted, it is cancelled."""
        with self._lock:
            if self._running is None:
                self._running = asyncio.new_event_loop()
                threading.Thread(target=self._running.run_forever, name="rvsg-models", daemon=True).start()
        future = asyncio.run_coroutine_threadsafe(call, self._running)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise


_LOOP = _Loop()


def _quieten() -> None:
    """Silence warnings of unlisted prices and ignored settings: this module reports what matters of them."""
    from pydantic_ai import exceptions as foreign

    for category in (
        foreign.CostNotFoundWarning,
        foreign.CostCalculationFailedWarning,
        foreign.UsageExtractionFailedWarning,
        foreign.UnsupportedSettingWarning,
    ):
        warnings.filterwarnings("ignore", category=category)


class ModelAccess:
    """A model by its name, e.g. `openai-chat:gpt-4.1`, `anthropic:claude-...`, `google:gemini-...`, `ollama:...`.

    With `base_url` any server that speaks the OpenAI protocol; its key, if it needs one, is read from the
    environment variable RVSG_API_KEY, so that no provider's key reaches another host. `prices` are dollars per
    million input, cached input and output tokens, for models whose price is not known. `sleep` is how it waits.
    """

    def __init__(
        self,
        name: str,
        *,
        base_url: str | None = None,
        limits: Limits | None = None,
        temperature: float | None = None,
        structured: bool = True,
        prices: tuple[float, float, float] | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        provider, model = named_model(name)
        self._name, self._provider, self._model = name, provider, model
        self._base_url = _checked_address(base_url, provider)
        self._limits = limits or Limits()
        self._temperature = temperature
        self._structured = structured
        self._prices = prices
        self._sleep = sleep
        self._lock = threading.Lock()
        self._made: Any = None
        self.waiting: Callable[[str], None] | None = None
        """Told why and how long it waits before it tries again."""

    @property
    def name(self) -> str:
        """The name it was given."""
        return self._name

    def knows_price(self) -> bool:
        """Return whether the cost of a call is known."""
        return self._prices is not None or _listed_price(self._provider, self._model, Usage(input_tokens=1)) is not None

    def prepare(self) -> None:
        """Find out before the first call whether the client is installed and has its key; InputError where not."""
        failure: Fault | None = None
        try:
            self._client()
        except Exception as foreign:
            failure = self._translated(foreign, None)
        if failure is not None:
            raise InputError(hide_secrets(f"Model {self._name}{self._place()}: {failure.message}"), code=failure.code)

    def ask(self, request: Request) -> Answer:
        """Ask, patiently; raises ModelUnavailable with the reason and what to do."""
        failure: Fault | None = None
        tries = self._limits.tries
        for number in range(1, tries + 1):
            begun = time.monotonic()
            try:
                answer = self._try(request)
            except Fault as caught:
                if caught.refused:
                    return self._refused(caught, request, number)
                failure = caught
            else:
                latency = round(time.monotonic() - begun, 3)
                return answer.model_copy(
                    update={"usage": answer.usage.model_copy(update={"latency_s": latency, "tries": number})}
                )
            if failure.without_shape:
                self._structured = False
            wait = self._wait(failure, number)
            if wait is None:
                break
            if wait > 0:
                if self.waiting is not None:
                    message = f"{failure.message} Waits {wait:.0f} s, then try {number + 1} of {tries}."
                    self.waiting(hide_secrets(message))
                self._sleep(wait)
        assert failure is not None
        message = hide_secrets(f"Model {self._name}{self._place()}: {failure.message} {failure.next_step}".rstrip())
        raise (InputError if failure.setup else ModelUnavailable)(message, code=failure.code)

    def _wait(self, failure: Fault, number: int) -> float | None:
        """Seconds until the next try; None where there is no next one."""
        if not failure.again or number >= self._limits.tries:
            if failure.again and number > 1:
                failure.message += f" Tried {number} times."
            return None
        if failure.without_shape:
            return 0.0
        if failure.wait_s is None:
            return float(min(self._limits.longest_wait_s, self._limits.first_wait_s * 2 ** (number - 1)))
        longest = self._limits.longest_wait_s
        if failure.wait_s > longest:
            failure.message += (
                f" The service asks to wait {failure.wait_s:.0f} s, longer than the {longest:.0f} s that RVSG waits."
            )
            failure.next_step = LATER
            return None
        return failure.wait_s

    def _place(self) -> str:
        return f" at {self._base_url}" if self._base_url else ""

    def _try(self, request: Request) -> Answer:
        """One request over the wire; raises Fault, never a foreign error."""
        failure: Fault | None = None
        response: Any = None
        try:
            direct, messages, parameters, settings = self._foreign(request)
            _quieten()
            response = _LOOP.result_of(
                direct.model_request(
                    self._client(), messages, model_settings=settings, model_request_parameters=parameters
                )
            )
        except Exception as foreign:
            failure = self._translated(foreign, request)
        if failure is not None:
            raise failure
        return self._answer(response, request)

    def _refused(self, fault: Fault, request: Request, tries: int) -> Answer:
        """Return a refusal that came as an error as an answer; its cost is unknown."""
        usage = Usage(input_tokens=estimated_input_tokens(request), estimated=True, tries=tries)
        prices = self._prices
        cost = _priced(usage, prices) if prices is not None else _listed_price(self._provider, self._model, usage)
        usage = usage.model_copy(update={"cost_usd": cost})
        return Answer(text=hide_secrets(fault.message), model=self._model, finish="refused", usage=usage)

    def _foreign(self, request: Request) -> tuple[Any, list[Any], Any, Any]:
        """The request in the words of pydantic-ai."""
        from pydantic_ai import direct
        from pydantic_ai.messages import (
            BinaryContent,
            CachePoint,
            ModelRequest,
            ModelResponse,
            SystemPromptPart,
            TextPart,
            UserPromptPart,
        )
        from pydantic_ai.models import ModelRequestParameters
        from pydantic_ai.output import OutputObjectDefinition

        messages: list[Any] = []
        parts: list[Any] = []
        for message in request.messages:
            if message.role == "assistant":
                if parts:
                    messages.append(ModelRequest(parts=parts))
                    parts = []
                messages.append(ModelResponse(parts=[TextPart(content=message.text)]))
            elif message.role == "system":
                parts.append(SystemPromptPart(content=message.text))
            else:
                content: list[Any] = [message.text]
                for shown in message.pictures:
                    data = request.pictures[shown.digest].png
                    content += [f"Picture: {shown.name}", BinaryContent(data=data, media_type="image/png")]
                if message.stable:
                    content.append(CachePoint())
                parts.append(UserPromptPart(content=content if len(content) > 1 else message.text))
        if parts:
            messages.append(ModelRequest(parts=parts))
        parameters = ModelRequestParameters()
        if request.shape is not None and self._structured:
            shape = OutputObjectDefinition(json_schema=request.shape, name="reply", strict=False)
            parameters = ModelRequestParameters(output_mode="native", output_object=shape)
        settings: dict[str, Any] = {"max_retries": 0, "request_timeout": self._limits.timeout_s}
        settings["timeout"] = self._limits.timeout_s
        if self._limits.max_output_tokens is not None:
            settings["max_tokens"] = self._limits.max_output_tokens
        if self._temperature is not None:
            settings["temperature"] = self._temperature
        return direct, messages, parameters, settings

    def _client(self) -> Any:
        """pydantic-ai's model object, made when it is first needed."""
        with self._lock:
            if self._made is None:
                self._made = _client_of(self._provider, self._model, self._base_url)
            return self._made

    def _translated(self, error: Exception, request: Request | None) -> Fault:
        """What a foreign error means."""
        foreign: Any = None
        with contextlib.suppress(ImportError):
            from pydantic_ai import exceptions

            foreign = exceptions
        called = Called(
            provider=self._provider,
            model=self._model,
            base_url=self._base_url,
            timeout_s=self._limits.timeout_s,
            shaped=request is not None and request.shape is not None and self._structured,
        )
        return translated(error, foreign, called)

    def _answer(self, response: Any, request: Request) -> Answer:
        """pydantic-ai's response as ours."""
        text = "".join(part.content for part in response.parts if part.part_kind == "text")
        details = response.provider_details or {}
        refusal = details.get("refusal")
        reason = response.finish_reason
        finish = "complete"
        if refusal or reason == "content_filter":
            finish, text = "refused", str(refusal or text)
        elif not text.strip():
            finish = "empty"
        elif reason == "length":
            finish = "truncated"
        counted = response.usage
        estimated = bool(counted.unmeasured_requests) or not counted.input_tokens
        usage = Usage(
            input_tokens=estimated_input_tokens(request) if estimated else counted.input_tokens,
            cached_tokens=0 if estimated else counted.cache_read_tokens,
            output_tokens=estimated_tokens(text) if estimated else counted.output_tokens,
            estimated=estimated,
        )
        cost = float(counted.cost) if counted.cost is not None and not estimated else None
        if self._prices is not None:
            cost = _priced(usage, self._prices)
        named = response.model_name or self._model
        return Answer.model_validate(
            {
                "text": hide_secrets(text),
                "model": named,
                "finish": finish,
                "usage": usage.model_copy(update={"cost_usd": cost}),
            }
        )


def _priced(usage: Usage, prices: tuple[float, float, float]) -> float:
    fresh = usage.input_tokens - usage.cached_tokens
    return (fresh * prices[0] + usage.cached_tokens * prices[1] + usage.output_tokens * prices[2]) / 1e6


def _listed_price(provider: str, model: str, usage: Usage) -> float | None:
    """What the usage costs by public price lists, in dollars; None where they do not know the model."""
    try:
        from genai_prices import Usage as Counted
        from genai_prices import calc_price
    except ImportError:
        return None
    listed = {"openai-chat": "openai", "openai-responses": "openai", "google-gla": "google"}.get(provider, provider)
    counted = Counted(input_tokens=usage.input_tokens, output_tokens=usage.output_tokens)
    try:
        return float(calc_price(counted, model_ref=model, provider_id=listed).total_price)
    except LookupError:
        return None


def _checked_address(base_url: str | None, provider: str) -> str | None:
    if base_url is None:
        return LOCAL_OLLAMA if provider == "ollama" and not os.environ.get("OLLAMA_BASE_URL") else None
    parts = urlsplit(base_url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise InputError(
            f"--base-url must be an http or https address, got {hide_secrets(base_url)!r}.", code="model-address"
        )
    if parts.username or parts.password or parts.query or parts.fragment:
        message = f"--base-url must not hold a user, a key or a query; put the key into {KEY_VARIABLE}."
        raise InputError(message, code="model-address-secret")
    if provider not in COMPATIBLE:
        raise InputError(
            f"--base-url is for servers that speak the OpenAI protocol: use a model name beginning with "
            f"{', '.join(p + ':' for p in COMPATIBLE[:-1])} or {COMPATIBLE[-1]}:, not {provider}:.",
            code="model-address-provider",
        )
    return base_url


def _client_of(provider: str, model: str, base_url: str | None) -> Any:
    if base_url is not None:
        from pydantic_ai.models.openai import OpenAIChatModel, OpenAIResponsesModel
        from pydantic_ai.providers.openai_compatible import OpenAICompatibleProvider

        key = os.environ.get(KEY_VARIABLE) or NO_KEY
        server = OpenAICompatibleProvider("openai-compatible", base_url=base_url, api_key=key)
        if provider in ("openai", "openai-responses"):
            return OpenAIResponsesModel(model, provider=server)
        return OpenAIChatModel(model, provider=server)
    from pydantic_ai.models import infer_model

    return infer_model(f"{provider}:{model}")
