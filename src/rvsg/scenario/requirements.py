"""Requirements as data: the shipped ones and those of a user's file. A new one on an existing metric needs no code.

A file maps names to requirements::

    wide_berth:
      title: Wide berth
      text: The robot stays at least 0.5 m away from every person.
      metric: min_distance        # or formula: always (distance_to_person > 0.5)
      worse: smaller
      limit: 0.5
      unit: m                     # that of the metric; may be left out
      source: our risk assessment
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import resources
from pathlib import Path

from pydantic import ValidationError

from rvsg.core.documents import Document, DocumentError, Problem, read_yaml
from rvsg.core.errors import FileError, InputError, Unfit, UnknownName
from rvsg.scenario.requirement import Requirement

Check = Callable[[Requirement], Requirement]
_FIELDS = sorted(set(Requirement.model_fields) - {"name"})


@cache
def _shipped() -> dict[str, Requirement]:
    with resources.as_file(resources.files("rvsg.scenario") / "requirements.yaml") as path:
        return load_requirements(path)


def shipped_requirements() -> dict[str, Requirement]:
    """The requirements that come with RVSG by name, in the order they are listed."""
    return dict(_shipped())


def load_requirement(name_or_path: str | Path, *, check: Check | None = None) -> Requirement:
    """A shipped requirement by its name, or one of a user's file as `file.yaml` or `file.yaml#name`.

    `file.yaml` alone must hold exactly one. Raises UnknownName, or FileError with the line of every mistake; `check`
    completes every requirement of a user's file, what InputError it raises is such a mistake.
    """
    text = str(name_or_path)
    if text in _shipped():
        return _shipped()[text]
    file, wanted = _file_and_name(text)
    if not (file.endswith((".yaml", ".yml")) or Path(file).exists()):
        raise UnknownName("requirement", text, _shipped(), hint="Or give a file: my.yaml or my.yaml#name.")
    found = load_requirements(Path(file), check=check)
    if wanted:
        if wanted not in found:
            raise UnknownName("requirement", wanted, found, hint=f"File: {file}.")
        return found[wanted]
    if len(found) > 1:
        raise FileError(file, f"holds {len(found)} requirements; say which: {file}#{next(iter(found))}")
    return next(iter(found.values()))


def _file_and_name(text: str) -> tuple[str, str]:
    """The file and the name in `file.yaml:name` (or `#name`); no name where none is given."""
    for ending in (".yaml", ".yml"):
        for mark in ":#":
            file, found, wanted = text.rpartition(f"{ending}{mark}")
            if found:
                return f"{file}{ending}", wanted
    return text, ""


def load_requirements(path: Path, *, check: Check | None = None) -> dict[str, Requirement]:
    """All requirements of a file by name; a FileError lists every mistake with its line."""
    document = read_yaml(path)
    if not isinstance(document.value, dict) or not document.value:
        raise FileError(path, 'expected a mapping from names to requirements, e.g. "R1: {title: ..., metric: dto}"')
    found: dict[str, Requirement] = {}
    mistakes: list[Problem] = []
    for name, fields in document.value.items():
        if not isinstance(fields, dict):
            message = f"{name}: expected a mapping with the keys {', '.join(_FIELDS)}"
            mistakes.append(document.problem(message, str(name)))
            continue
        if "name" in fields:
            message = f"{name}: the name is the key above; leave out `name`"
            mistakes.append(document.problem(message, str(name), "name"))
            continue
        if "metric" in fields and not {"worse", "formula"} & fields.keys():  # a guess could turn the verdict round
            message = f"{name}.worse: is missing; say which values of the metric are worse: smaller or larger"
            mistakes.append(document.problem(message, str(name)))
        try:
            read = Requirement.model_validate({"name": str(name), **fields})
            found[str(name)] = check(read) if check is not None else read
        except Unfit as error:
            mistakes.append(document.problem(f"{name}.{error.key}: {error}", str(name), error.key))
        except InputError as error:
            measured = "formula" if "formula" in fields else "metric"
            mistakes.append(document.problem(f"{name}.{measured}: {error}", str(name), measured))
        except ValidationError as error:
            mistakes += [_mistake(document, str(name), detail["loc"], detail) for detail in error.errors()]
    if mistakes:
        raise DocumentError(sorted(mistakes, key=lambda mistake: mistake.line or 0))
    return found


def _mistake(document: Document, name: str, loc: tuple[int | str, ...], detail: object) -> Problem:
    assert isinstance(detail, dict)
    where = ".".join([name, *(str(part) for part in loc)])
    if detail["type"] == "extra_forbidden":
        said = f"{where}: there is no such key; known: {', '.join(_FIELDS)}"
    elif detail["type"] == "missing":
        said = f"{where}: is missing"
    else:
        said = f"{where}: {detail['msg'].removeprefix('Value error, ')}"
        if loc:
            said += f", got {detail['input']!r}"
    return document.problem(said, name, *loc)
