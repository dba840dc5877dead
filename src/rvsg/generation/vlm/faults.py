"""What went wrong in a call of a model, in our words: what it means, whether to try again, and what to do next."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rvsg.core.errors import InputError, how_to_install
from rvsg.generation.vlm.secrets import hide_secrets

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
