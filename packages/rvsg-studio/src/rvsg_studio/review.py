"""The review of a description: what is typed, what a model revised for which reasons, kept until it is accepted."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from pydantic import BaseModel

import rvsg
from rvsg.core.files import write_whole
from rvsg.generation.environment import description_of
from rvsg.world.world import Description
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.jobs import Job
from rvsg_studio.workspace import Workspace

PARTS = {"layout": "Layout", "grid": "Grid"}


class Texts(BaseModel, frozen=True):
    """The two texts of a description."""

    layout: str = ""
    grid: str = ""

    @property
    def whole(self) -> bool:
        """Whether both are written."""
        return bool(self.layout.strip() and self.grid.strip())


class Draft(BaseModel, frozen=True):
    """A review as it stands."""

    texts: Texts = Texts()
    """As they are typed."""
    before: Texts | None = None
    """What a revision started from; the difference is shown against it."""
    reason: str = ""
    """As it is typed."""
    start: Texts | None = None
    """What the first reason was about; None where a model wrote the text in the same conversation."""
    reasons: tuple[str, ...] = ()
    """Given to the model so far."""
    proposed: Texts | None = None
    """What the model wrote last."""
    job: str = ""
    """The newest job whose result is taken in."""
    kept: Texts | None = None
    """What was stored last from here; where nothing was typed since, what is stored now is shown."""


class Review:
    """The review of one world; every change of it is on the disk before it returns."""

    def __init__(self, workspace: Workspace, name: str) -> None:
        self.workspace, self.name = workspace, name
        self.world = rvsg.load_world(name if name in shipped_worlds() else workspace.existing(name))
        self.stored = description_of(self.world)
        place = hashlib.sha256(name.encode()).hexdigest()[:16]
        self._path = workspace.own / "reviews" / f"{place}.json"
        self.target = f"description of {name}"
        self.draft = self._read()

    def _read(self) -> Draft:
        found = self.stored
        texts = Texts(layout=found.layout, grid=found.grid) if found else Texts()
        if not self._path.is_file():
            return Draft(texts=texts)
        draft = Draft.model_validate_json(self._path.read_text(encoding="utf-8"))
        return draft.model_copy(update={"texts": texts}) if draft.texts == draft.kept else draft

    def change(self, **values: Any) -> None:
        """Change something of the draft."""
        self.draft = self.draft.model_copy(update=values)
        self._path.parent.mkdir(exist_ok=True)
        write_whole(self._path, self.draft.model_dump_json())

    def type(self, part: str, text: str) -> None:
        """Take what is typed in one of the two texts."""
        self.change(texts=self.draft.texts.model_copy(update={part: text}))

    def forget(self) -> None:
        """Begin anew with what is stored."""
        job = self.draft.job
        self._path.unlink(missing_ok=True)
        self.draft = self._read()
        self.change(job=job, kept=self.draft.texts)

    def begin(self, reason: str) -> dict[str, Any]:
        """Return what a job has to know that gives a reason to the model, or has it write a first text."""
        texts, reasons, start = self.draft.texts, self.draft.reasons, self.draft.start
        if not reason:
            start, reasons = None, ()
        elif texts == self.draft.proposed:
            reasons = (*reasons, reason)
        else:  # a person wrote what is rejected: the conversation begins with it
            start, reasons = texts, (reason,)
        self.change(before=texts, start=start, reasons=reasons)
        return {
            "world": self.name,
            "start": start.model_dump() if start is not None else None,
            "reasons": list(reasons),
        }

    def take(self, job: Job) -> bool:
        """Take in what a finished job wrote; whether it was new."""
        if job.state != "finished" or job.id <= self.draft.job:
            return False
        made = Texts(layout=job.result["layout"], grid=job.result["grid"])
        self.change(texts=made, proposed=made, job=job.id, reason="")
        return True

    @property
    def job(self) -> Job | None:
        """The newest job of this review."""
        return self.workspace.jobs.of(self.target)

    @property
    def place(self) -> Path | None:
        """Where the description is stored; None for a shipped world, which keeps it in the data folder."""
        return None if self.name in shipped_worlds() else self.workspace.existing(self.name)

    def accept(self, made: Description) -> None:
        """Remember what was stored, and end the review."""
        self.stored = made
        self.forget()
        self.change(proposed=self.draft.texts)
