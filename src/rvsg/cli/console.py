"""Output of the verbs: results for machines on standard output, text for people on standard error."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console


def print_json(value: Any) -> None:
    """Print a result as readable JSON on standard output; NaN is refused (ValueError)."""
    sys.stdout.write(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    sys.stdout.flush()


def say(*what: Any, **how: Any) -> None:
    """Print for people on standard error: plain text without markup, or anything rich can draw."""
    plain = {"markup": False, "emoji": False, "highlight": False}
    console().print(*what, **plain | {"soft_wrap": all(isinstance(w, str) for w in what)} | how)


@cache
def _console(stream: Any) -> Console:
    from rich.console import Console

    class Teller(Console):
        def on_broken_pipe(self) -> None:
            """Leave it to the frame: rich would exit with code 1, which means "violated"."""
            raise

    return Teller(file=stream, stderr=True)


def console() -> Console:
    """Return the rich console on the current standard error."""
    return _console(sys.stderr)


def as_started(command: str) -> str:
    """Return a command line `rvsg ...` with the program as the user started it, e.g. `.venv/bin/rvsg`.

    For messages only: no record and no report depends on how the program was started.
    """
    program = Path(sys.argv[0])
    if program.name == "__main__.py" and program.parent.name == "rvsg":
        return f"{_typed(Path(sys.executable))} -m {command}"
    return _typed(program) + command.removeprefix("rvsg") if program.stem == "rvsg" else command


def _typed(program: Path) -> str:
    """Return the name of a program that is on PATH; else its path, relative where it is below the current folder."""
    # Do not follow links: a link in a virtual environment points to another program.
    found, whole = shutil.which(program.name), program.absolute()
    if found and Path(found).absolute() == whole:
        return program.name
    typed = str(whole.relative_to(Path.cwd()) if whole.is_relative_to(Path.cwd()) else whole)
    return shlex.quote(typed if os.sep in typed else f".{os.sep}{typed}")
