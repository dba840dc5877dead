"""Runs side by side: the only place of parallelism.

Runs are ordered ahead and collected in the order that is wanted, so what is recorded does not depend on how many
processes work or which is faster. A run whose id is known is not simulated again. When a worker process dies hard,
every run that was under way is made again alone, one at a time, to find the one that kills it.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from types import TracebackType
from typing import Any, Self

from rvsg.campaign.attempt import Failure
from rvsg.errors import SimulationError
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.run import Run, run_id
from rvsg.simulation.simulator import Simulator
from rvsg.world.world import World

ORPHAN_CHECK_S = 2.0


class Ordered:
    """A run that was ordered; `result` waits for it."""

    def __init__(self, makers: Simulations, scenario: Scenario, seed: int) -> None:
        self.scenario = scenario
        self.seed = seed
        self._makers = makers
        self._found: Run | Failure | None = None
        self._future: Future[Run | Failure] | None = None

    def result(self) -> Run | Failure:
        """The run, or why the simulator could not make it."""
        if self._found is None:
            self._found = self._makers.collect(self)
        return self._found


class Simulations:
    """Makes runs of one simulator in one world, in this process (`jobs` 1) or in `jobs` worker processes.

    `known` finds a run by its id, or None. Use it as a context manager: leaving it ends the workers.
    """

    def __init__(
        self, simulator: Simulator, world: World, *, jobs: int = 1, known: Callable[[str], Run | None] | None = None
    ) -> None:
        self.simulator = simulator
        self.world = world
        self.jobs = jobs
        self._known = known or (lambda _: None)
        self._open: dict[str, Ordered] = {}
        self._pool: Any = None

    @property
    def ahead(self) -> int:
        """How many attempts are worth ordering before the first is collected: none in one process."""
        return self.jobs if self.jobs > 1 else 0

    def order(self, scenario: Scenario, seed: int) -> Ordered:
        """Ask for a run; it starts at once where there are workers, else when its result is wanted."""
        key = run_id(scenario.id, self.simulator.name, self.simulator.options, seed)
        if key in self._open:
            return self._open[key]
        ordered = Ordered(self, scenario, seed)
        ordered._found = self._known(key)
        if ordered._found is None:
            self._open[key] = ordered
            if self.jobs > 1:
                ordered._future = self._submit(ordered)
        return ordered

    def collect(self, ordered: Ordered) -> Run | Failure:
        """Wait for an ordered run. KeyboardInterrupt passes through; what was not collected is lost."""
        if ordered._future is None:
            found = _attempt_run(self.simulator, self.world, ordered.scenario, ordered.seed)
        else:
            try:
                found = ordered._future.result()
            except BrokenProcessPool:
                found = self._alone(ordered)
        self._open = {key: other for key, other in self._open.items() if other is not ordered}
        return found

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._stop(kill=kind is not None)

    def _submit(self, ordered: Ordered) -> Future[Run | Failure]:
        if self._pool is None:
            from loky import ProcessPoolExecutor

            self._pool = ProcessPoolExecutor(
                max_workers=self.jobs,
                initializer=_prepare,
                initargs=(self.simulator, self.world),
                env={"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"},
            )
        try:
            future: Future[Run | Failure] = self._pool.submit(_work, ordered.scenario, ordered.seed)
        except BrokenProcessPool as broken:
            future = Future()
            future.set_exception(broken)
        return future

    def _alone(self, ordered: Ordered) -> Run | Failure:
        """Make a run again that was under way when a worker died, with nothing else running."""
        self._stop(kill=True)
        try:
            return self._submit(ordered).result()
        except BrokenProcessPool:
            self._stop(kill=True)
            return Failure(
                seed=ordered.seed,
                reason=f"the process of simulator {self.simulator.name!r} died twice while it ran this scenario",
            )

    def _stop(self, *, kill: bool) -> None:
        if self._pool is not None:
            pool, self._pool = self._pool, None
            pool.shutdown(wait=True, kill_workers=kill)


def _attempt_run(simulator: Simulator, world: World, scenario: Scenario, seed: int) -> Run | Failure:
    try:
        return simulator.run(scenario, world, seed=seed)
    except SimulationError as error:
        return Failure(seed=seed, reason=str(error))


_worker: dict[str, Any] = {}


def _prepare(simulator: Simulator, world: World) -> None:
    """Set a worker process up; Ctrl-C is for the parent, which then ends the workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    _worker.update(simulator=simulator, world=world)


def _end_with_parent(parent: int) -> None:
    """End this worker when its parent was killed: nobody would ever collect its runs or tell it to stop."""
    while os.getppid() == parent:
        time.sleep(ORPHAN_CHECK_S)
    os._exit(1)


def _work(scenario: Scenario, seed: int) -> Run | Failure:
    return _attempt_run(_worker["simulator"], _worker["world"], scenario, seed)
