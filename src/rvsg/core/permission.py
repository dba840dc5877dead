"""What data may cause: code that is run, and servers that get something of the user.

Settings can name code (a class or a file of a stack, a command, a launch line) and servers (the scheduler of a cluster,
a database, the address of a model). A person allows both by naming them on the command line, in a job of the studio or
as an argument in Python, under the setting that means them. A campaign file, the folder of a campaign and stored runs
are data, perhaps from a stranger: `check` refuses what only they name. It is called where plug-ins are made, so no door
can go round it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from importlib.machinery import all_suffixes
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from rvsg.core.errors import FileError, InputError
from rvsg.core.files import state_folder, write_whole

Namings = frozenset[tuple[str, str]]
"""Texts, each with the setting whose value it is; without one for a word of a command line that is no option."""
_scopes: ContextVar[tuple[Namings, ...]] = ContextVar("scopes", default=())
_process: list[tuple[Namings, Path | None]] = []
"""The scopes of the whole process, each with the file or folder whose code is allowed."""
CODE_OPTIONS = ("command", "launch", "module", "script", "executable", "address", "scheduler_file")
"""Options that count as code in a plug-in that does not say by `code_options` which of its options are."""
MOST_FILES, MOST_BYTES = 2_000, 100_000_000
"""A folder that holds more is not remembered."""


@contextmanager
def only(*named: Any) -> Iterator[None]:
    """Within the block, allow only what these settings name, at any depth; for work on stored settings."""
    token = _scopes.set((*_scopes.get(), frozenset(_namings(named))))
    try:
        yield
    finally:
        _scopes.reset(token)


@contextmanager
def only_in_process(named: Iterable[Any], *, trusted: Path | None = None, without: str = "") -> Iterator[None]:
    """Within the block, allow only what these settings name, in all threads; for a command line or a server.

    Args:
        named: settings with their values; or words without one.
        without: a setting that is none of them, wherever it stands.
        trusted: a file or folder; code that is named in it is allowed, and remembered where content decides what runs.

    Raises:
        InputError: there is no such file or folder.
    """
    if trusted is not None and not trusted.exists():
        raise InputError(f"--allow-code-from {trusted}: there is no such file or folder.", code="code-source-missing")
    scope = (frozenset(pair for pair in _namings(list(named)) if pair[0] != (without or None)), trusted)
    _process.append(scope)
    try:
        yield
    finally:
        _process.remove(scope)


def typed(words: Sequence[str]) -> Iterator[Any]:
    """Yield the options of a command line as settings, and its other words."""
    for number, word in enumerate(words, 1):
        name, mark, value = word.removeprefix("--").partition("=")
        if word.startswith("--") and word != name:
            yield {name.replace("-", "_"): value if mark else "".join(words[number : number + 1])}
        else:
            yield word


def check(kind: str, name: str, option: str, value: str) -> None:
    """Refuse to make what runs code, or uses a server, that nobody named.

    Args:
        kind: e.g. `stack`; this setting names a plug-in with or without its option, as in `exec:./planner`.
        value: what it would run, load or connect to, as the option says.

    Raises:
        InputError: it was read from data only.
    """
    is_named = partial(_is_named, kind=kind, name=name, option=option, value=value)
    scopes = [*_scopes.get(), *(named for named, _ in _process)]
    if all(map(is_named, scopes)):
        return
    trusted = [path for _, path in _process if path is not None]
    for file in (file for path in trusted for file in _documents(path) if is_named(_namings_in(file), file.parent)):
        if (key := _key(file, kind, name, option, value)) is not None:
            _remember(key, value)
        return
    if remembered := _remembered():
        for path in {Path(text) for named, _ in _process for _, text in named if len(text) < 4096 and "\0" not in text}:
            if any(_key(file, kind, name, option, value) in remembered for file in _documents(path)):
                return
    raise InputError(
        f"The {kind} {name} would run code or use a server that only stored settings name: {value}. Nothing that a "
        "file names is run by itself. If you trust it, name it on the command line or as an argument, too, or allow "
        "what that file or folder names: put its path after --allow-code-from.",
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
        for _, text in _namings(value):
            if option in declared or (code_options is None and _looks_like_code(text)):
                check(kind, name, option, text)


def allows_key_for(address: str) -> bool:
    """Return whether a server may get a key of the environment: the user named it, or allowed its host."""
    at = urlsplit(address.casefold())
    has_port = at.netloc.rpartition(":")[2].isdecimal()
    place = at.netloc if has_port else f"{at.netloc}:{443 if at.scheme == 'https' else 80}"
    scopes = [*_scopes.get(), *(named for named, _ in _process)]
    if all(("base_url", address) in scope for scope in scopes):
        if _process:
            allow_key_for(place)
        return True
    return not {_of_host(place), _of_host(at.hostname or "")}.isdisjoint(_remembered())


def allow_key_for(host: str) -> None:
    """Remember that a host, `NAME` or `NAME:PORT`, may get a key of the environment."""
    with contextlib.suppress(FileError):  # without a folder of state it is allowed in this call alone
        _remember(_of_host(host.casefold()), "a key of the environment")


def _of_host(host: str) -> str:
    return f"key for {host}"


def _namings(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield every text in a value, at any depth, with the setting it is the value of."""
    if hasattr(value, "model_dump"):
        value = value.model_dump()
    if isinstance(value, str | os.PathLike):
        text = os.fspath(value)
        yield key, text
        if text.startswith(("{", "[")):
            import yaml  # only few options are written so

            with contextlib.suppress(yaml.YAMLError, ValueError, RecursionError):  # refused where the option is read
                yield from _namings(yaml.safe_load(text), key)
        elif key.endswith("_option") or (not key and ":" in text.partition("=")[0] and not os.path.lexists(text)):
            # `--stack-option command=./planner`, and the word `embedded:stack=./mine.py:Mine,robot=small.yaml`
            for part in [text] if key else text.split(","):
                head, mark, rest = part.partition("=")
                if mark and (option := head.rpartition(":")[2]).isidentifier():
                    yield from _namings(rest, option)
    elif isinstance(value, Mapping):
        is_plug_in = value.keys() <= {"name", "options", "version"}
        for name, item in value.items():
            yield from _namings(item, key if name == "name" and is_plug_in else str(name))
    elif isinstance(value, Iterable):
        for item in value:
            yield from _namings(item, key)


