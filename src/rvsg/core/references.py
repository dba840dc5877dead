"""Records that kernels get by reference: one pointer instead of a copy of every field.

A reference is numba's `structref`, but for two things. Python fills its memory, so no kernel is compiled to make one.
And LLVM is told that the fields never change, so a loop does not read them again after every change of any array.
"""

# mypy: disable-error-code="attr-defined, no-untyped-call"
from __future__ import annotations

import hashlib
import struct
import sys
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
from numba.np.numpy_support import as_dtype

_KNOWN: dict[tuple[Any, ...], tuple[Any, struct.Struct]] = {}
"""The type of references to named tuples with these fields, and how to fill their memory."""
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
    given = values._replace(**others) if others else values
    signature: list[Any] = [cls]
    words: list[Any] = []
    _read(given, signature, words)
    key = tuple(signature)
    if key not in _KNOWN:
        rtsys.initialize(cpu_target.target_context)
        kinds = zip(cls._fields, map(_type_of, given), strict=True)
        kind = getattr(sys.modules[cls.__module__], f"{cls.__name__}RefType")(kinds)
        _KNOWN[key] = kind, struct.Struct(_format(_layout(kind)))
    kind, packed = _KNOWN[key]
    memory = np.zeros(-(-packed.size // 8), np.int64)
    packed.pack_into(memory.data, 0, *words)
    head = _nrt_python.meminfo_new(memory.ctypes.data, (memory, values, others))
    made = getattr(sys.modules[cls.__module__], f"{cls.__name__}Ref")._numba_box_(kind, MemInfo(head))
    made._head = head
    return made


def _read(values: Any, signature: list[Any], words: list[Any]) -> None:
    """Add what the types of fields depend on, and the numbers that lie in memory.

    Arrays have no owner there: the reference keeps them.
    """
    for value in values:
        kind = type(value)
        if kind is np.ndarray:
            signature.append((value.dtype, value.ndim, value.flags.num))
            words += (0, 0, value.size, value.itemsize, value.__array_interface__["data"][0])
            words += value.shape
            words += value.strides
        elif issubclass(kind, tuple):
            signature += (kind, len(value))
            _read(value, signature, words)
        elif issubclass(kind, structref.StructRefProxy):
            signature.append(value._type)
            words.append(value._head)
        else:
            signature.append(kind)
            words.append(value)


def _type_of(value: Any) -> Any:
    return cast(Any, numba.typeof)(value)


@cache
def _layout(kind: Any) -> np.dtype[Any]:
    """Return how what a reference refers to lies in memory."""
    return np.dtype([(name, _field_layout(each)) for name, each in kind.field_dict.items()], align=True)


@cache
def _offset(kind: Any, attr: str) -> int:
    return int(_layout(kind).fields[attr][1])  # type: ignore[index]


def _field_layout(kind: Any) -> Any:
    if isinstance(kind, types.Array):
        numbers = [(name, np.int64) for name in ("memory", "parent", "count", "size", "data")]
        return np.dtype([*numbers, ("shape", np.int64, (kind.ndim,)), ("strides", np.int64, (kind.ndim,))])
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind.types
        return np.dtype([(f"f{k}", _field_layout(each)) for k, each in enumerate(parts)], align=True)
    return np.dtype(np.int64) if isinstance(kind, types.StructRef) else as_dtype(kind)


def _format(layout: np.dtype[Any]) -> str:
    """Return a layout as the standard library's `struct` writes it."""
    if layout.subdtype is not None:
        return f"{layout.shape[0]}{layout.subdtype[0].char}"
    if layout.fields is None:
        return layout.char
    found, at = "", 0
    for each, start, *_ in layout.fields.values():
        found += f"{start - at}x{_format(each)}"
        at = start + each.itemsize
    return f"{found}{layout.itemsize - at}x"


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
