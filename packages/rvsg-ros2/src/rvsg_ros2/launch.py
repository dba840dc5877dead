"""The user's launch command, and the process that ends it with everything it started.

Its process has the arguments MARK COMMAND... and runs the command until standard input closes, that is, until the
caller is gone. MARK is in the environment of all that belongs to it, in whichever process group.
"""

from __future__ import annotations

import contextlib
import os
import select
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Mapping
from pathlib import Path

from rvsg.core.child_process import command as command_of
from rvsg.core.errors import InputError

VARIABLE = "RVSG_ROS2_MARK"
STEPS = ((signal.SIGINT, 8.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 5.0))
"""`ros2 launch` shuts its nodes down on SIGINT; what is left gets the next signal after these seconds."""


def marked(mark: str) -> list[int]:
    """Return the ids of all processes with the mark in their environment, this one left out."""
    wanted = f"{VARIABLE}={mark}".encode()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if wanted in (folder / "environ").read_bytes().split(b"\0") and not _is_zombie(folder):
                found.append(int(folder.name))
    return [pid for pid in found if pid != os.getpid()]


def programs(mark: str) -> dict[int, str]:
    """Return the names of the programs of all processes with the mark, by process id."""
    found = {}
    for pid in marked(mark):
        with contextlib.suppress(OSError):
            found[pid] = (Path("/proc") / str(pid) / "comm").read_text().strip()
    return found


def _is_zombie(folder: Path) -> bool:
    return (folder / "stat").read_text().rpartition(")")[2].split()[0] == "Z"


def end(child: subprocess.Popen[bytes], mark: str) -> None:
    """End the command and everything with the mark."""
    for number, patience in STEPS:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child.pid, number)
        for pid in marked(mark):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                if os.getpgid(pid) != child.pid:
                    os.kill(pid, number)
        until = time.monotonic() + patience
        while time.monotonic() < until:
            if child.poll() is not None and not marked(mark):
                return
            time.sleep(0.05)


def main() -> int:
    """Run the command until it ends or standard input closes."""
    mark, *command = sys.argv[1:]
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    environment = {**os.environ, VARIABLE: mark}
    try:
        child = subprocess.Popen(  # noqa: S603  (the user's own command)
            command, env=environment, stdin=subprocess.DEVNULL, start_new_session=True, preexec_fn=_obey_signals
        )
    except OSError as error:
        print(f"{command[0]}: {error.strerror}", file=sys.stderr)
        return 127
    while child.poll() is None:
        ready, _, _ = select.select([sys.stdin], [], [], 0.2)
        if ready and not os.read(sys.stdin.fileno(), 1):
            break
    code = child.poll()
    end(child, mark)
    return 0 if code is None else code


def _obey_signals() -> None:
    """Undo what this process ignores: a child inherits it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


RMW = "rmw_cyclonedds_cpp"
_TAIL_LINES = 12


class Launched:
    """A command that runs in a process group of its own; its output goes to a file."""

    def __init__(self, command: str, environment: Mapping[str, str]) -> None:
        try:
            words = shlex.split(command)
        except ValueError as error:
            raise InputError(
                f"launch: {command!r} cannot be split into words: {error}.", code="ros2-launch-words"
            ) from None
        if not words or shutil.which(words[0]) is None:
            raise InputError(
                f"launch: there is no command {words[0] if words else command!r}. Source your ROS 2 first "
                "(source /opt/ros/jazzy/setup.bash), or give the full path.",
                code="ros2-launch",
            )
        self.mark = uuid.uuid4().hex
        self._ready: dict[int, str] = {}
        self._folder = Path(tempfile.mkdtemp(prefix="rvsg-ros2-"))
        self.log = self._folder / "launch.log"
        with self.log.open("wb") as output:
            self._keeper = subprocess.Popen(  # noqa: S603  (the user's own command)
                command_of("rvsg_ros2.launch:main", self.mark, *words),
                stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT, start_new_session=True,
                env={**os.environ, **environment},
            )  # fmt: skip

    @property
    def ended(self) -> int | None:
        """The exit code of the command, None while it runs."""
        return self._keeper.poll()

    def note_processes(self) -> None:
        """Remember which processes run now, where the system is ready."""
        self._ready = programs(self.mark)

    def why_silent(self) -> str:
        """Return why a node does not answer: a process of the ready system is gone, or all run and one hangs."""
        gone = [f"{name} ({pid})" for pid, name in self._ready.items() if pid not in programs(self.mark)]
        if not gone:
            return "hanging: all processes of the launch command run"
        return f"crashed: {', '.join(gone)} ended. The last lines of the launch command:\n{self.tail()}"

    def tail(self) -> str:
        """Return the last lines that the command wrote."""
        return "\n".join(self.log.read_text(errors="replace").splitlines()[-_TAIL_LINES:])

    def close(self) -> None:
        """End the command and everything it started. May be called again."""
        if self._keeper.stdin is not None and not self._keeper.stdin.closed:
            self._keeper.stdin.close()
        self._keeper.wait(sum(patience for _, patience in STEPS) + 5.0)
        shutil.rmtree(self._folder, ignore_errors=True)


def ros_environment(domain: int) -> dict[str, str]:
    """Return what a launched system needs in its environment.

    Raises:
        InputError: another middleware is chosen.
    """
    chosen = os.environ.get("RMW_IMPLEMENTATION", RMW)
    if chosen != RMW:
        raise InputError(
            f"RMW_IMPLEMENTATION is {chosen}, but RVSG speaks to {RMW} directly. Unset it, or use the stack of "
            "packages/rvsg-ros2, which works with every middleware.",
            code="ros2-middleware",
        )
    return {"ROS_DOMAIN_ID": str(domain), "RMW_IMPLEMENTATION": RMW}
