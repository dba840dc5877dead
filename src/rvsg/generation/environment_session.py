"""Descriptions of worlds and names of their areas, by a vision language model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rvsg.core.errors import InputError
from rvsg.generation.environment import (
    AreaNames,
    EnvironmentDialogue,
    description_of,
    propose_area_names,
    store_description,
)
from rvsg.generation.prompts import Prompts
from rvsg.generation.vlm.access import ModelAccess, model_access
from rvsg.generation.vlm.model import Access
from rvsg.world.world import Description, World
from rvsg.world.world_folder import shipped_worlds


def reach(model: str | None, record: Path | None, **access: Any) -> ModelAccess:
    """Return a model ready to be asked; InputError if neither a model nor a replay is named."""
    given = {key: value for key, value in access.items() if value is not None}
    return model_access(model, Access.of(given, record=record))


def answered_from_record(model: ModelAccess) -> str | None:
    """Return that answers were taken from the record of an earlier session; None if none was."""
    known, recording = model.from_record, model.recording
    if model.replaying or recording is None or not known:
        return None
    calls = "1 call was" if known == 1 else f"{known} calls were"
    return f"{calls} answered at no cost from {recording.folder}; to ask again, give another --record."


@dataclass(frozen=True)
class EnvironmentSession:
    """A dialogue about a world with a model."""

    dialogue: EnvironmentDialogue
    model: ModelAccess

    def notes(self) -> list[str]:
        """Return what came from the record of an earlier session, and where a replay differs from its record."""
        earlier = answered_from_record(self.model)
        return [*([earlier] if earlier else []), *self.model.notes()]


def open_session(
    world: World, model: str | None, record: Path | None, prompts: Path | None, **access: Any
) -> EnvironmentSession | None:
    """Return a session with a model, or None if neither a model nor a replay is named; calls are recorded."""
    replay = access.get("replay")
    if model is None and replay is None:
        return None
    kept = record or (None if replay else Path("runs") / f"describe-{world.name}")
    reached = reach(model, kept, **access)
    return EnvironmentSession(EnvironmentDialogue(world, reached, Prompts(prompts)), reached)


def stored(world: World, command: str) -> Description:
    """Return the stored description of a world; InputError without one names the `command` that writes it."""
    description = description_of(world)
    if description is None:
        raise InputError(f"{world.name} has no description yet. Let a model write it: {command}", code="no-description")
    return description


def store(world: World, description: Description, *, out: Path | None, name: str) -> Path:
    """Store a description in `out`, in the world's folder, or for a shipped world in your data; return where."""
    place = out if out is not None else None if name in shipped_worlds() else Path(name)
    return store_description(world, description, place)


def revised(session: EnvironmentSession, start: Description | None, reasons: Sequence[str]) -> Description:
    """Return a description corrected for the reasons of a person, of which only the last costs a call.

    `start` is the description that the first reason is about; None lets the model write one first.
    """
    dialogue = session.dialogue
    if start is None:
        made = dialogue.describe()
    else:
        dialogue.begin_with(start)
        made = start
    for reason in reasons:
        made = dialogue.revise(reason)
    return made


def propose_names(
    world: World, model: str | None, record: Path | None = None, prompts: Path | None = None, **access: Any
) -> AreaNames:
    """Ask a vision language model for better names of the areas of a world; calls are recorded."""
    kept = record or (None if access.get("replay") else Path("runs") / f"names-{world.name}")
    return propose_area_names(world, reach(model, kept, **access).model, Prompts(prompts))
