"""Client of vision language models, any provider: the only module that imports pydantic-ai.

Foreign errors are translated here. What a service can recover from (a limit of calls, an overload, a broken
connection, a reply that is not the protocol) is tried again a bounded number of times, as late as the service asks;
what it cannot recover from (a wrong key, an unknown model) ends at once with what to do. No message carries a key:
errors are raised outside the handler of the foreign one, so that nothing of it hangs on them.
"""

from __future__ import annotations

import asyncio
import contextlib
import difflib
import os
import re
import threading
import time
import warnings
from collections.abc import Callable, Coroutine, Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from rvsg.core.errors import InputError, ModelUnavailable, how_to_install
from rvsg.generation.vlm.model import Answer, Request, Usage, estimated_input_tokens, estimated_tokens

HIDDEN = "[hidden]"
_NAMES = re.compile(r"(KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL)", re.IGNORECASE)
_LOOKS = (
    re.compile(r"\b(?:sk|pk|rk|xai|gsk|hf|ghp|AIza)[-_A-Za-z0-9]{12,}"),
    re.compile(r"(?i)\b(bearer|basic)\s+[A-Za-z0-9._~+/=-]{8,}"),
    re.compile(r"(?i)(?<=[?&])((?:api[-_]?)?key|token)=[^&\s\"']+"),
    re.compile(r"(?<=://)[^/\s:@]+:[^/\s@]+(?=@)"),
)


def secrets_of_environment() -> tuple[str, ...]:
    """Values of environment variables whose names say they are secret, the longest first (at least 6 characters)."""
    found = {value for name, value in os.environ.items() if _NAMES.search(name) and len(value) >= 6}
    return tuple(sorted(found, key=lambda value: (-len(value), value)))


def hide_secrets(text: str, *extra: str) -> str:
    """The text with every secret of the environment, of `extra`, or that looks like a key, replaced."""
    for secret in (*(e for e in extra if e), *secrets_of_environment()):
        text = text.replace(secret, HIDDEN)
    for pattern in _LOOKS:
        text = pattern.sub(HIDDEN, text)
    return text


KEY_VARIABLE = "RVSG_API_KEY"
DETAIL_CHARACTERS = 600
EXAMPLES = "openai-chat:gpt-4.1, anthropic:claude-sonnet-4-5, google:gemini-2.5-pro or ollama:qwen2.5vl"
_PROVIDERS = """
openai-chat openai openai-responses anthropic google google-cloud ollama vllm azure azure-responses bedrock
bedrock-mantle mistral groq openrouter xai deepseek together fireworks huggingface github github-copilot cohere
openai-chatgpt openai-codex alibaba moonshotai litellm nebius sambanova cerebras vercel meta zai heroku
"""
PROVIDERS = tuple(_PROVIDERS.split())
LATER = "Run the same command later: what was answered is kept and not asked again."
_FILTER_CODES = frozenset(
    {"content_filter", "content_policy_violation", "responsibleaipolicyviolation", "moderation_blocked", "safety"}
)
"""How services name their safety filter in the code, type or status of an error."""
_OTHER_KEYS = {"google": "GOOGLE", "openai": "OPENAI", "openai-chat": "OPENAI", "openai-responses": "OPENAI"}
_KEYLESS = ("ollama", "bedrock", "bedrock-mantle", "google-cloud", "huggingface", "cohere", "vllm", "litellm")
"""Providers that are reached by an address or by credentials of another name."""


class Fault(Exception):
    """A try that failed: what to tell, whether to try again, and when.

    `code` is that of the error it becomes. `setup`: nothing was asked, the user has to set something right. `refused`:
    a safety filter took the request or the reply, which is an answer, not a failure of the service.
    """

    def __init__(
        self,
        message: str,
        *,
        code: str = "model-failed",
        again: bool = False,
        wait_s: float | None = None,
        without_shape: bool = False,
        setup: bool = False,
        refused: bool = False,
        next_step: str = "",
    ) -> None:
        super().__init__(message)
        self.message = message
        self.code = code
        self.again = again
        self.wait_s = wait_s
        self.without_shape = without_shape
        self.setup = setup
        self.refused = refused
        self.next_step = next_step


