"""Worker processes on this machine, which may be killed at any moment without harm.

One thread per worker owns the worker's process and its two pipes. Nothing is shared between workers, neither a lock
nor a queue, so the death of one cannot block another: its pipe ends, its thread starts a new process, and only the
task it was working on is suspect. A suspect is repeated with nothing else under way; after `ATTEMPTS` deaths it
becomes a Failure.

A worker reads tasks from standard input and writes results to standard output. Every message is a frame: its length as
8 bytes, then that many bytes. The first frame holds the pickled work; each further frame holds one task. An empty frame
asks the worker to end. The worker answers READY once it can work, then one frame per task, in order. When its input
ends without an empty frame, its parent is gone, and the worker exits at once.
"""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import queue
import select
import signal
import struct
import subprocess
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import IO, Any

from rvsg.core.child_process import command
from rvsg.core.errors import SimulationError
from rvsg.runs.attempt import Failure

READY = b"ready"
ENDING = (signal.SIGINT, signal.SIGTERM)
_LENGTH = struct.Struct("<Q")


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


ATTEMPTS = 3
"""A run whose process died this often is given up."""
FAILED_STARTS = 10
"""The number of workers in a row that may die while they start."""
READ_AHEAD = 2
"""Tasks a worker has at most, so that it never waits for this process between two runs."""
START_S = 600.0
"""A worker that cannot work by then is killed, which counts as a failed start."""
LOOK_S = 2.0
"""The time between two looks at whether a silent worker lives. A run may take as long as it likes."""
STOP_S = 5.0
"""Killed workers are waited for at most this long."""


@dataclass(eq=False)
class Task:
    """A run that was submitted."""

    scenario: Any
    """The scenario, or what else the work takes in its place."""
    seed: int
    trial: bool = False
    deaths: int = 0
    future: Future[Any] = field(default_factory=Future)


class Processes:
    """An Executor of `jobs` worker processes."""

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        self._maker: Callable[..., Any] | None = None
        self._pool: _Pool | None = None

    @property
    def size(self) -> int:
        """The number of processes."""
        return self.jobs

    def start(self, maker: Callable[..., Any], notify: Callable[[str], None]) -> None:
        """Keep what the workers need; they start with the first run."""
        self._maker = maker

    def submit(self, scenario: Any, seed: int, *, trial: bool = False) -> Task:
        """Ask for a run."""
        if self._pool is None:
            import cloudpickle  # a simulator may be defined in a script or a notebook

            self._pool = _Pool(self.jobs, cloudpickle.dumps(self._maker))
        task = Task(scenario, seed, trial)
        self._pool.add(task)
        return task

    def result(self, submitted: Task) -> Any:
        """Wait for a run; SimulationError if workers cannot start."""
        return submitted.future.result()

    def stop(self, *, kill: bool) -> None:
        """End the workers."""
        if self._pool is not None:
            pool, self._pool = self._pool, None
            pool.stop(kill=kill)


class _Pool:
    """Hands tasks to the threads of its workers, and keeps count of what is under way."""

    def __init__(self, size: int, work: bytes) -> None:
        self.work = work
        self.changed = threading.Condition()
        self.waiting: deque[Task] = deque()
        self.suspects: deque[Task] = deque()
        self.failed_starts = 0
        self.broken: SimulationError | None = None
        self.ending = False
        self.keepers = [_Keeper(self) for _ in range(size)]
        for keeper in self.keepers:
            keeper.start()

    @property
    def over(self) -> bool:
        """Return whether no task will be handed out any more."""
        return self.ending or self.broken is not None

    def add(self, task: Task) -> None:
        with self.changed:
            if self.broken:
                task.future.set_exception(self.broken)
                return
            self.waiting.append(task)
            self.changed.notify_all()

    def take(self, keeper: _Keeper) -> Task | None:
        """Give a worker its next task.

        A worker that is free waits for one, and gets None at the end. A worker that has work gets a task ahead only
        where no other worker is free for it.
        """
        with self.changed:
            while not self.over:
                task = self._next(keeper)
                if task is not None:
                    keeper.tasks.append(task)
                    return task
                if keeper.tasks:
                    return None
                self.changed.wait()
            return None

    def _next(self, keeper: _Keeper) -> Task | None:
        under_way = [task for each in self.keepers for task in each.tasks]
        if self.suspects:
            return None if under_way else self.suspects.popleft()
        if not self.waiting or any(task.deaths for task in under_way):
            return None
        if keeper.tasks and not all(each.tasks for each in self.keepers):
            return None
        return self.waiting.popleft()

    def done(self, keeper: _Keeper) -> Future[Any]:
        """Note that a worker did the first of its tasks; return where its result goes."""
        with self.changed:
            task = keeper.tasks.popleft()
            self.changed.notify_all()
        return task.future

    def give_back(self, keeper: _Keeper) -> None:
        """Take back the tasks of a worker that died: the first was being worked on, the others were not."""
        with self.changed:
            tasks, keeper.tasks = list(keeper.tasks), deque()
            self.waiting.extendleft(reversed(tasks[1:]))
            for task in tasks[:1]:
                task.deaths += 1
                if task.deaths < ATTEMPTS:
                    self.suspects.append(task)
                else:
                    reason = f"the worker process died {ATTEMPTS} times while it ran this scenario"
                    task.future.set_result(Failure(seed=task.seed, reason=reason))
            if self.over:
                self._drop()
            self.changed.notify_all()

    def started(self, succeeded: bool) -> None:
        """Note a start of a worker; after too many failed ones in a row every task fails."""
        with self.changed:
            self.failed_starts = 0 if succeeded else self.failed_starts + 1
            if self.failed_starts >= FAILED_STARTS:
                self.fail(
                    f"{FAILED_STARTS} worker processes in a row died while they started. Is there enough memory? "
                    "--jobs 1 runs without worker processes."
                )

    def fail(self, reason: str) -> None:
        """Fail every task, also later ones."""
        with self.changed:
            self.broken = self.broken or SimulationError(reason, code="worker-start")
            self._drop()
            self.changed.notify_all()

    def stop(self, *, kill: bool) -> None:
        """End the workers, after the tasks they have unless `kill`; tasks that wait are cancelled."""
        with self.changed:
            self.ending = True
            self._drop()
            for keeper in self.keepers:
                if kill and keeper.process is not None:
                    keeper.process.kill()
            self.changed.notify_all()
        for keeper in self.keepers:
            keeper.join(STOP_S if kill else None)

    def _drop(self) -> None:
        for task in (*self.waiting, *self.suspects):
            if self.broken:
                task.future.set_exception(self.broken)
            else:
                task.future.cancel()
        self.waiting.clear()
        self.suspects.clear()


