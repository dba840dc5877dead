"""Runs on a cluster: an executor over Dask, the extra `cluster`.

Dask's scheduler gives a run whose worker is lost to another worker by itself. Only a run under which several workers
died in a row is given back; it is then made alone, so that one is not blamed for another beside it.

API: distributed 2024.8 and later (`Client.register_plugin`), https://distributed.dask.org.
"""

from __future__ import annotations

import json
import logging
import pickle
import platform
import re
import threading
import time
import uuid
from collections.abc import Callable
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

import rvsg
from rvsg.campaign.attempt import Failure
from rvsg.campaign.parallel import WorkerDied, _attempt_run
from rvsg.core.errors import InputError, SimulationError, how_to_install
from rvsg.scenario.scenario import Scenario
from rvsg.simulation.protocol import Simulator
from rvsg.simulation.run import Run
from rvsg.world.world import World

LOOK_S = 2.0
"""While a run is waited for, the cluster is looked at so often."""
LOST = "The connection to the cluster's scheduler is lost. Start it again, with workers, and resume."
INSTALL = f'The executor "cluster" needs Dask: {how_to_install("cluster")}'


def _check_scheduler_file(path: Path) -> None:
    """Raise ValueError where this is not what a Dask scheduler writes; Dask itself would wait for ever."""
    try:
        written = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"scheduler_file {path} cannot be read: {error.strerror}. Is the scheduler running?") from None
    except ValueError:
        written = None
    if not isinstance(written, dict) or not isinstance(written.get("address"), str):
        raise ValueError(f"scheduler_file {path} holds no scheduler's address: it is not what `dask scheduler` writes")


class Cluster:
    """The workers of a Dask cluster.

    `address` is that of its scheduler, e.g. `tcp://10.0.0.1:8786`, or `scheduler_file` the file it wrote. After
    `patience_s` seconds without any worker the campaign stops; it can be resumed.
    """

    def __init__(self, address: str | None = None, scheduler_file: str | None = None, patience_s: float = 60.0) -> None:
        if (address is None) == (scheduler_file is None):
            raise ValueError("give either address (of the scheduler, e.g. tcp://10.0.0.1:8786) or scheduler_file")
        if address is not None and not re.fullmatch(r"[a-z]+://\S+:\d+", address):
            raise ValueError(f"address must look like tcp://10.0.0.1:8786, got {address}")
        if scheduler_file is not None:
            _check_scheduler_file(Path(str(scheduler_file)))
        if isinstance(patience_s, bool) or not isinstance(patience_s, int | float) or not 0 < patience_s <= 86_400:
            raise ValueError(f"patience_s must be a number of seconds, over 0 and at most a day, got {patience_s!r}")
        self.address = address
        self.scheduler_file = scheduler_file
        self.patience_s = patience_s
        self._client: Any = None
        self._workers: frozenset[str] = frozenset()
        self._under_way: set[Any] = set()

    @property
    def size(self) -> int:
        """The number of workers when they were last looked at."""
        return max(1, len(self._workers))

    def begin(self, simulator: Simulator, world: World, tell: Callable[[str], None]) -> None:
        """Connect, wait for a worker, see that all have our versions, and send them simulator and world."""
        distributed = _distributed()
        import cloudpickle

        _hush()

        where = self.address or f"the address in {self.scheduler_file}"
        try:
            self._client = distributed.Client(
                self.address,
                scheduler_file=self.scheduler_file,
                timeout=min(10.0, self.patience_s),
                set_as_default=False,
            )
            self._client.wait_for_workers(1, timeout=self.patience_s)
        except TimeoutError:
            self.stop(kill=True)
            raise InputError(
                f"The Dask scheduler at {where} has no worker after {self.patience_s:g} s. "
                f"Start some: dask worker {self.address or '--scheduler-file FILE'} --nworkers auto --nthreads 1"
            ) from None
        except (OSError, ValueError) as error:
            self.stop(kill=True)
            raise InputError(
                f"No Dask scheduler answers at {where} ({error}). Is it running? `dask scheduler` starts one."
            ) from None
        self._tell = tell
        self._look()
        self._same_versions(tell)
        shared = cloudpickle.dumps((simulator, world))  # a simulator may stand in a script
        self._token = f"rvsg-{uuid.uuid4().hex}"  # of this campaign in this process; nothing of it is recorded
        self._client.register_plugin(_plugin(distributed, self._token, shared), name=self._token)
        tell(f"{len(self._workers)} workers of the cluster at {where} make the runs.")

    def submit(self, scenario: Scenario, seed: int) -> Any:
        """Ask for a run."""
        future = self._client.submit(_work, self._token, scenario, seed, pure=False, retries=0)
        self._under_way.add(future)
        return future

    def result(self, submitted: Any) -> Run | Failure:
        """Wait for a run; SimulationError where the whole cluster is gone."""
        distributed = _distributed()
        seen = time.monotonic()
        while True:
            failed = submitted.status == "error"  # then what is raised is of the simulator, not of the connection
            try:
                found: Run | Failure = submitted.result(timeout=LOOK_S)
            except distributed.KilledWorker as killed:
                raise WorkerDied from killed
            except (OSError, CancelledError) as error:
                if failed:
                    raise
                if submitted.status != "error":
                    seen = self._still(seen, error)
            else:
                self._under_way.discard(submitted)
                submitted.release()
                return found

    def again(self, scenario: Scenario, seed: int) -> Run | Failure:
        """Make a run alone: when all others under way are done, or have turned out to kill as well."""
        distributed = _distributed()
        self._tell("Several workers of the cluster died under one run; it is made again alone.")
        seen = time.monotonic()
        while waiting := [future for future in self._under_way if future.status == "pending"]:
            try:
                with self._client.as_current():  # it is no default client, which `wait` would take
                    distributed.wait(waiting, timeout=LOOK_S, return_when="FIRST_COMPLETED")
            except (OSError, CancelledError) as error:
                seen = self._still(seen, error)
        return self.result(self.submit(scenario, seed))

    def _still(self, seen: float, error: BaseException) -> float:
        """When there was a worker last, after nothing came; SimulationError where the cluster is gone."""
        if not isinstance(error, TimeoutError) or self._client.status not in ("running", "connecting"):
            raise SimulationError(LOST) from None
        if self._look():
            return time.monotonic()
        if time.monotonic() - seen > self.patience_s:
            raise SimulationError(
                f"The cluster has had no worker for {self.patience_s:g} s. Start workers and resume."
            ) from None
        return seen

    def stop(self, *, kill: bool) -> None:
        """Leave the cluster as it was found."""
        client, self._client = self._client, None
        if client is None:
            return
        left = list(self._under_way)
        self._under_way.clear()
        try:
            if client.status == "running":
                if kill:
                    client.cancel(left, force=True)
                if hasattr(self, "_token"):
                    client.unregister_worker_plugin(self._token)
        except (OSError, TimeoutError):
            pass  # it is gone already; there is nothing left to take back
        finally:
            client.close(timeout=5)

    def _look(self) -> bool:
        """See which workers there are, and say which are gone; whether there is any."""
        try:
            now = frozenset(self._client.scheduler_info(n_workers=-1).get("workers", ()))
        except (OSError, TimeoutError):
            return False
        gone = self._workers - now
        for worker in sorted(gone):
            self._tell(f"The cluster lost the worker at {worker}; its runs are made again by others.")
        self._workers = now
        return bool(now)

    def _same_versions(self, tell: Callable[[str], None]) -> None:
        """Refuse workers with other versions: they would make other runs. Other processors may, and are told."""
        mine = versions()
        theirs: dict[str, dict[str, str]] = self._client.run(versions)
        wrong = [
            f"{worker}: {key} {found.get(key)}, here {value}"
            for worker, found in sorted(theirs.items())
            for key, value in mine.items()
            if key != "processor" and found.get(key) != value
        ]
        if wrong:
            self.stop(kill=True)
            listed = "\n".join(f"  - {line}" for line in wrong[:12])
            raise InputError(f"Workers of the cluster have other versions, and would make other runs:\n{listed}")
        if others := sorted({found["processor"] for found in theirs.values()} - {mine["processor"]}):
            tell(
                f"The cluster has other processors ({', '.join(others)}; here {mine['processor']}): the last bits of "
                "a run may differ between them."
            )


