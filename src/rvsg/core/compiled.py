"""Compilation of kernels with numba, and the cache that keeps the compiled code.

The cache is addressed by content. A kernel is loaded only where its own code, the code of every kernel it calls, the
constants they read, the layout of its arguments, and the versions of Python, numba, llvmlite and the processor are
those it was compiled with. Path and age of the source files do not matter, so a cache can be copied between machines.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
import tempfile
import uuid
from collections.abc import Callable, Iterator
from enum import Enum
from functools import cache, partial
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeVar, cast, overload

import llvmlite
import numba
import numpy as np
from numba.core import types
from numba.core.caching import FunctionCache, _CacheLocator
from numba.core.dispatcher import Dispatcher
from numba.core.serialize import dumps as numba_dumps

from rvsg.core.nested import Door, DoorCompiler, Implementation, Nested, NestedCompiler
from rvsg.core.references import FIELDS

F = TypeVar("F", bound=Callable[..., object])

FORMAT = 3
"""Raise it to make every compiled kernel obsolete."""
_PACKAGE = __name__.split(".", maxsplit=1)[0]


@overload
def kernel(function: F) -> F: ...
@overload
def kernel(*, arrays: bool) -> Callable[[F], F]: ...


def kernel(function: Any = None, *, arrays: bool = False) -> Any:
    """Compile a function at its first call from Python, or load it from the cache.

    Arithmetic follows IEEE 754: division by zero gives an infinity or NaN.

    Args:
        arrays: it makes arrays, or gets new ones from what it calls, so it counts the references to arrays. Others
            borrow those of their arguments: less code, and nothing to count wherever an array is read.
    """
    if function is None:
        return partial(kernel, arrays=arrays)
    door = _compiled(function, Door, no_cfunc_wrapper=True)
    door.nested = _nested(function, arrays)
    return door


@overload
def inner(function: F) -> F: ...
@overload
def inner(*, arrays: bool) -> Callable[[F], F]: ...


def inner(function: Any = None, *, arrays: bool = False) -> Any:
    """Compile a function that only kernels call; `arrays` as for a kernel.

    It has no entry point for Python. Calling it from Python ends the process; a test calls it from a kernel of its own.
    """
    return partial(inner, arrays=arrays) if function is None else _nested(function, arrays)


def type_of(value: Any) -> Any:
    """Return numba's type of a value."""
    return cast(Any, numba.typeof)(value)


def compile_for(function: Callable[..., object], *kinds: Any) -> None:
    """Compile a kernel for types of arguments, or load it from the cache."""
    cast(Any, function).compile(kinds)


@cache
def cache_folder() -> Path:
    """Return the folder of compiled kernels: in NUMBA_CACHE_DIR, XDG_CACHE_HOME, ~/.cache or the temporary folder."""
    choices = [
        Path(os.environ["NUMBA_CACHE_DIR"]) if os.environ.get("NUMBA_CACHE_DIR") else None,
        Path(os.environ["XDG_CACHE_HOME"]) / "rvsg" if os.environ.get("XDG_CACHE_HOME") else None,
        Path("~/.cache/rvsg"),
        Path(tempfile.gettempdir()) / f"rvsg-{os.getuid() if hasattr(os, 'getuid') else 'user'}",
    ]
    name: str = f"kernels-{FORMAT}-py{sys.version_info[0]}{sys.version_info[1]}-numba{numba.__version__}-llvmlite" + (
        llvmlite.__version__
    )
    for choice in choices:
        if choice is None:
            continue
        try:
            folder = choice.expanduser() / name
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, RuntimeError):
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="rvsg-kernels-"))


def is_compiled(function: Callable[..., object]) -> bool:
    """Whether this process has compiled or loaded a kernel."""
    return bool(cast(Any, function).overloads)


def is_cached(function: Callable[..., object]) -> bool:
    """Whether the cache holds this kernel, as it is now, for this processor."""
    dispatcher = cast(Any, function)
    return any(cache_folder().glob(f"{dispatcher._cache.stem(dispatcher.targetctx.codegen())}-*.nbc"))


class _Folder(_CacheLocator):
    """Place of compiled kernels: one folder for all, whatever the path and age of the source."""

    @classmethod
    def from_function(cls, function: Any, file: str) -> _Folder:
        """Return the locator of a function."""
        return cls()

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(cache_folder())

    def get_source_stamp(self) -> int:
        """Return a constant: a file's name holds the content it was compiled from."""
        return FORMAT

    def get_disambiguator(self) -> str:
        """Return nothing: see `get_source_stamp`."""
        return ""


class _Implementation(Implementation):
    """Numba's serialisation of compiled code, in our folder."""

    _locator_classes = [_Folder]  # type: ignore[list-item]  # noqa: RUF012


class _Files:
    """One file per kernel, content and signature, so that processes with other sources can share the folder."""

    def load(self, key: str) -> Any:
        """Return the stored data; None where there is none or it cannot be read."""
        try:
            return pickle.loads((cache_folder() / f"{key}.nbc").read_bytes())  # noqa: S301
        except (OSError, EOFError, pickle.UnpicklingError):
            return None

    def save(self, key: str, data: Any) -> None:
        """Store data under a key in one step."""
        path = cache_folder() / f"{key}.nbc"
        temporary = path.with_suffix(f".{uuid.uuid4().hex[:16]}.tmp")
        try:
            temporary.write_bytes(numba_dumps(data))
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)

    def flush(self) -> None:
        """Do nothing: other contents are other files."""


