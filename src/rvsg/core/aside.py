"""Compile kernels in a process of their own, into the cache that all share, while the caller compiles others."""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from numba.core.serialize import dumps


def compile_aside(work: Sequence[tuple[Any, tuple[Any, ...]]]) -> subprocess.Popen[bytes] | None:
    """Begin to compile kernels for types of arguments; None where there is one processor only.

    Wait for the process before the kernels are used. What it has not compiled is compiled where it is needed.
    """
    if (os.cpu_count() or 1) < 2:
        return None
    named = [(kernel.py_func.__module__, kernel.py_func.__qualname__, kinds) for kernel, kinds in work]
    process = subprocess.Popen(  # noqa: S603  (this program)
        [sys.executable, "-c", f"from {__name__} import compile_asked; compile_asked()"],
        stdin=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
    )
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):  # it is dead already
        process.stdin.write(dumps(named))
        process.stdin.close()
    return process


def compile_asked() -> None:
    """Compile what another process of this program asks for on the standard input."""
    gc.disable()
    for module, name, kinds in pickle.loads(sys.stdin.buffer.read()):  # noqa: S301  (from the parent)
        getattr(importlib.import_module(module), name).compile(kinds)
