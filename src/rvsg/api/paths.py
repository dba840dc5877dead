"""Find the files that a stored campaign names, from any folder.

A campaign stores paths as they were typed, and the folder it was begun in, which relative paths are read from.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rvsg.api.config import file_of
from rvsg.scenario.requirement import shipped_requirements
from rvsg.world.io.load import shipped_worlds

FILES = ("world", "requirement", "moved", "knowledge", "stack", "prompts", "replay")
"""Settings that may name a file or a folder."""


def paths_of(values: Mapping[str, Any], begun_in: str | None) -> dict[str, str]:
    """Return the typed paths among settings, each with where it is, seen from the current folder."""
    if begun_in is None:
        return {}
    shipped = {*shipped_worlds(), *shipped_requirements()}
    here = Path(begun_in) == Path.cwd()
    found = {}
    for key in FILES:
        for text in _texts(values.get(key)):
            path = Path(begun_in) / text
            if text not in shipped and Path(file_of(str(path))).exists():
                found[text] = text if here else str(path)
    return found


def as_stored(asked: Mapping[str, Any], known: Mapping[str, str]) -> dict[str, Any]:
    """Return settings with every path as the stored campaign types it, where both name the same file.

    A path that is typed like a stored one but names another file here is made absolute, so that the two differ.
    """

    def typed(text: str) -> str:
        for kept, path in known.items():
            if _absolute(text) == _absolute(path):
                return kept
        return str(Path(text).absolute()) if text in known and Path(file_of(text)).exists() else text

    return {
        key: value
        if key not in FILES or value is None
        else [typed(text) for text in value]
        if isinstance(value, list)
        else typed(value)
        for key, value in asked.items()
    }


def spelled_out(values: Mapping[str, Any], known: Mapping[str, str]) -> dict[str, Any]:
    """Return settings whose paths hold from every folder."""
    shipped = {*shipped_worlds(), *shipped_requirements()}

    def spelled(text: str) -> str:
        path = known.get(text, text)
        return text if text in shipped or not Path(file_of(path)).exists() else str(Path(path).absolute())

    return {key: spelled(v) if key in FILES and isinstance(v, str) else v for key, v in values.items()}


def _texts(value: Any) -> Iterable[str]:
    return [text for text in (value if isinstance(value, list) else [value]) if isinstance(text, str)]


def _absolute(text: str) -> str:
    """Return a path with its links resolved, and the name of a part of the file unchanged."""
    file = file_of(text)
    return f"{Path(file).resolve()}{text[len(file) :].replace(':', '#', 1)}"
