"""An adaptive range coder of integers: small numbers, and numbers of the usual size, take few bits.

A number is coded as the count of its bits, one binary decision each, then the bits below the highest. What is likely is
learnt from the numbers before, apart for every size of the two numbers before it in its column. Only integers are
computed, so the bytes are the same on every machine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rvsg.core.compiled import inner, kernel

Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

SIZES, NEAR, PAST = 66, 16, 64
"""Contexts of a model: for each size of the numbers before and each count of bits; for what became of the rows before;
for the two bits below the highest of a number of each size."""
ROWS = SIZES * NEAR
BITS = ROWS + PAST
CONTEXTS = BITS + 65 * 4
HALF, ONE = 1 << 15, 1 << 16
SLOWEST = 40
"""A probability moves by at least a share of 1 in this, plus 1.5."""
MOST_BYTES = 12
"""Bytes that a number takes at most."""


@inner
def _learn(chances: Integers, seen: Integers, at: int, bit: int) -> None:
    """Move a probability towards what came."""
    target = ONE - 1 if bit else 0
    chances[at] += (target - chances[at]) * 2 // (2 * seen[at] + 3)
    chances[at] = min(max(chances[at], 32), ONE - 32)
    if seen[at] < SLOWEST:
        seen[at] += 1


@inner
def _put(state: Integers, out: Bytes, chance: int, bit: int) -> None:
    """Write a binary decision of which 1 has the probability `chance` / 65536."""
    width = state[1] - state[0]
    middle = state[0] + (width >> 16) * chance + (((width & 0xFFFF) * chance) >> 16)
    if bit:
        state[1] = middle
    else:
        state[0] = middle + 1
    while (state[0] ^ state[1]) & 0xFF000000 == 0:
        out[state[2]] = state[1] >> 24
        state[2] += 1
        state[0] = (state[0] << 8) & 0xFFFFFFFF
        state[1] = ((state[1] << 8) & 0xFFFFFFFF) | 255


@inner
def _get(state: Integers, data: Bytes, chance: int) -> int:
    """Read a binary decision; past the end of the data there are zeros."""
    width = state[1] - state[0]
    middle = state[0] + (width >> 16) * chance + (((width & 0xFFFF) * chance) >> 16)
    bit = 1 if state[3] <= middle else 0
    if bit:
        state[1] = middle
    else:
        state[0] = middle + 1
    while (state[0] ^ state[1]) & 0xFF000000 == 0:
        state[0] = (state[0] << 8) & 0xFFFFFFFF
        state[1] = ((state[1] << 8) & 0xFFFFFFFF) | 255
        state[3] = ((state[3] << 8) & 0xFFFFFFFF) | (data[state[2]] if state[2] < len(data) else 0)
        state[2] += 1
    return bit


@inner
def _bits(value: int) -> int:
    """Return how many bits a number of at least 0 has."""
    count = 0
    while value:
        value >>= 1
        count += 1
    return count


@inner
def _write(state: Integers, out: Bytes, chances: Integers, seen: Integers, before: int, value: int) -> int:
    """Write a number of at least 0; return how many bits it has."""
    count = _bits(value)
    for k in range(count):
        _put(state, out, chances[before * SIZES + k], 1)
        _learn(chances, seen, before * SIZES + k, 1)
    _put(state, out, chances[before * SIZES + count], 0)
    _learn(chances, seen, before * SIZES + count, 0)
    prefix = 1
    for k in range(count - 2, -1, -1):
        bit = (value >> k) & 1
        if prefix < 4:
            at = BITS + count * 4 + prefix
            _put(state, out, chances[at], bit)
            _learn(chances, seen, at, bit)
            prefix = 2 * prefix + bit
        else:
            _put(state, out, HALF, bit)
    return count


@inner
def _read(state: Integers, data: Bytes, chances: Integers, seen: Integers, before: int) -> tuple[int, int]:
    """Read a number; return it and how many bits it has."""
    count = 0
    while count < 63:
        at = before * SIZES + count
        bit = _get(state, data, chances[at])
        _learn(chances, seen, at, bit)
        if not bit:
            break
        count += 1
    value = prefix = 1
    for _ in range(count - 1):
        if prefix < 4:
            at = BITS + count * 4 + prefix
            bit = _get(state, data, chances[at])
            _learn(chances, seen, at, bit)
            prefix = 2 * prefix + bit
        else:
            bit = _get(state, data, HALF)
        value = 2 * value + bit
    return (value if count else 0), count


@inner
def _difference(values: Integers, first: int, columns: int, rows: Integers, k: int, order: int) -> int:
    """Return the difference of an order at kept row k of a column whose first value is at `first`."""
    here = values[first + rows[k] * columns]
    if order == 0 or k == 0:
        return here
    before = values[first + rows[k - 1] * columns]
    if order == 1:
        return here - before
    earlier = values[first + rows[k - 2] * columns] if k > 1 else 0
    return here - 2 * before + earlier


@inner
def _order(values: Integers, first: int, columns: int, rows: Integers) -> int:
    """Return how often a column is best differenced: 0 to 2."""
    best, least = 0, -1
    for order in range(3):
        size = 0
        for k in range(len(rows)):
            size += _bits(abs(_difference(values, first, columns, rows, k, order)))
        if least < 0 or size < least:
            best, least = order, size
    return best


@inner
def _kept(values: Integers, at: int, rows: int, columns: int) -> Integers:
    """Return the rows of an array that differ from the row before."""
    found = np.empty(rows, np.int64)
    count = 0
    for k in range(rows):
        changed = k == 0
        for c in range(columns):
            changed = changed or values[at + k * columns + c] != values[at + (k - 1) * columns + c]
        if changed:
            found[count] = k
            count += 1
    return found[:count]


@kernel
def encode(values: Integers, rows: Integers, columns: Integers, models: Integers) -> Bytes:
    """Code arrays of integers below 2**61.

    Args:
        values: All arrays, one after the other, each row by row.
        rows, columns: Of each array.
        models: Which arrays learn together: the number of each one's model, from 0.
    """
    known = models.max() + 1 if len(models) else 0
    chances = np.full((known, CONTEXTS), HALF, np.int64)
    seen = np.zeros((known, CONTEXTS), np.int64)
    out = np.empty(MOST_BYTES * len(values) + rows.sum() + 4 * columns.sum() + 64, np.uint8)
    state = np.array([0, 0xFFFFFFFF, 0, 0], np.int64)
    at = 0
    for a in range(len(rows)):
        chance, count = chances[models[a]], seen[models[a]]
        kept = _kept(values, at, rows[a], columns[a])
        history, place = 0, 0
        for k in range(rows[a]):
            bit = 1 if place < len(kept) and kept[place] == k else 0
            place += bit
            if k:
                _put(state, out, chance[ROWS + history], bit)
                _learn(chance, count, ROWS + history, bit)
            history = (2 * history + bit) & (PAST - 1)
        for c in range(columns[a]):
            order = _order(values, at + c, columns[a], kept)
            _put(state, out, HALF, order >> 1)
            _put(state, out, HALF, order & 1)
            one, two = 0, 0
            for k in range(len(kept)):
                value = _difference(values, at + c, columns[a], kept, k, order)
                folded = (value << 1) ^ (value >> 63)
                one, two = _write(state, out, chance, count, min(NEAR - 1, (one + two + 1) // 2), folded), one
        at += rows[a] * columns[a]
    for shift in (24, 16, 8, 0):
        out[state[2]] = (state[0] >> shift) & 255
        state[2] += 1
    return out[: state[2]].copy()


@kernel
def decode(data: Bytes, rows: Integers, columns: Integers, models: Integers) -> Integers:
    """Return the values that `encode` was given with the same shapes; of damaged bytes, some values."""
    known = models.max() + 1 if len(models) else 0
    chances = np.full((known, CONTEXTS), HALF, np.int64)
    seen = np.zeros((known, CONTEXTS), np.int64)
    values = np.zeros((rows * columns).sum(), np.int64)
    state = np.array([0, 0xFFFFFFFF, 0, 0], np.int64)
    for _ in range(4):
        state[3] = (state[3] << 8) | (data[state[2]] if state[2] < len(data) else 0)
        state[2] += 1
    at = 0
    for a in range(len(rows)):
        chance, count = chances[models[a]], seen[models[a]]
        kept = np.empty(rows[a], np.int64)
        length, history = 0, 0
        for k in range(rows[a]):
            bit = 1
            if k:
                bit = _get(state, data, chance[ROWS + history])
                _learn(chance, count, ROWS + history, bit)
            if bit:
                kept[length] = k
                length += 1
            history = (2 * history + bit) & (PAST - 1)
        for c in range(columns[a]):
            order = 2 * _get(state, data, HALF) + _get(state, data, HALF)
            one, two, before, earlier = 0, 0, 0, 0
            for k in range(length):
                folded, size = _read(state, data, chance, count, min(NEAR - 1, (one + two + 1) // 2))
                one, two = size, one
                value = (folded >> 1) ^ -(folded & 1)
                if order == 1:
                    value += before
                elif order == 2:
                    value += 2 * before - earlier
                before, earlier = value, before
                end = kept[k + 1] if k + 1 < length else rows[a]
                for row in range(kept[k], end):
                    values[at + row * columns[a] + c] = value
        at += rows[a] * columns[a]
    return values
