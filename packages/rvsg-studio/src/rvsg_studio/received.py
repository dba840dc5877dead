"""Files that are dropped for a new world; they wait until it is made, also over a restart."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg_studio.workspace import Workspace

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
