"""Stacks in another process: the protocol byte by byte, both clients, and every way to misbehave."""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.coded import coded
from tests.simulation.parts import TIAGO, route, standing

import rvsg
from rvsg.core.errors import InputError
from rvsg.core.records import Pose
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.run import Outcome, Run
from rvsg.simulation.stacks import external_process as frames
from rvsg.simulation.stacks.external_process import write_clients_to
from rvsg.stacks import StackChoice, StackError, Task
from rvsg.testing import check_stack

ROUTE, HUMAN = route((-2.0, 0.0), (1.5, 0.0), 12.0), standing(0.0, 2.0)
EXAMPLES = Path(__file__).parents[2] / "examples" / "stacks"
HEAD = "import os, struct, sys, time\nimport rvsg_client\nOUT = os.dup(1)\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_clients_to(tmp_path)
    return tmp_path


def script(folder: Path, body: str) -> str:
    """The command of a planner in Python whose `command` has this body."""
    text = HEAD + "class Mine(rvsg_client.Planner):\n    scans = people = False\n    def command(self, seen):\n"
    text += "".join(f"        {line}\n" for line in body.splitlines()) + "rvsg_client.serve(Mine())\n"
    (folder / "mine.py").write_text(text)
    return f"exec:{sys.executable} {folder / 'mine.py'}"


def drive(choice: StackChoice) -> Run:
    return simulate_agents(empty_room(), ROUTE, [HUMAN], stack=choice)


def test_the_task_is_described_byte_by_byte() -> None:
    world = empty_room()
    start, goals = Pose(x=1.0, y=2.0, yaw=0.5), (Pose(x=3.0, y=4.0),)
    task = Task(robot=TIAGO, world=world, start=start, goals=goals, time_limit_s=20.0, seed=7, period_s=0.05)
    frame = frames.task_frame(task)
    assert frame[:1] == b"R"
    assert struct.unpack_from("<Q2d", frame, 1) == (7, 0.05, 20.0)
    assert struct.unpack_from("<3d3dI3d", frame, 25) == (1.0, 0.5, 1.0, 1.0, 2.0, 0.5, 1, 3.0, 4.0, 0.0)
    (size,) = struct.unpack_from("<I", frame, 101)
    rows, columns, resolution, x, y = struct.unpack_from("<2I3d", frame, 105 + size)
    assert (rows, columns, resolution, x, y) == (120, 120, 0.05, -3.0, -3.0)
    assert frame[105 + size + 32 :] == world.occupancy.cells.tobytes()


@pytest.mark.parametrize(
    "answer", [b"", b"V", struct.pack("<cIB2d", b"V", 2, 1, 0, 0), struct.pack("<cIB2d", b"V", 1, 9, 0, 0), b"hello"]
)
def test_an_answer_that_is_none_is_refused(answer: bytes) -> None:
    with pytest.raises(StackError, check=coded("stack-answer")):
        frames.read_answer(answer, 1)


def test_the_answer_to_the_hello_says_what_is_sent() -> None:
    assert frames.read_hello(b'H{"protocol": 1, "scans": false}') == frames.Wanted(False, True, True, 1)
    for answer in (b"", b"H", b"H{}", b'H{"protocol": 3}', b'H{"protocol": true}', b"R", b"H[1]", b"H\xff"):
        with pytest.raises(StackError):
            frames.read_hello(answer)


def test_a_process_says_which_of_its_parameters_may_be_tuned() -> None:
    (found,) = frames.read_hello(b'H{"protocol": 2, "tunable": [{"name": "gain", "low": 0.5, "high": 4.0}]}').tunable
    assert (found.name, found.low, found.high) == ("parameters.gain", 0.5, 4.0)
    for wrong in (b'[{"low": 1, "high": 2}]', b'[{"name": "gain", "low": 2, "high": 1}]', b"[3]"):
        with pytest.raises(StackError, check=coded("stack-hello")):
            frames.read_hello(b'H{"protocol": 2, "tunable": ' + wrong + b"}")


def test_protocol_2_adds_the_speed_to_the_left() -> None:
    assert frames.read_hello(b'H{"protocol": 2}').protocol == 2
    assert frames.read_answer(struct.pack("<cIB2d", b"V", 7, 1, 0.5, 0.2), 7) == (1, (0.5, 0.2))
    wide = struct.pack("<cIB3d", b"V", 7, 1, 0.5, 0.2, -0.3)
    assert frames.read_answer(wide, 7, 2) == (1, (0.5, -0.3, 0.2))
    with pytest.raises(StackError):
        frames.read_answer(wide, 7, 1)