class _Keeper(threading.Thread):
    """The thread of one worker: starts it, gives it tasks, and starts another when it dies."""

    def __init__(self, pool: _Pool) -> None:
        super().__init__(daemon=True, name="rvsg-worker")
        self.pool = pool
        self.tasks: deque[Task] = deque()
        self.process: subprocess.Popen[bytes] | None = None

    def run(self) -> None:
        """Keep a worker alive until the pool is over."""
        if hasattr(signal, "pthread_sigmask"):  # workers inherit it: Ctrl-C in a terminal reaches them too
            signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        try:
            while (process := self._start()) is not None:
                try:
                    self._serve(process)
                except (EOFError, OSError):
                    pass  # it died; `give_back` decides what becomes of its tasks
                finally:
                    self.pool.give_back(self)
                    _end(process)
        except Exception as error:  # else those who wait for its tasks would wait forever
            self.pool.fail(f"a worker process cannot be used: {type(error).__name__}: {error}")
            self.pool.give_back(self)

    def _start(self) -> subprocess.Popen[bytes] | None:
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
        with self.pool.changed:  # so that `stop` finds every process
            if self.pool.over:
                return None
            self.process = subprocess.Popen(  # noqa: S603 - our own interpreter
                command(f"{__name__}:main"), stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
            )
        return self.process

    def _serve(self, process: subprocess.Popen[bytes]) -> None:
        """Give the worker its work and tasks until there are none; EOFError or OSError when it dies."""
        assert process.stdin is not None
        answers, answer = io.BufferedReader(_Answers(process)), b""
        late = threading.Timer(START_S, process.kill)
        late.daemon = True
        late.start()
        try:
            write_frame(process.stdin, self.pool.work)
            answer = read_frame(answers)
        finally:
            late.cancel()
            self.pool.started(bool(answer))
        if answer != READY:
            raise SimulationError(answer.decode())
        while True:
            while len(self.tasks) < READ_AHEAD and (task := self.pool.take(self)) is not None:
                write_frame(process.stdin, pickle.dumps((task.scenario, task.seed, task.trial)))
            if not self.tasks:
                write_frame(process.stdin, b"")
                return
            succeeded, value = pickle.loads(read_frame(answers))  # noqa: S301 - from our own worker
            future = self.pool.done(self)
            if succeeded:
                future.set_result(value)
            else:
                future.set_exception(value)


class _Answers(io.RawIOBase):
    """What a worker writes; it ends with the worker, also where a process that the worker forked holds the pipe."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        self._process, self._pipe, self._ready = process, process.stdout.fileno(), select.poll()
        self._ready.register(self._pipe, select.POLLIN)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        while not self._ready.poll(1000.0 * LOOK_S):
            if self._process.poll() is not None and not self._ready.poll(0.0):
                return 0
        return os.readv(self._pipe, [buffer])


def _end(process: subprocess.Popen[bytes]) -> None:
    """Close the pipes of a worker, which ends it, and wait until it is gone."""
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(OSError):
                stream.close()
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
