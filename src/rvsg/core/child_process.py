"""How a process of RVSG is started: by this interpreter, and with the import path of this process alone.

`python -m` and `python -c` put the current folder first, where a file of a stranger may be called `json.py`.
"""

from __future__ import annotations

import sys
from pathlib import Path


def command(function: str, *arguments: str) -> list[str]:
    """Return the command that calls a function, `module:name`, without arguments; its result is the exit code.

    Args:
        arguments: what it finds in `sys.argv[1:]`.
    """
    module, _, name = function.partition(":")
    path = [folder or str(Path.cwd()) for folder in sys.path]
    code = f"import sys; sys.path[:] = {path!r}; from {module} import {name}; sys.exit({name}())"
    return [sys.executable, "-P", "-c", code, *arguments]
