"""Runs side by side: the only place of parallelism.

Runs are ordered ahead and collected in the order that is wanted, so what is recorded does not depend on how many
processes work, where they are, or which is faster. A run whose id is known is not simulated again. When a process
dies hard, what was under way in it is made again, and a run that is suspected of it alone, with nothing beside it.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from types import FrameType, TracebackType
from typing import Any, Protocol, Self

from rvsg.campaign.attempt import Failure
from rvsg.core.errors import SimulationError
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Run, run_id
from rvsg.world.world import World

ENDING = (signal.SIGINT, signal.SIGTERM)
ORPHAN_CHECK_S = 2.0
STOP_S = 5.0
"""So long processes that are killed may take; they end without us where that is not enough."""


class WorkerDied(Exception):
    """The process that made a run died; the run, or another one in that process, may be to blame."""


class Executor(Protocol):
    """Where runs are made beside this process. Made with its options; a plug-in of the kind `executor`."""

    @property
    def size(self) -> int:
        """How many runs it makes at a time."""
        ...

    def begin(self, simulator: Simulator, world: World, tell: Callable[[str], None]) -> None:
        """Get ready for runs of this simulator in this world; InputError where that cannot be.

        `tell` is given what a person should know, such as that a machine is gone.
        """
        ...

    def submit(self, scenario: Scenario, seed: int) -> Any:
        """Ask for a run, and return at once what `result` takes."""
        ...

    def result(self, submitted: Any) -> Run | Failure:
        """Wait for a run; WorkerDied where its process did."""
        ...

    def again(self, scenario: Scenario, seed: int) -> Run | Failure:
        """Make a run whose process died once more, with nothing else under way; WorkerDied where it dies again."""
        ...

    def stop(self, *, kill: bool) -> None:
        """End; `kill`: nobody waits for what is under way. May be begun again."""
        ...


class Ordered:
    """A run that was ordered; `result` waits for it."""

    def __init__(self, makers: Simulations, scenario: Scenario, seed: int) -> None:
        self.scenario = scenario
        self.seed = seed
        self._makers = makers
        self._found: Run | Failure | None = None
        self._submitted: Any = None

    def result(self) -> Run | Failure:
        """The run, or why the simulator could not make it."""
        if self._found is None:
            self._found = self._makers.collect(self)
        return self._found


class Simulations:
    """Makes runs of one simulator in one world: in this process, in `jobs` worker processes, or where `executor` says.

    `known` finds a run by its id, or None; `tell` is given what a person should know. Use it as a context manager:
    leaving it ends the workers.
    """

    def __init__(
        self,
        simulator: Simulator,
        world: World,
        *,
        jobs: int = 1,
        known: Callable[[str], Run | None] | None = None,
        executor: Executor | None = None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.simulator = simulator
        self.world = world
        self._executor: Executor | None = executor or (Processes(jobs) if jobs > 1 else None)
        self._known = known or (lambda _: None)
        self._tell = tell
        self._open: dict[str, Ordered] = {}
        self._begun = False

    @property
    def ahead(self) -> int:
        """How many attempts are worth ordering before the first is collected: none in one process."""
        return self._ready().size if self._executor else 0

    def order(self, scenario: Scenario, seed: int) -> Ordered:
        """Ask for a run; it starts at once where there are workers, else when its result is wanted."""
        key = run_id(scenario.id, self.simulator.name, self.simulator.options, seed)
        if key in self._open:
            return self._open[key]
        ordered = Ordered(self, scenario, seed)
        ordered._found = self._known(key)
        if ordered._found is None:
            self._open[key] = ordered
            if self._executor:
                ordered._submitted = self._ready().submit(scenario, seed)
        return ordered

    def collect(self, ordered: Ordered) -> Run | Failure:
        """Wait for an ordered run. KeyboardInterrupt passes through; what was not collected is lost."""
        if self._executor is None:
            found = _attempt_run(self.simulator, self.world, ordered.scenario, ordered.seed)
        else:
            try:
                found = self._executor.result(ordered._submitted)
            except WorkerDied:
                found = self._alone(self._executor, ordered)
        self._open = {key: other for key, other in self._open.items() if other is not ordered}
        return found

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._executor and self._begun:
            self._begun = False
            self._executor.stop(kill=kind is not None)

    def _ready(self) -> Executor:
        assert self._executor is not None
        if not self._begun:
            self._executor.begin(self.simulator, self.world, self._tell)
            self._begun = True
        return self._executor

    def _alone(self, executor: Executor, ordered: Ordered) -> Run | Failure:
        """Make a run again that was under way when a worker died, with nothing else running."""
        try:
            return executor.again(ordered.scenario, ordered.seed)
        except WorkerDied:
            return Failure(
                seed=ordered.seed,
                reason=f"the process of simulator {self.simulator.name!r} died twice while it ran this scenario",
            )


class Processes:
    """Worker processes on this machine. When one dies all are replaced, and what was under way is made alone."""

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs
        self._pool: Any = None
        self._shared: tuple[Simulator, World] | None = None

    @property
    def size(self) -> int:
        """The number of processes."""
        return self.jobs

    def begin(self, simulator: Simulator, world: World, tell: Callable[[str], None]) -> None:
        """Keep what the processes are started with; they start with the first run."""
        self._shared = (simulator, world)

    def submit(self, scenario: Scenario, seed: int) -> Future[Run | Failure]:
        """Ask for a run."""
        from loky import ProcessPoolExecutor

        with _undisturbed():
            if self._pool is None:
                self._pool = ProcessPoolExecutor(
                    max_workers=self.jobs,
                    initializer=_prepare,
                    initargs=(os.getpid(), self._shared),
                    env={"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"},
                )
            try:
                future: Future[Run | Failure] = self._pool.submit(_work, scenario, seed)
            except BrokenProcessPool as broken:
                future = Future()
                future.set_exception(broken)
        return future

    def result(self, submitted: Future[Run | Failure]) -> Run | Failure:
        """Wait for a run; WorkerDied where any of the processes did, as all that is under way is lost then."""
        try:
            return submitted.result()
        except BrokenProcessPool as broken:
            raise WorkerDied from broken

    def again(self, scenario: Scenario, seed: int) -> Run | Failure:
        """Make a run alone, in new processes."""
        self.stop(kill=True)
        try:
            return self.result(self.submit(scenario, seed))
        except WorkerDied:
            self.stop(kill=True)
            raise

    def stop(self, *, kill: bool) -> None:
        """End the processes."""
        if self._pool is not None:
            pool, self._pool = self._pool, None
            if not kill:
                pool.shutdown(wait=True)
                return
            ending = threading.Thread(target=pool.shutdown, kwargs={"kill_workers": True}, daemon=True)
            ending.start()
            ending.join(STOP_S)


def _attempt_run(simulator: Simulator, world: World, scenario: Scenario, seed: int) -> Run | Failure:
    try:
        return simulator.run(scenario, world, seed=seed)
    except SimulationError as error:
        return Failure(seed=seed, reason=str(error))


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Hold Ctrl-C and SIGTERM back while processes are begun: a pool that is begun by half cannot be ended.

    A signal is handled in the main thread whichever thread it reaches, so its handler is replaced; and it is blocked,
    which the processes inherit: Ctrl-C in a terminal reaches them too, and they are to live until they are ended.
    Whoever asks a second time does not want to wait, and is passed on at once.
    """
    heard: list[int] = []
    handlers: dict[int, Any] = {}

    def hold(number: int, frame: FrameType | None) -> None:
        heard.append(number)
        if len(heard) > 1 and callable(handlers[number]):
            handlers[number](number, frame)

    blocked = None
    try:
        if threading.current_thread() is threading.main_thread():
            for number in ENDING:
                handlers[number] = signal.getsignal(number)
                signal.signal(number, hold)
        if hasattr(signal, "pthread_sigmask"):
            resource_tracker.ensure_running()  # else it begins with the first process, and unblocks them again
            blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        yield
    finally:
        if blocked is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        for ending, handler in handlers.items():
            signal.signal(ending, handler)
        if heard:
            signal.raise_signal(heard[0])


_worker: dict[str, Any] = {}


def _prepare(parent: int, shared: tuple[Simulator, World]) -> None:
    """Set a worker process up; Ctrl-C is for the parent, which then ends the workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):  # it began with both held back
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
    threading.Thread(target=_end_with_parent, args=(parent,), daemon=True).start()
    _worker.update(zip(("simulator", "world"), shared, strict=True))


def _end_with_parent(parent: int) -> None:
    """End this worker when its parent was killed: nobody would ever collect its runs or tell it to stop."""
    while os.getppid() == parent:
        time.sleep(ORPHAN_CHECK_S)
    os._exit(1)


def _work(scenario: Scenario, seed: int) -> Run | Failure:
    return _attempt_run(_worker["simulator"], _worker["world"], scenario, seed)
