"""How kernels are compiled: by numba, without Python, cached on disk under the hash of the simulator's sources.

numba checks only a kernel's own file when it loads it from its cache; a kernel it calls may have changed since.
The cache therefore lives in a folder named after the hash of *all* sources of this room.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import config, njit

F = TypeVar("F", bound=Callable[..., object])


@cache
def sources_hash() -> str:
    """16 hexadecimal digits over every source file of the simulation room: the version of the compiled code."""
    folder = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def checkout_hash() -> str:
    """8 hexadecimal digits over the place and age of the sources: numba keeps a cache for just these."""
    folder = Path(__file__).resolve().parent
    digest = hashlib.sha256(str(folder).encode())
    for path in sorted(folder.rglob("*.py")):
        digest.update(str(path.stat().st_mtime_ns).encode())
    return digest.hexdigest()[:8]


@cache
def cache_folder() -> Path:
    """Where compiled kernels are kept: NUMBA_CACHE_DIR, XDG_CACHE_HOME, ~/.cache, or the system's temporary folder."""
    choices = [
        Path(os.environ["NUMBA_CACHE_DIR"]) if os.environ.get("NUMBA_CACHE_DIR") else None,
        Path(os.environ["XDG_CACHE_HOME"]) / "rvsg" if os.environ.get("XDG_CACHE_HOME") else None,
        Path("~/.cache/rvsg"),
        Path(tempfile.gettempdir()) / f"rvsg-{os.getuid() if hasattr(os, 'getuid') else 'user'}",
    ]
    for choice in choices:
        if choice is None:
            continue
        try:
            folder = choice.expanduser() / f"kernels-{sources_hash()}-{checkout_hash()}"
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="rvsg-kernels-"))


def kernel(function: F) -> F:
    """Compile `function` at its first call, or load it from the cache. IEEE arithmetic: NaN and ±inf keep meaning."""
    return _compiled(function)


def inner(function: F) -> F:
    """A kernel that only kernels call: it has no door for Python, which halves its time of compilation.

    Calling it from Python is an error that ends the process; a test calls it from a kernel of its own.
    """
    return _compiled(function, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def _compiled(function: F, **flags: Any) -> F:
    before = getattr(config, "CACHE_DIR", "")
    setattr(config, "CACHE_DIR", str(cache_folder()))  # noqa: B010
    try:
        compile_later: Any = njit
        return cast(F, compile_later(cache=True, error_model="numpy", **flags)(function))
    finally:
        setattr(config, "CACHE_DIR", before)  # noqa: B010
