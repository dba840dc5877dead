"""Requirements on the robot, and their files. A new one on an existing metric needs no code.

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

import re
from collections.abc import Callable
from enum import Enum
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from rvsg.core.documents import DocumentError, Problem, problems_of, read_yaml
from rvsg.core.errors import FileError, InputError, Unfit, UnknownName
from rvsg.core.inputs import exists
from rvsg.core.records import Record


class Aim(str, Enum):
    """What a generator aims at. Each metric declares its aim; the value is the wording that generators use."""

    SHARE = "work close to the robot all along its way"
    MEET = "meet the robot closely where it has to pass"
    DISTURB = "come up in front of the robot again and again"
    DELAY = "walk and stand in the robot's lane, before it or towards it"
    NONE = "do the place's work wherever it is"


class Requirement(Record):
    """A requirement on the robot.

    Exactly one of `metric` and `formula` is given. Without a limit scenarios are ranked, but no run fails.
    """

    name: Annotated[str, Field(min_length=1)]
    title: str
    text: str
    """What the generator and the report read."""
    metric: str | None = None
    """Id of the metric that is the objective."""
    formula: str | None = None
    """Signal temporal logic; its robustness is the objective, smaller is worse, violated below 0."""
    worse: Literal["smaller", "larger"] = "smaller"
    """The direction in which the objective gets worse."""
    limit: float | None = None
    """The requirement is violated where the objective is beyond it, in the `worse` direction."""
    limit_share: Annotated[float, Field(gt=0)] | None = None
    """The limit as a share of the route's time limit; `for_time_limit` works it out."""
    unit: str = ""
    measured_as: str = ""
    """How the objective is measured, in plain words."""
    note: str = ""
    """What people should know about it; no model reads it."""
    source: str = ""

    @model_validator(mode="after")
    def _one_measure(self) -> Self:
        if (self.metric is None) == (self.formula is None):
            raise ValueError("give exactly one of metric and formula")
        if self.formula is not None and self.worse != "smaller":
            raise ValueError("a formula's robustness is worse when smaller")
        if self.limit is not None and self.limit_share is not None:
            raise ValueError("give limit or limit_share, not both")
        return self

    def for_time_limit(self, time_limit_s: float) -> Requirement:
        """Return the requirement with the limit that holds on a route with this time limit."""
        if self.limit_share is None:
            return self
        return self.model_copy(update={"limit": self.limit_share * time_limit_s, "limit_share": None})

    @property
    def threshold(self) -> float | None:
        """The limit; 0 for a formula."""
        return 0.0 if self.formula is not None and self.limit is None else self.limit

    def violated_by(self, objective: float) -> bool:
        """Return whether an objective violates the requirement; False without a limit."""
        limit = self.threshold
        if limit is None:
            return False
        return objective < limit if self.worse == "smaller" else objective > limit

    def worst(self, a: float, b: float) -> float:
        """Return the worse of two objectives."""
        return min(a, b) if self.worse == "smaller" else max(a, b)

    def badness(self, objective: float) -> float:
        """Return the objective with its sign turned so that larger is worse."""
        return -objective if self.worse == "smaller" else objective


Check = Callable[[Requirement], Requirement]
_FIELDS = sorted(set(Requirement.model_fields) - {"name"})


@cache
def _shipped() -> dict[str, Requirement]:
    with resources.as_file(resources.files("rvsg.scenario") / "requirements.yaml") as path:
        return load_requirements(path)


def shipped_requirements() -> dict[str, Requirement]:
    """Return the requirements that ship with RVSG by name, in the order of the list."""
    return dict(_shipped())


def load_requirement(name_or_path: str | Path, *, check: Check | None = None) -> Requirement:
    """Load a shipped requirement by its name, or one of a file as `file.yaml` or `file.yaml#name`.

    `file.yaml` alone must hold exactly one. A mistake blocks the requirement that has it and no other of its file.

    Args:
        check: Completes a requirement of a file, and raises InputError if it cannot be measured.

    Raises:
        UnknownName: There is no such requirement.
        FileError: The requirement cannot be used; it names every mistake with its line.
    """
    text = str(name_or_path)
    if text in _shipped():
        return _shipped()[text]
    file, wanted = _file_and_name(text)
    if not (file.endswith((".yaml", ".yml")) or exists(Path(file))):
        raise UnknownName("requirement", text, _shipped(), hint="Or give a file: my.yaml or my.yaml#name.")
    requirements, wrong = _read(Path(file), check)
    names = [*requirements, *wrong]
    if wanted and wanted not in names:
        raise UnknownName("requirement", wanted, names, hint=f"File: {file}.")
    if not wanted and len(names) > 1:
        raise FileError(file, f"holds {len(names)} requirements; say which: {file}#{names[0]}")
    asked = wanted or names[0]
    if asked in wrong:
        raise DocumentError(wrong[asked])
    return requirements[asked]


def _file_and_name(text: str) -> tuple[str, str]:
    """Return the file and the name in `file.yaml:name` (or `#name`); an empty name where none is given."""
    parts = re.fullmatch(r"(.*\.yaml)[:#](.*?)|(.*\.yml)[:#](.*?)", text, re.DOTALL)
    file, wanted = (part for part in parts.groups() if part is not None) if parts else (text, "")
    return file, wanted


def load_requirements(path: Path) -> dict[str, Requirement]:
    """Load all requirements of a file by name; a FileError names every mistake with its line."""
    requirements, wrong = _read(path, None)
    if wrong:
        raise DocumentError([problem for problems in wrong.values() for problem in problems])
    return requirements


def _read(path: Path, check: Check | None) -> tuple[dict[str, Requirement], dict[str, list[Problem]]]:
    """Return the requirements of a file, and the mistakes in others, by name."""
    document = read_yaml(path)
    if not isinstance(document.value, dict) or not document.value:
        raise FileError(path, 'expected a mapping from names to requirements, e.g. "R1: {title: ..., metric: dto}"')
    requirements: dict[str, Requirement] = {}
    wrong: dict[str, list[Problem]] = {}
    for key, fields in document.value.items():
        name = str(key)
        mistakes: list[Problem] = []
        wrong[name] = mistakes
        if not isinstance(fields, dict):
            mistakes.append(document.problem(f"{name}: expected a mapping with the keys {', '.join(_FIELDS)}", name))
            continue
        if "name" in fields:
            message = f"{name}: the name is the key above; leave out `name`"
            mistakes.append(document.problem(message, name, "name"))
            continue
        if "metric" in fields and not {"worse", "formula"} & fields.keys():  # a guess could turn the verdict round
            message = f"{name}.worse: is missing; say which values of the metric are worse: smaller or larger"
            mistakes.append(document.problem(message, name, "worse"))
        try:
            read = Requirement.model_validate({"name": name, **fields})
            read = check(read) if check is not None else read
        except Unfit as error:
            mistakes.append(document.problem(f"{name}.{error.key}: {error}", name, error.key))
        except InputError as error:
            measured = "formula" if "formula" in fields else "metric"
            mistakes.append(document.problem(f"{name}.{measured}: {error}", name, measured))
        except ValidationError as error:
            mistakes += problems_of(error, document, Requirement, (name,))
        if not mistakes:
            requirements[name] = read
            del wrong[name]
    return requirements, wrong
