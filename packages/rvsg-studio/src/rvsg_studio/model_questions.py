"""Questions to a model outside the search of a campaign: its settings, descriptions, conversations.

Keys of models come from the environment alone.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any, Literal

from markupsafe import Markup
from pydantic import BaseModel, ValidationError

import rvsg
from rvsg.app.campaign import Campaign
from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.generation.environment import description_of
from rvsg.generation.vlm.call_log import PICTURES, CallLog
from rvsg.report.conversations import Transcript, conversation_markup
from rvsg.world.areas import unknown_areas
from rvsg.world.world import Description, World
from rvsg.world.world_folder import shipped_worlds
from rvsg_studio.workspace import Job, Workspace


class AskedModel(BaseModel, frozen=True):
    """A model, the server it is asked at where that is not its provider's, and what its calls may cost."""

    model: str = ""
    base_url: str = ""
    budget_usd: float | None = None

    @property
    def arguments(self) -> dict[str, Any]:
        """What a job has to know; InputError where no model is named."""
        if not self.model.strip():
            raise InputError("Name a model first: PROVIDER:NAME, for example openai-chat:gpt-4.1.")
        values = {"model": self.model.strip(), "base_url": self.base_url.strip() or None, "budget_usd": self.budget_usd}
        return {key: value for key, value in values.items() if value is not None}

    @property
    def options(self) -> str:
        """The same as options of a command line."""
        address = f" --base-url {self.base_url.strip()}" if self.base_url.strip() else ""
        budget = f" --budget-usd {self.budget_usd:g}" if self.budget_usd is not None else ""
        return f"--model {self.model.strip() or 'PROVIDER:NAME'}{address}{budget}"


def asked_model(workspace: Workspace) -> AskedModel:
    """Return the model that was named last."""
    path = workspace.own / "model.json"
    return AskedModel.model_validate_json(path.read_text(encoding="utf-8")) if path.is_file() else AskedModel()


def keep_model(workspace: Workspace, **values: Any) -> AskedModel:
    """Change what is kept of the model; InputError where a value is none."""
    try:
        asked = AskedModel.model_validate(asked_model(workspace).model_dump() | values)
    except ValidationError as error:
        raise InputError(f"The model cannot be kept: {error.errors()[0]['msg']}.") from None
    write_whole(workspace.own / "model.json", asked.model_dump_json())
    return asked


PARTS = {"layout": "Layout", "grid": "Grid"}


class Texts(BaseModel, frozen=True):
    """The two texts of a description."""

    layout: str = ""
    grid: str = ""

    @property
    def whole(self) -> bool:
        """Whether both are written."""
        return bool(self.layout.strip() and self.grid.strip())


class ReviewDraft(BaseModel, frozen=True):
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
    saved: Texts | None = None
    """What was stored last from here; where nothing was typed since, what is stored now is shown."""


class Review:
    """The review of one world; every change of it is on the disk before it returns."""

    def __init__(self, workspace: Workspace, name: str) -> None:
        self.workspace, self.name = workspace, name
        self.world = rvsg.load_world(name if name in shipped_worlds() else workspace.existing(name))
        self.stored = description_of(self.world)
        self._path = workspace.own_file("reviews", name)
        self.target = f"description of {name}"
        self.draft = self._read()

    def _read(self) -> ReviewDraft:
        description = self.stored
        texts = Texts(layout=description.layout, grid=description.grid) if description else Texts()
        if not self._path.is_file():
            return ReviewDraft(texts=texts)
        draft = ReviewDraft.model_validate_json(self._path.read_text(encoding="utf-8"))
        return draft.model_copy(update={"texts": texts}) if draft.texts == draft.saved else draft

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
        self.change(job=job, saved=self.draft.texts)

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
        start_data = start.model_dump() if start is not None else None
        return {"world": self.name, "start": start_data, "reasons": list(reasons)}

    def take(self, job: Job) -> bool:
        """Take in what a finished job wrote; whether it was new."""
        if job.state != "finished" or job.id <= self.draft.job:
            return False
        written = Texts(layout=job.result["layout"], grid=job.result["grid"])
        self.change(texts=written, proposed=written, job=job.id, reason="")
        return True

    @property
    def job(self) -> Job | None:
        """The newest job of this review."""
        return self.workspace.jobs.of(self.target)

    @property
    def place(self) -> Path | None:
        """Where the description is stored; None for a shipped world, which keeps it in the data folder."""
        return None if self.name in shipped_worlds() else self.workspace.existing(self.name)

    def accept(self, description: Description) -> None:
        """Remember what was stored, and end the review."""
        self.stored = description
        self.forget()
        self.change(proposed=self.draft.texts)


