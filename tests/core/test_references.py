"""Records that kernels get by reference, and which kernels count the references to arrays."""

from __future__ import annotations

import gc
import sys
from typing import Annotated, Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import NumbaError
from pydantic import Field

from rvsg.core.kernels import compile_for, inner, kernel, type_of
from rvsg.core.records import Record
from rvsg.core.references import refer


class Inner(Record):
    share: float = 0.25
    limit: Annotated[float, Field(gt=0)] | None = None
    count: int | None = None
    name: str = "inner"
    corners: tuple[float, ...] | None = None


class Outer(Record):
    inner: Inner = Inner()
    on: bool = True


class Part(NamedTuple):
    weights: Any
    on: bool
    count: int
    share: float


class Whole(NamedTuple):
    table: Any
    part: Any
    copied: Any
    small: Any
    seen: bool


@inner
def total(whole: Any) -> float:
    found = 0.0
    for i in range(whole.part.weights.size):
        whole.table[1, i] += whole.part.weights[i]
        found += whole.table[1, i] * whole.part.share
    return found + whole.copied.count + whole.copied.weights[2] + whole.small[0]


@inner(arrays=True)
def doubled(part: Any) -> Any:
    return 2.0 * part.weights


@inner
def doubled_unmarked(part: Any) -> Any:
    return doubled(part)


@kernel
def read(whole: Any) -> float:
    part = whole.part
    return total(whole) + doubled(part)[1] if part.on and not whole.seen else -1.0


@kernel
def read_record(outer: Any) -> float:
    return outer.inner.share + outer.inner.limit if outer.on else -1.0


@kernel
def refused(part: Any) -> float:
    return doubled_unmarked(part)[0]


@inner
def share(part: Any) -> float:
    return part.share * part.weights.size


def parts() -> tuple[Part, Any, Whole]:
    weights = np.arange(3.0)
    part = Part(weights, True, 7, 0.5)
    held = refer(part)
    return part, held, Whole(np.ones((2, 3)), part, part, np.array([3], np.int32), False)


@pytest.mark.parametrize(
    "array",
    [np.zeros(3), np.zeros((2, 3), np.float32), np.zeros((4, 3, 2), bool)[:, 1], np.asfortranarray(np.ones((2, 2)))],
)
def test_an_array_has_the_type_that_numba_gives_it(array: Any) -> None:
    def kept() -> Any:
        return type_of(refer(Part(array, True, 7, 0.5))).fields["weights"]

    assert kept() == kept() == numba.typeof(array)
    array.flags.writeable = False
    assert kept() == numba.typeof(array)


def test_other_types_of_numbers_are_another_type_of_reference() -> None:
    kinds = {type_of(refer(Part(np.zeros(1), *values))) for values in ((True, 7, 0.5), (True, 7, 1), (1, 7, 0.5))}
    assert len(kinds) == 3
    assert type_of(refer(Part(np.ones(2), False, 8, 1.5))) in kinds


def test_kernels_read_the_numbers_and_records_of_a_record_whatever_else_it_holds() -> None:
    kinds = {type_of(refer(Inner(limit=limit, corners=corners))) for limit in (None, 2.0) for corners in (None, (1.0,))}
    assert len(kinds) == 1 and list(kinds.pop().fields) == ["share", "limit", "count"]
    assert list(type_of(refer(Outer())).fields) == ["inner", "on"]


@pytest.mark.slow
class TestKernels:
    @pytest.mark.parametrize(("limit", "total"), [(None, 0.25), (2.0, 2.25)])
    def test_a_kernel_reads_a_record_in_a_record(self, limit: float | None, total: float) -> None:
        assert read_record(refer(Outer(inner=Inner(limit=limit)))) == total
        assert read_record(refer(Outer(on=False))) == -1.0

    def test_a_kernel_reads_every_kind_of_field_and_changes_the_callers_arrays(self) -> None:
        _, held, whole = parts()
        assert read(refer(whole, part=held)) == 0.5 * (1.0 + 2.0 + 3.0) + 7 + 2.0 + 3 + 2.0
        assert whole.table[1].tolist() == [1.0, 2.0, 3.0]
        assert read(refer(whole._replace(seen=True), part=held)) == -1.0

    def test_references_to_arrays_stay_as_many_as_they_are(self) -> None:
        part, held, whole = parts()
        reference = refer(whole, part=held)
        read(reference)
        before = sys.getrefcount(part.weights), sys.getrefcount(whole.table)
        for _ in range(100):
            read(reference)
        assert (sys.getrefcount(part.weights), sys.getrefcount(whole.table)) == before

    def test_a_reference_keeps_what_it_refers_to(self) -> None:
        reference = refer(Whole(*parts()[2]), part=parts()[1])
        gc.collect()
        assert read(reference) == 17.0

    def test_a_kernel_that_passes_new_arrays_on_must_say_so(self) -> None:
        with pytest.raises(NumbaError):
            refused(parts()[1])

    def test_numba_has_what_makes_references_fast(self) -> None:
        """Fields are read once, and arrays are not counted. Where this fails, bound numba's version."""
        _, held, _ = parts()
        compile_for(share, (type_of(held),))  # a call from Python would end the process: it has no entry point
        (code,) = share.inspect_llvm().values()  # type: ignore[attr-defined]
        assert "invariant.load" in code
        assert "NRT_incref(" not in code.replace("declare", "")
