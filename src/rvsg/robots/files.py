"""Robot files: YAML, one robot per file."""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path

from rvsg.core.documents import read_document
from rvsg.core.errors import UnknownName
from rvsg.robots.robot import Robot

DEFAULT_ROBOT = "tiago_omni"
"""The robot of a scenario that names none."""


@cache
def _shipped() -> dict[str, Robot]:
    with resources.as_file(resources.files("rvsg.robots") / "data") as folder:
        robots = [read_document(path, Robot)[0] for path in sorted(folder.glob("*.yaml"))]
    return {robot.name: robot for robot in robots}


def shipped_robots() -> dict[str, Robot]:
    """Return the robots that come with RVSG, by name."""
    return dict(_shipped())


def load_robot(name_or_file: str | Path) -> Robot:
    """Load a shipped robot by its name, or a robot from a YAML file.

    Raises:
        UnknownName: there is neither a shipped robot nor a file of this name.
        FileError: the file cannot be read, or with the line of every mistake in it.
    """
    text = str(name_or_file)
    if text in _shipped():
        return _shipped()[text]
    if not (text.endswith((".yaml", ".yml")) or Path(text).exists()):
        raise UnknownName("robot", text, _shipped(), hint="Or give a file: robot.yaml.")
    return read_document(Path(text), Robot)[0]