def test_a_channel_never_waits_for_ever() -> None:
    reads, writes = os.pipe()
    back, _other = os.pipe()
    channel = frames.Channel(back, writes)
    with pytest.raises(StackError, check=coded("stack-late")):
        channel.receive(0.05)
    with pytest.raises(StackError, check=coded("stack-late")):
        channel.send(bytes(1_000_000), 0.05)  # nobody reads
    os.write(_other, struct.pack("<I", 2**31))
    with pytest.raises(StackError, check=coded("stack-answer")):
        channel.receive(1.0)
    os.write(_other, struct.pack("<I", 22) + b"V123")
    os.close(_other)
    with pytest.raises(StackError, check=coded("stack-ended")):
        channel.receive(1.0)
    for descriptor in (reads, writes, back):
        os.close(descriptor)


def test_a_stack_that_writes_on_and_on_and_does_not_read_is_told_at_once() -> None:
    question, other = os.pipe()
    back, answers = os.pipe()
    channel = frames.Channel(back, other)
    os.set_blocking(answers, False)
    stop = threading.Event()

    def flood() -> None:
        while not stop.is_set():
            with contextlib.suppress(BlockingIOError):
                os.write(answers, b"x" * 65_536)

    thread = threading.Thread(target=flood)
    thread.start()
    try:
        with pytest.raises(StackError, check=coded("stack-unasked")):
            channel.send(bytes(10_000_000), 60.0)
    finally:
        stop.set()
        thread.join()
    for descriptor in (question, other, back, answers):
        os.close(descriptor)


def test_what_cannot_be_started_is_one_error(tmp_path: Path) -> None:
    for name in ("exec:./no_such_program", "exec:", "exec:tcp://example.org:80", "exec:tcp://127.0.0.1:0"):
        with pytest.raises(InputError):
            StackChoice.of(name)
    with pytest.raises(InputError):
        StackChoice.of("exec:sh", {"timeout_s": 0})
    with pytest.raises(InputError):
        StackChoice.of(f"exec:{shutil.which('true')}").driver.prepare(lambda _: None)


def test_another_program_is_another_version(folder: Path) -> None:
    one = StackChoice.of(script(folder, "return 0.3, 0.0")).record
    other = StackChoice.of(script(folder, "return 0.4, 0.0")).record
    assert one.options == other.options and one.version != other.version


