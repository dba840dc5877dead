"""Describe a world in words, by a vision language model: what `rvsg describe` does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rvsg.api.models import answered_from_record, reach
from rvsg.api.words import describe_calls
from rvsg.core.errors import InputError
from rvsg.generation.environment import EnvironmentDialogue, description_of, store_description
from rvsg.generation.prompts import Prompts
from rvsg.generation.wiring import Wiring
from rvsg.world.io.load import shipped_worlds
from rvsg.world.world import Description, World


@dataclass(frozen=True)
class EnvironmentSession:
    """A dialogue about a world with a model."""

    dialogue: EnvironmentDialogue
    wiring: Wiring

    def notes(self) -> list[str]:
        """Return what the calls cost, what came from the record, and where a replay differs from its record."""
        earlier = answered_from_record(self.wiring)
        return [describe_calls(self.dialogue.calls), *([earlier] if earlier else []), *self.wiring.notes()]


def open_session(
    world: World, model: str | None, record: Path | None, prompts: Path | None, **access: Any
) -> EnvironmentSession | None:
    """Return a session with a model, or None where neither a model nor a replay is named.

    Calls are recorded, by default in `runs/describe-WORLD`, so that the same call resumes without paying twice.
    """
    replay = access.get("replay")
    if model is None and replay is None:
        return None
    kept = record or (None if replay else Path("runs") / f"describe-{world.name}")
    wiring = reach(model, kept, **access)
    return EnvironmentSession(EnvironmentDialogue(world, wiring.model, Prompts(prompts)), wiring)


def stored(world: World, command: str) -> Description:
    """Return the stored description of a world.

    Raises:
        InputError: there is none; `command` has a model write it.
    """
    description = description_of(world)
    if description is None:
        raise InputError(f"{world.name} has no description yet. Let a model write it: {command}")
    return description


def store(world: World, description: Description, *, out: Path | None, name: str) -> Path:
    """Store a description and return where: in `out`, in the world's folder, or for a shipped world in your data.

    Args:
        name: The world as the user named it.
    """
    place = out if out is not None else None if name in shipped_worlds() else Path(name)
    return store_description(world, description, place)
