"""Prompts from Jinja2 templates, one set for every requirement and every world, and the dialogue they make.

A template's first line declares its variables. A campaign folder may hold `prompts/NAME.md.j2` files, which stand in
for the shipped ones of the same name. Text that comes from a map, a person or a measurement is passed through the
filters `quoted` (one line, as a JSON string) or `block` (many lines, between marks that the text cannot close), so
that the model reads it as data.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from jinja2 import BaseLoader, Environment, StrictUndefined, TemplateNotFound, TemplateSyntaxError, UndefinedError, meta
from jinja2.exceptions import SecurityError
from jinja2.sandbox import SandboxedEnvironment

from rvsg.core.errors import FileError, UnknownName
from rvsg.core.inputs import read_text
from rvsg.generation.generator import Call
from rvsg.generation.vlm.model import Answer, Message, Model, Picture, Request

SHIPPED = Path(__file__).parent
SUFFIX = ".md.j2"
QUOTED_CHARACTERS = 300
BLOCK_CHARACTERS = 12_000
_DECLARES = re.compile(r"\A\{#-?\s*declares:\s*([^#]*?)\s*-?#\}\s*\n")


def shipped_prompts() -> tuple[str, ...]:
    """The names of the shipped templates, parts (whose names begin with `_`) left out."""
    return tuple(sorted(name for path in SHIPPED.glob(f"*{SUFFIX}") if not (name := _name(path)).startswith("_")))


def declared_variables(name: str, folder: Path | None = None) -> frozenset[str]:
    """The variables a template declares on its first line; UnknownName where there is no such template."""
    path = _known_path(name, folder)
    return _declared(path, _read(path))


def template_text(name: str) -> str:
    """The source of a shipped template, parts included; UnknownName where there is none."""
    return _read(_known_path(name, None))


class Prompts:
    """Renders templates: those of `folder` where it has one of the name, else the shipped ones."""

    def __init__(self, folder: str | Path | None = None) -> None:
        self.folder = Path(folder) if folder is not None else None
        if self.folder is not None and not self.folder.is_dir():
            raise FileError(
                self.folder,
                "there is no such folder of prompt templates; `rvsg scenario prompt --copy` begins one",
                code="prompts-folder",
            )
        if self.folder is not None:
            self._check_overrides(self.folder)
        self._environment: Environment = _environment(self.folder)

    def overridden(self) -> tuple[str, ...]:
        """The names of the templates that the folder replaces."""
        return tuple(sorted(_name(p) for p in self.folder.glob(f"*{SUFFIX}"))) if self.folder else ()

    def render(self, name: str, variables: Mapping[str, Any]) -> str:
        """The text of a prompt; FileError naming the file and what is missing or wrong in it."""
        path = _known_path(name, self.folder)
        declared = _declared(path, _read(path))
        missing = sorted(declared - variables.keys())
        if missing:
            raise FileError(
                path,
                f"declares {', '.join(missing)}, which RVSG does not give to this prompt",
                line=1,
                code="prompt-variable",
            )
        try:
            text = self._environment.get_template(name).render({key: variables[key] for key in declared})
        except UndefinedError as error:
            raise FileError(
                path, f"{error}. It declares {_listed(declared)}; RVSG gives {_listed(variables)}"
            ) from None
        except TemplateSyntaxError as error:
            raise FileError(
                error.filename or path, f"not a template: {error.message}", line=error.lineno, code="prompt-template"
            ) from None
        except (SecurityError, TemplateNotFound, TypeError, ValueError) as error:
            raise FileError(path, f"cannot be rendered: {error}", code="prompt-rendering") from None
        return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"

    def _check_overrides(self, folder: Path) -> None:
        known = {_name(path) for path in SHIPPED.glob(f"*{SUFFIX}")}
        for path in sorted(folder.iterdir()):
            if not path.name.endswith(SUFFIX) or _name(path) not in known:
                names = [name + SUFFIX for name in known]
                raise UnknownName("prompt file", path.name, names, hint=f"It is in {folder}.")
            _declared(path, _read(path))


class _Loader(BaseLoader):
    """Loads by name, the folder before the shipped ones."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def get_source(self, environment: Environment, template: str) -> tuple[str, str, Any]:
        path = _path(template, self._folder)
        if path is None:
            raise TemplateNotFound(template)
        return _read(path), str(path), None


