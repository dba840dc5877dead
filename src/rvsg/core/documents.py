"""Reader of YAML files as records. It reports all mistakes at once with file and line."""

from __future__ import annotations

import datetime
import difflib
import json
import math
import re
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

import pydantic
import yaml
from pydantic import BaseModel, ValidationError

from rvsg.core.errors import FileError, InvalidOptions
from rvsg.core.inputs import LARGEST_NUMBER, LONGEST_NUMBER, is_text, is_too_large, parse_json, read_text
from rvsg.core.records import Record

MOST_NODES = 400_000
MOST_LISTED = 50
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_EXPONENT = re.compile(r"[-+]?[0-9.]+[eE]\+?[0-9]{2,3}")
"""A number to a person and to a record, and text to YAML 1.1, which wants a point and a sign."""

Key = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)


@dataclass(frozen=True)
class Problem:
    """A mistake in a file: where, and what.

    `key` is the path of keys of the value it is about; empty if it is about the file as a whole. `code` says what is
    wrong as a stable word, as that of an error does.
    """

    path: Path
    line: int | None
    message: str
    key: Key = ()
    code: str = "document"

    @classmethod
    def of(cls, error: FileError) -> Problem:
        """Return the problem that an error reports."""
        return cls(error.path, error.line, error.reason, code=error.code)

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.message}" if self.line is not None else f"{self.path}: {self.message}"


class DocumentError(FileError):
    """One file, or several that belong together, with all mistakes in them."""

    code = "document"

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        first = self.problems[0]
        super().__init__(first.path, first.message, line=first.line)
        if len(self.problems) > 1:
            listed = "\n".join(f"  - {problem}" for problem in self.problems[:MOST_LISTED])
            if len(self.problems) > MOST_LISTED:
                listed += f"\n  and {len(self.problems) - MOST_LISTED} more"
            self.args = (f"{len(self.problems)} things are wrong:\n{listed}",)


class WrongValue(ValueError):
    """What a validator of a whole record raises about one value inside; `key` is the path of keys to that value."""

    def __init__(self, message: str, *key: str | int) -> None:
        super().__init__(message)
        self.key: Key = key


@dataclass(frozen=True)
class Document:
    """A YAML file as plain values; `lines` maps the path of keys to every value to its line, counted from 1."""

    path: Path
    value: Any
    lines: dict[Key, int]

    def line(self, *key: str | int) -> int | None:
        """Return the line of the value under this path of keys, or of the nearest value around it."""
        for length in range(len(key), -1, -1):
            if key[:length] in self.lines:
                return self.lines[key[:length]]
        return None

    def problem(self, message: str, *key: str | int, code: str = "document") -> Problem:
        """Return a problem of the value under this path of keys."""
        return Problem(self.path, self.line(*key), message, key, code)


def read_yaml(path: Path) -> Document:
    """Read one YAML document with the safe loader; raises FileError (with the line where it can)."""
    return parse_yaml(read_text(path), path)


