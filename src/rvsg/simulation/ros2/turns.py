"""One run at a time on a ROS 2 system, whichever process makes it; and ROS time that never goes back."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from rvsg.core.errors import SimulationError

GAP_S = 5
"""ROS time between the end of a run and the next."""


class Turn:
    """The right to use one DDS domain, shared by all processes of this machine."""

    def __init__(self, domain: int) -> None:
        from filelock import FileLock

        self.domain = domain
        folder = Path(tempfile.gettempdir())
        self._clock = folder / f"rvsg-ros2-{domain}.clock"
        self._lock = FileLock(folder / f"rvsg-ros2-{domain}.lock", mode=0o666)

    def take(self, limit_s: float) -> int:
        """Wait for the domain; return the ROS time (ns) to begin at, later than any that was used before.

        Raises:
            SimulationError: another process used it for longer than `limit_s`.
        """
        from filelock import Timeout

        try:
            self._lock.acquire(timeout=limit_s)
        except Timeout:
            raise SimulationError(
                f"Another process has used DDS domain {self.domain} for over {limit_s:g} s. Use one worker (--jobs 1), "
                "or end the other process."
            ) from None
        try:
            last = int(self._clock.read_text())
        except (OSError, ValueError):
            last = 0
        return max(time.time_ns(), last + GAP_S * 10**9)

    def give_back(self, now_ns: int) -> None:
        """Let others use the domain; `now_ns` is the ROS time that was reached. May be called again."""
        if self._lock.is_locked:
            self._clock.write_text(str(now_ns))
            self._lock.release()
