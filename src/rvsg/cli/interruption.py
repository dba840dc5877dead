"""Ctrl-C and SIGTERM: finish in order at the first, stop at once at the second."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

from rvsg.api.errors import Interrupted

ENDING = (signal.SIGINT, signal.SIGTERM)
"""A CI service that cancels sends SIGTERM: it is treated like Ctrl-C."""
LEAVING_S = 5.0
"""So long a process that was interrupted may take to leave after its last word."""
AT_ONCE = "Ended at once. What was finished is kept."
SHOW_CURSOR = "\x1b[?25h"


class Interruption:
    """Whether somebody asked for the end.

    The first signal raises KeyboardInterrupt wherever the program is, and code that ignores every error (a destructor,
    a callback of a library) may swallow it. It is therefore remembered too, and raised again by the next `check`. The
    second signal ends the process without waiting for anything: records are kept whole, and workers end without us.
    """

    def __init__(self) -> None:
        self.asked = False
        self.code = Interrupted.exit_code
        self._last_word: str | None = None

    def check(self) -> None:
        """Raise KeyboardInterrupt where somebody asked for the end."""
        if self.asked:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def at_once(self, last_word: str) -> Iterator[None]:
        """While nothing is under way that could be lost, the first signal ends the process, after a last word.

        A compiler that is interrupted within its callbacks may hang or crash.
        """
        self._last_word = last_word
        try:
            yield
        finally:
            self._last_word = None

    def leave(self, code: int) -> None:
        """The work is done. Where it was interrupted, nothing can change its code any more, nor hold it for long.

        Python, while it ends, would give the signals back their own effect, but for those that are ignored.
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
    """Listen to the signals that ask for the end; only the main thread can hear them. Within another one, the same.

    An error that only follows from an interruption (a compiler's callback that lost it) becomes KeyboardInterrupt.
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
    """Do all the work of this process, listening to the signals until it is gone; the exit code."""
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
    """Let the interruption hear the signals; what is returned undoes it."""
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
