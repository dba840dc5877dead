"""What numba remembers while kernels are compiled."""

from __future__ import annotations

import pytest
from numba.core import types
from numba.core.postproc import PostProcessor
from numba.core.registry import cpu_target
from numba.core.typing.context import BaseContext

from rvsg.core.remembered import remembered


def test_numba_is_as_before_after_an_error() -> None:
    before = BaseContext.resolve_function_type, PostProcessor.run
    with pytest.raises(ZeroDivisionError), remembered(), remembered():
        assert BaseContext.resolve_function_type is not before[0]
        _ = 1 / 0
    assert (BaseContext.resolve_function_type, PostProcessor.run) == before


@pytest.mark.parametrize(
    "kinds",
    [(types.float64, types.int64), (types.int64, types.int64), (types.float32, types.float32), (types.uint8, types.b1)],
)
def test_a_remembered_signature_is_numbas_own(kinds: tuple[types.Type, ...]) -> None:
    context = cpu_target.typing_context
    context.refresh()
    name = context.resolve_value_type(max)
    own = context.resolve_function_type(name, kinds, {})
    with remembered():
        assert context.resolve_function_type(name, kinds, {}) == own
        assert context.resolve_function_type(name, kinds, {}) is context.resolve_function_type(name, kinds, {})
