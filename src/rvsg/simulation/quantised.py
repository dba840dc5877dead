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
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Coded: TypeAlias = "tuple[list[object], bytes]"
"""An array as it stands in the head of an archive, and its bytes."""

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
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 3, "lc": 1, "lp": 0, "pb": 0, "dict_size": 1 << 18}]


def rounded_array(name: str, array: Floats) -> Floats:
    """Round an array to the decimals of its name; an array of another name, or with huge values, stays as it is."""
    decimals = _decimals(name)
    if decimals is None:
        return array
    steps = _steps(array, decimals)
    return array if steps is None else steps / 10.0**decimals


def encode(text: str, arrays: Mapping[str, Floats]) -> bytes:
    """Encode a text and named arrays; equal input gives equal bytes."""
    given = {name: np.atleast_1d(np.asarray(array, np.float64)) for name, array in arrays.items()}
    alike: dict[int, dict[str, Floats]] = {}
    for name, array in given.items():
        if array.size and _decimals(name) is not None:
            alike.setdefault(len(array), {})[name] = array
    coded: dict[str, Coded] = {}
    for group in alike.values():
        coded |= _encode_group(group)
    columns, planes = [], []
    for name, array in given.items():
        entry, data = coded.get(name) or ([name, list(array.shape), None, None, []], array.tobytes())
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


def _decimals(name: str) -> int | None:
    return DECIMALS.get(name.rpartition(".")[2])


def _encode_group(arrays: Mapping[str, Floats]) -> dict[str, Coded]:
    """Encode arrays of one length, all columns at once; those are left out that are not made of multiples."""
    flat = {name: array.reshape(len(array), -1) for name, array in arrays.items()}
    values = np.concatenate(list(flat.values()), axis=1)
    scale = np.concatenate([np.full(each.shape[1], 10.0 ** (_decimals(name) or 0)) for name, each in flat.items()])
    with np.errstate(over="ignore", invalid="ignore"):
        scaled = values * scale
        fits = (np.abs(scaled) < _EXACT).all(axis=0)
        steps = np.rint(np.where(fits, scaled, 0.0)).astype(np.int64)
        exact = fits & (steps / scale == values).all(axis=0)
    moved = steps[1:] != steps[:-1]
    alike: dict[bytes, list[tuple[str, int, int]]] = {}
    begin = 0
    for name, each in flat.items():
        first, begin = begin, begin + each.shape[1]
        if exact[first:begin].all():
            alike.setdefault(_kept_rows(moved[:, first:begin]), []).append((name, first, begin))
    found: dict[str, Coded] = {}
    for kept, members in alike.items():
        columns = [k for _, first, end in members for k in range(first, end)]
        rows = np.unpackbits(np.frombuffer(kept, np.uint8), count=len(steps)).astype(np.bool_) if kept else slice(None)
        part = steps[:, columns][rows]
        coding, planes = _coded(part)
        at = 0
        for name, first, end in members:
            upto = at + end - first
            shape = list(arrays[name].shape)
            entry: list[object] = [name, shape, _decimals(name), len(part) if kept else None, coding[at:upto]]
            found[name] = (entry, kept + b"".join(planes[at:upto]))
            at = upto
    return found


def _coded(steps: Integers) -> tuple[list[list[int]], list[bytes]]:
    """Difference each column as often as makes it smallest, and return how, and its bytes plane by plane."""
    differences = [steps]
    for _ in range(_MOST_DIFFERENCES):
        last = differences[-1]
        differences.append(np.concatenate([last[:1], last[1:] - last[:-1]]))
    sizes = [np.log2(np.abs(each).astype(np.float32) + np.float32(1.0)).sum(axis=0) for each in differences]
    orders = np.argmin(sizes, axis=0)
    chosen = np.choose(orders, differences)
    folded = np.ascontiguousarray(_folded(chosen).T).astype("<u8")
    widths = [max(1, (int(largest).bit_length() + 7) // 8) for largest in folded.max(axis=1)]
    planes = folded.view(np.uint8).reshape(*folded.shape, 8)
    coding = [[int(order), width] for order, width in zip(orders, widths, strict=True)]
    return coding, [plane[:, :width].T.tobytes() for plane, width in zip(planes, widths, strict=True)]


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


def _kept_rows(moved: NDArray[np.bool_]) -> bytes:
    """The rows that differ from the row before, as bits; nothing where too few repeat it to be worth leaving out.

    Args:
        moved: (N - 1, columns) whether a value differs from the one before.
    """
    changed = np.ones(len(moved) + 1, np.bool_)
    changed[1:] = moved[:, 0] if moved.shape[1] == 1 else moved.any(axis=1)
    return np.packbits(changed).tobytes() if np.count_nonzero(changed) < _WORTHWHILE * len(changed) else b""


def _folded(values: Integers) -> NDArray[np.uint64]:
    """Small numbers of either sign as small numbers without sign."""
    return ((values << 1) ^ (values >> 63)).astype(np.uint64)


def _unfolded(values: NDArray[np.uint64]) -> Integers:
    return (values >> np.uint64(1)).astype(np.int64) ^ -((values & np.uint64(1)).astype(np.int64))
