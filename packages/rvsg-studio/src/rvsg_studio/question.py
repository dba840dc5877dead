"""What a request may hold, whatever it is about: read and checked in one place, before any answer sees it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from rvsg.core.documents import mistakes_of
from rvsg.core.errors import InputError
from rvsg.core.inputs import parse_json
from rvsg.core.records import Record


class Question(Record):
    """The parts of a question or a change; each answer reads some, and refuses where one is missing."""

    campaign: str | None = None
    name: str | None = None
    attempt: int | None = None
    alone: bool = False
    run: str = ""
    t: float | None = None
    """Seconds of a run."""
    digest: str = ""
    file: str | None = None
    world: str | None = None
    route: str | None = None
    drive: bool = False
    robot: str = ""
    stack: str = ""
    change: dict[str, Any] | None = None
    together: str = ""
    scenario: str | dict[str, Any] = ""
    """The file of a scenario, or a scenario."""
    requirement: str = ""
    seeds: int | None = None
    as_is: bool = False
    stops: tuple[str, ...] | None = None
    save_as: str = ""
    add_to: str = ""
    title: str = ""
    suite: str | None = None
    case: str | None = None
    first: str = ""
    second: str = ""
    folder: str = ""
    job: str = ""
    page: str = ""
    fields: dict[str, Any] = Field(default_factory=dict)
    asked: dict[str, Any] = Field(default_factory=dict)
    photographs: str = ""
    area: str = ""


def question_of(sent: bytes | dict[str, str]) -> Question:
    """Return the question that a request asks by JSON or by its address; InputError where it is none."""
    value = sent if isinstance(sent, dict) else parse_json(sent.decode(errors="replace"), Path("request"))
    if not isinstance(value, dict):
        raise InputError("The request is no object.")
    try:
        return Question(**value)
    except ValidationError as error:
        raise InputError(f"The request: {'; '.join(mistakes_of(error, Question))}.") from None


def text_of(question: Question, key: str) -> str:
    """Return a text of a question; InputError where it is missing."""
    value = getattr(question, key)
    if not isinstance(value, str) or not value:
        raise InputError(f"The request has no {key!r}.")
    return value


def number_of(question: Question, key: Literal["attempt", "seeds"]) -> int:
    """Return a whole number of a question; InputError where it is missing."""
    value: int | None = getattr(question, key)
    if value is None:
        raise InputError(f"The request has no whole number {key!r}.")
    return value
