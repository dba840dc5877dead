"""Runs on a cluster: an executor over Dask, the extra `cluster`.

Dask's scheduler gives a run whose worker is lost to another worker. It returns only a run under which several workers
died in a row; that run is repeated once with nothing else under way, and becomes a Failure if it kills again.

API: distributed 2024.8 and later (`Client.register_plugin`), https://distributed.dask.org.
"""

from __future__ import annotations

import contextlib
import logging
import pickle
import platform
import re
import threading
import time
import uuid
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from pathlib import Path
from typing import Any

import rvsg
from rvsg.core.errors import FileError, InputError, SimulationError, how_to_install
from rvsg.core.inputs import parse_json, read_text
from rvsg.runs.attempt import Failure, Measurement
from rvsg.runs.runner import FinishedRun, RunMaker, RunRequest
from rvsg.runs.worker_pool import START_S

LOOK_S = 2.0
"""The time between two looks at the cluster while a run is awaited."""
CONNECT_S = 10.0
"""The longest wait for an answer of the scheduler."""
LOST = "The connection to the cluster's scheduler is lost. Start it again, with workers, and resume."
INSTALL = f'The executor "cluster" needs Dask: {how_to_install("cluster")}'


def _check_scheduler_file(path: Path) -> None:
    """Raise ValueError unless a Dask scheduler wrote this file; Dask itself would wait without end."""
    try:
        written = parse_json(read_text(path), path)
    except FileError as error:
        raise ValueError(f"scheduler_file {error}. Is the scheduler running?") from None
    if not isinstance(written, dict) or not isinstance(written.get("address"), str):
        raise ValueError(f"scheduler_file {path} holds no scheduler's address: it is not what `dask scheduler` writes")