class _ContentCache(FunctionCache):
    """Cache of one kernel, addressed by content.

    Numba freezes the constants that a kernel reads when it compiles it first. A process in which a constant changed
    after that (a test that patches it) neither loads nor saves that kernel any more.
    """

    _impl_class = _Implementation

    def __init__(self, function: Any, flags: dict[str, Any]) -> None:
        super().__init__(function)
        self._cache_file: Any = _Files()
        self._flags = flags
        self._frozen: str | None = None
        self._callees: set[_ContentCache] = set()

    def content(self) -> str:
        """Return the hash of everything that compiled code of this kernel depends on, as numba has frozen it."""
        if self._frozen is None:
            self._frozen = self._py_func.__qualname__  # what kernels that call each other see of this one
            self._frozen = self._current()
        return self._frozen

    def stem(self, codegen: Any) -> str:
        """Return the part of a file's name that all signatures share: function, content and processor."""
        version = _hash(self.content(), repr(codegen.magic_tuple()))
        return f"{self._py_func.__module__.rsplit('.', 1)[-1]}.{self._py_func.__name__}-{version}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load compiled code; None where there is none or a constant changed since the first compilation."""
        return super().load_overload(sig, target_context) if self._is_unchanged(set()) else None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save compiled code, unless a constant changed since the first compilation."""
        if self._is_unchanged(set()):
            super().save_overload(sig, data)

    def _current(self) -> str:
        return _hash(repr(sorted(self._flags.items())), *_pieces(self._py_func, {self._py_func}, self._callees))

    def _is_unchanged(self, seen: set[Any]) -> bool:
        """Whether the kernel and all that it calls read the constants with which they were first compiled."""
        if self in seen:
            return True
        seen.add(self)
        return self.content() == self._current() and all(callee._is_unchanged(seen) for callee in list(self._callees))

    def _index_key(self, sig: Any, codegen: Any) -> str:
        return f"{self.stem(codegen)}-{_hash(*_layout(sig))}"


def _hash(*pieces: str) -> str:
    """Return 16 hexadecimal digits."""
    return hashlib.sha256("\0".join(pieces).encode()).hexdigest()[:16]


def _pieces(function: Any, seen: set[Any], callees: set[_ContentCache]) -> Iterator[str]:
    """Yield the code of a function, the constants it reads and what the kernels it calls depend on.

    The caches of the kernels it calls are added to `callees`.
    """
    yield f"{function.__module__}.{function.__qualname__}"
    for code in _codes(function.__code__):
        yield code.co_code.hex()
        yield repr([constant for constant in code.co_consts if not isinstance(constant, CodeType)])
        yield repr((code.co_names, code.co_varnames, code.co_freevars))
        for name in code.co_names:
            if name in function.__globals__:
                yield name
                yield from _value(function.__globals__[name], code.co_names, seen, callees)
    yield repr(function.__defaults__)
    for cell in function.__closure__ or ():
        yield from _value(cell.cell_contents, (), seen, callees)


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield a code object and those of the functions and comprehensions inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _value(value: Any, names: tuple[str, ...], seen: set[Any], callees: set[_ContentCache]) -> Iterator[str]:
    """Yield the content of a global that a kernel reads; of a module of ours, those attributes that `names` holds."""
    if isinstance(value, Dispatcher):
        found = getattr(value, "_cache", None)
        if value.py_func in seen:
            yield f"{value.py_func.__module__}.{value.py_func.__qualname__}"
        elif isinstance(found, _ContentCache):
            callees.add(found)
            yield found.content()
        else:
            yield from _pieces(value.py_func, seen | {value.py_func}, callees)
    elif isinstance(value, ModuleType):
        yield value.__name__
        if value.__name__.split(".", maxsplit=1)[0] == _PACKAGE:
            for name in names:
                if name in vars(value):
                    yield name
                    yield from _value(vars(value)[name], names, seen, callees)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}{hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
    elif isinstance(value, type):
        yield f"{value.__module__}.{value.__qualname__}{FIELDS.get(value, getattr(value, '_fields', ''))}"
    elif isinstance(value, bool | int | float | complex | str | bytes | Enum | np.generic | None):
        yield f"{type(value).__name__}:{value!r}"
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _value(item, names, seen, callees)
    elif isinstance(value, FunctionType):
        if value not in seen:
            yield from _pieces(value, seen | {value}, callees)
    else:
        yield f"{type(value).__qualname__}:{getattr(value, '__name__', '')}"


def _layout(kind: Any) -> Iterator[str]:
    """Yield the field names of the named tuples among the types of a signature, which numba's types do not compare."""
    if isinstance(kind, tuple):
        for each in kind:
            yield from _layout(each)
    elif isinstance(kind, types.NamedTuple | types.NamedUniTuple):
        yield f"{kind.instance_class.__module__}.{kind.instance_class.__name__}{kind.fields}"
        yield from _layout(tuple(kind.types))
    elif isinstance(kind, types.StructRef):
        yield f"{type(kind).__module__}.{type(kind).__qualname__}{tuple(kind.field_dict)}"
        yield from _layout(tuple(kind.field_dict.values()))
    else:
        yield str(kind)


def _nested(function: Any, arrays: bool) -> Nested:
    flags = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": arrays}
    return cast(Nested, _compiled(function, Nested, pipeline_class=NestedCompiler, **flags))


def _compiled(function: Any, kind: Any, *, pipeline_class: Any = DoorCompiler, **flags: Any) -> Any:
    options = {"nopython": True, "boundscheck": None, "error_model": "numpy", **flags}
    dispatcher = kind(py_func=function, targetoptions=options, pipeline_class=pipeline_class)
    dispatcher._cache = _ContentCache(function, flags)
    return dispatcher
