"""A parameter file of Nav2 as a tree of sections, which remember what of it is honoured."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from rvsg.core.documents import DocumentError, Problem, read_yaml

Key = tuple[str, ...]
State = Literal["honoured", "no effect", "not supported"]
STATES: tuple[State, ...] = ("honoured", "no effect", "not supported")


@dataclass(frozen=True)
class Entry:
    """One key of the file."""

    key: str
    value: str
    state: State
    note: str = ""


@dataclass
class Nav2File:
    """A parameter file, read: the stack it asks for, and what becomes of every key."""

    path: Path
    stack: str
    options: dict[str, Any]
    entries: list[Entry] = field(default_factory=list)

    def counts(self) -> dict[str, int]:
        """Return how many keys are in each state."""
        return {state: sum(entry.state == state for entry in self.entries) for state in STATES}

    def messages(self) -> list[str]:
        """Return what a user has to know: the counts, and every key that is not supported, by reason."""
        counts = self.counts()
        lines = [
            f"{self.path}: {self.stack}; of {len(self.entries)} keys {counts['honoured']} are honoured, "
            f"{counts['no effect']} have no effect here, {counts['not supported']} are not supported. "
            f"`rvsg stacks {self.path}` lists all of them."
        ]
        reasons: dict[str, list[str]] = {}
        for entry in self.entries:
            if entry.state == "not supported":
                reasons.setdefault(entry.note, []).append(entry.key)
        lines += [f"not supported: {', '.join(keys)}: {reason}" for reason, keys in reasons.items()]
        return lines


class Section:
    """The parameters of a node or a plug-in; remembers which of them were used."""

    def __init__(self, reader: Reader, place: Key, values: Any) -> None:
        self._reader, self.place = reader, place
        self.values: Mapping[str, Any] = values if isinstance(values, Mapping) else {}

    def get(self, key: str, default: Any = None, note: str = "") -> Any:
        """Return a parameter and mark it as honoured; `a.b` may be nested or spelled with the dot."""
        parts = key.split(".")
        found: Any = self.values
        for part in parts:
            found = found.get(part) if isinstance(found, Mapping) else None
        if found is None and key in self.values:
            found, parts = self.values[key], [key]
        if found is None:
            return default
        self._reader.use((*self.place, *parts), note)
        return found

    def number(self, key: str, default: float | None = None) -> Any:
        """Return a number; FileError names the key where it is none."""
        value = self.get(key, default)
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            self._reader.wrong((*self.place, key), f"expected a number, got {value!r}")
        return value

    def inner(self, key: str) -> Section:
        """Return a plug-in's section."""
        return Section(self._reader, (*self.place, key), self.values.get(key))


class Reader:
    """Reads a parameter file; keeps what was used and what is not supported."""

    def __init__(self, path: Path, document: Mapping[str, Any]) -> None:
        self.path, self.document = path, document
        self.used: dict[Key, str] = {}
        self.refused: dict[Key, str] = {}
        self.idle: dict[Key, str] = {}
        """Sections that change nothing, and why."""
        self.options: dict[str, Any] = {"smoother": {}, "costmaps": {}, "behaviours": {}}

    def use(self, key: Key, note: str = "") -> None:
        """Mark a key as honoured."""
        self.used[key] = note

    def refuse(self, key: Key, note: str) -> None:
        """Mark a key as not supported, with the reason."""
        self.refused[key] = note

    def wrong(self, key: Key, message: str) -> None:
        """Raise what is wrong with a key."""
        line = read_yaml(self.path).lines.get(key)
        raise DocumentError([Problem(self.path, line, f"{'.'.join(map(str, key))}: {message}", key)])

    def node(self, *names: str) -> Section:
        """Return the section of a node, with the wild card of a namespace or not."""
        found: Any = self.document
        for name in (*names, "ros__parameters"):
            found = found.get(name) if isinstance(found, Mapping) else None
        return Section(self, (*names, "ros__parameters"), found)

    def kind_of(self, section: Section, known: tuple[str, ...] | Mapping[str, str], what: str) -> str:
        """Return the class of a plug-in, without its package; refuse one that is not simulated."""
        plugin = str(section.get("plugin", ""))
        kind = re.split(r"::|/", plugin)[-1]
        if kind not in known:
            near = difflib.get_close_matches(kind, list(known), n=1, cutoff=0.0)
            self.wrong(
                (*section.place, "plugin"),
                f"the {what} {plugin or '(no plugin)'} is not simulated. The nearest that is: "
                f"{near[0] if near else '-'}. Simulated: {', '.join(known)}. To test yours as it is, use "
                "--stack ros2 or exec:COMMAND.",
            )
        return kind

    def first_of(self, section: Section, *keys: str, default: str) -> str:
        """Return the name of the first plug-in that a key lists."""
        for key in keys:
            names = section.get(key)
            if names:
                if isinstance(names, list) and len(names) > 1:
                    self.refuse((*section.place, key), f"only the first is simulated: {names[0]}")
                return str(names[0] if isinstance(names, list) else names)
        return default


def put(into: dict[str, Any], key: str, value: Any) -> None:
    """Set a value, unless it is None."""
    if value is not None:
        into[key] = value


def circle(radius: float) -> tuple[tuple[float, float], ...]:
    """Return Nav2's outline of a round robot: a polygon of 16 corners."""
    angles = [2.0 * math.pi * k / 16 for k in range(16)]
    return tuple((radius * math.cos(a), radius * math.sin(a)) for a in angles)


def points_of(values: Mapping[str, Any]) -> tuple[tuple[float, float], ...] | None:
    """Return the corners of a polygon of the collision monitor: Humble lists numbers, later releases a text."""
    if values.get("type") == "circle" and isinstance(values.get("radius"), int | float):
        return circle(float(values["radius"]))
    given: Any = values.get("points")
    try:
        found = json.loads(given) if isinstance(given, str) else given
        if isinstance(found, list) and found and isinstance(found[0], int | float):
            found = list(zip(found[::2], found[1::2], strict=True))
        return tuple((float(x), float(y)) for x, y in found) if found else None
    except (ValueError, TypeError):
        return None


def leaves_of(value: Any, key: Key) -> Iterator[tuple[Key, Any]]:
    """Yield every value of a tree with the keys that lead to it."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from leaves_of(inner, (*key, str(name)))
    else:
        yield key, value
