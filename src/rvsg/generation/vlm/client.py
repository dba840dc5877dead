"""Client of vision language models, any provider: the only module that imports pydantic-ai.

Foreign errors are translated here. What a service can recover from (a limit of calls, an overload, a broken
connection, a reply that is not the protocol) is tried again a bounded number of times, as late as the service asks;
what it cannot recover from (a wrong key, an unknown model) ends at once with what to do. No message carries a key:
errors are raised outside the handler of the foreign one, so that nothing of it hangs on them.
"""

from __future__ import annotations

import asyncio
import difflib
import os
import re
import threading
import time
import warnings
from collections.abc import Callable, Coroutine, Iterator, Mapping
from functools import cache
from typing import Any, Literal
from urllib.parse import urlsplit

from rvsg.core import permission
from rvsg.core.errors import InputError, ModelUnavailable, how_to_install
from rvsg.generation.vlm.model import Access, Answer, Request, Usage, estimated_input_tokens, estimated_tokens

KEY_VARIABLE = "RVSG_API_KEY"
NO_KEY = "no-key-set"
LOCAL_OLLAMA = "http://localhost:11434/v1"
COMPATIBLE = ("openai-chat", "openai", "openai-responses", "ollama", "vllm")
DETAIL_CHARACTERS = 600
EXAMPLES = "openai-chat:gpt-4.1, anthropic:claude-sonnet-4-5, google:gemini-2.5-pro or ollama:qwen2.5vl"
PROVIDERS = (
    *("openai-chat", "openai", "openai-responses", "anthropic", "google", "google-cloud", "ollama", "vllm", "azure"),
    *("azure-responses", "bedrock", "bedrock-mantle", "mistral", "groq", "openrouter", "xai", "deepseek", "together"),
    *("fireworks", "huggingface", "github", "github-copilot", "cohere", "openai-chatgpt", "openai-codex", "alibaba"),
    *("moonshotai", "litellm", "nebius", "sambanova", "cerebras", "vercel", "meta", "zai", "heroku"),
)
LATER = "Run the same command later: what was answered is kept and not asked again."
_FILTER_CODES = frozenset(
    {"content_filter", "content_policy_violation", "responsibleaipolicyviolation", "moderation_blocked", "safety"}
)
"""How services name their safety filter in the code, type or status of an error."""
_OTHER_KEYS = {"google": "GOOGLE", "openai": "OPENAI", "openai-chat": "OPENAI", "openai-responses": "OPENAI"}
_KEYLESS = ("ollama", "bedrock", "bedrock-mantle", "google-cloud", "huggingface", "cohere", "vllm", "litellm")
"""Providers that are reached by an address or by credentials of another name."""


class Fault(Exception):
    """A try that failed: what to tell, the code of the error it becomes, and what the user can do (`next_step`).

    `then` says what follows: `retry`, after `wait_s` where the service asks for that; another try `unshaped`, which
    asks for no JSON schema; `setup`: nothing was asked, the user has to set something right; `refused`: a safety
    filter took the request or the reply, which is an answer and no failure of the service; else `stop`.
    """

    def __init__(
        self,
        message: str,
        code: str = "model-failed",
        then: Literal["stop", "retry", "unshaped", "setup", "refused"] = "stop",
        next_step: str = "",
        wait_s: float | None = None,
    ) -> None:
        super().__init__(message)
        self.message, self.code, self.then, self.next_step, self.wait_s = message, code, then, next_step, wait_s

    @property
    def again(self) -> bool:
        """Whether there is another try."""
        return self.then in ("retry", "unshaped")