@dataclass(frozen=True, kw_only=True)
class Called:
    """What was called: needed to say what to do. `shaped`: a JSON schema was asked for."""

    provider: str
    model: str
    base_url: str | None
    timeout_s: float
    shaped: bool = False


def named_model(name: str) -> tuple[str, str]:
    """Provider and model of a name; InputError where it has not both, or where there is no such provider."""
    provider, _, model = name.partition(":")
    if not model.strip() or not provider.strip() or name != "".join(name.split()):
        lacking = "names a provider but no model" if provider.strip() and ":" in name else "does not name a model"
        if model.strip() and provider.strip():
            lacking = "holds a space"
        raise InputError(f'"{name}" {lacking}. Expected PROVIDER:MODEL, for example {EXAMPLES}.', code="model-name")
    near = difflib.get_close_matches(provider, PROVIDERS, n=1, cutoff=0.6)
    if provider not in PROVIDERS and near and "/" not in provider:
        raise InputError(
            f'There is no provider "{provider}". Did you mean "{near[0]}:{model}"? '
            f"Expected PROVIDER:MODEL, for example {EXAMPLES}.",
            code="model-provider",
        )
    return provider, model


def translated(error: Exception, foreign: Any, called: Called) -> Fault:
    """What an error of the client library means. `foreign` is the module of its exceptions, None where it is absent."""
    if isinstance(error, ImportError) or foreign is None:
        return Fault(_missing_package(called.provider, error), code="model-package-missing", setup=True)
    if isinstance(error, foreign.UserError):
        return _setup(error, called)
    if isinstance(error, foreign.ContentFilterError) or _filtered(error):
        return Fault(f"a safety filter refused it. It said: {_said(error)}", code="model-filtered", refused=True)
    return _refusal(error, foreign, called) or _failure(error, foreign, called)


def _refusal(error: Exception, foreign: Any, called: Called) -> Fault | None:
    """What it means where the service answered, and will not do it; None where it is something else."""
    said = f"It said: {_said(error)}"
    if isinstance(error, foreign.ModelAuthenticationError):
        variable = key_variable(called.provider, called.base_url)
        message = f"the service refused the key (or found none). Check {variable} in the environment. {said}"
        return Fault(message, code="model-key-refused")
    if isinstance(error, foreign.ModelNotFoundError):
        check = f"Check --model{' and --base-url; most addresses end in /v1' if called.base_url else ''}"
        message = f'the service knows no model "{called.model}" (or the address is wrong). {check}. {said}'
        return Fault(message, code="model-unknown")
    if isinstance(error, foreign.ModelQuotaExceededError):
        message = f"the account's credit or quota is used up. {said}"
        return Fault(message, code="model-quota", next_step=f"Top it up. {LATER}")
    if isinstance(error, foreign.ModelContextWindowExceededError) or getattr(error, "status_code", None) == 413:
        message = f"the conversation is longer than the model can read. {said}"
        return Fault(message, code="model-too-long", next_step="Choose another model.")
    if isinstance(error, foreign.ModelRequestRejectedError):
        # Many compatible servers know no structured output: the prompt alone asks for the JSON as well.
        seeing = "The model must be able to see pictures; `rvsg prompt` shows what it is sent."
        plainly = {"again": called.shaped, "without_shape": called.shaped}
        return Fault(f"it refused the request. {said}", code="model-rejected", next_step=seeing, **plainly)
    return None


