"""Files that are written completely or not at all, checks made before the work begins, and the user's own state."""

from __future__ import annotations

import contextlib
import os
import stat
import sys
from pathlib import Path

from rvsg.core.errors import FileError, InputError


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


def state_folder() -> Path:
    """Return the user's folder of state, made where it is missing: what lies there has the authority of the user.

    Raises:
        FileError: it cannot be made, or others than the user own it or can write in it.
    """
    base = Path(os.environ.get("XDG_STATE_HOME", ""))  # a relative one would lie in whatever folder is current
    folder = (base if base.is_absolute() else Path("~/.local/state").expanduser()) / "rvsg"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        status = folder.lstat()
    except OSError as error:
        reason = error.strerror
    else:
        safe = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o022
        reason = "" if safe else "it is no folder that you own and you alone can write in"
    if reason:
        raise FileError(folder, f"{reason}. Mend it, or name another by XDG_STATE_HOME.", code="state-folder")
    return folder


def path_inside(folder: Path, name: str) -> Path:
    """Return the path of this name in a folder, links followed; InputError for one outside, however it is written."""
    try:
        path = (folder / name).resolve()
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            path.lstat()
    except (OSError, RuntimeError, ValueError) as error:  # too long, a loop of links, a zero byte
        raise InputError(f"{name[:200]!r} cannot be the path of a file: {error}.") from None
    if not path.is_relative_to(folder):
        raise InputError(f"{name}: this lies outside the folder, {folder}.", code="outside-workspace")
    return path


def write_text(path: Path, text: str) -> None:
    """Write a file atomically, or standard output."""
    if str(path) == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
    else:
        write_whole(path, text)


def check_writable(path: Path) -> None:
    """Check that an output file can be written before starting the work; FileError says why it cannot.

    Missing folders are made when the file is written.
    """
    if str(path) == "-":
        return
    if path.is_dir():
        raise FileError(path, "this is a folder; give the name of a file.", code="not-writable")
    if path.exists() and not path.is_file():
        return  # a device or a pipe
    nearest = next((folder for folder in path.parents if folder.exists()), Path())
    probe = nearest / f".{path.name}.{os.getpid()}"
    try:  # access rights alone do not tell: no file can be made in /proc
        probe.touch()
        probe.unlink()
    except OSError as error:
        reason = f"{nearest} is no folder that can be written ({error.strerror})"
        raise FileError(path, f"the file cannot be written: {reason}.", code="not-writable") from None


def make_folder(folder: Path, *, option: str = "--out") -> None:
    """Make the folder that an option names and prove that files can be written in it; FileError if that fails."""
    probe = folder / f".writable-{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        in_the_way = isinstance(error, FileExistsError | NotADirectoryError)
        reason = "a file is in the way" if in_the_way else error.strerror or error
        raise FileError(
            folder, f"the output folder cannot be written: {reason}. Choose another {option}.", code="not-writable"
        ) from None
