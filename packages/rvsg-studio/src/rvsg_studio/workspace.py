"""The folder a studio works in: files that may be named from outside, jobs, notes on findings, and unsaved input.

Jobs outlive a page and the studio itself: each is a process of its own with a folder of its own. They and all else
that the studio keeps lie with the user (`own_folder`): what the folder brings starts nothing.

::

    jobs/ID/
      job.json       what is to be done, and the command line that does the same
      events.jsonl   what happened, one JSON object per line, appended by the worker
      result.json    how it ended; missing while it runs, or where it was killed
      .lock          held by the worker while it lives
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import secrets
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Annotated, Any, Literal, TypeVar, cast
from urllib.parse import urlencode

import yaml
from pydantic import Field

from rvsg.app.folder import LEDGER
from rvsg.app.reconstruction import SUFFIXES
from rvsg.app.view import SUFFIX, unpack_view
from rvsg.core.child_process import command as command_of
from rvsg.core.documents import read_document
from rvsg.core.errors import InputError
from rvsg.core.files import path_inside, state_folder, write_whole
from rvsg.core.inputs import exists
from rvsg.core.records import Record
from rvsg_studio.listing import Lister, Listing
from rvsg_studio.question import Question

JOB, EVENTS, RESULT, LOCK, LOG = "job.json", "events.jsonl", "result.json", ".lock", "worker.log"
BOTH = "both.json"
"""A recorded drive and the nearest simulated one, as data of the replay component."""
PAUSE = "pause"
"""A file in a job's folder that asks its worker to pause, also one that has not begun yet."""
State = Literal["starting", "running", "finished", "paused", "failed", "ended"]
STARTING_S = 30.0
KEPT = 200
"""Finished jobs that are kept; older ones are deleted with their events."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """A job as it stands now."""

    id: str
    kind: str
    title: str
    command: str
    """The command line that does the same."""
    target: str
    """The campaign or scenario it works on, relative to the folder of the studio."""
    begun_s: float
    state: State
    arguments: dict[str, Any]
    result: dict[str, Any]
    folder: Path

    @property
    def took_s(self) -> float:
        """How long it took, once it has a result, seconds."""
        return (self.folder / RESULT).stat().st_mtime - self.begun_s

    @property
    def running(self) -> bool:
        """Whether its process lives, or is about to."""
        return self.state in ("starting", "running")


class Jobs:
    """The jobs of a studio; what they are is on the disk alone, so several studios and a restart see the same."""

    def __init__(self, folder: Path, workspace: Path) -> None:
        self.folder = folder
        self.workspace = workspace
        folder.mkdir(parents=True, exist_ok=True)
        self._children: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, kind: str, *, title: str, command: str, target: str, **arguments: Any) -> Job:
        """Start a job in a process of its own; InputError where another works on the same target."""
        if any(job.running and job.target == target for job in self.all()):
            raise InputError(f"A job works on {target} already. Wait for it, or stop it.")
        job = f"{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(3)}"
        folder = self.folder / job
        folder.mkdir()
        facts = {"kind": kind, "title": title, "command": command, "target": target, "begun_s": time.time()}
        write_whole(folder / JOB, json.dumps(facts | {"arguments": arguments}, indent=2))
        with (folder / LOG).open("wb") as log:
            self._children[job] = subprocess.Popen(  # noqa: S603
                command_of("rvsg_studio.worker:main", str(folder)),
                cwd=self.workspace,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        done = [other for other in self.all() if not other.running]
        for other in done[KEPT:]:
            shutil.rmtree(other.folder, ignore_errors=True)
        return self.get(job)

    def all(self) -> list[Job]:
        """Return the jobs, the newest first."""
        names = sorted((path.name for path in self.folder.iterdir() if (path / JOB).is_file()), reverse=True)
        return [self.get(name) for name in names]

    def get(self, job: str) -> Job:
        """Return a job; InputError where there is none of that name."""
        folder = self.folder / job
        if folder.parent != self.folder or not exists(folder / JOB):
            raise InputError(f"There is no job {job!r}.")
        facts = json.loads((folder / JOB).read_text(encoding="utf-8"))
        result = read_json(folder / RESULT, None)
        state = self._state(job, folder, result, facts["begun_s"])
        return Job(id=job, state=state, result=result or {}, folder=folder, **facts)

    def events(self, job: str, after: int = 0) -> tuple[list[dict[str, Any]], int]:
        """Return the events behind a place in the file of events, and the place behind them."""
        path = self.folder / self.get(job).id / EVENTS
        try:
            with path.open("rb") as file:
                file.seek(after)
                read = file.read()
        except FileNotFoundError:
            return [], after
        whole = read[: read.rfind(b"\n") + 1]
        return [json.loads(line) for line in whole.splitlines()], after + len(whole)

    def of(self, target: str) -> Job | None:
        """Return the newest job on a target; None where there is none."""
        return next((job for job in self.all() if job.target == target), None)

    def pause(self, job: str) -> None:
        """Let the runs in progress end, then stop; the same command line resumes."""
        (self.get(job).folder / PAUSE).touch()
        self._signal(job, signal.SIGTERM)

    def stop(self, job: str) -> None:
        """End the worker and its processes now. What was finished is stored; the same command line resumes."""
        self._signal(job, signal.SIGKILL)

    def _signal(self, job: str, number: int) -> None:
        folder = self.get(job).folder
        pid = _holder(folder / LOCK)
        child = self._children.get(job)
        if pid is None and child is not None and number == signal.SIGKILL:
            pid = child.pid  # it has not begun yet
        if pid is not None:
            with contextlib.suppress(ProcessLookupError):
                (os.killpg if number == signal.SIGKILL else os.kill)(pid, number)

    def _state(self, job: str, folder: Path, result: dict[str, Any] | None, begun_s: float) -> State:
        child = self._children.get(job)
        if child is not None and child.poll() is not None:
            del self._children[job]
            child = None
        if result is not None:
            state: State = result["state"]
            return state
        if _holder(folder / LOCK) is not None:
            return "running"
        if child is not None and time.time() - begun_s < STARTING_S:
            return "starting"
        return "ended"


@contextlib.contextmanager
def holding(folder: Path) -> Iterator[None]:
    """Hold the lock of a job's folder while its worker lives, with the id of the process in it."""
    import fcntl

    with (folder / LOCK).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.write(str(os.getpid()))
        lock.flush()
        yield


