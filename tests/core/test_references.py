"""Records that kernels get by reference, and which kernels count the references to arrays."""

from __future__ import annotations

import gc
import sys
from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import NumbaError
from numba.core.registry import cpu_target
from tests.simulation.tiago import STACK

from rvsg.core.compiled import inner, kernel
from rvsg.core.references import _layout, by_reference, refer


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


by_reference(Part)
by_reference(Whole)


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
def refused(part: Any) -> float:
    return doubled_unmarked(part)[0]


def parts() -> tuple[Part, Any, Whole]:
    weights = np.arange(3.0)
    part = Part(weights, True, 7, 0.5)
    held = refer(part)
    return part, held, Whole(np.ones((2, 3)), part, part, np.array([3], np.int32), False)


@pytest.mark.parametrize("kind", [STACK._type, refer(parts()[2], part=parts()[1])._type])
def test_a_record_lies_in_memory_as_the_compiler_reads_it(kind: Any) -> None:
    context = cpu_target.target_context
    payload = context.data_model_manager[kind.get_data_type()].get_value_type()
    assert _layout(kind).itemsize == context.get_abi_sizeof(payload)


@pytest.mark.parametrize(
    "array",
    [np.zeros(3), np.zeros((2, 3), np.float32), np.zeros((4, 3, 2), bool)[:, 1], np.asfortranarray(np.ones((2, 2)))],
)
def test_an_array_has_the_type_that_numba_gives_it(array: Any) -> None:
    def kept() -> Any:
        return refer(Part(array, True, 7, 0.5))._type.field_dict["weights"]

    assert kept() == kept() == numba.typeof(array)
    array.flags.writeable = False
    assert kept() == numba.typeof(array)


def test_other_types_of_numbers_are_another_type_of_reference() -> None:
    kinds = [refer(Part(np.zeros(1), *values))._type for values in ((True, 7, 0.5), (True, 7, 1), (1, 7, 0.5))]
    assert len({str(kind.field_dict) for kind in kinds}) == 3


@pytest.mark.slow
class TestKernels:
    def test_a_kernel_reads_every_kind_of_field_and_changes_the_callers_arrays(self) -> None:
        _, held, whole = parts()
        assert read(refer(whole, part=held)) == 0.5 * (1.0 + 2.0 + 3.0) + 7 + 2.0 + 3 + 2.0
        assert whole.table[1].tolist() == [1.0, 2.0, 3.0]
        assert read(refer(whole._replace(seen=True), part=held)) == -1.0

    def test_references_to_arrays_and_records_stay_as_many_as_they_are(self) -> None:
        part, held, whole = parts()
        reference = refer(whole, part=held)
        read(reference)
        before = sys.getrefcount(part.weights), sys.getrefcount(whole.table), held._meminfo.refcount
        for _ in range(100):
            read(reference)
        assert (sys.getrefcount(part.weights), sys.getrefcount(whole.table), held._meminfo.refcount) == before

    def test_a_reference_keeps_what_it_refers_to(self) -> None:
        reference = refer(Whole(*parts()[2]), part=parts()[1])
        gc.collect()
        assert read(reference) == 17.0

    def test_a_kernel_that_passes_new_arrays_on_must_say_so(self) -> None:
        with pytest.raises(NumbaError):
            refused(parts()[1])
