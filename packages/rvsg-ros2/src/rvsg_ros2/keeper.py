"""Runs a command and ends everything that it started when standard input closes, that is, when the caller is gone.

`python keeper.py MARK COMMAND...`. MARK is in the environment of all that belongs to it, in whichever process group.
This file imports the standard library only.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

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


def main(mark: str, command: list[str]) -> int:
    """Run the command until it ends or standard input closes."""
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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
