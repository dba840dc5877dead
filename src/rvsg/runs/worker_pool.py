"""Worker processes on this machine, which may be killed at any moment without harm.

Each thread of a pool owns one process and the socket to it. Workers share neither a lock nor a queue, as those of
`concurrent.futures.ProcessPoolExecutor` and loky do, so the death of one blocks and ends no other: its socket ends, and
only the run that it made is suspect. A suspect is repeated with nothing else under way; after `ATTEMPTS` deaths it
becomes a Failure.

Every message is pickled bytes: first the work, which the worker answers with `READY`, then a job at a time, which it
answers with its result. No bytes ask it to end. A worker whose parent is gone exits at once.
"""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import queue
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from typing import IO, Any

from rvsg.core.child_process import command
from rvsg.core.errors import SimulationError
from rvsg.runs.attempt import Failure

Stream = IO[bytes] | io.BufferedRWPair
READY = b"ready"
ATTEMPTS = 3
"""A run whose process died this often is given up."""
FAILED_STARTS = 10
"""The number of workers in a row that may die while they start."""
START_S = 600.0
"""A worker that cannot work by then is killed, which counts as a failed start."""
STOP_S = 5.0
"""A worker that does not end by itself is killed after this time."""


def send(stream: Stream, message: bytes) -> None:
    """Write one message."""
    pickle.dump(message, stream)
    stream.flush()


def receive(stream: Stream) -> bytes:
    """Read one message; EOFError if the other side is gone."""
    try:
        message: bytes = pickle.load(stream)  # noqa: S301 - from our own process
    except (OSError, pickle.UnpicklingError) as error:  # a message that ends in its middle
        raise EOFError from error
    return message


def main() -> None:
    """Work until the parent asks for the end or is gone."""
    parent = socket.socket(fileno=int(sys.argv[1]))
    parent.set_inheritable(False)  # else a process that a simulator starts would hold it
    stream, waiting = parent.makefile("rwb"), queue.SimpleQueue[bytes]()
    threading.Thread(target=_listen, args=(parent.makefile("rb"), waiting), daemon=True).start()
    try:
        work = pickle.loads(waiting.get())  # noqa: S301 - from the parent
    except Exception as error:  # such as a module that only the parent finds
        send(stream, f"it cannot load the simulator: {type(error).__name__}: {error}".encode())
        return
    send(stream, READY)
    try:
        while job := waiting.get():
            send(stream, _answer(work, job))
    finally:
        work.close()


def _listen(stream: Stream, waiting: queue.SimpleQueue[bytes]) -> None:
    """Notice the end of the parent while a run is under way."""
    try:
        while True:
            waiting.put(receive(stream))
    except EOFError:
        os._exit(1)


def _answer(work: Callable[[Any], Any], job: bytes) -> bytes:
    """Do one job; return the pickled pair of whether it succeeded, and its result or error."""
    try:
        return pickle.dumps((True, work(pickle.loads(job))))  # noqa: S301 - from the parent
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


