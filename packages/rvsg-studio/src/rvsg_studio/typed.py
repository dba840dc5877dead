"""Unsaved input of the studio's pages, kept on disk with every keystroke so that it survives a restart."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Mapping
from typing import Any

from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg_studio.workspace import Workspace

_keeping = threading.Lock()


class Typed:
    """The unsaved input of one page, by field."""

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
        """Write the values of fields to disk; None forgets a field."""
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
    """Keep the values of fields of a page; null forgets a field."""
    fields = given.get("fields")
    if not isinstance(fields, dict):
        raise InputError("The request has no fields.")
    Typed(workspace, str(given.get("page"))).keep(fields)
    return {}
