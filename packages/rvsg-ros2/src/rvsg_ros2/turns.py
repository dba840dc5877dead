"""One run at a time on a ROS 2 system, whichever process makes it; and ROS time that never goes back."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from rvsg.core.errors import SimulationError

GAP_S = 5
"""ROS time between the end of a run and the next."""
TELL_S = 5.0
"""After so long a user is told what is waited for."""
POLL_S = 0.02
COURTESY_S = 0.06
"""Who has just used the domain lets others who wait for it see that it is free."""


class Turn:
    """The right to use one DDS domain, shared by all processes that have the same network."""

    def __init__(self, domain: int) -> None:
        from filelock import FileLock

        self.domain = domain
        folder = Path(tempfile.gettempdir())
        name = f"rvsg-ros2-{domain}"
        with suppress(OSError):  # not Linux: one network
            name += f"-{Path('/proc/self/ns/net').stat().st_ino}"
        self._clock = folder / f"{name}.clock"
        self._lock = FileLock(folder / f"{name}.lock", mode=0o666)
        self._given_back = 0.0

    def take(self, limit_s: float, tell: Callable[[str], None] = lambda _: None) -> int:
        """Wait for the domain; return the ROS time (ns) to begin at, later than any that was used before.

        Raises:
            SimulationError: another process used it for longer than `limit_s`.
        """
        time.sleep(max(0.0, self._given_back + COURTESY_S - time.monotonic()))
        if not self._acquire(min(TELL_S, limit_s)):
            if limit_s > TELL_S:
                tell(
                    f"waiting for DDS domain {self.domain}: another process uses it, and runs take turns "
                    "(ROS_DOMAIN_ID or the option domain chooses another)"
                )
            if not self._acquire(limit_s - TELL_S):
                raise SimulationError(
                    f"Another process has used DDS domain {self.domain} for over {limit_s:g} s. Use one worker "
                    "(--jobs 1), or end the other process."
                )
        try:
            last = int(self._clock.read_text())
        except (OSError, ValueError):
            last = 0
        return max(time.time_ns(), last + GAP_S * 10**9)

    def _acquire(self, limit_s: float) -> bool:
        from filelock import Timeout

        try:
            self._lock.acquire(timeout=max(0.0, limit_s), poll_interval=POLL_S)
        except Timeout:
            return False
        return True

    def give_back(self, now_ns: int) -> None:
        """Let others use the domain; `now_ns` is the ROS time that was reached. May be called again."""
        if self._lock.is_locked:
            self._clock.write_text(str(now_ns))
            self._lock.release()
            self._given_back = time.monotonic()
