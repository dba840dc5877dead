"""Permission to run code that settings name.

Settings can name code: a class or a file of a stack, a command, a launch line, the scheduler of a cluster. A person
allows it by naming it on the command line, in a form of the studio or as an argument in Python. A campaign file, the
folder of a campaign and stored runs are data, perhaps from a stranger: `check` refuses code that only they name. It is
called where plug-ins are made, so no door can go round it.
"""

from __future__ import annotations

import hashlib
import json
import os
import shlex
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from rvsg.core.errors import FileError, InputError
from rvsg.core.files import state_folder, write_whole

_scopes: ContextVar[tuple[frozenset[str], ...]] = ContextVar("scopes", default=())
_process: list[tuple[frozenset[str], Path | None]] = []
"""The scopes of the whole process, each with the file or folder whose code is allowed."""
CODE_OPTIONS = ("command", "launch", "module", "script", "executable", "address", "scheduler_file")
"""Options that count as code in a plug-in that does not say by `code_options` which of its options are."""


@contextmanager
def only(*named: Any) -> Iterator[None]:
    """Within the block, allow only code that these values name, at any depth; for work on stored settings."""
    token = _scopes.set((*_scopes.get(), _texts(named)))
    try:
        yield
    finally:
        _scopes.reset(token)


@contextmanager
def only_in_process(named: Iterable[Any], *, trusted: Path | None = None) -> Iterator[None]:
    """Within the block, allow only code that these values name, in all threads; for a command line or a server.

    Args:
        trusted: a file or folder; code that is named in it is allowed, and remembered by its content.

    Raises:
        InputError: there is no such file or folder.
    """
    if trusted is not None and not trusted.exists():
        raise InputError(f"--allow-code-from {trusted}: there is no such file or folder.", code="code-source-missing")
    scope = (_texts(named), trusted)
    _process.append(scope)
    try:
        yield
    finally:
        _process.remove(scope)


def check(kind: str, name: str, code: str) -> None:
    """Refuse to make a plug-in that runs code which nobody named.

    Args:
        code: what it would run or load, as the settings name it.

    Raises:
        InputError: it was read from data only.
    """
    scopes = [*_scopes.get(), *(named for named, _ in _process)]
    if all(_canonical(code) in scope for scope in scopes):
        return
    key = _key(kind, name, code)
    if any(trusted is not None and _is_named_in(trusted, code) for _, trusted in _process):
        _remember(key, code)
    elif key not in _remembered():
        raise InputError(
            f"The {kind} {name} would run code that only stored settings name: {code}. Nothing that a file names is "
            "run by itself. If you trust it, name it on the command line or as an argument, too, or allow what that "
            "file or folder names: put its path after --allow-code-from.",
            code="code-not-allowed",
        )


def check_options(kind: str, name: str, options: Mapping[str, Any], code_options: Iterable[str] | None) -> None:
    """Refuse options that run code which nobody named.

    Args:
        code_options: the options whose values are run; None where the plug-in does not say: then those of
            `CODE_OPTIONS` and every text that names a Python file or MODULE:CLASS count.
    """
    declared = CODE_OPTIONS if code_options is None else code_options
    for option, value in options.items():
        for text in _strings(value):
            if option in declared or (code_options is None and _looks_like_code(text)):
                check(kind, name, text)


def _texts(named: Iterable[Any]) -> frozenset[str]:
    found: set[str] = set()
    for text in _strings(list(named)):
        while text:
            found.add(_canonical(text))
            if text.startswith(("{", "[")):
                import yaml  # only few options are written so

                try:
                    found |= {_canonical(each) for each in _strings(yaml.safe_load(text))}
                except (yaml.YAMLError, ValueError, RecursionError):  # refused where the option is read
                    break
            # `--stack-option command=./planner` and `exec:./planner` name `./planner`
            head, mark, rest = text.partition("=")
            text = rest if mark and " " not in head else text.removeprefix("exec:") if text.startswith("exec:") else ""
    return frozenset(found)


def _strings(value: Any) -> Iterator[str]:
    """Return every text in a value, at any depth."""
    if isinstance(value, str | os.PathLike):
        yield os.fspath(value)
    elif isinstance(value, Mapping):
        for key, each in value.items():
            yield from _strings(key)
            yield from _strings(each)
    elif hasattr(value, "model_dump"):
        yield from _strings(value.model_dump())
    elif isinstance(value, Iterable):
        for each in value:
            yield from _strings(each)


def _looks_like_code(text: str) -> bool:
    module, _, attribute = text.rpartition(":")
    return ".py" in text or (attribute.isidentifier() and all(part.isidentifier() for part in module.split(".")))


def _canonical(text: str) -> str:
    """Return a text with the place of the Python file or command it names, where there is one of that name."""
    file, mark, attribute = text.rpartition(":")
    file, rest = (file, mark + attribute) if mark and file.endswith(".py") else (text, "")
    return os.path.realpath(file) + rest if len(file) < 4096 and file.endswith(".py") else text


def _key(kind: str, name: str, code: str) -> str:
    """Return a hash of a piece of code: what names it, and the content of every file that is named in it."""
    digest = hashlib.sha256(json.dumps([kind, name, code]).encode())
    try:
        words = shlex.split(code)
    except ValueError:
        words = [code]
    for word in words:
        for path in (Path(word), Path(word.rpartition(":")[0] or word)):
            try:
                if path.is_file():
                    digest.update(path.read_bytes())
                    break
            except (OSError, ValueError):
                continue
    return digest.hexdigest()


def _is_named_in(source: Path, code: str) -> bool:
    """Return whether a file, or a file of a folder, names the code: as it is, or relative to the file."""
    folder, files = (source, source.iterdir()) if source.is_dir() else (source.parent, iter([source]))
    forms = [code, os.path.relpath(code, folder)] if ".py:" in code else [code]
    written = [text.encode() for form in forms for text in (form, json.dumps(form)[1:-1])]
    contents = (path.read_bytes() for path in files if path.is_file())
    return any(text in content for content in contents for text in written)


def _memory() -> Path:
    return state_folder() / "allowed-code.json"


def _remembered() -> dict[str, str]:
    try:
        found = json.loads(_memory().read_text(encoding="utf-8"))
    except (OSError, ValueError, FileError):
        return {}
    return found if isinstance(found, dict) else {}


def _remember(key: str, code: str) -> None:
    known = _remembered()
    if key in known:
        return
    write_whole(_memory(), json.dumps(known | {key: code}, indent=1) + "\n")
