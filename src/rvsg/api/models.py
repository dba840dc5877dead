"""Reach a model outside a campaign."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rvsg.generation.vlm.watching import CallNews
from rvsg.generation.wiring import Access, Wiring, wired

__all__ = ["CallNews", "Wiring", "answered_from_record", "reach"]


def reach(model: str | None, record: Path | None, **access: Any) -> Wiring:
    """Return a model ready to be asked; InputError where neither a model nor a replay is named."""
    given = {key: value for key, value in access.items() if value is not None}
    return wired(model, Access.of(given, record=record))


def answered_from_record(wiring: Wiring) -> str | None:
    """Return that answers were taken from the record of an earlier session; None where none was."""
    known, recording = wiring.model.from_record, wiring.recording
    if wiring.replaying or recording is None or not known:
        return None
    calls = "1 call was" if known == 1 else f"{known} calls were"
    return f"{calls} answered at no cost from {recording.folder}; to ask anew, give another --record."
