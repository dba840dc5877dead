"""JSON of replies: the schemas models are held to, and a search for JSON in what they wrote all the same.

Proper JSON is read by the standard library, malformed JSON by json-repair. The search finds where a value begins and
ends among prose, says whether it is complete, and bounds the work: a reply may be as long and nested as it likes.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from json_repair import repair_json

from rvsg.core.inputs import whole_text
from rvsg.scenario.scenario import Attention, Behaviour, PersonKind

MAX_DEPTH = 40
MAX_STARTS = 2000
MAX_REPAIRED = 200_000
"""Malformed JSON longer than this (characters) is not read: the time of json-repair can grow with the square."""
WORK_PER_CHARACTER = 24
LARGEST = 10**300
OUT_OF_RANGE = "out of range"
"""Stands for a number no quantity can have; a reader that expects a number refuses it."""
_MARKS = re.compile(r'"(?:[^"\\]|\\.)*+"|[{}\[\]]', re.DOTALL)
_BRACKETS = re.compile(r"[{}\[\]]")
_OPENED_BY = {"}": "{", "]": "["}


@dataclass(frozen=True, kw_only=True)
class Found:
    """A JSON value in a text."""

    value: Any
    start: int
    """The index of its first character."""
    end: int
    """The index after its last character."""
    repaired: bool = False
    """Whether it was malformed."""
    complete: bool = True
    """Whether its last bracket is there; if not, the text was cut off."""


def find_json(text: str) -> tuple[Found, ...]:
    """Return every JSON object or list in a text, in order, outermost only.

    Lists are found only where they hold objects, stand in a fence or stand alone: prose is full of `[G7, G8]`.
    """
    found: list[Found] = []
    decoder = json.JSONDecoder(parse_constant=_number, parse_float=_number, parse_int=_number)
    work = WORK_PER_CHARACTER * len(text) + 10_000
    at = 0
    for _ in range(MAX_STARTS):
        starts = [i for i in (text.find("{", at), text.find("[", at)) if i >= 0]
        if not starts or work <= 0:
            break
        start = min(starts)
        try:
            value, end = decoder.raw_decode(text, start)
            one: Found | None = Found(value=_storable(value), start=start, end=end)
        except (ValueError, RecursionError):
            one, spent = _repaired(text, start)
            work -= spent
        if one is None or not _is_data(one, text):
            at = start + 1
            continue
        found.append(one)
        at = max(one.end, start + 1)
    return tuple(found)


def _number(text: str) -> float:
    """Refuse what JSON does not know (NaN, Infinity) and what cannot be stored."""
    value = int(text) if text.removeprefix("-").isdigit() else float(text)
    if not abs(value) < (LARGEST if isinstance(value, int) else math.inf):
        raise ValueError(f"{text[:40]} is no number of JSON, or too large")
    return value


def _repaired(text: str, start: int) -> tuple[Found | None, int]:
    """Return what json-repair makes of the value at `start`, or None, and the characters read."""
    end, spent = _end_of(text, start, _MARKS)
    if end is None:  # perhaps a quotation mark too many hides the last bracket
        end, more = _end_of(text, start, _BRACKETS)
        spent += more
    if end == start:
        return None, spent
    fence = text.find("```", start)
    stop = end if end is not None else fence if fence >= 0 else len(text)
    source = text[start:stop]
    if len(source) > MAX_REPAIRED or (source[0] == "{" and ":" not in source):
        return None, spent
    spent += len(source)
    try:
        value = repair_json(source, return_objects=True, skip_json_loads=True)
    except (ValueError, RecursionError):
        return None, spent
    if not isinstance(value, dict if source[0] == "{" else list):
        return None, spent
    return Found(value=_storable(value), start=start, end=stop, repaired=True, complete=end is not None), spent


def _end_of(text: str, start: int, marks: re.Pattern[str]) -> tuple[int | None, int]:
    """Return the index after the bracket that closes the one at `start`, or None, and the characters read."""
    opened: list[str] = []
    for mark in marks.finditer(text, start):
        bracket = mark.group()
        if bracket in ("{", "["):
            opened.append(bracket)
            if len(opened) > MAX_DEPTH:
                return start, mark.end() - start
        elif (opening := _OPENED_BY.get(bracket)) in opened:
            while opened.pop() != opening:
                pass
            if not opened:
                return mark.end(), mark.end() - start
    return None, len(text) - start


def _storable(value: Any) -> Any:
    """Return the value without halves of characters and numbers out of range, which could not be stored."""
    if isinstance(value, str):
        return whole_text(value)
    if isinstance(value, dict):
        return {whole_text(str(key)): _storable(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_storable(item) for item in value]
    too_large = isinstance(value, int) and abs(value) >= LARGEST
    return OUT_OF_RANGE if too_large or (isinstance(value, float) and not math.isfinite(value)) else value


def _is_data(found: Found, text: str) -> bool:
    """Return whether a value is data, not a bracket in prose."""
    if isinstance(found.value, dict):
        return bool(found.value) or not found.repaired
    if any(isinstance(item, dict) for item in found.value):
        return True
    before = text[: found.start].rstrip()
    alone = not before and not text[found.end :].strip()
    fenced = before.endswith(("```", "```json", "```JSON"))
    return bool(found.value) and (alone or fenced)


def number_of(value: Any) -> float | None:
    """Return a finite number that a model gives as a number or as text ("1.2", "5 s"); None for anything else."""
    if isinstance(value, bool):
        return None
    if isinstance(value, str):
        match = re.match(r"\s*(-?\d+(?:\.\d+)?)\s*(?:s|sec|seconds|m/s)?\s*$", value)
        value = float(match[1]) if match else None
    try:
        number = float(value) if isinstance(value, (int, float)) else math.nan
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def object_schema(properties: dict[str, Any]) -> dict[str, Any]:
    """The schema of an object with these properties and no others, all of them required."""
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }


def texts_schema(*keys: str) -> dict[str, Any]:
    """The schema of an object of texts."""
    return object_schema(dict.fromkeys(keys, TEXT))


TUNABLE = ("speed_m_s", "start_delay_s", "pause_s", "start", "stops")
"""What an optimiser may change of a person; of the first three a model may also give a range."""
TEXT: dict[str, Any] = {"type": "string"}
NUMBER: dict[str, Any] = {"type": "number"}
_PATH = {"type": "array", "items": TEXT, "minItems": 1}
_MOVED = object_schema({"name": TEXT, **dict.fromkeys(("x", "y", "length_m", "width_m", "height_m", "yaw"), NUMBER)})
_PAUSES = {"type": "array", "items": object_schema({"at": TEXT, "duration_s": NUMBER})}


def configuration_schema(
    *,
    rich: bool,
    described: bool = True,
    behaviours: Sequence[Behaviour] = tuple(Behaviour),
    actors: Sequence[str] = (),
    tunes: bool = False,
) -> dict[str, Any]:
    """Return the schema of a configuration; `rich` with description, speeds, delays, pauses and behaviours.

    Args:
        tunes: Whether it says what an optimiser may change.
    """
    task = {"task": TEXT, "path": _PATH}
    if not rich:
        plain = object_schema({"name": TEXT, "tasks": {"type": "array", "items": object_schema(task)}})
        humans = {"humans": {"type": "array", "items": plain}}
        return object_schema({"description": TEXT, **humans, "lesson": TEXT} if described else humans)
    human = {
        "name": TEXT,
        "behaviour": {"type": "string", "enum": [b.value for b in behaviours]},
        "attention": {"type": "string", "enum": [a.value for a in Attention]},
        "speed_m_s": NUMBER,
        "start_delay_s": NUMBER,
        "group": {"type": ["integer", "null"]},
        "plan": {"type": "array", "items": object_schema({"at": TEXT, "time_s": NUMBER})},
        "tasks": {"type": "array", "items": object_schema({**task, "pauses": _PAUSES})},
    }
    if tunes:
        human["tuning"] = texts_schema(*TUNABLE)
    kinds = [kind.value for kind in PersonKind if kind is PersonKind.ADULT or kind.value in actors]
    if len(kinds) > 1:
        human["kind"] = {"type": "string", "enum": kinds}
    if "trolley" in actors:
        human["trolley"] = {"anyOf": [object_schema({"length_m": NUMBER, "width_m": NUMBER}), {"type": "null"}]}
    shape = {"analysis": TEXT, "lesson": TEXT, "description": TEXT}
    shape["humans"] = {"type": "array", "items": object_schema(human)}
    return object_schema(shape | ({"moved": {"type": "array", "items": _MOVED}} if "moved_object" in actors else {}))
