"""Runs on a Dask cluster on this machine."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.campaign.parts import Distance, Disturbed, MemoryLedger, a_scenario, die, measure, plan, searched, warehouse
from tests.coded import coded

from rvsg.core.errors import InputError, SimulationError
from rvsg.runs.attempt import Attempt, Plan
from rvsg.runs.ledger import CachedLedger
from rvsg.runs.runner import FinishedRun, RunMaker, Runner, RunRequest
from rvsg.search.strategies import StudyStrategy
from rvsg.simulation.kinematic import KinematicSimulator

distributed = pytest.importorskip("distributed", reason="Dask is not installed (the extra `cluster`)")

from rvsg.runs.cluster import Cluster, versions  # noqa: E402

pytestmark = [
    pytest.mark.service,
    pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


def local(workers: int) -> Any:
    how = {"threads_per_worker": 1, "dashboard_address": ":0", "host": "127.0.0.1"}
    return distributed.LocalCluster(n_workers=workers, **how)


@pytest.fixture(scope="module")
def cluster() -> Iterator[object]:
    with local(2) as started:
        yield started


def campaign(
    the_plan: Plan,
    address: str,
    told: list[str],
    simulator: object = None,
    ledger: MemoryLedger | None = None,
    now: Callable[[], float] = lambda: 0.0,
    **how: float,
) -> list[Attempt]:
    """Run a campaign on a cluster; the clock stands still, since a busy machine restarts workers slowly."""
    ledger = ledger or MemoryLedger()
    executor = Cluster(address=address, **how)  # type: ignore[arg-type]
    executor._now = now
    runner = Runner(
        simulator or KinematicSimulator(),  # type: ignore[arg-type]
        warehouse(),
        measuring=Distance(measure),
        ledger=CachedLedger(ledger),
        executor=executor,
        notify=told.append,
    )
    return searched(StudyStrategy, the_plan, ledger, changes={"runner": runner})


def alone(the_plan: Plan) -> list[Attempt]:
    return searched(StudyStrategy, the_plan)


def test_a_campaign_on_a_cluster_keeps_what_it_keeps_in_one_process(cluster) -> None:
    the_plan = plan(max_in_flight=3)
    told: list[str] = []
    assert campaign(the_plan, cluster.scheduler_address, told) == alone(the_plan)
    assert told == [f"2 workers of the cluster at {cluster.scheduler_address} make the runs."]


@pytest.mark.exhaustive  # a LocalCluster does not always start workers again that were killed one after the other
@pytest.mark.parametrize("always", [False, True])
def test_a_worker_that_dies_costs_at_most_its_own_run(tmp_path: Path, always: bool) -> None:
    the_plan = plan(scenarios=1, refinements=0, repeats=4, confirmations=0)
    (calm,) = alone(the_plan)
    seed = calm.measurements[2].seed
    told: list[str] = []

    def die_of_one(each: int) -> None:
        if each == seed and (always or not (tmp_path / "died").exists()):
            (tmp_path / "died").touch()
            die()

    with local(2) as own:
        (shaken,) = campaign(
            the_plan, own.scheduler_address, told, Disturbed(die_of_one), now=time.monotonic, patience_s=300.0
        )
    assert list(shaken.measurements) == [m for m in calm.measurements if not always or m.seed != seed]
    assert [failure.seed for failure in shaken.failures] == ([seed] if always else [])
    if always:
        assert any("repeated alone" in line for line in told)


def test_a_run_is_made_again_when_what_is_under_way_beside_it_is_done(cluster) -> None:
    scenario = a_scenario()
    executor = Cluster(address=cluster.scheduler_address)
    executor.start(RunMaker(Disturbed(lambda _: time.sleep(0.3)), warehouse()), lambda _: None)
    beside = [executor.submit(RunRequest(scenario, seed)) for seed in range(4)]
    executor._wait_for_others()
    assert all(submitted.status == "finished" for submitted in beside)
    executor.stop(kill=True)


@pytest.mark.parametrize("error", [TimeoutError("the physics took too long"), FileNotFoundError("no mesh.dae")])
def test_an_error_of_the_simulator_is_none_of_the_connection(cluster, error: Exception) -> None:
    def fail(_: int) -> None:
        raise error

    with pytest.raises(type(error)) as caught:
        campaign(plan(), cluster.scheduler_address, [], Disturbed(fail))
    assert caught.value.args == error.args


def test_a_scheduler_that_is_not_there_is_one_message() -> None:
    with pytest.raises(InputError, check=coded("cluster-unreachable")):
        campaign(plan(), "tcp://127.0.0.1:9", [], patience_s=1.0)


def test_what_answers_without_being_a_scheduler_is_one_message() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            with contextlib.suppress(OSError):  # until the test closes it
                while True:
                    connection, _ = server.accept()
                    with connection:
                        connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        threading.Thread(target=answer, daemon=True).start()
        with pytest.raises(InputError, check=coded("cluster-unreachable")):
            campaign(plan(), f"tcp://127.0.0.1:{server.getsockname()[1]}", [])


def test_a_cluster_without_workers_is_one_message() -> None:
    with (
        local(0) as empty,
        pytest.raises(InputError, check=coded("cluster-no-worker")),
    ):
        campaign(plan(), empty.scheduler_address, [], patience_s=0.5)


def test_a_cluster_that_is_gone_stops_the_campaign_and_the_same_call_resumes_it(cluster, tmp_path: Path) -> None:
    def close_worker_for_good(_: int) -> None:
        marks = len(list(tmp_path.iterdir()))
        (tmp_path / str(marks)).touch()
        if marks == 5:
            worker = distributed.get_worker()
            worker.loop.add_callback(worker.close, nanny=True)
            time.sleep(2)

    told: list[str] = []
    ledger = MemoryLedger()
    with (
        local(1) as small,
        pytest.raises(SimulationError, check=coded("cluster-no-worker")),
    ):
        campaign(
            plan(),
            small.scheduler_address,
            told,
            Disturbed(close_worker_for_good),
            ledger,
            now=itertools.count(0, 25).__next__,
        )
    assert any("lost the worker" in line for line in told)
    assert 0 < len(ledger.runs) < plan().runs
    assert campaign(plan(), cluster.scheduler_address, told, None, ledger) == alone(plan())


def test_a_scheduler_that_ends_stops_the_campaign_with_one_message() -> None:
    own = local(1)
    with Runner(KinematicSimulator(), warehouse(), executor=Cluster(address=own.scheduler_address)) as runner:
        scenario = a_scenario()
        assert isinstance(runner.submit(RunRequest(scenario, 1)).result(), FinishedRun)
        own.close()
        with pytest.raises(SimulationError, check=coded("cluster-lost")):
            runner.submit(RunRequest(scenario, 2)).result()


FREEZES = """
import distributed, sys
if __name__ == "__main__":
    how = {"protocol": "tcp://", "host": "127.0.0.1", "dashboard_address": ":0"}
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, **how) as local:
        print(local.scheduler_address, flush=True)
        sys.stdin.read()
