"""A compact, lossless encoding of arrays whose values are multiples of a small decimal step.

`rounded_array` rounds to the step of an array; `encode` stores such an array as integers, differenced up to twice,
split into byte planes and compressed. An array that is not made of such multiples is stored as it is, so `decode`
returns exactly what `encode` received.
"""

from __future__ import annotations

import json
import lzma
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

DECIMALS = {
    "t": 6,
    "x": 4,
    "y": 4,
    "yaw": 6,
    "v": 4,
    "omega": 4,
    "acceleration": 4,
    "human_x": 4,
    "human_y": 4,
    "human_yaw": 4,
    "human_speed": 4,
    "imu": 4,
}
"""Decimals kept, by the last part of an array's name; SI units, so 4 is 0.1 mm, 0.1 mm/s, 0.0001 m/s2.

Jerk is a second difference of the robot's yaw, so yaw has more."""
MAGIC = b"RVQ1"
LARGEST = 256_000_000
"""Bytes that a decoded archive may have at most."""
_EXACT = 2**50
"""Integers below this stay exact as float64, with room for two differences."""
_MOST_DIFFERENCES = 2
_WORTHWHILE = 0.75
"""Repeated rows are left out where less than this share of the rows changes."""
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 6, "lc": 1, "lp": 0, "pb": 0, "dict_size": 1 << 18}]


def rounded_array(name: str, array: Floats) -> Floats:
    """Round an array to the decimals of its name; an array of another name, or with huge values, stays as it is."""
    decimals = DECIMALS.get(name.rpartition(".")[2])
    if decimals is None:
        return array
    steps = _steps(array, decimals)
    return array if steps is None else steps / 10.0**decimals


def encode(text: str, arrays: Mapping[str, Floats]) -> bytes:
    """Encode a text and named arrays; equal input gives equal bytes."""
    columns, planes = [], []
    for name, array in arrays.items():
        entry, data = _encode_array(name, np.atleast_1d(np.asarray(array, np.float64)))
        columns.append(entry)
        planes.append(data)
    head = json.dumps([text, columns], ensure_ascii=False, separators=(",", ":")).encode()
    body = len(head).to_bytes(4, "little") + head + b"".join(planes)
    return MAGIC + lzma.compress(body, format=lzma.FORMAT_RAW, filters=_FILTERS)


def decode(data: bytes) -> tuple[str, dict[str, Floats]]:
    """Decode what `encode` returned.

    Raises:
        ValueError: The bytes are not from `encode`.
    """
    body = _decompress(data)
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


def _decompress(data: bytes) -> bytes:
    if not data.startswith(MAGIC):
        raise ValueError("this is no archive of a run")
    decompressor = lzma.LZMADecompressor(format=lzma.FORMAT_RAW, filters=_FILTERS)
    try:
        body = decompressor.decompress(data[len(MAGIC) :], max_length=LARGEST)
    except lzma.LZMAError as error:
        raise ValueError(f"the archive is damaged ({error})") from None
    if not decompressor.eof:
        raise ValueError("the archive is damaged (it ends too early, or is too large)")
    return body


def _steps(array: Floats, decimals: int) -> Integers | None:
    """The array in whole steps; None where a value is not finite or too large."""
    with np.errstate(over="ignore"):
        scaled = array * 10.0**decimals
    if not np.isfinite(scaled).all() or (np.abs(scaled) >= _EXACT).any():
        return None
    return np.rint(scaled).astype(np.int64)


def _encode_array(name: str, array: Floats) -> tuple[list[object], bytes]:
    decimals = DECIMALS.get(name.rpartition(".")[2])
    steps = None if decimals is None else _steps(array, decimals)
    if decimals is None or steps is None or not array.size or not np.array_equal(steps / 10.0**decimals, array):
        return [name, list(array.shape), None, None, []], array.tobytes()
    kept = _changed(steps)
    data = b""
    if kept is not None:
        data, steps = np.packbits(kept).tobytes(), steps[kept]
    flat = steps.reshape(len(steps), -1)
    differences = [flat]
    for _ in range(_MOST_DIFFERENCES):
        differences.append(np.diff(differences[-1], axis=0, prepend=np.zeros((1, flat.shape[1]), np.int64)))
    orders = np.argmin([np.log2(np.abs(each) + 1.0).sum(axis=0) for each in differences], axis=0)
    coding = []
    for k, order in enumerate(orders):
        folded = _folded(differences[order][:, k])
        width = max(1, (int(folded.max(initial=0)).bit_length() + 7) // 8)
        coding.append([int(order), width])
        data += folded.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :width].T.tobytes()
    return [name, list(array.shape), decimals, None if kept is None else len(steps), coding], data


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
        differences = _unfolded(planes.view("<u8").reshape(-1))
        for _ in range(order):
            differences = np.cumsum(differences)
        steps[:, k] = differences
        at = end
    return (steps if rows is None else steps[rows]).reshape(shape) / 10.0**decimals, at


def _changed(steps: Integers) -> NDArray[np.bool_] | None:
    """The rows that differ from the row before; None where too few repeat it to be worth leaving out."""
    if len(steps) < 2:
        return None
    changed = np.ones(len(steps), np.bool_)
    changed[1:] = (steps[1:] != steps[:-1]).reshape(len(steps) - 1, -1).any(axis=1)
    return changed if changed.mean() < _WORTHWHILE else None


def _folded(values: Integers) -> NDArray[np.uint64]:
    """Small numbers of either sign as small numbers without sign."""
    return ((values << 1) ^ (values >> 63)).astype(np.uint64)


def _unfolded(values: NDArray[np.uint64]) -> Integers:
    return (values >> np.uint64(1)).astype(np.int64) ^ -((values & np.uint64(1)).astype(np.int64))
