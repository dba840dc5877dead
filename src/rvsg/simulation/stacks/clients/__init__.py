"""The clients of stacks in another process: files to copy, in Python and C++."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from rvsg.core.files import write_whole

FILES = ("rvsg_client.py", "rvsg_client.hpp")


def write_clients_to(folder: str | Path) -> list[Path]:
    """Write the clients into a folder; return their paths."""
    source = resources.files(__name__)
    written = []
    for name in FILES:
        written.append(Path(folder) / name)
        write_whole(written[-1], (source / name).read_text(encoding="utf-8"))
    return written