def parse_yaml(text: str, path: Path) -> Document:
    """Parse YAML text that came from `path`."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)(text)
    try:
        node = loader.get_single_node()
        if node is None:
            raise FileError(path, "the file is empty", code="file-empty")
        lines: dict[Key, int] = {}
        _note_lines(node, path, lines)
        _check_scalars(node, path)
        return Document(path, loader.construct_document(node), lines)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        reason = " ".join(part for part in (error.context, error.problem) if part)
        raise FileError(path, f"not valid YAML: {reason}", line=mark.line + 1 if mark else None, code="yaml") from None
    except yaml.YAMLError as error:
        raise FileError(path, f"not valid YAML: {error}", code="yaml") from None
    except ValueError as error:  # such as a date with month 13
        raise FileError(path, f"not valid YAML: {error}", code="yaml") from None
    finally:
        loader.dispose()


def _check_scalars(root: yaml.Node, path: Path) -> None:
    """Refuse text that cannot be written again, and numbers no computer writes (Python takes minutes for them)."""
    stack, seen = [root], set()
    while stack:
        node = stack.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, yaml.ScalarNode):
            line = node.start_mark.line + 1
            if not is_text(node.value):
                raise FileError(path, "a text holds half a character (a lone surrogate)", line=line)
            if len(node.value) > LONGEST_NUMBER and node.tag in _NUMBERS:
                raise FileError(path, f"a number has {len(node.value)} characters", line=line)
            if (node.tag in _NUMBERS or _EXPONENT.fullmatch(node.value)) and is_too_large(node.value):
                reason = f"{node.value[:20]} is too large; at most {LARGEST_NUMBER:.0e} is read"
                raise FileError(path, reason, line=line, code="number-too-large")
        elif isinstance(node, yaml.SequenceNode):
            stack.extend(node.value)
        elif isinstance(node, yaml.MappingNode):
            stack.extend(child for pair in node.value for child in pair)


def _note_lines(root: yaml.Node, path: Path, lines: dict[Key, int]) -> None:
    """Note the line of every value. Bounded, so that a file of nested aliases cannot exhaust the machine."""
    stack: list[tuple[Key, yaml.Node]] = [((), root)]
    while stack:
        key, node = stack.pop()
        lines.setdefault(key, node.start_mark.line + 1)
        if len(lines) > MOST_NODES or len(key) > 60:
            raise FileError(
                path,
                "the file is nested too deep or refers to itself",
                line=node.start_mark.line + 1,
                code="yaml-nested",
            )
        if isinstance(node, yaml.SequenceNode):
            stack.extend(((*key, i), item) for i, item in enumerate(node.value))
        elif isinstance(node, yaml.MappingNode):
            seen: set[str] = set()
            for name, item in node.value:
                line = name.start_mark.line + 1
                if not isinstance(name, yaml.ScalarNode):
                    raise FileError(
                        path, "not valid YAML: a key is a list or a mapping; is a bracket misplaced?", line=line
                    )
                if name.value in seen:
                    raise FileError(path, f'the key "{name.value}" stands here twice', line=line, code="yaml-key-twice")
                seen.add(name.value)
                lines[(*key, name.value)] = line
                stack.append(((*key, name.value), item))


def read_document(path: Path, model: type[Model]) -> tuple[Model, Document]:
    """Read a YAML file into a record; raises DocumentError with every mistake, or FileError for unreadable text."""
    document = read_yaml(path)
    return validated(document, model), document


def validated(document: Document, model: type[Model]) -> Model:
    """Return the document as a record; raises DocumentError with every mistake."""
    if not isinstance(document.value, dict):
        wanted = ", ".join(model.model_fields)
        raise DocumentError([document.problem(f"expected keys and values ({wanted}), got {_shown(document.value)}")])
    try:
        return model.model_validate(document.value)
    except ValidationError as error:
        raise DocumentError(problems_of(error, document, model)) from None


def problems_of(error: ValidationError, document: Document, model: type[BaseModel], at: Key = ()) -> list[Problem]:
    """Return each error of a validation as a problem with its line, in the order of the file.

    `at`: the path of keys to the value that was validated.
    """
    details = _details(error)
    keys = [_file_key((*at, *detail["loc"]), document) for detail in details]
    within = Counter(key[:length] for key in keys for length in range(len(key) + 1))
    mapping_wanted = {key for key, detail in zip(keys, details, strict=True) if detail["type"] in _NO_MAPPING}
    text_wanted = {key for key, detail in zip(keys, details, strict=True) if detail["type"] == "string_type"}
    problems = []
    for key, detail in zip(keys, details, strict=True):
        # Where a name or a mapping may stand, pydantic complains of both forms; only the one that was written counts.
        mapping_given = detail["type"] == "string_type" and isinstance(detail["input"], dict) and within[key] > 1
        text_given = detail["type"] in _NO_MAPPING and key in text_wanted
        if detail["type"] == "string_type" and key in mapping_wanted:
            detail["type"] = "text_or_mapping"
        if not (mapping_given or text_given):
            problems.append(document.problem(_message(detail, key, model), *key))
    return sorted(set(problems), key=lambda problem: (problem.line or 0, problem.message))


def mistakes_of(
    error: ValidationError, model: type[BaseModel], *, noun: str = "key", besides: Collection[str] = (), whole: str = ""
) -> list[str]:
    """Return each mistake of a validation in words, for values outside files.

    Args:
        noun: The word for a key.
        besides: Keys whose mistakes are left out.
        whole: The word for a value as a whole, put before a mistake that names no key.
    """
    problems = []
    for detail in _details(error):
        if detail["loc"] and detail["loc"][0] in besides:
            continue
        place = tuple(part for part in detail["loc"] if isinstance(part, int) or part.isidentifier())
        problems.append(_message(detail, place, model, noun=noun, whole=whole))
    return list(dict.fromkeys(problems))


def keys_of(error: ValidationError) -> tuple[str, ...]:
    """Return the keys a validation complains of, as people write them: `areas[0].name`."""
    return tuple(dict.fromkeys(key_text(detail["loc"]) for detail in _details(error)))


def invalid_options(error: ValidationError, model: type[BaseModel], where: str) -> InvalidOptions:
    """Return the error for options that their record refuses, with every mistake. `where` begins the message."""
    return InvalidOptions(f"{where}: {'; '.join(mistakes_of(error, model, noun='option'))}", keys_of(error))


def _details(error: ValidationError) -> list[dict[str, Any]]:
    """Return pydantic's details of a validation; a WrongValue is located where its value is."""
    details: list[dict[str, Any]] = [dict(detail) for detail in error.errors(include_url=False)]
    for detail in details:
        if isinstance(raised := detail.get("ctx", {}).get("error"), WrongValue):
            detail["loc"] = (*detail["loc"], *raised.key)
    # Where a value of a list is wrong, pydantic adds that the list is too short without it.
    return [
        detail
        for detail in details
        if detail["type"] != "too_short" or len(detail["input"]) < detail["ctx"]["min_length"]
    ]


