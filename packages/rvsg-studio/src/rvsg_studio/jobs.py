"""Work that outlives a page and the studio itself: each job is a process of its own with a folder of its own.

::

    jobs/ID/
      job.json       what is to be done, and the command line that does the same
      events.jsonl   what happened, one JSON object per line, appended by the worker
      result.json    how it ended; missing while it runs, or where it was killed
      .lock          held by the worker while it lives
"""

from __future__ import annotations

import contextlib
import json
import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from rvsg.core.errors import InputError

JOB, EVENTS, RESULT, LOCK, LOG = "job.json", "events.jsonl", "result.json", ".lock", "worker.log"
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
        told = {"kind": kind, "title": title, "command": command, "target": target, "begun_s": time.time()}
        (folder / JOB).write_text(json.dumps(told | {"arguments": arguments}, indent=2), encoding="utf-8")
        with (folder / LOG).open("wb") as log:
            self._children[job] = subprocess.Popen(  # noqa: S603
                [sys.executable, "-m", "rvsg_studio.worker", str(folder)],
                cwd=self.workspace,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._tidy()
        return self.get(job)

    def all(self) -> list[Job]:
        """Return the jobs, the newest first."""
        names = sorted((path.name for path in self.folder.iterdir() if (path / JOB).is_file()), reverse=True)
        return [self.get(name) for name in names]

    def get(self, job: str) -> Job:
        """Return a job; InputError where there is none of that name."""
        folder = self.folder / job
        if folder.parent != self.folder or not (folder / JOB).is_file():
            raise InputError(f"There is no job {job!r}.")
        told = json.loads((folder / JOB).read_text(encoding="utf-8"))
        result = _read(folder / RESULT)
        return Job(
            id=job,
            kind=told["kind"],
            title=told["title"],
            command=told["command"],
            target=told["target"],
            begun_s=told["begun_s"],
            state=self._state(job, folder, result, told["begun_s"]),
            arguments=told["arguments"],
            result=result or {},
            folder=folder,
        )

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
                if number == signal.SIGKILL:
                    os.killpg(pid, number)
                else:
                    os.kill(pid, number)

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

    def _tidy(self) -> None:
        done = [job for job in self.all() if not job.running]
        for job in done[KEPT:]:
            for path in job.folder.iterdir():
                path.unlink()
            job.folder.rmdir()


@contextlib.contextmanager
def holding(folder: Path) -> Iterator[None]:
    """Hold the lock of a job's folder while its worker lives, with the id of the process in it."""
    import fcntl

    with (folder / LOCK).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.write(str(os.getpid()))
        lock.flush()
        yield


def _holder(path: Path) -> int | None:
    """Return the process that holds a lock; None where none does: an id alone may belong to another by now."""
    import fcntl

    try:
        with path.open("r") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                return int(lock.read() or 0) or None
    except FileNotFoundError:
        pass
    return None


def _read(path: Path) -> dict[str, Any] | None:
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    return found
