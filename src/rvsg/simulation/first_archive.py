"""Reads archives of runs in stores of version 4 and older.

The arrays are integers, differenced up to twice, split into byte planes, and compressed with LZMA after the head.
"""

from __future__ import annotations

import json
import lzma
import math

import numpy as np
from numpy.typing import NDArray

from rvsg.simulation.byte_planes import inflated, unfold

Floats = NDArray[np.float64]

MAGIC = b"RVQ1"
LARGEST = 256_000_000
"""Bytes that a decoded archive may have at most."""
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 3, "lc": 1, "lp": 0, "pb": 0, "dict_size": 1 << 18}]


def decode(data: bytes) -> tuple[str, dict[str, Floats]]:
    """Return the text and the arrays of an archive.

    Raises:
        ValueError: The bytes are no such archive.
    """
    body = inflated(data[len(MAGIC) :], _FILTERS, LARGEST)
    length = int.from_bytes(body[:4], "little")
    try:
        text, columns = json.loads(body[4 : 4 + length])
        arrays, at = {}, 4 + length
        for name, *entry in columns:
            arrays[str(name)], at = _decode_array(body, at, *entry)
    except (TypeError, OverflowError, RecursionError, MemoryError) as error:
        raise ValueError(f"the archive is damaged ({error})") from None
    if at != len(body) or not isinstance(text, str):
        raise ValueError("the archive is damaged (it has another length than it says)")
    return text, arrays


def _decode_array(
    body: bytes, at: int, shape: list[int], decimals: int | None, kept: int | None, coding: list[list[int]]
) -> tuple[Floats, int]:
    size = math.prod(shape)
    if min(shape, default=0) < 0 or size * 8 > LARGEST:
        raise ValueError("the archive is damaged (an array is too large)")
    if decimals is None:
        end = at + 8 * size
        return np.frombuffer(body[at:end], "<f8").reshape(shape).astype(np.float64), end
    rows = None
    if kept is not None:
        end = at + (shape[0] + 7) // 8
        rows = np.unpackbits(np.frombuffer(body[at:end], np.uint8), count=shape[0]).cumsum() - 1
        at = end
    count = shape[0] if kept is None else kept
    steps = np.empty((count, len(coding)), np.int64)
    for k, (order, width) in enumerate(coding):
        end = at + width * count
        planes = np.zeros((count, 8), np.uint8)
        planes[:, :width] = np.frombuffer(body[at:end], np.uint8).reshape(width, count).T
        differences = unfold(planes.view("<u8").reshape(-1))
        for _ in range(order):
            differences = np.cumsum(differences)
        steps[:, k] = differences
        at = end
    return (steps if rows is None else steps[rows]).reshape(shape) / 10.0**decimals, at
