"""Files that are written completely or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from rvsg.core.errors import FileError


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file so that it is there whole or not at all, its folder made; FileError if it cannot be."""
    data = content.encode() if isinstance(content, str) else content
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            path.write_bytes(data)  # a device or a pipe is written to, not replaced
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_bytes(data)
        draft.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        in_the_way = isinstance(error, FileExistsError | NotADirectoryError)
        reason = f"{path.parent} is no folder" if in_the_way else error.strerror or error
        raise FileError(path, f"the file cannot be written: {reason}.", code="not-writable") from None
