"""What numba works out anew for every function, remembered while kernels are compiled: a fifth of the time.

The code that numba makes is the same. This relies on how the numba works that pyproject.toml allows.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from types import BuiltinFunctionType
from typing import Any
from unittest.mock import patch

from numba.core import types
from numba.core.base import BaseContext
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.transforms import canonicalize_cfg
from numba.core.typing.context import BaseContext as TypingContext

_PLAIN = (types.Number, types.Boolean, types.Array, types.BaseTuple, int)
_FUNCTIONS = (types.Function, BuiltinFunctionType, str)
_signatures: dict[Any, Any] = {}
_sizes: dict[str, int] = {}
_loaded: set[int] = set()
_resolve: Any = TypingContext.resolve_function_type
_size_of: Any = BaseContext.get_abi_sizeof
_refresh: Any = BaseContext.refresh
_process: Any = PostProcessor.run
_canonical: Any = canonicalize_cfg
_lifetimes: Any = VariableLifetime


@contextmanager
def remembered() -> Iterator[None]:
    """Let numba remember, within this context."""
    if TypingContext.resolve_function_type is _resolved:
        yield
        return
    with ExitStack() as stack:
        stack.enter_context(patch.object(TypingContext, "resolve_function_type", _resolved))
        stack.enter_context(patch.object(BaseContext, "get_abi_sizeof", _sized))
        stack.enter_context(patch.object(BaseContext, "refresh", _refreshed))
        stack.enter_context(patch.object(PostProcessor, "run", _processed))
        yield


def _resolved(context: Any, function: Any, arguments: Any, keywords: Any) -> Any:
    """Return the signature of a builtin function for numbers and arrays, which does not depend on who calls it."""
    if keywords or not isinstance(function, _FUNCTIONS) or not all(isinstance(kind, _PLAIN) for kind in arguments):
        return _resolve(context, function, arguments, keywords)
    key = (context, function, tuple(arguments))
    found = _signatures.get(key)
    if found is None:
        found = _resolve(context, function, arguments, keywords)
        if found is not None:
            _signatures[key] = found
    return found


def _sized(context: Any, kind: Any) -> int:
    """Return the size of a type, for which numba has LLVM parse a module."""
    name = str(kind)
    if name not in _sizes:
        _sizes[name] = _size_of(context, kind)
    return _sizes[name]


def _refreshed(context: Any) -> None:
    """Look for what was registered since, without importing all of numba's own modules again."""
    if id(context.typing_context) not in _loaded:
        _refresh(context)
        _loaded.add(id(context.typing_context))
        return
    for registry in list(context._registries):
        context.install_registry(registry)
    typing = context.typing_context
    for registry in list(typing._registries):
        typing.install_registry(registry)


def _processed(processor: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """Leave out what only generators need, and the ends of lifetimes as long as nobody asks for them."""
    ir = processor.func_ir
    if emit_dels or ir.is_generator:
        _process(processor, emit_dels, extend_lifetimes)
        return
    ir.blocks = _canonical(ir.blocks)
    ir.variable_lifetime = _lifetimes(ir.blocks)
    ir.generator_info = None
