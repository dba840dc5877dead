"""The folder a studio works in: what lies there, and which of its files may be named from outside."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Any

from rvsg.core.errors import InputError
from rvsg_studio.jobs import Jobs
from rvsg_studio.listing import Lister, Listing

OWN = ".rvsg-studio"
"""The studio's own folder in the folder it works in: jobs, undo steps, the index. Deleting it loses no result."""
REMEMBERED = 24


class Workspace:
    """The folder of a studio, its jobs, and what was computed from its files and still holds."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.own = self.folder / OWN
        self.own.mkdir(exist_ok=True)
        ignore = self.own / ".gitignore"
        if not ignore.exists():
            ignore.write_text("*\n", encoding="utf-8")
        self._lister = Lister(self.folder, self.own / "index.json")
        self.jobs = Jobs(self.own / "jobs", self.folder)
        self._kept: OrderedDict[tuple[Any, ...], Any] = OrderedDict()
        self._lock = Lock()

    def listing(self) -> Listing:
        """Return what lies in the folder now; campaigns that have changed are read in the background."""
        return self._lister.listing(wait=False)

    def whole_listing(self) -> Listing:
        """Return what lies in the folder now, every campaign read."""
        return self._lister.listing()

    def path(self, name: str) -> Path:
        """Return a path in the folder; InputError for one outside of it, however it is written."""
        if "\0" in name:
            raise InputError("A path holds no zero byte.")
        path = (self.folder / name).resolve()
        if not path.is_relative_to(self.folder) or path.is_relative_to(self.own):
            raise InputError(f"{name}: this lies outside the folder of the studio, {self.folder}.")
        return path

    def existing(self, name: str) -> Path:
        """Return a path in the folder that exists; InputError where there is nothing."""
        path = self.path(name)
        if not path.exists():
            raise InputError(f"{name}: there is no such file or folder in {self.folder}.")
        return path

    def relative(self, path: Path) -> str:
        """Return a path as it is named in addresses and command lines: relative to the folder."""
        return path.resolve().relative_to(self.folder).as_posix()

    def kept(self, key: tuple[Any, ...], path: Path, make: Callable[[], Any]) -> Any:
        """Return what was made of a file or a store, made anew where its files have changed since."""
        now = stamp(path)
        with self._lock:
            found = self._kept.get(key)
            if found is not None and found[0] == now:
                self._kept.move_to_end(key)
                return found[1]
        made = make()
        with self._lock:
            self._kept[key] = (now, made)
            while len(self._kept) > REMEMBERED:
                self._kept.popitem(last=False)
        return made


def stamp(path: Path) -> tuple[Any, ...]:
    """Return what changes when a file, or a file directly in a folder, changes."""
    if path.is_file():
        status = path.stat()
        return (status.st_mtime_ns, status.st_size)
    found = []
    with os.scandir(path) as entries:
        for entry in entries:
            if entry.is_file() and not entry.name.endswith(("-shm", ".lock", ".html")):
                status = entry.stat()
                if status.st_size:
                    found.append((entry.name, status.st_mtime_ns, status.st_size))
    return tuple(sorted(found))