@pytest.mark.slow
def test_the_python_client_passes_the_exam(folder: Path) -> None:
    body = """import math
x, y, yaw = seen.pose
away = [math.hypot(px - x, py - y) for px, py in seen.plan]
k = away.index(min(away))
while k + 1 < len(away) and away[k] < 0.6: k += 1
arrived = away[-1] < 0.2
heading = math.atan2(seen.plan[k][1] - y, seen.plan[k][0] - x)
error = math.remainder((seen.goal[2] if arrived else heading) - yaw, math.tau)
print("noise on standard output")
return (0.0, max(-1.0, min(1.0, 2 * error))) if arrived or abs(error) > 0.8 else (0.5, math.sin(error) / 0.6)"""
    assert "passes: it crosses an empty room" in check_stack(script(folder, body))


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++")
def test_the_cpp_client_drives_and_is_told_everything(folder: Path) -> None:
    shutil.copy(EXAMPLES / "follow_the_plan.cpp", folder)
    build = ["g++", "-O1", "-std=c++17", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([*build, "follow_the_plan.cpp", "-o", "planner"], cwd=folder, check=True)
    check_stack(f"exec:{folder / 'planner'}")
    (folder / "probe.cpp").write_text(PROBE)
    subprocess.run([*build, "probe.cpp", "-o", "probe"], cwd=folder, check=True)
    run = drive(StackChoice.of(f"exec:{folder / 'probe'}"))
    told: Any = run.details["stack"]
    assert "fault" not in told, told


PROBE = """#include <cmath>
#include "rvsg_client.hpp"
struct Probe : rvsg::Planner {
  void reset(const rvsg::Task &t) override {
    if (t.map_rows != 120 || t.map_cells[0] != 100 || t.goals.size() != 1 || t.max_speed != 1.0) throw 1;
    if (t.robot_json.find("tiago_omni") == std::string::npos) throw 2;
  }
  rvsg::Answer command(const rvsg::Observation &seen) override {
    if (seen.scans.size() != 2 || seen.scans[1].ranges.size() != 818) throw 3;
    if (!(seen.scans[0].ranges[400] > 0.1f && seen.scans[0].ranges[400] < 9.0f)) throw 4;
    if (seen.people.size() != 1 || std::abs(seen.people[0].y - 2.0f) > 0.3f) throw 5;
    if (seen.costmap.size() != 3600 || std::abs(seen.costmap_resolution - 0.05) > 1e-12) throw 6;
    if (seen.plan.size() < 4 || std::abs(seen.goal.x - 1.5) > 0.3) throw 7;
    return rvsg::velocity(0.5, 0.0);
  }
};
int main() { Probe probe; return rvsg::serve(probe); }
"""

FAULTS = {
    "crash": ("raise ValueError('no map')", "ended (exit code 1: "),
    "exit": ("os._exit(3)", "ended (exit code 3)"),
    "signal": ("os.abort()", "ended (signal SIGABRT"),
    "middle": ("os.write(4, b'')\nos._exit(0) if seen.t < 1 else None\nreturn None", ""),
    "hang": ("time.sleep(1000)", "it did not answer within 10 s"),
    "status": ("return rvsg_client.REACHED", ""),
    "flood": ("os.write(OUT, b'x' * 60000)", "standard output"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("body", "said"), FAULTS.values(), ids=FAULTS)
def test_a_process_that_fails_ends_its_run_and_the_next_gets_a_fresh_one(folder: Path, body: str, said: str) -> None:
    failed = folder / "failed"
    once = f"if seen.t > 0.5 and not os.path.exists({str(failed)!r}):\n    open({str(failed)!r}, 'w').close()\n"
    lines = "\n".join(f"    {line}" for line in body.splitlines())
    limits = {"timeout_s": 10.0 if "sleep" in body else 300.0, "start_timeout_s": 300.0}
    choice = StackChoice.of(script(folder, f"{once}{lines}\nreturn 0.5, 0.0"), limits)
    first, second = drive(choice), drive(choice)
    assert first.outcome is Outcome.STACK_FAILED
    told: Any = first.details["stack"]
    assert told["fault"] and said in told["fault"] and 0.4 < told["fault_t"] < 0.7
    assert second.outcome is Outcome.REACHED
    choice.driver.close()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="there is no /proc to look for processes in")
@pytest.mark.parametrize("jobs", [1, 2])
def test_no_process_survives_a_campaign(folder: Path, jobs: int) -> None:
    stack = script(folder, f"open({str(folder)!r} + '/pid.%d' % os.getpid(), 'w').close()\nreturn 0.4, 0.0")
    campaign = rvsg.Campaign.create(
        folder / "campaign", stack=stack, generator="heuristic", scenarios=1, refinements=0, repeats=2, confirmations=0,
        search_anyway=True,
    )  # fmt: skip
    for _ in campaign.run(jobs=jobs):
        pass
    started = {int(path.suffix[1:]) for path in folder.glob("pid.*")}
    assert started and not [pid for pid in started if Path(f"/proc/{pid}").exists()]


@pytest.fixture
def server() -> Iterator[str]:
    """A planner on a loopback socket, served in a thread by the client file that ships."""
    import importlib.util

    from rvsg.simulation.stacks import external_process

    path = Path(external_process.__file__).parent / "clients" / "rvsg_client.py"
    spec = importlib.util.spec_from_file_location("rvsg_client_under_test", path)
    assert spec is not None and spec.loader is not None
    client = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(client)

    class Mine(client.Planner):  # type: ignore[name-defined,misc]
        people = scans = False

        def command(self, seen: Any) -> tuple[float, float]:
            return 0.5, 0.0

    listening = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        connection, _ = listening.accept()
        with connection:
            client.serve(Mine(), connection.fileno(), connection.fileno())

    thread = threading.Thread(target=serve)
    thread.start()
    yield f"exec:tcp://127.0.0.1:{listening.getsockname()[1]}"
    thread.join(300.0)
    listening.close()
    assert not thread.is_alive()


def test_a_server_on_this_machine_drives_over_a_socket(server: str) -> None:
    choice = StackChoice.of(server)
    run = drive(choice)
    choice.driver.close()
    assert run.outcome is Outcome.REACHED
    assert np.isfinite(run.trajectory.x).all()