def named_in(text: str, world: World) -> list[tuple[str, Literal["text", "known", "unknown"]]]:
    """Return a text in pieces: names of areas of the world, what looks like one and is none, and the rest."""
    areas = [area.name for area in world.areas]
    unknown = [name for name in unknown_areas(text, areas) if name.strip()]
    kinds: dict[str, Literal["known", "unknown"]] = {name.casefold(): "unknown" for name in unknown}
    kinds |= {name.casefold(): "known" for name in areas}
    if not kinds:
        return [(text, "text")]
    longest = sorted(kinds, key=len, reverse=True)
    pattern = re.compile(r"(?<!\w)(" + "|".join(re.escape(name) for name in longest) + r")(?!\w)", re.IGNORECASE)
    pieces: list[tuple[str, Literal["text", "known", "unknown"]]] = []
    for place, piece in enumerate(pattern.split(text)):
        if piece:
            pieces.append((piece, "text" if place % 2 == 0 else kinds.get(piece.casefold(), "unknown")))
    return pieces


def difference(before: str, after: str) -> list[tuple[Literal["same", "removed", "added"], str]]:
    """Return what changed between two texts, word by word: pieces that are the same, removed or added."""
    old, new = (re.findall(r"\S+\s*", text) for text in (before, after))
    matcher = SequenceMatcher(None, [w.strip() for w in old], [w.strip() for w in new], autojunk=False)
    pieces: list[tuple[Literal["same", "removed", "added"], str]] = []
    for kind, i1, i2, j1, j2 in matcher.get_opcodes():
        if kind == "equal":
            pieces.append(("same", "".join(new[j1:j2])))
        else:
            pieces += [("removed", "".join(old[i1:i2]))] if i2 > i1 else []
            pieces += [("added", "".join(new[j1:j2]))] if j2 > j1 else []
    return pieces


LONGEST_DIGEST = 128
MOST_CHARACTERS = 5_000_000
"""Characters of a conversation that a page of the studio holds."""


def conversation_of(campaign: Campaign, picture: Callable[[str], str], finding: Callable[[int], str]) -> Markup:
    """Return how each configuration of the search came to be, as the report shows it.

    Args:
        picture: returns the address of a picture by its digest.
        finding: returns the address of the page of an attempt.
    """
    log = campaign.recording

    def address(digest: str) -> str:
        return picture(digest) if log is not None and _picture(log, digest).is_file() else ""

    transcript = Transcript(log, picture=address, most=MOST_CHARACTERS)
    attempts, unit = campaign.attempts(), campaign.requirement.unit
    return conversation_markup(attempts, unit, campaign.shown_world, transcript, finding=finding)


def picture_of_call(campaign: Campaign, digest: str) -> bytes:
    """Return a picture that a model was shown, as PNG.

    Raises:
        InputError: there is none of that digest.
    """
    log = campaign.recording
    path = _picture(log, digest) if log is not None and digest.isalnum() else None
    if path is not None and len(digest) <= LONGEST_DIGEST and path.is_file():
        return path.read_bytes()
    raise InputError("This picture is not kept in the record of the campaign.")


def _picture(log: CallLog, digest: str) -> Path:
    return log.folder / PICTURES / f"{digest}.png"
