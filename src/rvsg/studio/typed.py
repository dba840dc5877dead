"""What is typed in a field and not stored elsewhere yet: on the disk with every keystroke, there after a restart."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Mapping
from typing import Any

from rvsg.api.errors import InputError
from rvsg.api.files import write_whole
from rvsg.studio.workspace import Workspace

_keeping = threading.Lock()


class Typed:
    """What is typed on one page, by field."""

    def __init__(self, workspace: Workspace, page: str) -> None:
        name = hashlib.sha256(page.encode()).hexdigest()[:16]
        self._path = workspace.own / "typed" / f"{name}.json"

    @property
    def fields(self) -> dict[str, Any]:
        """What is kept, by field."""
        if not self._path.is_file():
            return {}
        found: dict[str, Any] = json.loads(self._path.read_text(encoding="utf-8"))
        return found

    def keep(self, fields: Mapping[str, Any]) -> None:
        """Keep what stands in fields; None forgets one. On return it is on the disk."""
        with _keeping:
            kept = {key: value for key, value in {**self.fields, **fields}.items() if value is not None}
            if kept:
                write_whole(self._path, json.dumps(kept))
            else:
                self._path.unlink(missing_ok=True)


def typed(workspace: Workspace, given: dict[str, Any]) -> dict[str, Any]:
    """Return what is kept of a page."""
    return Typed(workspace, str(given.get("page"))).fields


def typed_keep(workspace: Workspace, given: dict[str, Any]) -> dict[str, Any]:
    """Keep what stands in fields of a page; null forgets one."""
    fields = given.get("fields")
    if not isinstance(fields, dict):
        raise InputError("The question lacks fields.")
    Typed(workspace, str(given.get("page"))).keep(fields)
    return {}