"""


@pytest.fixture
def frozen() -> Iterator[subprocess.Popen[str]]:
    """A cluster in a process of its own, to be stopped as if its machine were lost: no connection is closed."""
    command = [sys.executable, "-c", FREEZES]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


def test_a_scheduler_whose_machine_is_lost_stops_the_campaign(
    frozen: subprocess.Popen[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert frozen.stdout is not None
    executor = Cluster(address=frozen.stdout.readline().strip(), patience_s=300.0)
    scenario = a_scenario()
    with Runner(KinematicSimulator(), warehouse(), executor=executor) as runner:
        assert isinstance(runner.submit(RunRequest(scenario, 1)).result(), FinishedRun)
        os.kill(frozen.pid, signal.SIGSTOP)
        monkeypatch.setattr("rvsg.runs.cluster.CONNECT_S", 1.0)
        executor.patience_s = 1.0
        with pytest.raises(SimulationError, check=coded("cluster-no-worker")):
            runner.submit(RunRequest(scenario, 2)).result()
    with pytest.raises(InputError, check=coded("cluster-unreachable")):
        executor.start(RunMaker(KinematicSimulator(), warehouse()), lambda _: None)


def test_workers_of_other_versions_are_refused(cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = versions() | {"numba": "0.1"}
    monkeypatch.setattr("rvsg.runs.cluster.versions", lambda: mine)
    monkeypatch.setattr(distributed.Client, "run", lambda self, function: {"tcp://w": versions_of_old})
    versions_of_old = mine | {"numba": "0.2"}
    with pytest.raises(InputError, check=coded("cluster-versions")):
        campaign(plan(), cluster.scheduler_address, [])


def test_a_worker_closes_its_copy_of_the_simulator(cluster, tmp_path: Path) -> None:
    mark = tmp_path / "closed"

    class Closes(KinematicSimulator):
        def close(self) -> None:
            mark.touch()

    with Runner(Closes(), warehouse(), executor=Cluster(address=cluster.scheduler_address)) as runner:
        assert isinstance(runner.submit(RunRequest(a_scenario(), 1)).result(), FinishedRun)
        assert not mark.exists()
    assert mark.exists()


@pytest.mark.parametrize(
    "options",
    [{}, {"address": "a", "scheduler_file": "b"}, {"address": "tcp://a:1", "patience_s": 0.0}, {"address": "lab"}],
)
def test_options_that_say_no_place_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(ValueError):
        Cluster(**options)  # type: ignore[arg-type]