def _is_named(
    namings: Iterable[tuple[str, str]], folder: Path = Path(), *, kind: str, name: str, option: str, value: str
) -> bool:
    """Return whether one of the settings, whose paths are relative to a folder, means just this."""
    wanted = _canonical(value)
    whole = {wanted, f"{name}:{value}"}
    return any(
        (key == option and _canonical(text, folder) == wanted) or (key == kind and _canonical(text, folder) in whole)
        for key, text in namings
    )


def _looks_like_code(text: str) -> bool:
    module, _, attribute = text.rpartition(":")
    return ".py" in text or (attribute.isidentifier() and all(part.isidentifier() for part in module.split(".")))


def _canonical(text: str, folder: Path = Path()) -> str:
    """Return a text with the place of the Python file it names, where it is FILE.py:CLASS."""
    file, _, attribute = text.rpartition(":")
    return f"{os.path.realpath(folder / file)}:{attribute}" if file.endswith(".py") and len(file) < 4096 else text


def _documents(source: Path) -> list[Path]:
    """Return a file, or the documents in a folder and its sub-folders."""
    places = [*source.glob("*"), *source.glob("*/*")] if source.is_dir() else [source]
    return [file for file in places if file.suffix in (".yaml", ".yml", ".json", ".jsonl") and file.is_file()]


def _namings_in(file: Path) -> Namings:
    import yaml

    with contextlib.suppress(OSError, ValueError, yaml.YAMLError, RecursionError):  # what cannot be read names nothing
        text = file.read_text(encoding="utf-8")
        if file.suffix == ".jsonl":
            return frozenset(_namings([json.loads(line) for line in text.splitlines()]))
        return frozenset(_namings(json.loads(text) if file.suffix == ".json" else yaml.safe_load(text)))
    return frozenset()


def _key(file: Path, kind: str, name: str, option: str, value: str) -> str | None:
    """Return a hash of what a file names as code, of the file and of all that the code may load from its folder.

    None where content does not decide what runs: of a command, a server, or a module that is found by a path.
    """
    code, folder = _canonical(value), Path(_canonical(value).rpartition(":")[0]).parent
    if ".py:" not in code:
        return None
    digest = hashlib.sha256(json.dumps([kind, _canonical(name), option, code, os.path.realpath(file)]).encode())
    digest.update(file.read_bytes())
    count = size = 0
    outputs: tuple[str, ...] = ()
    for place, folders, files in os.walk(folder):
        if any(Path(place, name).is_symlink() for name in folders):
            return None
        folders.sort()
        if place.endswith("/.git") or (place != str(folder) and any(name.startswith("ledger.") for name in files)):
            outputs += (f"{place}/",)  # what git and RVSG write changes all the time: modules alone count there
        is_aside = f"{place}/".startswith(outputs)
        for path in (Path(place, name) for name in sorted(files)):
            if is_aside and not path.name.endswith(tuple(all_suffixes())):
                continue
            count, size = count + 1, size + path.stat().st_size
            if count > MOST_FILES or size > MOST_BYTES or not path.is_file():
                return None
            digest.update(json.dumps([str(path), hashlib.sha256(path.read_bytes()).hexdigest()]).encode())
    return digest.hexdigest()


def _memory() -> Path:
    return state_folder() / "allowed.json"


def _remembered() -> dict[str, str]:
    try:
        permissions = json.loads(_memory().read_text(encoding="utf-8"))
    except (OSError, ValueError, FileError):
        return {}
    return permissions if isinstance(permissions, dict) else {}


def _remember(key: str, what: str) -> None:
    if key not in (permissions := _remembered()):
        write_whole(_memory(), json.dumps(permissions | {key: what}, indent=1) + "\n")
