"""Earlier scenarios that a generator gets besides those of its campaign: a file, and a copy in the folder."""

from __future__ import annotations

from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from rvsg.core.errors import FileError
from rvsg.core.inputs import read_text
from rvsg.scenario.brief import Remembered

COPY = "knowledge.json"
"""The copy in the folder of a campaign, which a resumed campaign reads, so that it ends with the same records."""
_REMEMBERED = TypeAdapter(tuple[Remembered, ...])


def read_remembered(path: str | Path) -> tuple[Remembered, ...]:
    """Read earlier scenarios as `rvsg knowledge search --out FILE` writes them.

    Raises:
        FileError: the file holds something else.
    """
    try:
        return _REMEMBERED.validate_json(read_text(Path(path)))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise FileError(
            path, f"expected what `rvsg knowledge search --out FILE` writes: {first['msg']} at {first['loc']}."
        ) from None