def is_held(path: Path) -> bool:
    """Return whether a process holds a lock; the file alone may be left over from one that has ended."""
    import fcntl

    try:
        with path.open("r") as lock:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except BlockingIOError:
        return True
    return False


def _holder(path: Path) -> int | None:
    """Return the process that holds a lock; None where none does: an id alone may belong to another by now."""
    return int(path.read_text() or 0) or None if is_held(path) else None


def read_json(path: Path, otherwise: Any) -> Any:
    """Return what a file of JSON holds, or something else where there is none."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return otherwise


def own_folder(folder: Path) -> Path:
    """Return where the studio keeps what is its own about a folder: jobs, token, undo steps, what is typed, the index.

    It lies with the user and not in the folder, which may come from a stranger. Deleting it loses no result.
    """
    place = folder.resolve()
    own = state_folder() / "studio" / f"{place.name}-{hashlib.sha256(os.fsencode(place)).hexdigest()[:16]}"
    own.mkdir(parents=True, exist_ok=True, mode=0o700)
    return own


REMEMBERED = 24
T = TypeVar("T")


class Workspace:
    """The folder of a studio, its jobs, and what was computed from its files and still holds."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.own = own_folder(self.folder)
        self._lister = Lister(self.folder, self.own / "index.json")
        self.jobs = Jobs(self.own / "jobs", self.folder)
        self._kept: OrderedDict[tuple[Any, ...], Any] = OrderedDict()
        self._lock = Lock()
        self.menu: dict[str, tuple[int, str]] = {}
        """Pages of the menu by their address: place and name."""

    def listing(self) -> Listing:
        """Return what lies in the folder now; campaigns that have changed are read in the background."""
        return self._lister.listing(wait=False)

    def whole_listing(self) -> Listing:
        """Return what lies in the folder now, every campaign read."""
        return self._lister.listing()

    def path(self, name: str) -> Path:
        """Return a path in the folder; InputError for one outside of it, however it is written."""
        path = path_inside(self.folder, name)
        if path.is_relative_to(state_folder()):
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

    def own_file(self, kind: str, about: str) -> Path:
        """Return where the studio keeps something of its own about a page, a world or a scenario."""
        return self.own / kind / f"{hashlib.sha256(about.encode()).hexdigest()[:16]}.json"

    def cached(self, key: tuple[Any, ...], path: Path, make: Callable[[], T]) -> T:
        """Return what was made of a file or a store, made anew where its files have changed since."""
        now = stamp(path)
        with self._lock:
            entry = self._kept.get(key)
            if entry is not None and entry[0] == now:
                self._kept.move_to_end(key)
                return cast(T, entry[1])
        value = make()
        with self._lock:
            self._kept[key] = (now, value)
            while len(self._kept) > REMEMBERED:
                self._kept.popitem(last=False)
        return value


def stamp(path: Path) -> tuple[Any, ...]:
    """Return what changes when a file, or a file directly in a folder, changes."""
    if path.is_file():
        status = path.stat()
        return (status.st_mtime_ns, status.st_size)
    stamps = []
    with os.scandir(path) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):  # gone by now, or a loop of links
                if entry.is_file() and not entry.name.endswith(("-shm", ".lock", ".html")):
                    status = entry.stat()
                    if status.st_size:
                        stamps.append((entry.name, status.st_mtime_ns, status.st_size))
    return tuple(sorted(stamps))


