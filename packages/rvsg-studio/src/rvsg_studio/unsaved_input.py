"""Input that is not saved yet, kept over a restart: files for a new world, and the fields of pages."""

from __future__ import annotations

import hashlib
import json
import shutil
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg_studio.workspace import Workspace, read_json

KINDS = (".yaml", ".yml", ".pgm", ".png", ".bmp", ".sdf", ".world")
"""What a file for a world ends in."""
LARGEST = 60_000_000
"""Bytes of a map or a Gazebo world."""
MOST = 20
"""Files that wait at a time."""


def received(workspace: Workspace) -> list[Path]:
    """Return the files that wait, by name."""
    folder = _folder(workspace)
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in KINDS) if folder.is_dir() else []


def receive(workspace: Workspace, name: str, content: bytes) -> dict[str, Any]:
    """Take a file, by its name without any folder in it, and return the names of all that wait."""
    plain = Path(name.replace("\\", "/")).name
    if Path(plain).suffix.lower() not in KINDS or "\0" in plain or len(plain.encode()) > 200:
        raise InputError(f"{plain[:200]}: expected a file that ends in {', '.join(KINDS)}.")
    if len(received(workspace)) >= MOST:
        raise InputError(f"{MOST} files wait already. Remove them first.")
    write_whole(_folder(workspace) / plain, content)
    return listed(workspace, {})


def listed(workspace: Workspace, _: dict[str, Any]) -> dict[str, Any]:
    """Return the names of the files that wait."""
    return {"names": [path.name for path in received(workspace)]}


def forget(workspace: Workspace, _: dict[str, Any] | None = None) -> dict[str, Any]:
    """Remove the files that wait."""
    shutil.rmtree(_folder(workspace), ignore_errors=True)
    return listed(workspace, {})


def _folder(workspace: Workspace) -> Path:
    return workspace.own / "new-world"


_keeping = threading.Lock()


class Typed:
    """The unsaved input of one page, by field."""

    def __init__(self, workspace: Workspace, page: str) -> None:
        name = hashlib.sha256(page.encode()).hexdigest()[:16]
        self._path = workspace.own / "typed" / f"{name}.json"

    @property
    def fields(self) -> dict[str, Any]:
        """What is kept, by field."""
        found: dict[str, Any] = read_json(self._path, {})
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
