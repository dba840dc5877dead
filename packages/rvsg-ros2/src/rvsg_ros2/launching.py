"""Start the user's launch command and end it with all its processes."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import uuid
from collections.abc import Mapping
from pathlib import Path

from rvsg.core.errors import InputError
from rvsg_ros2 import keeper

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
        self._folder = Path(tempfile.mkdtemp(prefix="rvsg-ros2-"))
        self.log = self._folder / "launch.log"
        with self.log.open("wb") as output:
            self._keeper = subprocess.Popen(  # noqa: S603  (the user's own command)
                [sys.executable, str(Path(keeper.__file__)), self.mark, *words],
                stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT, start_new_session=True,
                env={**os.environ, **environment},
            )  # fmt: skip

    @property
    def ended(self) -> int | None:
        """The exit code of the command, None while it runs."""
        return self._keeper.poll()

    def tail(self) -> str:
        """Return the last lines that the command wrote."""
        return "\n".join(self.log.read_text(errors="replace").splitlines()[-_TAIL_LINES:])

    def close(self) -> None:
        """End the command and everything it started. May be called again."""
        if self._keeper.stdin is not None and not self._keeper.stdin.closed:
            self._keeper.stdin.close()
        self._keeper.wait(sum(patience for _, patience in keeper.STEPS) + 5.0)
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
