"""Records that kernels get by reference: an address instead of a copy of every field.

Numba passes a named tuple as one argument for each number of each field, some three hundred for the state of a run. By
reference the loop compiles in half of the time, and it reads a field only where it uses it. Numba's own `structref`
costs a fifth of the speed of runs: it counts the references to every array that it reads, and it reads fields again
after every change of any array. Here LLVM is told that fields never change. This uses numba's extension interface.
"""

# mypy: disable-error-code="no-untyped-call, untyped-decorator, misc"
from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Union, cast, get_args, get_origin

import numpy as np

from rvsg.core import kernels  # noqa: F401  (the one that imports numba)

# isort: split
import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

from rvsg.core.records import Record

_WORD = ir.IntType(64)


class ReferenceType(types.Type):
    """Numba's type of a reference: the class of the named tuple or record, its fields and their types."""

    def __init__(self, cls: type, names: Iterable[str], kinds: tuple[Any, ...]) -> None:
        self.fields = dict(zip(names, kinds, strict=True))
        text = f"{cls.__module__}.{cls.__qualname__}{list(self.fields.items())}"
        super().__init__(f"{cls.__name__}Ref{hashlib.sha256(text.encode()).hexdigest()[:16]}")


@register_model(ReferenceType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _WORD)


class Reference:
    """A named tuple by reference. It keeps the tuple, whose arrays it shares, and 64-bit words that describe it."""

    __slots__ = ("address", "kept", "kind")

    def __init__(self, kind: ReferenceType, words: bytes, kept: Any) -> None:
        memory = np.frombuffer(words, np.int64)
        self.kind = kind
        self.address = memory.ctypes.data
        self.kept = memory, kept


_KNOWN: dict[tuple[Any, ...], tuple[ReferenceType, struct.Struct]] = {}
"""The type of a reference and the form of its words by what decides them: to ask numba takes 4 ms for each run."""


def refer(values: Any, **others: Any) -> Any:
    """Return a named tuple or a record by reference, sharing its arrays.

    Args:
        values: records that are fields of it become references, too. Of a record, kernels read the numbers; None is 0.
        others: the references that are other fields of it.
    """
    fields: dict[str, Any]
    if isinstance(values, Record):
        fields = {name: 0.0 if (value := getattr(values, name)) is None else value for name in _read_of(type(values))}
    else:
        fields = values._asdict() | others
    fields = {name: refer(value) if isinstance(value, Record) else value for name, value in fields.items()}
    words: list[Any] = []
    form: list[Any] = [type(values)]
    _add_words(tuple(fields.values()), words, form)
    key = tuple(form)
    if key not in _KNOWN:
        kinds = tuple(types.unliteral(cast(Any, numba.typeof)(value)) for value in fields.values())
        signs = "".join("d" if isinstance(word, float | np.floating) else "q" for word in words)
        _KNOWN[key] = ReferenceType(type(values), fields, kinds), struct.Struct(signs)
    kind, packed = _KNOWN[key]
    return Reference(kind, packed.pack(*words), (values, fields))


@cache
def _read_of(kind: type[Record]) -> tuple[str, ...]:
    """Return the fields of a record that kernels read: its numbers, also those that may be None, and its records."""

    def is_read(annotation: Any) -> bool:
        if get_origin(annotation) in (Union, UnionType):
            return all(is_read(argument) for argument in get_args(annotation) if argument is not NoneType)
        plain = get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation
        return isinstance(plain, type) and issubclass(plain, int | float | Record)

    return tuple(name for name, info in kind.model_fields.items() if is_read(info.annotation))


def _add_words(value: Any, words: list[Any], form: list[Any]) -> None:
    if isinstance(value, np.ndarray):
        form.append((value.dtype, value.ndim, value.flags.num))
        words += (value.__array_interface__["data"][0], *value.shape, *value.strides)
    elif isinstance(value, tuple):
        form += (type(value), len(value))
        for item in value:
            _add_words(item, words, form)
    elif isinstance(value, Reference):
        form.append(value.kind)
        words.append(value.address)
    else:
        form.append(type(value))
        words.append(value)


@typeof_impl.register(Reference)
def _type_of(value: Reference, _: Any) -> ReferenceType:
    return value.kind


@unbox(ReferenceType)
def _unbox(_: Any, value: Any, c: Any) -> Any:
    address = c.pyapi.object_getattr_string(value, "address")
    word = c.unbox(types.int64, address).value
    c.pyapi.decref(address)
    return NativeValue(word)


@infer_getattr
class _Fields(AttributeTemplate):
    key = ReferenceType

    def generic_resolve(self, kind: Any, name: str) -> Any:  # type: ignore[override]
        return kind.fields.get(name)


@lower_getattr_generic(ReferenceType)
def _read_field(context: Any, builder: Any, kind: Any, address: Any, name: str) -> Any:
    base = builder.inttoptr(address, _WORD.as_pointer())
    fields = list(kind.fields)
    at = sum(_size(kind.fields[field]) for field in fields[: fields.index(name)])
    return _read(context, builder, base, at, kind.fields[name])


def _size(kind: Any) -> int:
    """Return the number of words of a field."""
    if isinstance(kind, types.Array):
        return 1 + 2 * int(kind.ndim)
    return sum(map(_size, cast(Any, kind).types)) if isinstance(kind, types.BaseTuple) else 1


def _read(context: Any, builder: Any, base: Any, at: int, kind: Any) -> Any:
    """Return the code that reads a field. An array has no owner there: `Reference` keeps it."""

    def load(index: int, wanted: Any = _WORD) -> Any:
        place = builder.gep(base, [ir.Constant(_WORD, index)], inbounds=True)
        loaded = builder.load(builder.bitcast(place, wanted.as_pointer()))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    if isinstance(kind, types.Array):
        array = cgutils.create_struct_proxy(kind)(context, builder)
        array.data = builder.inttoptr(load(at), array.data.type)
        sizes = range(at + 1, at + 1 + kind.ndim)
        shape = [load(k) for k in sizes]
        count = shape[0]
        for operand in shape[1:]:
            count = builder.mul(count, operand)
        array.nitems = count
        size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        array.itemsize = context.get_constant(types.intp, size)
        array.shape = cgutils.pack_array(builder, shape)
        array.strides = cgutils.pack_array(builder, [load(k + kind.ndim) for k in sizes])
        array.meminfo = array.meminfo.type(None)
        array.parent = array.parent.type(None)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        parts = []
        for member in cast(Any, kind).types:
            parts.append(_read(context, builder, base, at, member))
            at += _size(member)
        return context.make_tuple(builder, kind, parts)
    wanted = context.get_value_type(kind)
    if isinstance(kind, types.Float):
        return builder.fptrunc(load(at, ir.DoubleType()), wanted) if kind.bitwidth < 64 else load(at, wanted)
    word = load(at)
    return builder.trunc(word, wanted) if wanted.width < 64 else word
