"""Where the files of a kept campaign are, whatever folder one stands in.

A campaign keeps the paths it was given as they were given: they are part of its records, which are to be the same on
every machine. It also keeps the folder it was begun in, which relative paths are read from.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rvsg.api.config import file_of
from rvsg.scenario.requirements import shipped_requirements
from rvsg.world.io.load import shipped_worlds

FROM = "from"
"""The key under which the folder is kept that a campaign was begun in."""
FILES = ("world", "requirement", "prompts", "replay")
"""Settings that may name a file or a folder."""


def places(values: Mapping[str, Any], begun_in: object) -> dict[str, str]:
    """The paths among settings, each with the place where it is, seen from the present folder."""
    if not isinstance(begun_in, str):
        return {}
    shipped = {*shipped_worlds(), *shipped_requirements()}
    here = Path(begun_in) == Path.cwd()
    found = {}
    for key in FILES:
        for text in _texts(values.get(key)):
            place = Path(begun_in) / text
            if text not in shipped and Path(file_of(str(place))).exists():
                found[text] = text if here else str(place)
    return found


def as_kept(asked: Mapping[str, Any], known: Mapping[str, str]) -> dict[str, Any]:
    """Settings that are asked for in the words of the kept campaign where they name the same file.

    A path that is worded as a kept one but is another file here is spelt out, so that it is not taken for it.
    """

    def worded(text: str) -> str:
        for kept, place in known.items():
            if _absolute(text) == _absolute(place):
                return kept
        return str(Path(text).absolute()) if text in known and Path(file_of(text)).exists() else text

    return {
        key: value
        if key not in FILES or value is None
        else [worded(text) for text in value]
        if isinstance(value, list)
        else worded(value)
        for key, value in asked.items()
    }


def spelt_out(values: Mapping[str, Any], known: Mapping[str, str]) -> dict[str, Any]:
    """Settings whose paths hold from every folder."""
    shipped = {*shipped_worlds(), *shipped_requirements()}

    def spelt(text: str) -> str:
        place = known.get(text, text)
        return text if text in shipped or not Path(file_of(place)).exists() else str(Path(place).absolute())

    return {key: spelt(v) if key in FILES and isinstance(v, str) else v for key, v in values.items()}


def _texts(value: Any) -> Iterable[str]:
    return [text for text in (value if isinstance(value, list) else [value]) if isinstance(text, str)]


def _absolute(text: str) -> str:
    """A path with its links followed, and the name of a part of the file as it is."""
    file = file_of(text)
    return f"{Path(file).resolve()}{text[len(file) :].replace(':', '#', 1)}"
