"""Records that kernels get by reference: one pointer instead of a copy of every field.

A reference is numba's `structref`, but for two things. Python fills its memory, so no kernel is compiled to make one.
And LLVM is told that the fields never change, so a loop does not read them again after every change of any array.
"""

# mypy: disable-error-code="attr-defined, no-untyped-call"
from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from functools import cache
from typing import Any, cast

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, imputils, types
from numba.core.datamodel import default_manager, models
from numba.core.extending import infer_getattr, lower_getattr_generic
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python, rtsys
from numba.core.runtime.nrt import MemInfo
from numba.core.runtime.nrtdynmod import _meminfo_struct_type
from numba.core.typing.templates import AttributeTemplate
from numba.experimental import structref
from numba.np.numpy_support import as_dtype, from_dtype, map_layout

FIELDS: dict[type, tuple[str, ...]] = {}
"""The names of the fields of each class of references."""
_DATA = 3
"""Which number of numba's record of a piece of memory is the address."""


def by_reference(cls: Any) -> Any:
    """Make the by-reference form of a NamedTuple class, named `<class>Ref`, in the class's module.

    `refer` makes one of a tuple; kernels read the fields by the same names.
    """
    module = sys.modules[cls.__module__]
    name = f"{cls.__name__}Ref"

    def preprocess_fields(self: Any, fields: Any) -> Any:
        return tuple((field, types.unliteral(kind)) for field, kind in fields)

    def mangling_args(self: Any) -> tuple[str, tuple[()]]:
        """A short name in the code: numba's would list all fields in the name of every function and every call."""
        return f"{name}{hashlib.sha256(self.name.encode()).hexdigest()[:16]}", ()

    body = {
        "preprocess_fields": preprocess_fields,
        "mangling_args": property(mangling_args),
        "__module__": cls.__module__,
        "__qualname__": f"{name}Type",
    }
    kind = type(f"{name}Type", (types.StructRef,), body)
    default_manager.register(kind, models.StructRefModel)
    _read_fields(kind)
    proxy = type(name, (structref.StructRefProxy,), {"__module__": cls.__module__, "__qualname__": name})
    structref.define_boxing(kind, proxy)
    FIELDS[proxy] = cls._fields
    # The cache pickles types by name, so both must be found in the module.
    setattr(module, f"{name}Type", kind)
    setattr(module, name, proxy)
    return proxy


def refer(values: Any, **others: Any) -> Any:
    """Return a named tuple by reference, sharing its arrays; `others` are the references that are fields of it."""
    cls: Any = type(values)
    given = tuple(others.get(name, value) for name, value in zip(cls._fields, values, strict=True))
    kind = _kind(cls, tuple(_type_of(value) for value in given))
    layout, pack = _form(kind)
    memory = np.zeros(1, layout)
    memory[0] = tuple(each(value) for each, value in zip(pack, given, strict=True))
    rtsys.initialize(cpu_target.target_context)
    head = _nrt_python.meminfo_new(memory.ctypes.data, (memory, values, others))
    made = getattr(sys.modules[cls.__module__], f"{cls.__name__}Ref")._numba_box_(kind, MemInfo(head))
    made._head = head
    return made


def _type_of(value: Any) -> Any:
    if type(value) is not np.ndarray:
        return cast(Any, numba.typeof)(value)
    flags = value.flags
    return _array_type(value.dtype, value.ndim, map_layout(value), flags.writeable, flags.aligned)


@cache
def _array_type(dtype: Any, ndim: int, order: Any, writeable: bool, aligned: bool) -> Any:
    return types.Array(from_dtype(dtype), ndim, order, readonly=not writeable, aligned=aligned)


@cache
def _kind(cls: Any, kinds: tuple[Any, ...]) -> Any:
    """Return the type of the references to a class of named tuples whose fields have these types."""
    return getattr(sys.modules[cls.__module__], f"{cls.__name__}RefType")(zip(cls._fields, kinds, strict=True))


@cache
def _form(kind: Any) -> tuple[np.dtype[Any], tuple[Callable[[Any], Any], ...]]:
    """Return how what a reference refers to lies in memory, and how each field is packed."""
    fields = kind.field_dict
    layout = np.dtype([(name, _field_layout(each)) for name, each in fields.items()], align=True)
    return layout, tuple(_packer(each) for each in fields.values())


@cache
def _offset(kind: Any, attr: str) -> int:
    return int(_form(kind)[0].fields[attr][1])  # type: ignore[index]


def _field_layout(kind: Any) -> Any:
    if isinstance(kind, types.Array):
        numbers = [(name, np.int64) for name in ("memory", "parent", "count", "size", "data")]
        return np.dtype([*numbers, ("shape", np.int64, (kind.ndim,)), ("strides", np.int64, (kind.ndim,))])
    if isinstance(kind, types.BaseTuple):
        return np.dtype([(f"f{k}", _field_layout(each)) for k, each in enumerate(_parts(kind))], align=True)
    return np.dtype(np.int64) if isinstance(kind, types.StructRef) else as_dtype(kind)


def _packer(kind: Any) -> Callable[[Any], Any]:
    """Return what makes of a field what numpy takes. Arrays have no owner there: the reference keeps them."""
    if isinstance(kind, types.Array):
        return lambda array: (
            0, 0, array.size, array.itemsize, array.__array_interface__["data"][0], array.shape, array.strides
        )  # fmt: skip
    if isinstance(kind, types.BaseTuple):
        inner = tuple(_packer(each) for each in _parts(kind))
        return lambda values: tuple(each(value) for each, value in zip(inner, values, strict=True))
    return (lambda reference: reference._head) if isinstance(kind, types.StructRef) else lambda value: value


def _parts(kind: Any) -> tuple[Any, ...]:
    return tuple(kind.types)


def _read_fields(kind: Any) -> None:
    """Let kernels read the fields of a type of references."""

    @infer_getattr
    class Fields(AttributeTemplate):
        key = kind

        def generic_resolve(self, typ: Any, attr: str) -> Any:  # type: ignore[override]
            return typ.field_dict.get(attr)

    @lower_getattr_generic(kind)  # type: ignore[untyped-decorator]
    def read(context: Any, builder: Any, typ: Any, value: Any, attr: str) -> Any:
        field = typ.field_dict[attr]
        memory = builder.extract_value(value, 0)
        head = builder.bitcast(memory, _meminfo_struct_type.as_pointer())
        data = _constant(builder, builder.load(cgutils.gep_inbounds(builder, head, 0, _DATA)))
        at = builder.gep(data, [ir.Constant(ir.IntType(64), _offset(typ, attr))], inbounds=True)
        pointer = builder.bitcast(at, context.get_value_type(field).as_pointer())
        found = _constant(builder, builder.load(pointer))
        return imputils.impl_ret_borrowed(context, builder, field, found)


def _constant(builder: Any, loaded: Any) -> Any:
    """Tell LLVM that what is read is never written.

    It splits the reading of an array's record, and keeps only the second of these marks then.
    """
    module = builder.module
    number = ir.IntType(64)
    loaded.set_metadata("invariant.load", module.add_metadata([]))
    field = module.add_metadata(["field", module.add_metadata(["fields of rvsg"]), number(0)])
    loaded.set_metadata("tbaa", module.add_metadata([field, field, number(0), number(1)]))
    return loaded
