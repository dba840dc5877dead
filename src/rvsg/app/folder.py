"""The folder of a campaign: its ledger, its configuration, its report; one process at a time."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rvsg.core import plugins
from rvsg.core.errors import FileError, InputError
from rvsg.core.files import write_whole
from rvsg.core.inputs import exists, parse_json, read_text

if TYPE_CHECKING:
    from rvsg.runs.ledger import Ledger


LEDGER = "ledger.sqlite"
MATRIX = "matrix.json"
"""The settings of several campaigns of one command, whose folders stand beside it."""
STORE = "store.json"
"""Says which store keeps the campaign where that is not SQLite, so that resuming and reporting find it."""
CONFIG = "campaign.yaml"
REPORT = "report.html"
BEST = "best_scenario.json"
LOCK = ".lock"
"""Held in the folder of a campaign while a process runs it."""
LOCK_PATIENCE_S = 0.5
"""Seconds to wait for the lock: who looks whether it is held, as the studio does, holds it for an instant."""
BEFOREHAND = ("prompts", "vlm")
"""What a user may put into the folder of a campaign before it begins: templates, and recorded calls of a model."""


def store_of(folder: Path) -> tuple[str, dict[str, Any]] | None:
    """Name and options of the store that keeps the campaign of a folder; None if there is no campaign."""
    try:
        if not exists(folder / STORE):
            return ("sqlite", {}) if exists(folder / LEDGER) else None
        stored = parse_json(read_text(folder / STORE), folder / STORE)
        return str(stored["store"]), dict(stored["options"])
    except (ValueError, KeyError, TypeError) as error:
        raise FileError(folder / STORE, f"it does not say which store keeps this campaign ({error}).") from None


def is_matrix(folder: Path) -> bool:
    """Return whether a folder holds several campaigns of one command."""
    return (folder / MATRIX).is_file()


def holds_several(folder: Path) -> bool:
    """Return whether a folder holds no campaign itself, but folders that do."""
    if is_matrix(folder) or not folder.is_dir():
        return is_matrix(folder)
    return store_of(folder) is None and any(store_of(path) for path in folder.iterdir() if path.is_dir())


@contextlib.contextmanager
def opened(folder: Path, store: str, options: Mapping[str, Any]) -> Iterator[Ledger]:
    """The store of a folder, open; a plug-in is given the path `ledger.NAME` in the folder, and its options."""
    ledger = plugins.make("store", store, options, folder / f"ledger.{store}")
    try:
        if store != "sqlite":  # and only now: a store that cannot be made keeps nothing
            write_whole(folder / STORE, json.dumps({"store": store, "options": dict(options)}, indent=2) + "\n")
        yield ledger
    finally:
        ledger.close()


@contextlib.contextmanager
def reading(store: Path) -> Iterator[Ledger]:
    """The store of a campaign's folder, or the ledger file itself, opened to be read; StoreError if none is."""
    named = store_of(store) if store.is_dir() else None
    if named is not None and named[0] != "sqlite":
        ledger: Ledger = plugins.make("store", named[0], named[1], store / f"ledger.{named[0]}")
    else:
        from rvsg.store.sqlite import SqliteLedger

        ledger = SqliteLedger.existing(store / LEDGER if store.is_dir() else store)
    try:
        yield ledger
    finally:
        ledger.close()


def check_out(folder: Path) -> None:
    """Refuse an output folder that is a file, or that holds what no campaign made: it could be replaced."""
    nearest = next((path for path in (folder, *folder.parents) if os.path.lexists(path)), Path())
    if not nearest.is_dir():
        raise FileError(
            nearest, f"this is no folder, and --out {folder} needs one. Choose another --out.", code="out-no-folder"
        )
    try:
        names = {path.name for path in folder.iterdir() if path.name[:1] != "."} if nearest == folder else set()
    except OSError as error:
        raise FileError(folder, f"the folder cannot be read: {error.strerror}. Choose another --out.") from None
    foreign = sorted(names.difference(BEFOREHAND))
    if foreign and not names.intersection((LEDGER, STORE, MATRIX)):
        listed = ", ".join(foreign[:3]) + (", ..." if len(foreign) > 3 else "")
        raise FileError(
            folder,
            f"this folder holds no campaign but other files ({listed}), which could be replaced. Choose a new or an "
            "empty folder as --out.",
            code="out-occupied",
        )


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder while a campaign runs in it. The lock ends with the process.

    Raises:
        InputError: another process holds it.
    """
    from filelock import FileLock, Timeout

    try:
        held = FileLock(folder / LOCK, timeout=LOCK_PATIENCE_S, thread_local=False).acquire()
    except Timeout:
        raise InputError(
            f"{folder}: another `rvsg run` works in this folder. Wait for it, or stop it.", code="out-in-use"
        ) from None
    with held:
        yield
