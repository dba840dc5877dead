"""Notes on the findings of a campaign: a status and a comment, in `notes.yaml` beside its ledger."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import Field

from rvsg.core.documents import read_document
from rvsg.core.files import write_whole
from rvsg.core.records import Record

FILE = "notes.yaml"
HEAD = "# Notes on findings, by the id of their scenario. status: new, known, accepted or fixed.\n"
State = Literal["new", "known", "accepted", "fixed"]
STATES: tuple[State, ...] = ("new", "known", "accepted", "fixed")
_writing = threading.Lock()


class Note(Record):
    """What people say of a finding."""

    status: State = "new"
    comment: Annotated[str, Field(max_length=20_000)] = ""


class Notes(Record):
    """The notes of a campaign, by the id of the scenario they are on."""

    findings: dict[str, Note] = Field(default_factory=dict)


def notes_of(folder: Path) -> Notes:
    """Return the notes beside a campaign; none if there is no such file.

    Raises:
        FileError: the file cannot be used; names the line.
    """
    path = folder / FILE
    return read_document(path, Notes)[0] if path.is_file() else Notes()


def note(folder: Path, scenario_id: str, *, status: State | None = None, comment: str | None = None) -> Note:
    """Change the note on a finding, keep the others, and return it; the file is whole at any moment."""
    with _writing:
        kept = notes_of(folder)
        before = kept.findings.get(scenario_id, Note())
        changes = {"status": status, "comment": comment}
        made = before.replace(**{key: value for key, value in changes.items() if value is not None})
        values = kept.replace(findings={**kept.findings, scenario_id: made}).model_dump(mode="json")
        text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=100)
        write_whole(folder / FILE, HEAD + text)
    return made
