"""Compiled kernels: numba's decorator with the options of RVSG, and the folder that keeps the compiled code.

Numba's cache knows the source of a function's own module only. Here the folder is also named by everything else that a
module's kernels depend on: the constants it reads, the modules of the kernels it calls, the versions and the processor.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import json
import os
import pickle
import pickletools
import stat
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, cast, overload

import llvmlite
import llvmlite.binding
import numpy as np

from rvsg.core.child_process import command
from rvsg.core.files import write_whole


@contextlib.contextmanager
def _without_yaml() -> Iterator[None]:
    """Within the block, hide the reader of YAML: numba would take its options from a file of the current folder."""
    warnings.filterwarnings("ignore", message="A Numba config file is found")
    loaded = sys.modules.get("yaml")
    sys.modules["yaml"] = cast(ModuleType, None)  # an import of it fails
    try:
        yield
    finally:
        del sys.modules["yaml"]
        if loaded is not None:
            sys.modules["yaml"] = loaded


with _without_yaml():
    import numba

boolean, complex128, float64, int64 = numba.boolean, numba.complex128, numba.float64, numba.int64

F = TypeVar("F", bound=Callable[..., object])

FORMAT = 4
"""Raise it to make every compiled kernel obsolete."""
MANIFEST = "manifest.json"
LATER_LARGER = 1.45
"""The share of functions to the power of this is the share of the time, as measured: callers come last."""
BUSY = 0.6
"""Below this share of a core, compilation is said to be slow because of other processes."""
_PACKAGE = __name__.split(".", maxsplit=1)[0]


@overload
def kernel(function: F) -> F: ...
@overload
def kernel(*, arrays: bool) -> Callable[[F], F]: ...


def kernel(function: Any = None, *, arrays: bool = False) -> Any:
    """Compile a function at its first call from Python or from a kernel, or load it from the cache.

    Arithmetic follows IEEE 754: division by zero gives an infinity or NaN.

    Args:
        arrays: it makes arrays, for the reader; see `inner`.
    """
    return partial(kernel, arrays=arrays) if function is None else _compiled(function, _nrt=True)


@overload
def inner(function: F) -> F: ...
@overload
def inner(*, arrays: bool = ..., cached: bool = ...) -> Callable[[F], F]: ...


def inner(function: Any = None, *, arrays: bool = False, cached: bool = False) -> Any:
    """Compile a function that only kernels call; it has no entry point for Python.

    Args:
        arrays: it makes arrays, or gets new ones from what it calls, so it counts the references to arrays. Others
            borrow those of their arguments, by numba's option `_nrt`, which makes runs a tenth faster.
        cached: keep it in the cache by itself, so that another process can compile it beforehand.
    """
    if function is None:
        return partial(inner, arrays=arrays, cached=cached)
    return _compiled(function, cached=cached, no_cpython_wrapper=True, _nrt=arrays)


def type_of(value: Any) -> Any:
    """Return numba's type of a value."""
    return cast(Any, numba.typeof)(value)


def is_cached(function: Callable[..., object]) -> bool:
    """Return whether this process has compiled a kernel, or the cache holds it."""
    dispatcher = cast(Any, function)
    name = f"{dispatcher.py_func.__module__.rsplit('.', 1)[-1]}.{dispatcher.py_func.__qualname__}-*.nbi"
    return bool(dispatcher.overloads) or any(Path(dispatcher.stats.cache_path).glob(name))


def compile_for(function: Callable[..., object], kinds: tuple[Any, ...]) -> None:
    """Compile a function for types of arguments, or load it from the cache."""
    cast(Any, function).compile(kinds)


def compile_aside(work: Sequence[tuple[Any, tuple[Any, ...]]], *, nice: int = 0) -> subprocess.Popen[bytes] | None:
    """Begin to compile cached functions for types of arguments in another process; None on a single processor.

    Wait for the process before the functions are used. What it has not compiled is compiled where it is needed.
    `nice`: how far it steps back for other processes.
    """
    if (os.cpu_count() or 1) < 2:
        return None
    named = [(function.py_func.__module__, function.py_func.__qualname__, kinds) for function, kinds in work]
    process = subprocess.Popen(command(f"{__name__}:compile_asked", str(nice)), stdin=subprocess.PIPE)  # noqa: S603
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):  # it is dead already
        process.stdin.write(pickle.dumps(named))
        process.stdin.close()
    return process


def compile_asked() -> None:
    """Compile what `compile_aside` asks for on standard input."""
    if hasattr(os, "nice"):
        os.nice(int(sys.argv[1]))
    for module, name, kinds in pickle.load(sys.stdin.buffer):  # noqa: S301 - from the parent
        compile_for(getattr(importlib.import_module(module), name), kinds)


@cache
def cache_folder() -> Path:
    """Return the folder of compiled kernels: in NUMBA_CACHE_DIR, XDG_CACHE_HOME, ~/.cache or the temporary folder.

    It belongs to the user and is closed to others, because code in it is run. What is damaged in it is removed.
    """
    choices: list[str | Path | None] = [
        os.environ.get("NUMBA_CACHE_DIR"),
        Path(os.environ["XDG_CACHE_HOME"]) / "rvsg" if os.environ.get("XDG_CACHE_HOME") else None,
        "~/.cache/rvsg",
    ]
    name = f"kernels-{FORMAT}-py{sys.version_info[0]}{sys.version_info[1]}-numba{numba.__version__}"
    for choice in filter(None, choices):
        with contextlib.suppress(OSError, RuntimeError):
            folder = Path(str(choice)).expanduser() / name
            folder.parent.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(FileExistsError):
                folder.mkdir(mode=0o700)
            if _is_private(folder) and os.access(folder, os.W_OK):
                _remove_damaged(folder)
                return folder
    root = tempfile.mkdtemp(prefix="rvsg-kernels-")
    os.environ["NUMBA_CACHE_DIR"] = root  # processes that this one starts take the same
    folder = Path(root) / name
    folder.mkdir(mode=0o700)
    return folder


