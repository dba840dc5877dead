"""Stacks in another process: a command that RVSG starts, or a server on this machine that it connects to.

Both sides exchange frames: a length (4 bytes, unsigned, little-endian) and as many bytes, of which the first is the
kind of the frame. docs/reference/stack-protocol.md describes every byte.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import select
import shlex
import shutil
import signal
import socket
import struct
import subprocess
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import IO, Any, ClassVar, NamedTuple, Never, TypeVar

import numpy as np

from rvsg.core.errors import InputError
from rvsg.core.files import write_whole
from rvsg.core.plugins import ignore
from rvsg.robots.robot import Robot
from rvsg.simulation.stacks.parameters import Parameter
from rvsg.simulation.stacks.protocol import (
    Command,
    Ended,
    LocalObservation,
    LocalPlanner,
    Observation,
    StackError,
    Task,
    WholeStack,
)

PROTOCOLS = (1, 2)
"""Those that are spoken. From 2 on observations and answers have a speed to the left."""
LENGTH = struct.Struct("<I")
OBSERVATION = struct.Struct("<cId3d2d3d3d3d5I")
"""Kind, number, t, pose, velocity, goal, map_from_odom, origin and resolution of the costmap; then the numbers of plan
points, rows, columns, people and lidars. From protocol 2 on the measured speed to the left follows."""
TASK = struct.Struct("<cQ2d3d3dI")
"""Kind, seed, period, time limit, limits of the robot, start, number of goals."""
MAP = struct.Struct("<2I3d")
"""Rows, columns, resolution and origin of the map."""
SCAN = struct.Struct("<I6d")
"""Rays, t, bearing of the first ray, step, place x, y, yaw in the base."""
ANSWER = struct.Struct("<cIB2d")
"""Kind, number of the observation, status, v, w."""
LATERAL_ANSWER = struct.Struct("<cIB3d")
"""The same from protocol 2 on, with the speed to the left at the end."""
LATERAL = struct.Struct("<d")
NO_COMMAND, VELOCITY, REACHED, GAVE_UP = range(4)
LARGEST_ANSWER = 65_536
NO_PLAN, NO_CELLS, NOBODY = np.zeros((0, 2)), np.zeros((0, 0), np.uint8), np.zeros((0, 4))


T = TypeVar("T")


class Wanted(NamedTuple):
    """What a stack wants to be told, by its answer to the hello."""

    scans: bool
    people: bool
    costmap: bool
    protocol: int = 1
    tunable: tuple[Parameter, ...] = ()
    """What of its parameters may be tuned."""


def task_frame(task: Task) -> bytes:
    """Return the frame that begins a run."""
    limits, occupancy = task.robot.limits, task.world.occupancy
    goals = [(pose.x, pose.y, pose.yaw) for pose in task.goals]
    cells = np.ascontiguousarray(occupancy.cells, np.uint8)
    robot = task.robot.model_dump_json().encode()
    head = TASK.pack(
        b"R", task.seed % 2**64, task.period_s, task.time_limit_s, limits.speed_m_s, limits.reverse_m_s,
        limits.yaw_rate_rad_s, task.start.x, task.start.y, task.start.yaw, len(goals),
    )  # fmt: skip
    origin = occupancy.origin
    return b"".join((
        head,
        np.array(goals, "<f8").tobytes(),
        LENGTH.pack(len(robot)),
        robot,
        MAP.pack(*cells.shape, occupancy.resolution, origin.x, origin.y),
        cells.tobytes(),
    ))  # fmt: skip


def observation_frame(number: int, seen: LocalObservation, lidars: int, wanted: Wanted, *, local: bool) -> bytes:
    """Return an observation as a frame."""
    plan = seen.plan if local else NO_PLAN
    cells = seen.costmap.cells if local and wanted.costmap else NO_CELLS
    people = seen.people() if wanted.people else NOBODY
    scans = [seen.scan(k) for k in range(lidars)] if wanted.scans else []
    parts = [
        OBSERVATION.pack(
            b"O", number, seen.t, *seen.pose, *seen.velocity, *seen.goal, *seen.map_from_odom, seen.costmap.origin_x,
            seen.costmap.origin_y, seen.costmap.resolution, len(plan), *cells.shape, len(people), len(scans),
        ),
        LATERAL.pack(seen.lateral) if wanted.protocol > 1 else b"",
        plan.astype("<f4").tobytes(),
        cells.tobytes(),
        people.astype("<f4").tobytes(),
    ]  # fmt: skip
    for scan in scans:
        parts.append(
            SCAN.pack(len(scan.ranges), scan.t, scan.angle_min, scan.angle_increment, scan.x, scan.y, scan.yaw)
        )
        parts.append(scan.ranges.astype("<f4").tobytes())
    return b"".join(parts)


def read_hello(frame: bytes) -> Wanted:
    """Return what the answer to the hello asks for; StackError where it is no such answer."""
    try:
        if frame[:1] != b"H":
            raise ValueError(f"it begins with {frame[:1]!r}")
        told = json.loads(frame[1:])
        version = told["protocol"]
    except (ValueError, TypeError, KeyError) as error:
        raise StackError(
            f"its answer to the hello is not one ({error}); expected H and JSON with protocol", code="stack-hello"
        ) from None
    if isinstance(version, bool) or version not in PROTOCOLS:
        spoken = " and ".join(map(str, PROTOCOLS))
        raise StackError(
            f"it speaks protocol {version!r:.40}, this version of RVSG speaks {spoken}", code="stack-protocol"
        )
    scans, people, costmap = (bool(told.get(key, True)) for key in ("scans", "people", "costmap"))
    try:
        tunable = tuple(Parameter(**{**each, "name": f"parameters.{each['name']}"}) for each in told.get("tunable", ()))
    except (TypeError, KeyError, ValueError) as error:
        raise StackError(
            f"its answer to the hello declares a parameter that is none: {error}", code="stack-hello"
        ) from None
    return Wanted(scans, people, costmap, int(version), tunable)


def read_answer(frame: bytes, number: int, protocol: int = 1) -> tuple[int, Command]:
    """Return status and velocity of the answer to an observation; StackError where it is no such answer."""
    answer = ANSWER if protocol == 1 else LATERAL_ANSWER
    if len(frame) != answer.size or frame[:1] != b"V":
        raise StackError(
            f"it answered {len(frame)} bytes {frame[:12]!r}; expected {answer.size} that begin with V",
            code="stack-answer",
        )
    _, of, status, v, w, *lateral = answer.unpack(frame)
    if of != number:
        raise StackError(
            f"it answered observation {of}, but was asked {number}; send one answer for each observation",
            code="stack-answer",
        )
    if status > GAVE_UP:
        raise StackError(f"it answered with the status {status}; expected 0 to {GAVE_UP}", code="stack-answer")
    return status, (v, *lateral, w)


class Channel:
    """Frames over two file descriptors, with a time limit for each; it takes them over.

    A frame takes one write, and an answer one wait and one read, where the operating system passes them on whole.
    """

    def __init__(self, reads: int, writes: int) -> None:
        self.reads, self.writes = reads, writes
        self._rest = b""
        """What was read beyond the last answer."""
        for descriptor in {reads, writes}:
            os.set_blocking(descriptor, False)

    def send(self, frame: bytes, limit_s: float) -> None:
        """Write a frame.

        Raises:
            StackError: the other side is gone, does not read, or writes on and on without being asked.
        """
        data = memoryview(LENGTH.pack(len(frame)) + frame)
        until = time.monotonic() + limit_s
        while data:
            try:
                data = data[os.write(self.writes, data) :]
            except BlockingIOError:
                left = max(0.0, until - time.monotonic())
                flooded, ready, _ = select.select([self.reads], [self.writes], [], left)
                if flooded and not ready:
                    self._take()  # an early answer is none, a flood ends it
                    if len(self._rest) > LARGEST_ANSWER + LENGTH.size:
                        raise StackError(
                            f"it wrote {len(self._rest)} bytes without being asked, before it read the question. Does "
                            "it print to standard output? Print to standard error.",
                            code="stack-unasked",
                        ) from None
                elif not ready:
                    raise StackError(f"it did not read within {limit_s:g} s", code="stack-late") from None
            except OSError as error:
                raise StackError("it ended", code="stack-ended") from error

    def _take(self) -> None:
        """Keep what the other side has written; StackError where it is gone."""
        try:
            part = os.read(self.reads, LARGEST_ANSWER)
        except BlockingIOError:
            return
        except OSError as error:
            raise StackError("it ended", code="stack-ended") from error
        if not part:
            raise StackError("it ended in the middle of an answer" if self._rest else "it ended", code="stack-ended")
        self._rest += part

    def receive(self, limit_s: float) -> bytes:
        """Read a frame.

        Raises:
            StackError: the other side is gone, does not answer, or floods.
        """
        until = time.monotonic() + limit_s
        self._read(LENGTH.size, until, limit_s)
        (size,) = LENGTH.unpack_from(self._rest)
        if not 0 < size <= LARGEST_ANSWER:
            self._rest = b""
            raise StackError(
                f"it announced an answer of {size} bytes, at most {LARGEST_ANSWER} are read. Does it print to standard "
                "output? Print to standard error.",
                code="stack-answer",
            )
        end = LENGTH.size + size
        self._read(end, until, limit_s)
        frame, self._rest = self._rest[LENGTH.size : end], self._rest[end:]
        return frame

    def _read(self, size: int, until: float, limit_s: float) -> None:
        """Read until `size` bytes are there."""
        while len(self._rest) < size:
            if not select.select([self.reads], [], [], max(0.0, until - time.monotonic()))[0]:
                raise StackError(f"it did not answer within {limit_s:g} s", code="stack-late")
            self._take()


TCP = "tcp://"
ENDING_S = 2.0
"""How long a process may take to end after it is told to."""
KEPT_LINES = 20


class Connection:
    """The process or the server of an external stack."""

    def __init__(self, command: str, limit_s: float) -> None:
        self._lines: deque[str] = deque(maxlen=KEPT_LINES)
        self._child: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        if command.startswith(TCP):
            host, port = _address(command)
            try:
                self._socket = socket.create_connection((host, port), timeout=limit_s)
            except OSError as error:
                raise StackError(
                    f"there is no server at {command}: {error.strerror or error}", code="stack-unreachable"
                ) from error
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.channel = Channel(self._socket.fileno(), self._socket.fileno())
            return
        try:
            self._child = subprocess.Popen(  # noqa: S603  (the user's own command)
                shlex.split(command), stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0,
                start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            raise StackError(f"{command} cannot be started: {error.strerror or error}", code="stack-start") from error
        assert self._child.stdin and self._child.stdout and self._child.stderr
        self.channel = Channel(self._child.stdout.fileno(), self._child.stdin.fileno())
        self._reader = threading.Thread(target=_keep, args=(self._child.stderr, self._lines), daemon=True)
        self._reader.start()
        self._end = weakref.finalize(self, _kill, self._child)

    def why(self) -> str:
        """Return how the process ended and what it wrote last to standard error."""
        if self._child is None:
            return ""
        try:
            code = self._child.wait(0.2)
        except subprocess.TimeoutExpired:
            return ""
        self._reader.join(1.0)  # its last words may still be in the pipe; a child of its own may hold that open
        said = " | ".join(self._lines)[-300:]
        how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        return f" ({how}{': ' + said if said else ''})"

    def close(self, *, kill: bool) -> None:
        """End the process, at once with `kill`, or leave the server."""
        if self._socket is not None:
            self._socket.close()
        if self._child is not None:
            assert self._child.stdin is not None
            self._child.stdin.close()
            if not kill:
                try:
                    self._child.wait(ENDING_S)
                except subprocess.TimeoutExpired:
                    kill = True
            self._end()


def _keep(stream: IO[bytes], lines: deque[str]) -> None:
    """Read standard error to its end, so that it never fills; keep the last lines."""
    with stream:
        while chunk := stream.read(4096):
            lines.extend(text[-300:] for text in chunk.decode(errors="replace").splitlines() if text.strip())


def _kill(child: subprocess.Popen[bytes]) -> None:
    """End a process and those that it started, and release its pipes."""
    if child.poll() is None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()
    for stream in (child.stdin, child.stdout):
        if stream is not None:
            stream.close()


def _address(command: str) -> tuple[str, int]:
    host, _, port = command.removeprefix(TCP).rpartition(":")
    if host not in ("127.0.0.1", "localhost", "[::1]") or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(f"{command}: expected tcp://127.0.0.1:PORT; only servers on this machine are connected to.")
    return host.strip("[]"), int(port)


class External:
    """What a local planner and a whole stack in another process have in common."""

    answer_time_s: ClassVar[float | None] = None
    code_options: ClassVar[tuple[str, ...] | None] = ("command",)
    local: ClassVar[bool]

    def __init__(
        self, command: str, *, timeout_s: float = 10.0, start_timeout_s: float = 30.0, version: str = "1",
        parameters: Mapping[str, Any] | None = None,
    ) -> None:  # fmt: skip
        self.command_line = command
        self.parameters = dict(parameters or {})
        self.timeout_s = _seconds("timeout_s", timeout_s)
        self.start_timeout_s = _seconds("start_timeout_s", start_timeout_s)
        self.version = f"{version}{_content(command)}"
        self._connection: Connection | None = None
        self._wanted = Wanted(scans=True, people=True, costmap=True)
        self._started = 0

    @property
    def options(self) -> dict[str, Any]:
        """The command and what is sent to the stack; time limits decide no run that goes well."""
        return {"command": self.command_line, "parameters": self.parameters}

    def tunable_parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """Return those of its parameters that the process says may be tuned, in its answer to the hello."""
        self.prepare(ignore)
        return self._wanted.tunable

    def prepare(self, tell: Callable[[str], None]) -> None:
        """Start the process or connect, and say hello."""
        try:
            self._connect()
        except StackError as error:
            raise InputError(f"The stack {self.command_line}: {str(error).removesuffix('.')}.") from error

    def reset(self, task: Task) -> None:
        """Begin a run, in a fresh process where the one before failed."""
        self._lidars, self._number = len(task.robot.lidars), 0
        self._connect()
        answer = self._exchange(task_frame(task), self.start_timeout_s, bytes)
        if answer != b"R":
            self._broken(f"it answered {answer[:12]!r} to a new task; expected R")

    def ask(self, seen: LocalObservation) -> tuple[int, Command]:
        """Send an observation; return status and velocity."""
        self._number += 1
        frame = observation_frame(self._number, seen, self._lidars, self._wanted, local=self.local)
        return self._exchange(
            frame, self.timeout_s, lambda answer: read_answer(answer, self._number, self._wanted.protocol)
        )

    def close(self) -> None:
        """End the process, or leave the server."""
        if self._connection is not None:
            connection, self._connection = self._connection, None
            with contextlib.suppress(StackError):  # it may be gone already
                connection.channel.send(b"Q", 1.0)
            connection.close(kill=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_connection": None}

    def _connect(self) -> None:
        if self._connection is None:
            self._connection = Connection(self.command_line, self.start_timeout_s)
            self._started += 1
            hello = {"protocol": PROTOCOLS[0], "protocols": PROTOCOLS, "options": self.parameters}
            self._wanted = self._exchange(b"H" + json.dumps(hello).encode(), self.start_timeout_s, read_hello)

    def _exchange(self, frame: bytes, limit_s: float, read: Callable[[bytes], T]) -> T:
        """Send a frame and return what is read of the answer; end the process where that fails."""
        if self._connection is None:
            raise StackError("it ended", code="stack-ended")
        try:
            self._connection.channel.send(frame, limit_s)
            return read(self._connection.channel.receive(limit_s))
        except StackError as error:
            self._broken(f"{error}{self._connection.why()}", error.code)

    def _broken(self, reason: str, code: str = "stack-answer") -> Never:
        """End the process: the next run gets a fresh one."""
        if self._connection is not None:
            self._connection.close(kill=True)
            self._connection = None
        raise StackError(reason, code=code)


class ExternalPlanner(External, LocalPlanner):
    """A local planner in another process."""

    name: ClassVar[str] = "exec"
    title: ClassVar[str] = "A local planner in another process, in any language: exec:./my_planner or exec:tcp://..."
    local: ClassVar[bool] = True

    def command(self, seen: LocalObservation) -> Command | None:
        """Ask the other process."""
        status, velocity = self.ask(seen)
        if status in (REACHED, GAVE_UP):
            self._broken(f"it answered with the status {status}, which is for whole stacks (exec-stack:)")
        return velocity if status == VELOCITY else None


class ExternalStack(External, WholeStack):
    """A whole navigation stack in another process."""

    name: ClassVar[str] = "exec-stack"
    title: ClassVar[str] = "A whole navigation stack in another process: exec-stack:./my_stack"
    local: ClassVar[bool] = False

    def __init__(self, command: str, *, period_s: float = 0.05, **options: Any) -> None:
        super().__init__(command, **options)
        self._period_s = _seconds("period_s", period_s)

    @property
    def period_s(self) -> float:
        """Simulated time between two steps."""
        return self._period_s

    @property
    def options(self) -> dict[str, Any]:
        """The command, what is sent to the stack, and the period."""
        return {**super().options, "period_s": self._period_s}

    def step(self, seen: Observation) -> Command | Ended | None:
        """Ask the other process."""
        assert isinstance(seen, LocalObservation)
        status, velocity = self.ask(seen)
        if status == REACHED:
            return Ended.REACHED
        if status == GAVE_UP:
            return Ended.GAVE_UP
        return velocity if status == VELOCITY else None


def _seconds(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value <= 3600.0:
        raise ValueError(f"{name} must be a number of seconds over 0 and at most 3600, got {value!r}")
    return float(value)


def _content(command: str) -> str:
    """Return a hash of the files that a command names, so that a rebuilt planner gives new runs."""
    if command.startswith(TCP):
        _address(command)
        return ""
    words = shlex.split(command)
    if not words:
        raise InputError("The command of the stack is empty. Expected exec:COMMAND.")
    found = shutil.which(words[0])
    if found is None:
        raise InputError(f"There is no program {words[0]} that can be started. Give its path: exec:./my_planner.")
    files = [path for path in map(Path, [found, *words[1:]]) if path.is_file()]
    digest = hashlib.sha256(b"".join(hashlib.sha256(path.read_bytes()).digest() for path in files))
    return f"+{digest.hexdigest()[:12]}"


CLIENTS = ("rvsg_client.py", "rvsg_client.hpp")
"""Files to copy for stacks in another process, in Python and C++."""


def write_clients_to(folder: str | Path) -> list[Path]:
    """Write the clients into a folder; return their paths."""
    source = resources.files("rvsg.simulation.stacks") / "clients"
    written = []
    for name in CLIENTS:
        written.append(Path(folder) / name)
        write_whole(written[-1], (source / name).read_text(encoding="utf-8"))
    return written
