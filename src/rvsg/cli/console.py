"""Output of the verbs: results for machines on standard output, text for people on standard error."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.segment import Segment


def print_json(value: Any) -> None:
    """Print a result as readable JSON on standard output; NaN is refused (ValueError)."""
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False)
    sys.stdout.write(re.sub("[\x7f-\x9f]", lambda match: f"\\u{ord(match[0]):04x}", text) + "\n")
    sys.stdout.flush()


def harmless(text: str) -> str:
    """Return a text that a terminal shows and does not obey: control characters, also of direction, are replaced."""
    return text.translate(_SHOWN)


_CONTROLS = [*range(0x20), *range(0x7F, 0xA0), *range(0x202A, 0x202F), *range(0x2066, 0x206A)]
_SHOWN = {code: "\N{REPLACEMENT CHARACTER}" for code in _CONTROLS if chr(code) not in "\t\n"}


def say(*what: Any, **how: Any) -> None:
    """Print for people on standard error: plain text without markup, or anything rich can draw."""
    plain = {"markup": False, "emoji": False, "highlight": False}
    console().print(*what, **plain | {"soft_wrap": all(isinstance(w, str) for w in what)} | how)


@cache
def _console(stream: Any) -> Console:
    from rich.console import Console
    from rich.segment import Segment

    class Teller(Console):
        def render(self, renderable: Any, options: Any = None) -> Iterator[Segment]:
            """Draw what is printed; names of files and worlds may be a stranger's."""
            for segment in super().render(renderable, options):
                yield segment if segment.control else Segment(harmless(segment.text), segment.style)

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
    program_path, whole = shutil.which(program.name), program.absolute()
    if program_path and Path(program_path).absolute() == whole:
        return program.name
    typed = str(whole.relative_to(Path.cwd()) if whole.is_relative_to(Path.cwd()) else whole)
    return shlex.quote(typed if os.sep in typed else f".{os.sep}{typed}")