def _file_key(loc: Key, document: Document) -> Key:
    """Return the part of pydantic's location that is in the file; the location also names branches of unions."""
    key: Key = ()
    for part in loc:
        for candidate in ((*key, part), (*key, str(part))):
            if candidate in document.lines:
                key = candidate
                break
    return key


_NO_MAPPING = ("model_type", "model_attributes_type")

_SAID = {
    "text_or_mapping": "expected a name, or keys and values",
    "string_type": "expected text",
    "invalid_key": "expected a word as key",
    "float_type": "expected a number",
    "float_parsing": "expected a number",
    "int_type": "expected a whole number",
    "int_parsing": "expected a whole number",
    "finite_number": "expected a finite number",
    "bool_parsing": "expected true or false",
    "bool_type": "expected true or false",
    "tuple_type": "expected a list",
    "list_type": "expected a list",
    "dict_type": "expected keys and values",
    "model_type": "expected keys and values",
    "model_attributes_type": "expected keys and values",
}


def _message(detail: dict[str, Any], key: Key, model: type[BaseModel], *, noun: str = "key", whole: str = "") -> str:
    kind, loc = detail["type"], detail["loc"]
    place = key_text(key)
    if kind == "extra_forbidden":
        return _misspelt(str(loc[-1]), key_text(key[:-1]), _model_at(model, loc[:-1]), noun)
    if kind == "missing":
        if isinstance(loc[-1], int):
            return f"{place}: expected more values than {_shown(detail['input'])}"
        return f'{place + ": " if place else ""}"{loc[-1]}" is missing'
    said = _SAID.get(kind, _of_length(detail) or detail["msg"].removeprefix("Value error, "))
    if kind == "value_error":
        return f"{place}: {said}" if place else said
    said = said.replace("Input should be greater", "expected a value greater")
    said = said.replace("Input should be less", "expected a value less").replace("Input should be", "expected")
    if kind == "string_type" and isinstance(detail["input"], bool | int | float | datetime.date):
        said += " (put it in quotes)"
    return f"{place or whole}: {said}, got {_shown(detail['input'])}{_other_unit(detail, key)}"


