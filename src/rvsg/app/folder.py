"""The folder of a campaign: its ledger, its configuration, its report; one process at a time."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from rvsg.errors import FileError, InputError

LEDGER = "ledger.sqlite"
CONFIG = "campaign.yaml"
REPORT = "report.html"
BEST = "best_scenario.json"


def make_folder(folder: Path) -> None:
    """Make the folder and prove that files can be written in it; FileError where not."""
    probe = folder / f".writable-{os.getpid()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise FileError(
            folder, f"the output folder cannot be written: {error.strerror or error}. Choose another --out."
        ) from None


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Hold the folder while a campaign runs in it; InputError where another process does. The lock ends with us."""
    try:
        import fcntl
    except ImportError:  # where there is no fcntl the ledger still refuses an attempt that is there already
        yield
        return
    with (folder / ".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"{folder}: another `rvsg run` works in this folder. Wait for it, or stop it.") from None
        yield
