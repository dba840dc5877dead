"""What verbs print with: results for machines on standard output, words for people on standard error."""

from __future__ import annotations

import json
import sys
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console


def print_json(value: Any) -> None:
    """Print a result as readable JSON on standard output; NaN is refused (ValueError)."""
    sys.stdout.write(json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    sys.stdout.flush()


def say(*what: Any, **how: Any) -> None:
    """Print for people on standard error: text as it stands (no markup), or anything rich can draw."""
    plain = {"markup": False, "emoji": False, "highlight": False}
    console().print(*what, **plain | {"soft_wrap": all(isinstance(w, str) for w in what)} | how)


@cache
def _console(stream: Any) -> Console:
    from rich.console import Console

    class Teller(Console):
        def on_broken_pipe(self) -> None:
            """Leave it to the frame: by itself rich ends with exit code 1, which means "violated"."""
            raise

    return Teller(file=stream, stderr=True)


def console() -> Console:
    """The rich console on the present standard error."""
    return _console(sys.stderr)