def _other_unit(detail: dict[str, Any], key: Key) -> str:
    """Return a hint at millimetres or degrees, where a number is too large in metres or radians."""
    value, limits = detail["input"], detail.get("ctx", {})
    most = max((abs(limits[name]) for name in ("le", "lt", "ge", "gt") if name in limits), default=0)
    name = next((part for part in reversed(key) if isinstance(part, str)), "")
    if not isinstance(value, int | float) or abs(value) <= most:
        return ""
    if name == "yaw" or name.endswith("_rad"):
        return f" (radians; if degrees are meant, write {math.radians(value):.4g})" if abs(value) <= 360 else ""
    lengths = ("x", "y", "footprint", "body", "polygon")
    metres = name in lengths or re.fullmatch(r"(?!.*_m_s).*_m", name)
    return (
        f" (metres; if millimetres are meant, write {value / 1000:g})" if metres and abs(value) / 1000 <= most else ""
    )


def _of_length(detail: dict[str, Any]) -> str | None:
    """Return a mistake of length in words; None for a mistake of another kind."""
    bounds = detail.get("ctx", {})
    match detail["type"]:
        case "string_too_short":
            return "expected some text"
        case "string_too_long":
            return f"expected at most {bounds['max_length']} characters"
        case "too_short":
            return f"expected at least {bounds['min_length']} values"
        case "too_long":
            return f"expected at most {bounds['max_length']} values"
    return None


def key_text(key: Key) -> str:
    """Return a path of keys as people write it: `areas[0].name`."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def _misspelt(key: str, place: str, model: type[BaseModel] | None, noun: str) -> str:
    keys = [field.alias or name for name, field in model.model_fields.items()] if model is not None else []
    near = difflib.get_close_matches(key, keys, n=1, cutoff=0.5)
    where = f" in {place}" if place else ""
    asked = f'. Did you mean "{near[0]}"?' if near else "." if keys else ""
    listed = f" Known: {', '.join(keys)}" if keys else ""
    return f'there is no {noun} "{key}"{where}{asked}{listed}'


def _model_at(model: type[BaseModel], loc: Key) -> type[BaseModel] | None:
    """Return the model whose keys are at this location."""
    current: type[BaseModel] | None = model
    for part in loc:
        if current is not None and isinstance(part, str) and part in current.model_fields:
            current = _nested(current.model_fields[part].annotation)
    return current


def _nested(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for inner in get_args(annotation):
        nested = _nested(inner)
        if nested is not None:
            return nested
    return None


def _shown(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


Kept = TypeVar("Kept", bound=Record)


MOST_IN_A_LINE = 12


def read_record(path: Path, kind: type[Kept]) -> Kept:
    """Return a record from a JSON file; FileError names everything that is wrong."""
    return record_of(path, parse_json(read_text(path), path), kind)


def record_of(path: Path, value: object, kind: type[Kept]) -> Kept:
    """Return a record made of plain data; FileError names everything that is wrong."""
    try:
        return kind.model_validate_json(json.dumps(value))
    except pydantic.ValidationError as error:
        wrong = mistakes_of(error, kind, whole="the whole file")
        more = [f"and {len(wrong) - MOST_IN_A_LINE} more"] if len(wrong) > MOST_IN_A_LINE else []
        listed = "; ".join([*wrong[:MOST_IN_A_LINE], *more])
        raise FileError(path, f"this is not a {kind.__name__.lower()}: {listed}.", code="record-invalid") from None