class Processes:
    """An Executor of `jobs` worker processes."""

    def __init__(self, jobs: int) -> None:
        self.size = jobs
        self.workers: set[Worker] = set()
        """The workers that were not seen to be dead."""
        self._maker: Callable[[Any], Any] | None = None
        self._threads: ThreadPoolExecutor | None = None
        self._own = threading.local()
        self._changed = threading.Condition()
        self._under_way = self._suspects = self._failed_starts = 0
        self._ending = False
        self._broken: SimulationError | None = None

    def start(self, maker: Callable[[Any], Any], notify: Callable[[str], None]) -> None:
        """Keep what the workers need; they start with the first runs."""
        self._maker, self._ending, self._broken, self._failed_starts = maker, False, None, 0

    def submit(self, job: Any) -> Future[Any]:
        """Ask for a run."""
        if self._threads is None:
            import cloudpickle  # a simulator may be defined in a script or a notebook

            self._work: bytes = cloudpickle.dumps(self._maker)
            self._own = threading.local()
            self._threads = ThreadPoolExecutor(self.size, "rvsg-worker")
        return self._threads.submit(self._made, job)

    def result(self, submitted: Future[Any]) -> Any:
        """Wait for a run; SimulationError if workers cannot start."""
        return submitted.result()

    def stop(self, *, kill: bool) -> None:
        """End the workers, after the runs they make unless `kill`; runs that wait are cancelled."""
        with self._changed:
            self._ending = True
            for worker in self.workers if kill else ():
                worker.process.kill()
        if self._threads is not None:
            self._threads.shutdown(cancel_futures=True)
            self._threads = None
        for worker in self.workers:
            worker.dismiss()
        while self.workers:
            self.workers.pop().end()

    def _made(self, job: Any) -> Any:
        """Make a run in the worker of this thread; alone where it is suspected to have killed one."""
        for deaths in range(ATTEMPTS):
            with self._turn(alone=deaths > 0):
                worker = self._worker()
                try:
                    succeeded, value = worker.ask(pickle.dumps(job))
                except EOFError:
                    self._bury(worker)
                    continue
            if succeeded:
                return value
            raise value
        return Failure(seed=job.seed, reason=f"the worker process died {ATTEMPTS} times while it ran this scenario")

    @contextlib.contextmanager
    def _turn(self, *, alone: bool) -> Iterator[None]:
        """Wait until a run may begin; nothing else is under way beside one that is alone."""
        with self._changed:
            self._suspects += alone
            self._changed.wait_for(lambda: not (self._under_way if alone else self._suspects))
            self._under_way += 1
        try:
            yield
        finally:
            with self._changed:
                self._under_way -= 1
                self._suspects -= alone
                self._changed.notify_all()

    def _worker(self) -> Worker:
        """Return the worker of this thread, started where there is none."""
        worker: Worker | None = getattr(self._own, "worker", None)
        while worker is None:
            with self._changed:  # so that `stop` finds every process
                if self._ending:
                    raise CancelledError
                if self._broken is not None:
                    raise self._broken
                self.workers.add(starting := Worker())
            answer = starting.begin(self._work)
            with self._changed:
                self._failed_starts = 0 if answer else self._failed_starts + 1
                if answer not in (READY, b""):
                    self._broken = SimulationError(
                        f"a worker process cannot be used: {answer.decode()}", code="worker-start"
                    )
                elif self._failed_starts >= FAILED_STARTS:
                    self._broken = SimulationError(
                        f"{FAILED_STARTS} worker processes in a row died while they started. Is there enough memory? "
                        "--jobs 1 runs without worker processes.",
                        code="worker-start",
                    )
            if answer == READY:
                self._own.worker = worker = starting
            else:
                self._bury(starting)
        return worker

    def _bury(self, worker: Worker) -> None:
        """Forget a worker that died."""
        self._own.worker = None
        worker.end()
        with self._changed:
            self.workers.discard(worker)


class Worker:
    """A worker process, with the socket to it."""

    def __init__(self) -> None:
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
        self._socket, theirs = socket.socketpair()
        with theirs:
            self.process = subprocess.Popen(  # noqa: S603 - our own interpreter
                [*command(f"{__name__}:main"), str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL if sys.__stderr__ is None else 2,  # what a simulator prints
                env=environment,
                pass_fds=[theirs.fileno()],
                process_group=0,  # Ctrl-C is for the parent, which then ends its workers
            )
        self._stream = self._socket.makefile("rwb")
        self._watch = threading.Thread(target=self._wait, daemon=True)
        self._watch.start()

    def _wait(self) -> None:
        """Close the socket when the process is gone, also where a process that it forked holds the other end."""
        self.process.wait()
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)

    def begin(self, work: bytes) -> bytes:
        """Give the worker its work; return what it answers, nothing if it died."""
        late = threading.Timer(START_S, self.process.kill)
        late.daemon = True
        late.start()
        try:
            send(self._stream, work)
            return receive(self._stream)
        except (EOFError, OSError):
            return b""
        finally:
            late.cancel()

    def ask(self, job: bytes) -> tuple[bool, Any]:
        """Return whether a job succeeded, and its result or error; EOFError if the worker dies."""
        try:
            send(self._stream, job)
        except OSError as error:
            raise EOFError from error
        answer: tuple[bool, Any] = pickle.loads(receive(self._stream))  # noqa: S301 - from our own worker
        return answer

    def dismiss(self) -> None:
        """Ask the worker to end."""
        with contextlib.suppress(OSError):
            send(self._stream, b"")

    def end(self) -> None:
        """Wait until a worker that died or was dismissed is gone."""
        try:
            self.process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self._watch.join()
        with contextlib.suppress(OSError):  # what could not be sent
            self._stream.close()
        self._socket.close()
