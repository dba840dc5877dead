"""Stacks in another process: a command that RVSG starts, or a server on this machine that it connects to."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shlex
import shutil
import signal
import socket
import subprocess
import threading
import weakref
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any, ClassVar, Never

from rvsg.core.errors import InputError
from rvsg.simulation.stacks import frames
from rvsg.simulation.stacks.frames import Channel, Wanted
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
        threading.Thread(target=_keep, args=(self._child.stderr, self._lines), daemon=True).start()
        self._end = weakref.finalize(self, _kill, self._child)

    def why(self) -> str:
        """Return how the process ended and what it wrote last to standard error."""
        if self._child is None:
            return ""
        try:
            code = self._child.wait(0.2)
        except subprocess.TimeoutExpired:
            return ""
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
        answer = self._exchange(frames.task_frame(task), self.start_timeout_s)
        if answer != b"R":
            self._broken(f"it answered {answer[:12]!r} to a new task; expected R")

    def ask(self, seen: LocalObservation) -> tuple[int, Command]:
        """Send an observation; return status and velocity."""
        self._number += 1
        frame = frames.observation_frame(self._number, seen, self._lidars, self._wanted, local=self.local)
        answer = self._exchange(frame, self.timeout_s)
        try:
            return frames.read_answer(answer, self._number, self._wanted.protocol)
        except StackError as error:
            self._broken(str(error), error.code)

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
            answer = self._exchange(frames.hello_frame(self.parameters), self.start_timeout_s)
            try:
                self._wanted = frames.read_hello(answer)
            except StackError as error:
                self._broken(str(error), error.code)

    def _exchange(self, frame: bytes, limit_s: float) -> bytes:
        if self._connection is None:
            raise StackError("it ended", code="stack-ended")
        try:
            self._connection.channel.send(frame, limit_s)
            return self._connection.channel.receive(limit_s)
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
        if status in (frames.REACHED, frames.GAVE_UP):
            self._broken(f"it answered with the status {status}, which is for whole stacks (exec-stack:)")
        return velocity if status == frames.VELOCITY else None


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
        if status == frames.REACHED:
            return Ended.REACHED
        if status == frames.GAVE_UP:
            return Ended.GAVE_UP
        return velocity if status == frames.VELOCITY else None


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


__all__ = ["Connection", "ExternalPlanner", "ExternalStack"]
