"""Ctrl-C and SIGTERM: the first one ends in order, the second one at once."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

from rvsg.core.errors import Interrupted

ENDING = (signal.SIGINT, signal.SIGTERM)
"""A CI service cancels with SIGTERM; treat it like Ctrl-C."""
LEAVING_S = 5.0
"""Seconds that an interrupted process may take to exit after its last message."""
AT_ONCE = "Stopped at once."
SHOW_CURSOR = "\x1b[?25h"


class Interruption:
    """Remembers that a signal asked the process to end.

    The first signal raises KeyboardInterrupt wherever the program is. Code that ignores every error (a destructor, a
    callback of a library) may swallow it, so the next `check` raises it again. The second signal ends the process at
    once: stored records stay whole, and the workers exit by themselves.
    """

    def __init__(self) -> None:
        self.asked = False
        self.code = Interrupted.exit_code
        self._last_word: str | None = None

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal has arrived."""
        if self.asked:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def at_once(self, last_word: str) -> Iterator[None]:
        """Let the first signal end the process at once, after a last message; for work that may be lost.

        A compiler that is interrupted within its callbacks may hang or crash.
        """
        self._last_word = last_word
        try:
            yield
        finally:
            self._last_word = None

    def leave(self, code: int) -> None:
        """Fix the exit code. An interrupted process ignores further signals and exits within `LEAVING_S`.

        While Python shuts down, it restores the default effect of every signal that is not ignored.
        """
        self.code, self.asked = code, True
        if code == Interrupted.exit_code:
            for number in ENDING:
                signal.signal(number, signal.SIG_IGN)
            held = threading.Timer(LEAVING_S, os._exit, (code,))
            held.daemon = True
            held.start()

    def _heard(self, number: int, frame: FrameType | None) -> None:
        if self.asked or self._last_word is not None:
            cursor = SHOW_CURSOR if os.isatty(2) else ""  # a progress bar hides it
            with contextlib.suppress(OSError):
                os.write(2, f"{cursor}{self._last_word or AT_ONCE}\n".encode())
            os._exit(self.code)
        self.asked = True
        raise KeyboardInterrupt


_listening: Interruption | None = None


@contextlib.contextmanager
def interruptible() -> Iterator[Interruption]:
    """Handle the signals that ask the process to end; only the main thread can. Nested calls share one Interruption.

    An error that follows from an interruption (a compiler's callback that lost it) becomes KeyboardInterrupt.
    """
    begun = _listening is None and threading.current_thread() is threading.main_thread()
    interruption = _listening or Interruption()
    before = _listen(interruption) if begun else None
    try:
        yield interruption
    except Interrupted:
        raise
    except Exception:
        interruption.check()
        raise
    finally:
        if before is not None:
            before()


def until_gone(work: Callable[[], int]) -> int:
    """Do all the work of this process, handle signals until it exits, and return the exit code."""
    if threading.current_thread() is not threading.main_thread():
        return work()
    interruption = Interruption()
    _listen(interruption)
    try:
        code = work()
        interruption.leave(code)
    except KeyboardInterrupt:
        code = interruption.code
        interruption.leave(code)
    return code


def _listen(interruption: Interruption) -> Callable[[], None]:
    """Install the signal handlers; return a function that removes them."""
    global _listening
    _listening, hook = interruption, sys.unraisablehook
    handlers = {number: signal.signal(number, interruption._heard) for number in ENDING}

    def unraisable(error: Any) -> None:
        if not isinstance(error.exc_value, KeyboardInterrupt):  # that one is remembered
            hook(error)

    def undo() -> None:
        global _listening
        _listening, sys.unraisablehook = None, hook
        for number, handler in handlers.items():
            signal.signal(number, handler)

    sys.unraisablehook = unraisable
    return undo