def _environment(folder: Path | None) -> Environment:
    # The text is a prompt, not a page: what stands in it is escaped for its reader by `quoted` and `block`.
    environment = SandboxedEnvironment(
        loader=_Loader(folder),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=False,
        autoescape=False,
    )
    environment.policies["json.dumps_kwargs"] = {"ensure_ascii": False}
    environment.filters |= {"quoted": quoted, "block": block, "num": number}
    return environment


def quoted(text: Any, characters: int = QUOTED_CHARACTERS) -> str:
    """A text on one line as a JSON string, control characters out, at most 300 (or so many) characters."""
    line = " ".join(str(text).split())
    line = "".join(sign for sign in line if sign.isprintable())
    if len(line) > characters:
        line = line[:characters] + "..."
    return json.dumps(line, ensure_ascii=False)


def block(text: Any, name: str = "text") -> str:
    """A text of many lines between `<data>` marks that it cannot close itself, at most 12 000 characters."""
    body = re.sub(r"<\s*(/?)\s*data", r"(\1data", str(text), flags=re.IGNORECASE)
    body = "".join(sign for sign in body if sign.isprintable() or sign == "\n").strip()
    if len(body) > BLOCK_CHARACTERS:
        body = body[:BLOCK_CHARACTERS] + " ..."
    return f'<data name="{name}">\n{body}\n</data>'


def number(value: float) -> str:
    """A number with three significant digits, as people read it."""
    text = f"{value:.3g}"
    return f"{float(text):.0f}" if "e" in text and abs(float(text)) >= 1 else text


def _path(name: str, folder: Path | None) -> Path | None:
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        return None
    places = [folder / f"{name}{SUFFIX}"] if folder is not None else []
    return next((path for path in [*places, SHIPPED / f"{name}{SUFFIX}"] if path.is_file()), None)


def _known_path(name: str, folder: Path | None) -> Path:
    path = _path(name, folder)
    if path is None:
        raise UnknownName("prompt", name, shipped_prompts())
    return path


def _name(path: Path) -> str:
    return path.name.removesuffix(SUFFIX)


@lru_cache(maxsize=128)
def _read_at(path: Path, changed_ns: int) -> str:
    return read_text(path)


def _read(path: Path) -> str:
    return _read_at(path, path.stat().st_mtime_ns)


def _declared(path: Path, text: str) -> frozenset[str]:
    """The declared variables, after checking that nothing else is used."""
    found = _DECLARES.match(text)
    if found is None:
        raise FileError(
            path,
            "the first line must declare the variables, as in {# declares: areas, route #}",
            line=1,
            code="prompt-declaration",
        )
    declared = frozenset(part.strip() for part in found.group(1).split(",") if part.strip())
    try:
        used = meta.find_undeclared_variables(_environment(None).parse(text))
    except TemplateSyntaxError as error:
        raise FileError(path, f"not a template: {error.message}", line=error.lineno, code="prompt-template") from None
    undeclared = sorted(used - declared)
    if undeclared:
        near = f"It declares {_listed(declared)}."
        line = next((n for n, row in enumerate(text.splitlines(), 1) if undeclared[0] in row), None)
        raise FileError(
            path,
            f'uses "{undeclared[0]}", which its first line does not declare. {near}',
            line=line,
            code="prompt-variable",
        )
    return declared


def _listed(names: Any) -> str:
    return ", ".join(sorted(names)) or "nothing"


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
