"""One campaign of several in a process of its own; `cells` begins it."""

from __future__ import annotations

import json
import os
import sys
import threading
import time

from rvsg.cli.frame import guarded
from rvsg.cli.interruption import until_gone
from rvsg.cli.run import run_one


def main() -> int:
    """The process of one cell: its settings as JSON on standard input, words for people on standard error.

    Its one argument is how the program that began it was begun: the commands it tells are begun so too.
    """
    del sys.argv[0]
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    return until_gone(_find)


def _find() -> int:
    values = json.loads(sys.stdin.read())
    return guarded(lambda: run_one({}, values), ["run", "--out", str(values["out"])])


def _end_with_parent(parent: int) -> None:
    """End this cell when its parent was killed, as if it were killed too: it resumes."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)