class ModelClient:
    """A model by its name, e.g. `openai-chat:gpt-4.1`, `anthropic:claude-...`, `google:gemini-...`, `ollama:...`.

    With `base_url` any server that speaks the OpenAI protocol; its key, if it needs one, is read from the
    environment variable RVSG_API_KEY, so that no provider's key reaches another host. It is sent only where the user
    named the server (`rvsg.core.permission`). `sleep` is how it waits.
    """

    def __init__(
        self, name: str, options: Access | None = None, *, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        self.name, self.options = name, options or Access()
        self._provider, self._model = named_model(name)
        self._base_url = _checked_address(self.options.base_url, self._provider)
        self._has_key = self.options.base_url is None or permission.allows_key_for(self.options.base_url)
        self._structured = self.options.structured
        self._sleep = sleep
        self._lock = threading.Lock()
        self._made: Any = None
        self.waiting: Callable[[str], None] | None = None
        """Told why and how long it waits before it tries again."""

    def knows_price(self) -> bool:
        """Return whether the cost of a call is known."""
        return self._cost(Usage(input_tokens=1)) is not None

    def prepare(self) -> None:
        """Find out before the first call whether the client is installed and has its key; InputError where not."""
        failure: Fault | None = None
        try:
            self._client()
        except Exception as foreign:
            failure = self._translated(foreign, shaped=False)
        if failure is not None:
            raise self._error(failure)

    def ask(self, request: Request) -> Answer:
        """Ask, patiently; raises ModelUnavailable with the reason and what to do."""
        from tenacity import Retrying, retry_if_exception, stop_after_attempt

        retrying = Retrying(
            stop=stop_after_attempt(self.options.tries),
            retry=retry_if_exception(lambda error: isinstance(error, Fault) and error.again),
            wait=self._wait_s,
            sleep=lambda seconds: self._sleep(seconds) if seconds else None,
            reraise=True,
        )
        number, begun = 1, time.monotonic()
        try:
            for attempt in retrying:
                number, begun = attempt.retry_state.attempt_number, time.monotonic()
                with attempt:
                    answer = self._try(request)
        except Fault as caught:
            failure = caught
        else:
            usage = answer.usage.replace(latency_s=round(time.monotonic() - begun, 3), tries=number)
            return answer.replace(usage=usage)
        if failure.then == "refused":  # its cost is unknown
            usage = Usage(input_tokens=estimated_input_tokens(request), estimated=True, tries=number)
            usage = usage.replace(cost_usd=self._cost(usage))
            return Answer(text=hide_secrets(failure.message), model=self._model, finish="refused", usage=usage)
        if failure.again and number > 1:
            failure.message += f" Tried {number} times."
        raise self._error(failure)

    def _wait_s(self, state: Any) -> float:
        """Return the seconds until the next try; whoever watches is told."""
        failure, number, options = state.outcome.exception(), state.attempt_number, self.options
        if failure.then == "unshaped" or number >= options.tries:
            return 0.0
        wait = failure.wait_s
        if wait is None:
            wait = min(options.longest_wait_s, options.first_wait_s * 2 ** (number - 1))
        if wait > 0 and self.waiting is not None:
            message = f"{failure.message} Waits {wait:.0f} s, then try {number + 1} of {options.tries}."
            self.waiting(hide_secrets(message))
        return float(wait)

    def _error(self, failure: Fault) -> InputError | ModelUnavailable:
        place = f" at {self._base_url}" if self._base_url else ""
        message = hide_secrets(f"Model {self.name}{place}: {failure.message} {failure.next_step}".rstrip())
        return (InputError if failure.then == "setup" else ModelUnavailable)(message, code=failure.code)

    def _try(self, request: Request) -> Answer:
        """One request over the wire; raises Fault, never a foreign error."""
        failure: Fault | None = None
        shaped, options = request.shape is not None and self._structured, self.options
        try:
            from pydantic_ai import direct
            from pydantic_ai.models import ModelRequestParameters
            from pydantic_ai.output import OutputObjectDefinition

            parameters = ModelRequestParameters()
            if shaped and request.shape is not None:
                shape = OutputObjectDefinition(json_schema=request.shape, name="reply", strict=False)
                parameters = ModelRequestParameters(output_mode="native", output_object=shape)
            seconds, most, temperature = options.call_timeout_s, options.max_output_tokens, options.temperature
            settings: Any = {"max_retries": 0, "request_timeout": seconds, "timeout": seconds}
            settings |= {"max_tokens": most} if most is not None else {}
            settings |= {"temperature": temperature} if temperature is not None else {}
            response = _result_of(
                direct.model_request(
                    self._client(), _messages(request), model_settings=settings, model_request_parameters=parameters
                )
            )
        except Exception as foreign:
            failure = self._translated(foreign, shaped)
        if failure is None:
            return self._answer(response, request)
        longest = options.longest_wait_s
        wait = failure.wait_s
        if failure.then == "retry" and wait is not None and wait > longest:
            failure.then, failure.next_step = "stop", LATER
            failure.message += (
                f" The service asks to wait {wait:.0f} s, longer than the {longest:.0f} s that RVSG waits."
            )
        if failure.then == "unshaped":
            self._structured = False
        raise failure

    def _client(self) -> Any:
        """pydantic-ai's model object, made when it is first needed."""
        with self._lock:
            if self._made is None:
                self._made = _client_of(self._provider, self._model, self._base_url, has_key=self._has_key)
            return self._made

    def _answer(self, response: Any, request: Request) -> Answer:
        """pydantic-ai's response as ours."""
        text = "".join(part.content for part in response.parts if part.part_kind == "text")
        refusal = (response.provider_details or {}).get("refusal")
        finish: Literal["complete", "truncated", "refused", "empty"] = "complete"
        if refusal or response.finish_reason == "content_filter":
            finish, text = "refused", str(refusal or text)
        elif not text.strip():
            finish = "empty"
        elif response.finish_reason == "length":
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
        if self.options.prices is not None:
            cost = self._cost(usage)
        priced = usage.replace(cost_usd=cost)
        return Answer(text=hide_secrets(text), model=response.model_name or self._model, finish=finish, usage=priced)

    def _cost(self, usage: Usage) -> float | None:
        """Return the dollars of a usage by the given prices or by public price lists; None where both know nothing."""
        if self.options.prices is not None:
            fresh, cached, output = self.options.prices
            paid = (usage.input_tokens - usage.cached_tokens) * fresh
            return (paid + usage.cached_tokens * cached + usage.output_tokens * output) / 1e6
        try:
            from genai_prices import Usage as Counted
            from genai_prices import calc_price
        except ImportError:
            return None
        listed = {"openai-chat": "openai", "openai-responses": "openai", "google-gla": "google"}
        provider = listed.get(self._provider, self._provider)
        counted = Counted(
            input_tokens=usage.input_tokens, cache_read_tokens=usage.cached_tokens, output_tokens=usage.output_tokens
        )
        try:
            return float(calc_price(counted, model_ref=self._model, provider_id=provider).total_price)
        except LookupError:
            return None

    # -- what went wrong ---------------------------------------------------------------------------------------------

    def _translated(self, error: Exception, shaped: bool) -> Fault:
        """What an error of the client library means. `shaped`: a JSON schema was asked for."""
        if isinstance(error, ImportError):
            extra = {"anthropic": "anthropic", "google": "google", "google-gla": "google"}.get(self._provider, "vlm")
            missing = f" (Missing: {error.name})" if error.name else ""
            message = f"it needs a package that is not installed: {how_to_install(extra)}.{missing}"
            return Fault(message, "model-package-missing", "setup")
        from pydantic_ai import exceptions as foreign

        if isinstance(error, foreign.UserError):
            return self._setup_fault(error)
        body, status, wait = (getattr(error, name, None) for name in ("body", "status_code", "retry_after"))
        told, own = _said(error), self._base_url is not None
        said = f"It said: {told}"
        # Some services send a refusal as an HTTP error with a code for it.
        filtered = status in (400, 403, 422) and any(code.casefold() in _FILTER_CODES for code in _codes(body))
        if isinstance(error, foreign.ContentFilterError) or filtered:
            return Fault(f"a safety filter refused it. {said}", "model-filtered", "refused")
        # The first that fits: where the service answered and will not do it, another try is of no use.
        if isinstance(error, foreign.ModelAuthenticationError):
            check = f"Check {self._key_variable()} in the environment."
            if not self._has_key:
                host = urlsplit(self._base_url or "").netloc
                check = f"It got none, because only a file names it: --allow-key-for {host} allows it, also later."
            return Fault(f"the service refused the key (or found none). {check} {said}", "model-key-refused")
        if isinstance(error, foreign.ModelNotFoundError):
            check = f"Check --model{' and --base-url; most addresses end in /v1' if own else ''}"
            message = f'the service knows no model "{self._model}" (or the address is wrong). {check}. {said}'
            return Fault(message, "model-unknown")
        if isinstance(error, foreign.ModelQuotaExceededError):
            message = f"the account's credit or quota is used up. {said}"
            return Fault(message, "model-quota", next_step=f"Top it up. {LATER}")
        if isinstance(error, foreign.ModelContextWindowExceededError) or status == 413:
            message = f"the conversation is longer than the model can read. {said}"
            return Fault(message, "model-too-long", next_step="Choose another model.")
        if isinstance(error, foreign.ModelRequestRejectedError):
            # Many compatible servers know no structured output: the prompt alone asks for the JSON as well.
            seeing = "The model must be able to see pictures; `rvsg prompt` shows what it is sent."
            return Fault(f"it refused the request. {said}", "model-rejected", "unshaped" if shaped else "stop", seeing)
        if isinstance(error, foreign.ModelRateLimitError):
            fewer = (
                "Allow fewer calls (--generator-option calls_per_minute=N), or run the same command later: what was "
            )
            return Fault(f"too many calls (429). {said}", "model-busy", "retry", f"{fewer}answered is kept.", wait)
        if isinstance(error, (foreign.ModelTimeoutError, foreign.ModelRequestTimeout)):
            longer = "Wait longer: --generator-option call_timeout_s=SECONDS (rvsg describe: --call-timeout SECONDS)."
            return Fault(f"no answer within {self.options.call_timeout_s:g} s.", "model-timeout", "retry", longer)
        if isinstance(error, foreign.ModelConnectionError):
            message = f"the connection failed or broke off. {told}"
            return Fault(message, "model-unreachable", "retry", self._reachable())
        if isinstance(error, foreign.ModelAPIError) and status is not None:
            return Fault(f"the service failed. {said}", "model-failed", "retry", LATER, wait)
        server = "Check --base-url: does a server with the OpenAI protocol answer there? Most addresses end in /v1."
        message = f"the service's reply is not what its protocol promises ({told.rstrip('.')})."
        return Fault(message, "model-protocol", "retry", server if own else LATER, wait)

    def _setup_fault(self, error: Exception) -> Fault:
        """Something is missing before anything can be asked: a key, an address, or such a model."""
        if self._provider not in PROVIDERS:
            message = (
                f"the client library knows no such provider or model. Expected PROVIDER:MODEL, for example {EXAMPLES}; "
                f"providers are {', '.join(PROVIDERS)}. For a server of your own: --model openai-chat:NAME "
                "--base-url URL."
            )
            return Fault(message, "model-provider", "setup")
        variable = self._key_variable()
        if self._provider in _KEYLESS or os.environ.get(variable):
            return Fault(f"it cannot be used. {_said(error)}", "model-setup", "setup")
        own = " For a server of your own give --base-url, and its key, if any, in RVSG_API_KEY."
        message = f"no key: set {variable} in the environment (export {variable}=...)."
        return Fault(message + ("" if self._base_url else own), "model-key-missing", "setup")

    def _key_variable(self) -> str:
        """The environment variable that holds the key."""
        if self._base_url is not None:
            return KEY_VARIABLE
        return f"{_OTHER_KEYS.get(self._provider, self._provider.upper().replace('-', '_'))}_API_KEY"

    def _reachable(self) -> str:
        if self._provider == "ollama":
            return "Is Ollama running (ollama serve), and the model pulled? OLLAMA_BASE_URL names another place."
        if self._base_url:
            return "Is the server running there? Check --base-url."
        return f"Check the network and its proxy. {LATER}"


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


def _checked_address(base_url: str | None, provider: str) -> str | None:
    if base_url is None:
        return LOCAL_OLLAMA if provider == "ollama" and not os.environ.get("OLLAMA_BASE_URL") else None
    parts = urlsplit(base_url)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        message = f"--base-url must be an http or https address, got {hide_secrets(base_url)!r}."
        raise InputError(message, code="model-address")
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


def _client_of(provider: str, model: str, base_url: str | None, *, has_key: bool) -> Any:
    from pydantic_ai import exceptions as foreign
    from pydantic_ai.models import infer_model

    # Unlisted prices and ignored settings: this module reports what matters of them.
    for category in (
        *(foreign.CostNotFoundWarning, foreign.CostCalculationFailedWarning),
        *(foreign.UsageExtractionFailedWarning, foreign.UnsupportedSettingWarning),
    ):
        warnings.filterwarnings("ignore", category=category)
    if base_url is None:
        return infer_model(f"{provider}:{model}")
    from pydantic_ai.models.openai import OpenAIChatModel, OpenAIResponsesModel
    from pydantic_ai.providers.openai_compatible import OpenAICompatibleProvider

    key = (has_key and os.environ.get(KEY_VARIABLE)) or NO_KEY
    server = OpenAICompatibleProvider("openai-compatible", base_url=base_url, api_key=key)
    kind = OpenAIResponsesModel if provider in ("openai", "openai-responses") else OpenAIChatModel
    return kind(model, provider=server)


def _messages(request: Request) -> list[Any]:
    """The messages of a request in the words of pydantic-ai."""
    from pydantic_ai import messages as foreign

    messages: list[Any] = []
    for message in request.messages:
        if message.role == "assistant":
            messages.append(foreign.ModelResponse(parts=[foreign.TextPart(content=message.text)]))
            continue
        if message.role == "system":
            part: Any = foreign.SystemPromptPart(content=message.text)
        else:
            content: list[Any] = [message.text]
            for shown in message.pictures:
                png = foreign.BinaryContent(data=request.pictures[shown.digest].png, media_type="image/png")
                content += [f"Picture: {shown.name}", png]
            if message.stable:
                content.append(foreign.CachePoint())
            part = foreign.UserPromptPart(content=content if len(content) > 1 else message.text)
        if messages and isinstance(messages[-1], foreign.ModelRequest):
            messages[-1] = foreign.ModelRequest(parts=[*messages[-1].parts, part])
        else:
            messages.append(foreign.ModelRequest(parts=[part]))
    return messages


_loop_lock = threading.Lock()


@cache
def _loop() -> asyncio.AbstractEventLoop:
    """Return the one loop of all threads' calls: a client's connections belong to the loop they began on."""
    loop = asyncio.new_event_loop()
    threading.Thread(target=loop.run_forever, name="rvsg-models", daemon=True).start()
    return loop


def _result_of(call: Coroutine[Any, Any, Any]) -> Any:
    """Run a coroutine to its end and return what it returns; interrupted, it is cancelled."""
    with _loop_lock:
        loop = _loop()
    future = asyncio.run_coroutine_threadsafe(call, loop)
    try:
        return future.result()
    except BaseException:
        future.cancel()
        raise


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
    line = " ".join(hide_secrets(f"HTTP {status}, {text}" if status is not None else text).split())
    line = line if len(line) <= DETAIL_CHARACTERS else line[:DETAIL_CHARACTERS] + " ..."
    line = line.rstrip(". ")
    return line if line.endswith(("?", "!")) else f"{line}."


HIDDEN = "[hidden]"
_SECRET_NAMES = re.compile(r"(KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL)", re.IGNORECASE)
_SECRET_LOOKS = (
    re.compile(r"\b(?:sk|pk|rk|xai|gsk|hf|ghp|AIza)[-_A-Za-z0-9]{12,}"),
    re.compile(r"(?i)\b(bearer|basic)\s+[A-Za-z0-9._~+/=-]{8,}"),
    re.compile(r"(?i)(?<=[?&])((?:api[-_]?)?key|token)=[^&\s\"']+"),
    re.compile(r"(?<=://)[^/\s:@]+:[^/\s@]+(?=@)"),
)


def hide_secrets(text: str) -> str:
    """Return the text without the values of secret-named variables (6 characters or more) and what looks like a key."""
    secrets = {value for name, value in os.environ.items() if _SECRET_NAMES.search(name) and len(value) >= 6}
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, HIDDEN)
    for pattern in _SECRET_LOOKS:
        text = pattern.sub(HIDDEN, text)
    return text
