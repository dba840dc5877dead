"""A binary heap of numbered entries with the order of C++'s `std::priority_queue`, so that ties fall as in Nav2."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner

Ints = NDArray[np.int32]


@inner
def sift_up(heap: Ints, hole: int, top: int, entry: int, keys: Any) -> None:
    """Put an entry into a hole, or above it where its key is less than those there."""
    while hole > top:
        parent = (hole - 1) // 2
        if not keys[heap[parent]] > keys[entry]:
            break
        heap[hole] = heap[parent]
        hole = parent
    heap[hole] = entry


@inner
def push(heap: Ints, size: int, entry: int, keys: Any) -> int:
    """Add an entry; return the new size."""
    sift_up(heap, size, 0, entry, keys)
    return size + 1


@inner
def pop(heap: Ints, size: int, keys: Any) -> int:
    """Remove the entry of the least key, which is `heap[0]`; return the new size."""
    size -= 1
    entry = heap[size]
    hole = 0
    child = 2
    while child < size:
        if keys[heap[child]] > keys[heap[child - 1]]:
            child -= 1
        heap[hole] = heap[child]
        hole = child
        child = 2 * hole + 2
    if child == size and size > 0:
        heap[hole] = heap[child - 1]
        hole = child - 1
    if size > 0:
        sift_up(heap, hole, 0, entry, keys)
    return size
