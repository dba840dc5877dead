"""A worker process: reads tasks from standard input and writes results to standard output.

Every message is a frame: its length as 8 bytes, then that many bytes. The first frame holds the pickled work, a
callable of a scenario and a seed with a method `close`; each further frame holds one task. An empty frame asks the
worker to end. The worker answers READY once it can work, then one frame per task, in order. When its input ends
without an empty frame, its parent is gone, and the worker exits at once.
"""

from __future__ import annotations

import json
import os
import pickle
import queue
import signal
import struct
import sys
import threading
from collections.abc import Sequence
from typing import IO, Any

READY = b"ready"
ENDING = (signal.SIGINT, signal.SIGTERM)
_LENGTH = struct.Struct("<Q")


def command() -> list[str]:
    """Return the command that starts a worker with this interpreter and this import path."""
    code = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from rvsg.campaign.worker import main; main()"
    return [sys.executable, "-c", code, json.dumps(sys.path)]


def write_frame(stream: IO[bytes], data: bytes) -> None:
    """Write one frame."""
    stream.write(_LENGTH.pack(len(data)))
    stream.write(data)
    stream.flush()


def read_frame(stream: IO[bytes]) -> bytes:
    """Read one frame.

    Raises:
        EOFError: The stream ends before the frame does.
    """
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    (length,) = _LENGTH.unpack(head)
    data = stream.read(length)
    if len(data) < length:
        raise EOFError
    return data


def main() -> None:
    """Work until the parent asks for the end or is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which then ends its workers
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
    tasks, results = _private_streams()
    waiting: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read_tasks, args=(tasks, waiting), daemon=True).start()
    try:
        work = pickle.loads(waiting.get())  # noqa: S301 - from the parent
    except Exception as error:  # such as a module that only the parent finds
        write_frame(results, f"it cannot load the simulator: {type(error).__name__}: {error}".encode())
        return
    write_frame(results, READY)
    try:
        while task := waiting.get():
            write_frame(results, _answer(work, pickle.loads(task)))  # noqa: S301 - from the parent
    finally:
        work.close()


def _private_streams() -> tuple[IO[bytes], IO[bytes]]:
    """Keep the pipes to the parent for this module: what a simulator prints goes to standard error."""
    tasks, results = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    try:
        os.dup2(2, 1)
    except OSError:  # standard error is closed
        os.dup2(0, 1)
    return tasks, results


def _read_tasks(stream: IO[bytes], waiting: queue.SimpleQueue[bytes]) -> None:
    """Read ahead, so that the parent never waits for room in the pipe while a run is under way."""
    try:
        while data := read_frame(stream):
            waiting.put(data)
    except (EOFError, OSError):
        os._exit(1)
    waiting.put(b"")


def _answer(work: Any, task: Sequence[Any]) -> bytes:
    """Do one task; return the pickled pair of whether it succeeded, and its result or error."""
    try:
        scenario, seed, trial = task
        return pickle.dumps((True, work(scenario, seed, trial=trial)))
    except Exception as error:
        return pickle.dumps((False, _portable(error)))


def _portable(error: Exception) -> Exception:
    """Return the error, or one of the nearest base class that survives the way to the parent."""
    for kind in type(error).__mro__:
        candidate = error if kind is type(error) else None
        try:
            candidate = candidate or kind(str(error))
            pickle.loads(pickle.dumps(candidate))  # noqa: S301 - our own bytes
        except Exception:  # noqa: S112 - pickling may fail in any way; the next base class is tried
            continue
        return candidate
    return RuntimeError(f"{type(error).__name__}: {error}")