def versions() -> dict[str, str]:
    """What decides the bits of a run, besides the scenario: versions of programs, and the processor."""
    import numba
    import numpy
    import scipy
    from llvmlite import binding

    return {
        "RVSG": rvsg.__version__,
        "Python": ".".join(platform.python_version_tuple()[:2]),
        "numpy": numpy.__version__,
        "numba": numba.__version__,
        "scipy": scipy.__version__,
        "processor": f"{platform.machine()} {binding.get_host_cpu_name()}",
    }


def _distributed() -> Any:
    try:
        import distributed
        import distributed.client
    except ImportError as error:
        raise InputError(f"{INSTALL} ({error})") from None
    return distributed


def _hush() -> None:
    """Dask tells of every lost connection with a traceback; we tell of it in one message."""
    for name in list(logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)


_shared: dict[str, tuple[Simulator, World]] = {}
_one_at_a_time = threading.Lock()


def _plugin(distributed: Any, token: str, shared: bytes) -> Any:
    """Gives simulator and world to every worker, also to one that comes later."""

    class Sharing(distributed.WorkerPlugin):  # type: ignore[misc]
        def setup(self, worker: Any) -> None:
            keep(token, shared)

        def teardown(self, worker: Any) -> None:
            keep(token, None)

    return Sharing()


def keep(token: str, shared: bytes | None) -> None:
    """Keep in this process what the runs of a campaign share; None: forget it."""
    if shared is None:
        _shared.pop(token, None)
    else:
        _shared[token] = pickle.loads(shared)  # noqa: S301 - sent by the campaign, as Dask sends everything


def _work(token: str, scenario: Scenario, seed: int) -> Run | Failure:
    with _one_at_a_time:  # simulators keep buffers per process; workers have one thread, or take turns
        return _attempt_run(*_shared[token], scenario, seed)