def _failure(error: Exception, foreign: Any, called: Called) -> Fault:
    """What it means where the service failed, is too busy or does not answer: another try may succeed."""
    said = f"It said: {_said(error)}"
    wait = getattr(error, "retry_after", None)
    if isinstance(error, foreign.ModelRateLimitError):
        fewer = "Allow fewer calls (--generator-option calls_per_minute=N), or run the same command later: what was "
        message = f"too many calls (429). {said}"
        return Fault(message, code="model-busy", again=True, wait_s=wait, next_step=f"{fewer}answered is kept.")
    if isinstance(error, (foreign.ModelTimeoutError, foreign.ModelRequestTimeout)):
        longer = "Wait longer: --generator-option call_timeout_s=SECONDS (rvsg describe: --call-timeout SECONDS)."
        message = f"no answer within {called.timeout_s:g} s."
        return Fault(message, code="model-timeout", again=True, next_step=longer)
    if isinstance(error, foreign.ModelConnectionError):
        message = f"the connection failed or broke off. {_said(error)}"
        return Fault(message, code="model-unreachable", again=True, next_step=_reachable(called))
    if isinstance(error, foreign.ModelAPIError) and getattr(error, "status_code", None) is not None:
        return Fault(f"the service failed. {said}", again=True, wait_s=wait, next_step=LATER)
    no_protocol = (
        "Check --base-url: does a server with the OpenAI protocol answer there? Most addresses end in /v1."
        if called.base_url
        else LATER
    )
    message = f"the service's reply is not what its protocol promises ({_said(error).rstrip('.')})."
    return Fault(message, code="model-protocol", again=True, wait_s=wait, next_step=no_protocol)


def key_variable(provider: str, base_url: str | None) -> str:
    """The environment variable that holds the key."""
    if base_url is not None:
        return KEY_VARIABLE
    return f"{_OTHER_KEYS.get(provider, provider.upper().replace('-', '_'))}_API_KEY"


def _setup(error: Exception, called: Called) -> Fault:
    """Something is missing before anything can be asked: a key, an address, or such a model."""
    if called.provider not in PROVIDERS:
        return Fault(
            f"the client library knows no such provider or model. Expected PROVIDER:MODEL, for example {EXAMPLES}; "
            f"providers are {', '.join(PROVIDERS)}. For a server of your own: --model openai-chat:NAME --base-url URL.",
            code="model-provider",
            setup=True,
        )
    variable = key_variable(called.provider, called.base_url)
    if called.provider not in _KEYLESS and not os.environ.get(variable):
        more = " For a server of your own give --base-url, and its key, if any, in RVSG_API_KEY."
        message = f"no key: set {variable} in the environment (export {variable}=...)."
        return Fault(message + (more if called.base_url is None else ""), code="model-key-missing", setup=True)
    return Fault(f"it cannot be used. {_said(error)}", code="model-setup", setup=True)


def _reachable(called: Called) -> str:
    if called.provider == "ollama":
        return "Is Ollama running (ollama serve), and the model pulled? OLLAMA_BASE_URL names another place."
    if called.base_url:
        return "Is the server running there? Check --base-url."
    return f"Check the network and its proxy. {LATER}"


def _filtered(error: Exception) -> bool:
    """Return whether a safety filter answered: some services send a refusal as an HTTP error with a code for it."""
    if getattr(error, "status_code", None) not in (400, 403, 422):
        return False
    return any(code.casefold() in _FILTER_CODES for code in _codes(getattr(error, "body", None)))


def _codes(body: object) -> Iterator[str]:
    """Yield the codes, types and states of an error's body, those of the errors inside it too."""
    if isinstance(body, Mapping):
        yield from (str(body[key]) for key in ("code", "type", "status") if isinstance(body.get(key), str))
        for key in ("error", "innererror", "inner_error"):
            yield from _codes(body.get(key))


def _said(error: Exception) -> str:
    """The words of the service, its HTTP status before them, on one line, without anything secret."""
    body, status = getattr(error, "body", None), getattr(error, "status_code", None)
    inner = body.get("error", body) if isinstance(body, dict) else body
    words = inner.get("message") if isinstance(inner, dict) else inner
    text = str(words) if isinstance(words, str) and words.strip() else str(error)
    place = f"HTTP {status}, " if status is not None and text is not str(error) else ""
    return _sentence(_one_line(hide_secrets(place + text)))


def _missing_package(provider: str, error: Exception) -> str:
    extra = {"anthropic": "anthropic", "google": "google", "google-gla": "google"}.get(provider, "vlm")
    missing = f" (Missing: {error.name})" if isinstance(error, ImportError) and error.name else ""
    return f"it needs a package that is not installed: {how_to_install(extra)}.{missing}"


def _sentence(text: str) -> str:
    text = text.rstrip(". ")
    return text if text.endswith(("?", "!")) else f"{text}."


def _one_line(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= DETAIL_CHARACTERS else line[:DETAIL_CHARACTERS] + " ..."


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
