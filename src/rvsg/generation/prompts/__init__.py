"""Prompts from Jinja2 templates, one set for every requirement and every world, and the dialogue they make.

A template's first line declares its variables. A campaign folder may hold `prompts/NAME.md.j2` files, which stand in
for the shipped ones of the same name. Text that comes from a map, a person or a measurement is passed through the
filters `quoted` (one line, as a JSON string) or `block` (many lines, between marks that the text cannot close), so
that the model reads it as data.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import (
    Environment,
    FunctionLoader,
    StrictUndefined,
    TemplateNotFound,
    TemplateSyntaxError,
    UndefinedError,
    meta,
)
from jinja2.exceptions import SecurityError
from jinja2.sandbox import SandboxedEnvironment

from rvsg.core.errors import FileError, UnknownName
from rvsg.core.inputs import read_text
from rvsg.generation.generator import Call
from rvsg.generation.vlm.model import Answer, Message, Model, Picture, Request, Role

SHIPPED = Path(__file__).parent
SUFFIX = ".md.j2"
QUOTED_CHARACTERS = 300
BLOCK_CHARACTERS = 12_000
_DECLARES = re.compile(r"\A\{#-?\s*declares:\s*([^#]*?)\s*-?#\}\s*\n")


def shipped_prompts() -> tuple[str, ...]:
    """The names of the shipped templates, parts (whose names begin with `_`) left out."""
    return tuple(name for name in _names(SHIPPED) if not name.startswith("_"))


def declared_variables(name: str) -> frozenset[str]:
    """The variables a shipped template declares on its first line; UnknownName where there is no such template."""
    return _declared(_known_path(name, None))


def template_text(name: str) -> str:
    """The source of a shipped template, parts included; UnknownName where there is none."""
    return read_text(_known_path(name, None))


class Prompts:
    """Renders templates: those of `folder` where it has one of the name, else the shipped ones."""

    def __init__(self, folder: str | Path | None = None) -> None:
        self.folder = Path(folder) if folder is not None else None
        if self.folder is not None:
            if not self.folder.is_dir():
                reason = "there is no such folder of prompt templates; `rvsg prompt --copy` begins one"
                raise FileError(self.folder, reason, code="prompts-folder")
            known = _names(SHIPPED)
            for path in sorted(self.folder.iterdir()):
                if path.name not in (shipped := [name + SUFFIX for name in known]):
                    raise UnknownName("prompt file", path.name, shipped, hint=f"It is in {folder}.")
                _declared(path)
        self._environment: Environment = _environment(self.folder)

    def overridden(self) -> tuple[str, ...]:
        """The names of the templates that the folder replaces."""
        return _names(self.folder) if self.folder else ()

    def render(self, name: str, variables: Mapping[str, Any]) -> str:
        """The text of a prompt; FileError naming the file and what is missing or wrong in it."""
        path = _known_path(name, self.folder)
        declared = _declared(path)
        if missing := sorted(declared - variables.keys()):
            reason = f"declares {', '.join(missing)}, which RVSG does not give to this prompt"
            raise FileError(path, reason, line=1, code="prompt-variable")
        try:
            text = self._environment.get_template(name).render({key: variables[key] for key in declared})
        except UndefinedError as error:
            reason = f"{error}. It declares {_listed(declared)}; RVSG gives {_listed(variables)}"
            raise FileError(path, reason) from None
        except TemplateSyntaxError as error:
            raise _not_a_template(error, Path(error.filename or path)) from None
        except (SecurityError, TemplateNotFound, TypeError, ValueError) as error:
            raise FileError(path, f"cannot be rendered: {error}", code="prompt-rendering") from None
        return re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"


def _environment(folder: Path | None) -> Environment:
    def load(name: str) -> tuple[str, str, None] | None:
        path = _path(name, folder)
        return (read_text(path), str(path), None) if path is not None else None

    # The text is a prompt, not a page: what stands in it is escaped for its reader by `quoted` and `block`.
    environment = SandboxedEnvironment(
        loader=FunctionLoader(load),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=False,
        autoescape=False,
    )
    environment.policies["json.dumps_kwargs"] = {"ensure_ascii": False, "separators": (",", ":")}
    environment.filters |= {"quoted": quoted, "block": block, "num": number, "positions": positions}
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
    text = f"{float(text):.0f}" if "e" in text and abs(float(text)) >= 1 else text
    return "0" if text == "-0" else text


def positions(lines: Sequence[Mapping[str, Any]]) -> str:
    """Where the rows or columns of a grid are: the first and the last one of even ones, else each of them."""
    steps = {number(after["at"] - before["at"]) for before, after in itertools.pairwise(lines)}
    if len(lines) > 2 and len(steps) == 1:
        (first, second, *_, last) = lines
        step = number(abs(second["at"] - first["at"]))
        return f"{first['name']}:{number(first['at'])} to {last['name']}:{number(last['at'])}, {step} m apart"
    return ", ".join(f"{line['name']}:{number(line['at'])}" for line in lines)


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


def _names(folder: Path) -> tuple[str, ...]:
    return tuple(sorted(path.name.removesuffix(SUFFIX) for path in folder.glob(f"*{SUFFIX}")))


def _declared(path: Path) -> frozenset[str]:
    """The declared variables of a template, after checking that nothing else is used."""
    text = read_text(path)
    found = _DECLARES.match(text)
    if found is None:
        reason = "the first line must declare the variables, as in {# declares: areas, route #}"
        raise FileError(path, reason, line=1, code="prompt-declaration")
    declared = frozenset(part.strip() for part in found.group(1).split(",") if part.strip())
    try:
        used = meta.find_undeclared_variables(_environment(None).parse(text))
    except TemplateSyntaxError as error:
        raise _not_a_template(error, path) from None
    for name in sorted(used - declared)[:1]:
        line = next((n for n, row in enumerate(text.splitlines(), 1) if name in row), None)
        reason = f'uses "{name}", which its first line does not declare. It declares {_listed(declared)}.'
        raise FileError(path, reason, line=line, code="prompt-variable")
    return declared


def _not_a_template(error: TemplateSyntaxError, path: Path) -> FileError:
    return FileError(path, f"not a template: {error.message}", line=error.lineno, code="prompt-template")


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "nothing"


class Dialogue:
    """Asks a model turn by turn. Prompts are rendered from `facts`; the calls are numbered from 1 within `session`."""

    def __init__(
        self, model: Model, prompts: Prompts, session: str, facts: Mapping[str, Any], pictures: Iterable[Picture]
    ) -> None:
        self.model, self.prompts, self.session, self.facts = model, prompts, session, dict(facts)
        self.messages: list[Message] = []
        self.pictures = {picture.digest: picture for picture in pictures}
        self.calls: list[Call] = []

    def tell(self, template: str, *, role: Role = "user", shown: Iterable[Picture] = (), stable: bool = False) -> None:
        """Add a message without asking yet."""
        self.tell_text(role, self.prompts.render(template, self.facts), shown, stable=stable)

    def tell_text(self, role: Role, text: str, shown: Iterable[Picture] = (), *, stable: bool = False) -> None:
        """Add a message as it stands."""
        references = tuple(picture.reference for picture in shown)
        self.messages.append(Message(role=role, text=text, pictures=references, stable=stable))

    def words(self, template: str, **more: Any) -> int:
        """Return how many words the request has in which this prompt is next."""
        texts = [*(message.text for message in self.messages), self.prompts.render(template, {**self.facts, **more})]
        return sum(len(text.split()) for text in texts)

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
        self.tell_text("user", self.prompts.render(template, {**self.facts, **more}), shown)
        return self.answered(purpose, shape)

    def answered(self, purpose: str, shape: dict[str, Any] | None = None) -> Answer:
        """Ask for the answer to the messages so far, and add it."""
        request = Request(
            session=self.session,
            number=len(self.calls) + 1,
            purpose=purpose,
            messages=tuple(self.messages),
            pictures=self.pictures,
            shape=shape,
        )
        answer = self.model.ask(request)
        usage = answer.usage
        self.calls.append(
            Call(
                purpose=purpose,
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
        )
        self.tell_text("assistant", answer.text or "(no answer)")
        return answer
