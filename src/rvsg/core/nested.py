"""How kernels are compiled into kernels: each function once, and machine code only for what Python calls.

Numba optimises every function and turns it into machine code, and again as a part of every function that calls it.
Here a function that a kernel calls stays as it is lowered, unless it is an innermost one, until the kernel that Python
calls is optimised as a whole.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
from numba.core import ir, types
from numba.core.caching import CompileResultCacheImpl
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult, Flags
from numba.core.errors import UnsupportedError
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature

from rvsg.core.remembered import remembered

NESTED = "nested"
"""How the cache marks the code of a function that only kernels call."""


class NestedLibrary(JITCodeLibrary):
    """The code of a function that only kernels call: not turned into machine code."""

    @property
    def codegen(self) -> Any:
        """Return the code generator, without an engine that could hold this code."""
        return _WithoutEngine(self._codegen)

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        """Optimise innermost functions, whose loops make better code alone; leave the others to the kernel."""
        if not any(isinstance(library, NestedLibrary) for library in self._linking_libraries):
            super()._optimize_final_module()

    def _finalize_final_module(self) -> None:
        # Addresses of functions as values lie in the code until it is optimised; the kernel looks whether one is left.
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return the code for kernels. Numba copies it first, to keep its own for the engine."""
        self._ensure_finalized()
        if self._shared_module is None:
            for function in self._final_module.functions:
                if not function.is_declaration and function.linkage == llvm.Linkage.external:
                    function.linkage = llvm.Linkage.linkonce_odr
            self._shared_module = self._final_module
        return self._shared_module

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: there is no machine code."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Return what the cache holds: the code to be linked into kernels."""
        return (self.name, NESTED, self._get_module_for_linking().as_bitcode())

    @classmethod
    def restored(cls, codegen: Any, name: str, bitcode: bytes) -> NestedLibrary:
        """Return the library of code from the cache."""
        library = cls(codegen, name)
        library._shared_module = llvm.parse_bitcode(bitcode)
        library._finalized = True
        return library


class _WithoutEngine:
    """A code generator that does not set the environment of a function that has no machine code."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: the kernel sets the environments of all that is linked into it."""


class KeptFlags(Flags):
    """Numba's flags, without asking for each of them by name wherever two sets are compared, which is all the time."""

    __slots__ = ()

    def values(self) -> dict[str, Any]:
        """Return the value of every flag."""
        return {**_DEFAULTS, **self._values}

    def __hash__(self) -> int:
        return _HASH


_DEFAULTS = Flags().values()
_HASH = hash(Flags())
"""Numba's own hash is that of the names of the flags."""


UNUSED = frozenset(
    {
        "dead_branch_prune", "find_literally", "inline_closure_likes", "inline_inlinables", "inline_overloads",
        "literal_unroll", "LiteralPropagation", "make_function_op_code_to_jit_function", "Rewrite dynamic raises",
        "rewrite_semantic_constants", "with_lifting",
    }
)  # fmt: skip
"""Numba's passes for what kernels do not contain: closures, comprehensions, `with`, arguments that may be None."""


class DoorCompiler(Compiler):
    """Numba's compiler for kernels."""

    def __init__(
        self, typing: Any, target: Any, library: Any, args: Any, returned: Any, flags: Any, local: Any
    ) -> None:
        super().__init__(typing, target, library, args, returned, KeptFlags(flags), local)

    def define_pipelines(self) -> Any:
        """Return numba's passes without those that kernels do not need."""
        (manager,) = super().define_pipelines()
        manager.passes = [entry for entry in manager.passes if entry[0]._name not in UNUSED]
        manager.finalize()
        return [manager]


class NestedCompiler(DoorCompiler):
    """Numba's compiler with a library for code that only kernels call."""

    def __init__(self, typing: Any, target: Any, library: Any, *rest: Any) -> None:
        super().__init__(typing, target, library, *rest)
        if library is None:
            self.state.library = NestedLibrary(target.codegen(), NESTED)
            self.state.library.enable_object_caching()

    def compile_extra(self, func: Any) -> Any:
        """Compile a function; refuse one that would have to count references to arrays and does not."""
        compiled: Any = super().compile_extra(func)
        if not self.state.flags.nrt and self._owns_arrays(compiled):
            raise UnsupportedError(f"{func.__qualname__} returns an array or gets one from a call: mark it arrays=True")
        return compiled

    def _owns_arrays(self, compiled: Any) -> bool:
        kinds = [compiled.signature.return_type]
        for expression, signature in compiled.type_annotation.calltypes.items():
            if isinstance(expression, ir.Expr) and expression.op == "call" and signature is not None:
                kinds.append(signature.return_type)
        models = self.state.targetctx.data_model_manager
        return any(models[kind].contains_nrt_meminfo() for kind in kinds)


class Implementation(CompileResultCacheImpl):
    """Numba's serialisation of compiled code, and that of code that only kernels call."""

    def reduce(self, cres: Any) -> Any:
        """Return what the cache holds of a compiled function, without its source with types."""
        return super().reduce(cres._replace(type_annotation=""))

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return the compiled function that the cache holds."""
        (name, kind, code), fndesc, environment, signature, objectmode, lifted, annotation, reload_init, _ = payload
        if kind != NESTED:
            return super().rebuild(target_context, payload)
        for function in reload_init:
            function()
        library = NestedLibrary.restored(target_context.codegen(), name, code)
        result: Any = CompileResult
        return result(
            typing_context=target_context.typing_context,
            target_context=target_context,
            entry_point=target_context.get_executable(library, fndesc, environment),
            typing_error=None,
            type_annotation=annotation,
            signature=signature,
            objectmode=objectmode,
            lifted=lifted,
            fndesc=fndesc,
            library=library,
            call_helper=None,
            environment=environment,
            metadata=None,
            reload_init=reload_init,
            referenced_envs=(),
        )


class Nested(CPUDispatcher):
    """A function that only kernels call."""

    def compile(self, sig: Any) -> Any:
        """Compile it for a signature, unless that is done."""
        done: Any = self.overloads.get(tuple(normalize_signature(sig)[0]))
        if done is not None:
            return done.entry_point
        with remembered():
            return super().compile(sig)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return how a kernel calls it: one compiled form for all constants of a type."""
        plain = tuple(types.unliteral(kind) for kind in args)
        return super().get_call_template(plain, {name: types.unliteral(kind) for name, kind in kws.items()})


class Door(CPUDispatcher):
    """A kernel that Python calls; `nested` is what kernels call."""

    nested: Any
    """A `Nested`."""

    def compile(self, sig: Any) -> Any:
        """Compile the kernel with all that it calls."""
        kinds = tuple(normalize_signature(sig)[0])
        fresh = kinds not in self.overloads
        with _no_collection(), remembered():
            entry = super().compile(sig)
        if fresh:
            compiled: Any = self.overloads[kinds]
            for environment in compiled._find_referenced_environments():
                compiled.codegen.set_env(environment.env_name, environment)
        return entry

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return how a kernel calls it."""
        return self.nested.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """Return what a kernel calls."""
        return self.nested.get_overload(sig)


@contextmanager
def _no_collection() -> Iterator[None]:
    """Keep the garbage collector out: compilation makes millions of objects that live until its end."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
