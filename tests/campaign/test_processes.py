"""Worker processes that are killed at any moment."""

from __future__ import annotations

import os
import pickle
import random
import signal
import threading
import time
from pathlib import Path

import pytest
from tests.campaign.parts import Disturbed, MemoryLedger, a_scenario, die, parts, plan, searched, warehouse
from tests.coded import coded

from rvsg.core.errors import FileError, SimulationError
from rvsg.runs.attempt import Attempt, Failure
from rvsg.runs.runner import FinishedRun, RunMaker, RunRequest
from rvsg.runs.worker_pool import ATTEMPTS, Processes
from rvsg.search.strategies import StudyStrategy
from rvsg.simulation.kinematic import KinematicSimulator

pytestmark = pytest.mark.slow
STUCK_S = 300.0
"""A campaign that takes longer hangs; it takes a few seconds."""


def started(simulator: object, jobs: int = 2) -> Processes:
    processes = Processes(jobs)
    processes.start(RunMaker(simulator, warehouse()), lambda _: None)  # type: ignore[arg-type]
    return processes


def worker_ids(processes: Processes) -> list[int]:
    return [worker.process.pid for worker in list(processes.workers)]


def killed_while_it_runs(kills: int, seed: int) -> list[Attempt]:
    """A campaign with two workers, of which one is killed now and then at a moment of chance."""
    the_plan = plan(scenarios=2, refinements=1, repeats=4)
    chance, result = random.Random(seed), []
    made = parts(ledger := MemoryLedger(), simulator=Disturbed(lambda _: time.sleep(0.02)), jobs=2)

    def campaign() -> None:
        result.extend(searched(StudyStrategy, the_plan, ledger, changes={"runner": made.runner}))

    thread = threading.Thread(target=campaign, daemon=True)
    thread.start()
    executor = made.runner._executor
    assert isinstance(executor, Processes)
    for _ in range(kills):
        thread.join(chance.uniform(0.0, 2.5))
        if ids := worker_ids(executor):
            try:
                os.kill(chance.choice(ids), signal.SIGKILL)
            except ProcessLookupError:
                continue
    thread.join(STUCK_S)
    assert not thread.is_alive(), "the campaign hangs"
    return result


def test_a_campaign_whose_workers_are_killed_has_the_same_records() -> None:
    calm = searched(StudyStrategy, plan(scenarios=2, refinements=1, repeats=4))
    for seed in range(2):
        assert killed_while_it_runs(2, seed) == calm


def test_the_death_of_an_idle_worker_is_not_noticed() -> None:
    processes = started(KinematicSimulator(), jobs=1)
    first = processes.result(processes.submit(RunRequest(a_scenario(), 1)))
    os.kill(worker_ids(processes)[0], signal.SIGKILL)
    again = processes.result(processes.submit(RunRequest(a_scenario(), 1)))
    processes.stop(kill=False)
    assert again == first


def test_a_worker_that_dies_is_noticed_though_its_child_holds_the_pipe(tmp_path: Path) -> None:
    def fork_and_die(seed: int) -> None:
        if seed == 2:
            if os.fork() == 0:
                while not (tmp_path / "end").exists():
                    time.sleep(0.1)
                os._exit(0)
            die()

    processes = started(Disturbed(fork_and_die), jobs=1)
    pending = [processes.submit(RunRequest(a_scenario(), seed)) for seed in (1, 2, 3)]
    done = []
    waiting = threading.Thread(target=lambda: done.extend(map(processes.result, pending)), daemon=True)
    waiting.start()
    waiting.join(STUCK_S)
    (tmp_path / "end").touch()
    assert [type(each) for each in done] == [FinishedRun, Failure, FinishedRun]
    processes.stop(kill=True)


def test_a_result_that_is_half_written_is_made_again(tmp_path: Path) -> None:
    def write_half_once(_: int) -> None:
        if not (tmp_path / "mark").exists():
            (tmp_path / "mark").touch()
            from rvsg.runs import worker_pool

            def half(stream, message: bytes) -> None:  # type: ignore[no-untyped-def]
                data = pickle.dumps(message)
                stream.write(data[: len(data) // 2])
                stream.flush()
                die()

            worker_pool.send = half

    processes = started(Disturbed(write_half_once))
    submitted = [processes.submit(RunRequest(a_scenario(), seed)) for seed in range(4)]
    found = [processes.result(each) for each in submitted]
    processes.stop(kill=False)
    expected = RunMaker(KinematicSimulator(), warehouse())
    assert found == [expected(RunRequest(a_scenario(), seed)) for seed in range(4)]


def test_a_run_that_always_kills_is_tried_alone_and_blamed_alone(tmp_path: Path) -> None:
    def die_of_one(seed: int) -> None:
        if seed == 2:
            (tmp_path / f"died {time.monotonic_ns()}").touch()
            die()

    processes = started(Disturbed(die_of_one))
    submitted = [processes.submit(RunRequest(a_scenario(), seed)) for seed in range(6)]
    found = [processes.result(each) for each in submitted]
    processes.stop(kill=False)
    assert [isinstance(each, Failure) for each in found] == [False, False, True, False, False, False]
    assert len(list(tmp_path.iterdir())) == ATTEMPTS


def test_an_error_of_the_simulator_comes_back_as_it_is(capfd: pytest.CaptureFixture[str]) -> None:
    def fail(seed: int) -> None:
        print("a simulator may print")
        if seed:
            raise FileError("mesh.dae", "the file does not exist")

    processes = started(Disturbed(fail), jobs=1)
    assert isinstance(processes.result(processes.submit(RunRequest(a_scenario(), 0))), FinishedRun)
    with pytest.raises(FileError) as caught:
        processes.result(processes.submit(RunRequest(a_scenario(), 1)))
    assert (caught.value.path, caught.value.reason) == (Path("mesh.dae"), "the file does not exist")
    processes.stop(kill=False)
    assert capfd.readouterr() == ("", "a simulator may print\n" * 2)


class Unloadable(KinematicSimulator):
    def __setstate__(self, state: object) -> None:
        raise ImportError("no module named there")

    def __getstate__(self) -> object:
        return {"kept": 1}


@pytest.mark.parametrize(
    ("simulator", "command", "start_s"),
    [
        (Unloadable(), None, 600.0),  # it cannot load the simulator
        (KinematicSimulator(), ["sleep", "1000"], 0.1),  # it never begins to work
        (KinematicSimulator(), ["false"], 600.0),  # it dies at its start again and again
    ],
)
def test_workers_that_cannot_begin_to_work_are_one_message(
    simulator: KinematicSimulator, command: list[str] | None, start_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    if command is not None:
        monkeypatch.setattr("rvsg.runs.worker_pool.command", lambda *_: command)
    monkeypatch.setattr("rvsg.runs.worker_pool.START_S", start_s)
    processes = started(simulator)
    for seed in (0, 1):
        with pytest.raises(SimulationError, check=coded("worker-start")):
            processes.result(processes.submit(RunRequest(a_scenario(), seed)))
    processes.stop(kill=True)