def seal_cache() -> None:
    """Note the checksums of what the cache holds, so that another process finds out what is damaged."""
    folder = cache_folder()
    with contextlib.suppress(OSError):
        write_whole(
            folder / MANIFEST, json.dumps({str(p.relative_to(folder)): _digest(p) for p in _data_files(folder)})
        )


@contextlib.contextmanager
def compilation_reported(functions: int, report: Callable[[str], None], *, period_s: float = 0.5) -> Iterator[None]:
    """Report at each quarter how many of about so many functions the cache has received, and the time left."""
    before, started, done = len(_data_files(cache_folder())), time.monotonic(), threading.Event()
    processor = time.process_time()

    def watch() -> None:
        quarter = 1
        while not done.wait(period_s):
            share = (len(_data_files(cache_folder())) - before) / functions
            if quarter <= 4 * share < 4:
                left = (time.monotonic() - started) * (share**-LATER_LARGER - 1)
                ours = (time.process_time() - processor) / (time.monotonic() - started)
                busy = f"; the machine is busy, this process gets {ours:.0%} of a core" if ours < BUSY else ""
                report(
                    f"compiled {share * functions:.0f} of about {functions} functions, about {left:.0f} s left{busy}"
                )
                quarter = int(4 * share) + 1

    watching = threading.Thread(target=watch, daemon=True)
    watching.start()
    try:
        yield
    finally:
        done.set()
        watching.join()


def _is_private(folder: Path) -> bool:
    status = folder.lstat()
    ours = not hasattr(os, "getuid") or (status.st_uid == os.getuid() and not status.st_mode & 0o077)
    return stat.S_ISDIR(status.st_mode) and ours


def _remove_damaged(folder: Path) -> None:
    """Remove compiled code that is not as it was sealed, and indices that cannot be read."""
    try:
        sealed = json.loads((folder / MANIFEST).read_bytes())
    except (OSError, ValueError):
        sealed = {}
    for path in _data_files(folder):
        if sealed.get(str(path.relative_to(folder)), digest := _digest(path)) != digest:
            path.unlink(missing_ok=True)
            index = path.name.removesuffix(".nbc").rsplit(".", 1)[0] + ".nbi"
            path.with_name(index).unlink(missing_ok=True)
    for path in folder.glob("*/*/*.nbi"):
        try:
            with path.open("rb") as file:  # numba's version, then the index; nothing of it is run
                deque(pickletools.genops(file), maxlen=0)
                deque(pickletools.genops(file), maxlen=0)
        except Exception:
            path.unlink(missing_ok=True)


def _data_files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*/*/*.nbc"))


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _compiled(function: Any, *, cached: bool = True, **options: Any) -> Any:
    module = sys.modules.get(function.__module__)
    cached = cached and module is not None and function.__module__.split(".", maxsplit=1)[0] == _PACKAGE
    config, njit = cast(Any, numba.config), cast(Any, numba.njit)
    before = config.CACHE_DIR
    if cached:
        config.CACHE_DIR = str(cache_folder() / _content(cast(ModuleType, module)))
    try:
        return njit(error_model="numpy", cache=cached, no_cfunc_wrapper=True, **options)(function)
    finally:
        config.CACHE_DIR = before


_CONTENTS: dict[str, str] = {}


def _content(module: ModuleType) -> str:
    """Return the hash of what the kernels of a module depend on, as it is when its first kernel is defined."""
    if module.__name__ not in _CONTENTS:
        _CONTENTS[module.__name__] = ""  # modules that import each other
        digest = hashlib.sha256(f"{FORMAT} {llvmlite.__version__} {llvmlite.binding.get_host_cpu_name()}".encode())
        digest.update(Path(str(module.__file__)).read_bytes())
        for piece in sorted(_pieces(module)):
            digest.update(piece.encode())
        _CONTENTS[module.__name__] = digest.hexdigest()[:16]
    return _CONTENTS[module.__name__]


def _pieces(module: ModuleType) -> Iterator[str]:
    """Yield the constants of a module, its imported ones too, and the content of modules whose kernels it calls."""
    for name, value in vars(module).items():
        other = value if isinstance(value, ModuleType) else sys.modules.get(getattr(value, "__module__", None) or "")
        if isinstance(value, bool | int | float | str | tuple | np.generic):
            yield f"{name}={value!r}"
        elif isinstance(value, np.ndarray):
            yield f"{name}={value.dtype}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
        elif isinstance(value, type) and issubclass(value, tuple):
            yield f"{name}={value.__module__}{getattr(value, '_fields', '')}"
        elif other is not None and other is not module and "_nrt" in getattr(value, "targetoptions", ()):
            yield f"{name}={_content(other)}"
        elif isinstance(value, ModuleType) and value.__name__.startswith(f"{_PACKAGE}.simulation"):
            yield f"{name}={_content(value)}"