FILE = "notes.yaml"
HEAD = "# Notes on findings, by the id of their scenario. status: new, known, accepted or fixed.\n"
NoteState = Literal["new", "known", "accepted", "fixed"]
STATES: tuple[NoteState, ...] = ("new", "known", "accepted", "fixed")
_writing = threading.Lock()


class FindingNote(Record):
    """What people say of a finding."""

    status: NoteState = "new"
    comment: Annotated[str, Field(max_length=20_000)] = ""


class Notes(Record):
    """The notes of a campaign, by the id of the scenario they are on."""

    findings: dict[str, FindingNote] = Field(default_factory=dict)


def notes_of(folder: Path) -> Notes:
    """Return the notes beside a campaign; none if there is no such file.

    Raises:
        FileError: the file cannot be used; names the line.
    """
    path = folder / FILE
    return read_document(path, Notes)[0] if path.is_file() else Notes()


def note(folder: Path, scenario_id: str, *, status: NoteState | None = None, comment: str | None = None) -> FindingNote:
    """Change the note on a finding, keep the others, and return it; the file is whole at any moment."""
    with _writing:
        notes = notes_of(folder)
        before = notes.findings.get(scenario_id, FindingNote())
        changes = {"status": status, "comment": comment}
        changed = before.replace(**{key: value for key, value in changes.items() if value is not None})
        values = notes.replace(findings={**notes.findings, scenario_id: changed}).model_dump(mode="json")
        text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=100)
        write_whole(folder / FILE, HEAD + text)
    return changed


KINDS = (".yaml", ".yml", ".pgm", ".png", ".bmp", ".sdf", ".world")
"""What a file for a world ends in."""
LARGEST_FILE = 60_000_000
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
    return listed(workspace)


def receive_view(workspace: Workspace, name: str, content: bytes) -> dict[str, Any]:
    """Unpack a `.rvsg` file into a folder `received/NAME`, and return the address that shows what it holds."""
    plain = _plain(name)
    with tempfile.TemporaryDirectory(dir=workspace.own) as draft:
        Path(draft, plain).write_bytes(content)
        folder = unpack_view(Path(draft, plain), workspace.path(f"received/{Path(plain).stem}"))
    shown = urlencode({"folder": workspace.relative(folder)})
    return {"address": f"/campaign?{shown}" if (folder / LEDGER).exists() else "/compare/versions"}


def receive_recording(workspace: Workspace, name: str, content: bytes) -> dict[str, Any]:
    """Keep a recording as `recordings/NAME`, and return the address that shows what it holds."""
    path = workspace.path(f"recordings/{_plain(name)}")
    if path.exists() and path.read_bytes() != content:
        raise InputError(f"{workspace.relative(path)} is another recording. Rename the file.")
    write_whole(path, content)
    return {"address": f"/recording?{urlencode({'file': workspace.relative(path)})}"}


def _plain(name: str) -> str:
    """Return the name of a file without any folder in it; InputError where it cannot be kept."""
    plain = Path(name.replace("\\", "/")).name
    if plain.startswith(".") or "\0" in plain or len(plain.encode()) > 200:
        raise InputError(f"{plain[:200]}: a file of this name cannot be kept. Rename it.")
    return plain


def receiver(name: str) -> Callable[[Workspace, str, bytes], dict[str, Any]]:
    """Return what takes a dropped file of this name."""
    if name.endswith(SUFFIX):
        return receive_view
    return receive_recording if Path(name).suffix in SUFFIXES else receive


def listed(workspace: Workspace, _: Question | None = None) -> dict[str, Any]:
    """Return the names of the files that wait."""
    return {"names": [path.name for path in received(workspace)]}


def forget(workspace: Workspace, _: Question | None = None) -> dict[str, Any]:
    """Remove the files that wait."""
    shutil.rmtree(_folder(workspace), ignore_errors=True)
    return listed(workspace)


def _folder(workspace: Workspace) -> Path:
    return workspace.own / "new-world"


_keeping = threading.Lock()


class Typed:
    """The unsaved input of one page, by field."""

    def __init__(self, workspace: Workspace, page: str) -> None:
        self._path = workspace.own_file("typed", page)

    @property
    def fields(self) -> dict[str, Any]:
        """What is kept, by field."""
        stored: dict[str, Any] = read_json(self._path, {})
        return stored

    def keep(self, fields: Mapping[str, Any]) -> None:
        """Write the values of fields to disk; None forgets a field."""
        with _keeping:
            values = {key: value for key, value in {**self.fields, **fields}.items() if value is not None}
            if values:
                write_whole(self._path, json.dumps(values))
            else:
                self._path.unlink(missing_ok=True)


def typed(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Return what is kept of a page."""
    return Typed(workspace, question.page).fields


def typed_keep(workspace: Workspace, question: Question) -> dict[str, Any]:
    """Keep the values of fields of a page; null forgets a field."""
    Typed(workspace, question.page).keep(question.fields)
    return {}