class Cluster:
    """An Executor over the workers of a Dask cluster.

    Args:
        address: The scheduler's address, e.g. `tcp://10.0.0.1:8786`.
        scheduler_file: Instead of the address, the file that the scheduler wrote.
        patience_s: The campaign stops after this many seconds without any worker, or without an answer of the
            scheduler; it can be resumed.
    """

    code_options = ("address", "scheduler_file")  # messages of Dask are pickles

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
        self._under_way: dict[Any, RunRequest] = {}
        self._now: Callable[[], float] = time.monotonic

    @property
    def size(self) -> int:
        """The number of workers at the last look."""
        return max(1, len(self._workers))

    def start(self, maker: RunMaker, notify: Callable[[str], None]) -> None:
        """Connect, wait for a worker, compare versions, and send `maker` to every worker.

        Raises:
            InputError: No scheduler answers, it has no worker, or a worker has other versions.
        """
        distributed = _distributed()
        import cloudpickle

        for name in list(logging.root.manager.loggerDict):  # a lost connection is one message of ours, no traceback
            if name.partition(".")[0] in ("distributed", "tornado", "asyncio"):
                logging.getLogger(name).setLevel(logging.CRITICAL + 1)

        class Client(distributed.Client):  # type: ignore[misc, name-defined]
            def __del__(self) -> None:  # one that could not connect is given up at once; `stop` closes the others
                return

        where = self.address or f"the address in {self.scheduler_file}"
        try:
            self._client = _within(
                2.0 * CONNECT_S if self.scheduler_file is None else CONNECT_S + self.patience_s,
                Client,
                self.address,
                scheduler_file=self.scheduler_file,
                timeout=min(CONNECT_S, self.patience_s),
                set_as_default=False,
            )
            _within(CONNECT_S + self.patience_s, self._client.wait_for_workers, 1, timeout=self.patience_s)
        except Exception as error:  # Dask takes whatever else answers there for lengths of messages
            connected = self._client is not None
            self.stop(kill=True)
            if connected and isinstance(error, TimeoutError):
                raise InputError(
                    f"The Dask scheduler at {where} has no worker after {self.patience_s:g} s. "
                    f"Start some: dask worker {self.address or '--scheduler-file FILE'} --nworkers auto --nthreads 1",
                    code="cluster-no-worker",
                ) from None
            raise InputError(
                f"No Dask scheduler answers at {where} ({str(error) or type(error).__name__}). Is it running? "
                "`dask scheduler` starts one, and prints its address.",
                code="cluster-unreachable",
            ) from None
        self._notify = notify
        self._look()
        shared = cloudpickle.dumps(maker)  # a simulator may be defined in a script
        try:
            self._compare_versions(notify)
            self._token = f"rvsg-{uuid.uuid4().hex}"  # names this campaign in this process; never recorded
            sharing = _plugin(distributed, self._token, shared)
            _within(START_S, self._client.register_plugin, sharing, name=self._token)
        except (OSError, CancelledError) as error:
            self.stop(kill=True)
            raise InputError(
                f"The cluster at {where} is gone, or was not ready within {START_S:g} s ({error}). Start it again, "
                "with workers.",
                code="cluster-unreachable",
            ) from None
        notify(f"{len(self._workers)} workers of the cluster at {where} make the runs.")

    def submit(self, job: RunRequest) -> Any:
        """Start a run; return Dask's future for it."""
        future = self._client.submit(_work, self._token, job, pure=False, retries=0)
        self._under_way[future] = job
        return future

    def result(self, submitted: Any) -> FinishedRun | Measurement | Failure:
        """Wait for a run; SimulationError if the whole cluster is gone."""
        killed, job = _distributed().KilledWorker, self._under_way[submitted]
        for again in (False, True):
            if again:
                self._notify("Several workers of the cluster died under one run; it is repeated alone.")
                self._wait_for_others()
                submitted = self.submit(job)
            try:
                return self._wait(submitted)
            except killed:
                del self._under_way[submitted]
        return Failure(seed=job.seed, reason="workers of the cluster died again and again while they ran this scenario")

    def _wait(self, future: Any) -> FinishedRun | Measurement | Failure:
        """Wait for one future, and look at the cluster from time to time."""
        distributed = _distributed()
        seen = self._now()
        while True:
            failed = future.status == "error"  # then the error is the simulator's, not the connection's
            try:
                result: FinishedRun | Measurement | Failure = future.result(timeout=LOOK_S)
            except distributed.KilledWorker:
                raise
            except (OSError, CancelledError) as error:
                if failed:
                    raise
                if future.status != "error":
                    seen = self._last_seen(seen, error)
            else:
                del self._under_way[future]
                future.release()
                return result

    def _wait_for_others(self) -> None:
        """Wait until every other run is done, or has killed its workers as well."""
        distributed = _distributed()
        seen = self._now()
        while waiting := [future for future in self._under_way if future.status == "pending"]:
            try:
                with self._client.as_current():  # it is no default client, which `wait` would take
                    distributed.wait(waiting, timeout=LOOK_S, return_when="FIRST_COMPLETED")
            except (OSError, CancelledError) as error:
                seen = self._last_seen(seen, error)

    def _last_seen(self, seen: float, error: BaseException) -> float:
        """Return when there was a worker last, after waiting for one; SimulationError if the cluster is gone."""
        if not isinstance(error, TimeoutError) or self._client.status not in ("running", "connecting"):
            raise SimulationError(LOST, code="cluster-lost") from None
        if self._look():
            return self._now()
        if self._now() - seen > self.patience_s:
            raise SimulationError(
                f"The cluster has had no worker for {self.patience_s:g} s, or its scheduler does not answer. Start "
                "workers and resume.",
                code="cluster-no-worker",
            ) from None
        return seen

    def stop(self, *, kill: bool) -> None:
        """Cancel what is under way if `kill`, remove `maker` from the workers, and disconnect."""
        client, self._client = self._client, None
        if client is None:
            return
        left = list(self._under_way)
        self._under_way.clear()
        try:
            if client.status == "running":
                if kill:
                    _within(CONNECT_S, client.cancel, left, force=True)
                if hasattr(self, "_token"):
                    _within(CONNECT_S, client.unregister_worker_plugin, self._token)
        except (OSError, CancelledError):
            pass  # the cluster is gone already
        finally:
            with contextlib.suppress(TimeoutError):  # it does not answer the farewell either
                client.close(timeout=5)

    def _look(self) -> bool:
        """Update the set of workers, report those that are gone, and return whether there is any."""
        try:
            now = frozenset(_within(CONNECT_S, self._client.scheduler_info, n_workers=-1).get("workers", ()))
        except OSError:
            return False
        gone = self._workers - now
        for worker in sorted(gone):
            self._notify(f"The cluster lost the worker at {worker}; other workers repeat its runs.")
        self._workers = now
        return bool(now)

    def _compare_versions(self, notify: Callable[[str], None]) -> None:
        """Refuse workers whose versions would give other runs; report other processors, which may."""
        mine = versions()
        theirs: dict[str, dict[str, str]] = _within(START_S, self._client.run, versions)
        wrong = [
            f"{worker}: {key} {its.get(key)}, here {value}"
            for worker, its in sorted(theirs.items())
            for key, value in mine.items()
            if key != "processor" and its.get(key) != value
        ]
        if wrong:
            self.stop(kill=True)
            listed = "\n".join(f"  - {line}" for line in wrong[:12])
            raise InputError(
                f"Workers of the cluster have other versions, and would make other runs:\n{listed}",
                code="cluster-versions",
            )
        if others := sorted({its["processor"] for its in theirs.values()} - {mine["processor"]}):
            notify(
                f"The cluster has other processors ({', '.join(others)}; here {mine['processor']}): the last bits of "
                "a run may differ between them."
            )


