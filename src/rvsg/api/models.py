"""Reach a model outside a campaign."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Literal

from rvsg.generation.vlm.access import Access, Wiring, wired
from rvsg.world.authoring.named_areas import unknown_areas
from rvsg.world.world import World


def reach(model: str | None, record: Path | None, **access: Any) -> Wiring:
    """Return a model ready to be asked; InputError if neither a model nor a replay is named."""
    given = {key: value for key, value in access.items() if value is not None}
    return wired(model, Access.of(given, record=record))


def named_in(text: str, world: World) -> list[tuple[str, Literal["text", "known", "unknown"]]]:
    """Return a text in pieces: names of areas of the world, what looks like one and is none, and the rest."""
    known = [area.name for area in world.areas]
    unknown = [name for name in unknown_areas(text, known) if name.strip()]
    kinds = {name.casefold(): "unknown" for name in unknown} | {name.casefold(): "known" for name in known}
    if not kinds:
        return [(text, "text")]
    longest = sorted(kinds, key=len, reverse=True)
    pattern = re.compile(r"(?<!\w)(" + "|".join(re.escape(name) for name in longest) + r")(?!\w)", re.IGNORECASE)
    pieces: list[tuple[str, Literal["text", "known", "unknown"]]] = []
    for place, piece in enumerate(pattern.split(text)):
        if piece:
            is_known = kinds.get(piece.casefold()) == "known"
            pieces.append((piece, "text" if place % 2 == 0 else "known" if is_known else "unknown"))
    return pieces


def answered_from_record(wiring: Wiring) -> str | None:
    """Return that answers were taken from the record of an earlier session; None if none was."""
    known, recording = wiring.model.from_record, wiring.recording
    if wiring.replaying or recording is None or not known:
        return None
    calls = "1 call was" if known == 1 else f"{known} calls were"
    return f"{calls} answered at no cost from {recording.folder}; to ask again, give another --record."
