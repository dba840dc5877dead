"""The journal of the loop: one line of JSON for each thing done, and the same in words for a person.

The journal is the whole state: a stopped loop reads it and resumes with the next step.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from rvsg.campaign.suite import State
from rvsg.campaign.watch.parts import Symptom
from rvsg.core.errors import FileError
from rvsg.core.records import Record

QUIET = (State.PASSED.value, State.KNOWN_FAILURE.value)
"""States that were expected; the log counts their cases and names the others."""
Part = Literal["loop", "monitor", "analyse", "plan", "legitimate", "execute", "knowledge"]


class Note(Record):
    """One thing that the loop did."""

    time: str
    """UTC, ISO 8601."""
    cycle: int
    part: Part
    text: str
    seen: tuple[str, ...] = ()
    """Sources whose cycle is complete."""
    symptom: Symptom | None = None
    """A symptom that has been acted on."""
    plan: str | None = None
    """The id of a plan or a change of the suite that was decided on or done."""
    outcome: str = ""
    runs: int = 0
    """Runs that it took."""
    results: tuple[tuple[str, str], ...] = ()
    """Of a case of the suite: its name with each requirement, and the state."""


class Journal:
    """A file of notes, and the state that follows from them."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.words = path.with_suffix(".log")
        self.notes = list(_read(path)) if path.exists() else []

    @property
    def seen(self) -> frozenset[str]:
        """Sources that were watched in a complete cycle."""
        return frozenset(source for note in self.notes for source in note.seen)

    @property
    def handled(self) -> frozenset[str]:
        """Ids of the symptoms that were acted on."""
        return frozenset(note.symptom.id for note in self.notes if note.symptom is not None and note.part == "plan")

    @property
    def settled(self) -> frozenset[str]:
        """Ids of the plans that were refused or run, and of the changes that were refused or written."""
        done = [note for note in self.notes if note.part == "execute" or note.outcome in ("refused", "written")]
        return frozenset(note.plan for note in done if note.plan is not None)

    @property
    def decided(self) -> dict[str, str]:
        """The last decision on each plan, by its id."""
        return {n.plan: n.outcome for n in self.notes if n.part == "legitimate" and n.plan is not None}

    @property
    def spent(self) -> int:
        """Runs of all plans."""
        return sum(note.runs for note in self.notes)

    @property
    def cycle(self) -> int:
        """Cycles that are complete."""
        return sum(note.part == "loop" and note.outcome == "complete" for note in self.notes)

    def version_in_words(self) -> str:
        """Return what the cases say of the version that was acted on last; empty if that is said already."""
        version, results = "", dict[str, str]()
        for note in self.notes:
            if note.symptom is not None and note.symptom.kind == "new version":
                version, results = note.symptom.version, {}
            elif note.outcome == "version":
                results = {}
            results |= dict(note.results)
        told = []
        for state in dict.fromkeys(results.values()):
            names = [name for name, each in results.items() if each == state]
            told.append(f"{len(names)} {state}" + ("" if state in QUIET else f" ({', '.join(names)})"))
        return f"the suite on {version}: {', '.join(told)}" if told else ""

    def add(self, note: Note) -> None:
        """Append a note to both files; each line is flushed before the next thing is done."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(note.model_dump(mode="json"), ensure_ascii=False) + "\n")
        with self.words.open("a", encoding="utf-8") as file:
            file.write(in_words(note) + "\n")
        self.notes.append(note)


def in_words(note: Note) -> str:
    """Return a note as a line of the log."""
    return f"{note.time[:19].replace('T', ' ')}  cycle {note.cycle:<3} {note.part:10}  {note.text}"


def _read(path: Path) -> list[Note]:
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    notes = []
    for number, line in enumerate(lines, 1):
        try:
            notes.append(Note.from_json(line))
        except ValidationError:
            if number == len(lines) and not line.endswith("\n"):
                path.write_text("".join(lines[:-1]), encoding="utf-8")  # the process was killed while it wrote this
                break
            raise FileError(
                path, "this line is no note of a watch. Move the folder away to start again.", line=number
            ) from None
    return notes