def versions() -> dict[str, str]:
    """Return what decides the bits of a run besides the scenario: versions, and the processor."""
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


def _within(limit_s: float, call: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """Return what a call of Dask's client returns.

    Most of these calls wait as long as the connection to the scheduler is open, also where its machine was lost.

    Raises:
        TimeoutError: There is no answer within the limit; the call waits on in its own thread.
    """
    answer: Future[Any] = Future()

    def ask() -> None:
        try:
            answer.set_result(call(*arguments, **named))
        except BaseException as error:
            answer.set_exception(error)

    threading.Thread(target=ask, name="rvsg-cluster", daemon=True).start()
    return answer.result(limit_s)


def _distributed() -> Any:
    try:
        import distributed
        import distributed.client
    except ImportError as error:
        raise InputError(f"{INSTALL} ({error})") from None
    return distributed


_shared: dict[str, RunMaker] = {}
_one_at_a_time = threading.Lock()


def _plugin(distributed: Any, token: str, shared: bytes) -> Any:
    """Return the Dask plug-in that gives the pickled RunMaker to every worker, also to a later one."""

    class Sharing(distributed.WorkerPlugin):  # type: ignore[misc]
        def setup(self, worker: Any) -> None:
            keep(token, shared)

        def teardown(self, worker: Any) -> None:
            keep(token, None)

    return Sharing()


def keep(token: str, shared: bytes | None) -> None:
    """Keep the RunMaker of a campaign in this process; None: close and forget it."""
    if shared is not None:
        _shared[token] = pickle.loads(shared)  # noqa: S301 - sent by the campaign, as Dask sends everything
        return
    maker = _shared.pop(token, None)
    if maker is not None and _one_at_a_time.acquire(blocking=False):  # a run that was cancelled may go on
        try:
            maker.close()
        finally:
            _one_at_a_time.release()


def _work(token: str, job: RunRequest) -> FinishedRun | Measurement | Failure:
    with _one_at_a_time:  # simulators keep buffers per process, and a Dask worker may have several threads
        return _shared[token](job)
