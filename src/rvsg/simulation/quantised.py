"""A compact, lossless encoding of arrays whose values are multiples of a small decimal step.

`rounded_arrays` rounds to the steps of the arrays. `encode` stores such arrays as integers, less what other arrays of
the same run foretell (`rvsg.simulation.foretold`), in few bytes (`rvsg.simulation.byte_planes`). An array that is not
made of such multiples is stored as it is, so `decode` returns exactly what `encode` received.

An archive is `MAGIC`, the CRC-32 of the rest, a deflate stream and the coded integers. The stream holds one line of
JSON with the list of the arrays and the length of the text, then the text, then the arrays that are stored as they are.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rvsg.simulation import byte_planes, first_archive
from rvsg.simulation.archive_head import HEAD
from rvsg.simulation.first_archive import LARGEST
from rvsg.simulation.foretold import How, Integers, add_foretold, less_foretold

Floats = NDArray[np.float64]

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
    "lateral": 4,
    "imu": 4,
}
"""Decimals kept, by the last part of an array's name; SI units, so 4 is 0.1 mm, 0.1 mm/s, 0.0001 m/s2.

Jerk is a second difference of the robot's yaw, so yaw has more."""
MAGIC = b"RVQ2"
_SAME = -1
"""In the list of the arrays: as many rows as the array before."""
_EXACT = 2**50
"""Integers below this stay exact as float64, with room for two differences."""


def rounded_arrays(arrays: Mapping[str, Floats]) -> dict[str, Floats]:
    """Round each array to the decimals of its name; one of another name, or with huge values, stays as it is."""
    found = dict(arrays)
    for names, values, scale in _groups(arrays):
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = values * scale
            fits = np.all(np.abs(scaled) < _EXACT, axis=0)
            whole = np.rint(scaled) / scale
        for name, first, end in names:
            if fits[first:end].all():
                found[name] = np.ascontiguousarray(whole[:, first:end]).reshape(arrays[name].shape)
    return found


def encode(text: str, arrays: Mapping[str, Floats]) -> bytes:
    """Encode a text and named arrays; equal input gives equal bytes."""
    given = {name: np.atleast_1d(np.asarray(array, np.float64)) for name, array in arrays.items()}
    steps: dict[str, Integers] = {}
    for names, values, scale in _groups(given):
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = values * scale
            fits = (np.abs(scaled) < _EXACT).all(axis=0)
            whole = np.rint(np.where(fits, scaled, 0.0)).astype(np.int64)
            exact = fits & (whole / scale == values).all(axis=0)
        steps |= {name: whole[:, first:end] for name, first, end in names if exact[first:end].all()}
    left, how = less_foretold(steps)
    listed, before = [], -1
    for name, array in given.items():
        rows, before = _SAME if len(array) == before else len(array), len(array)
        rule = [how[name]] if name in how else []
        listed.append([name, [rows, *array.shape[1:]], _decimals(name) if name in steps else None, *rule])
    said = text.encode()
    line = json.dumps([listed, len(said)], separators=(",", ":"))
    plain = [array.tobytes() for name, array in given.items() if name not in steps]
    deflate = zlib.compressobj(9, zlib.DEFLATED, -15, 9, zlib.Z_DEFAULT_STRATEGY, HEAD)
    head = deflate.compress(b"".join([line.encode(), b"\n", said, *plain])) + deflate.flush()
    body = head + byte_planes.encode([left[name] for name in given if name in steps])
    return MAGIC + zlib.crc32(body).to_bytes(4, "little") + body


def decode(data: bytes) -> tuple[str, dict[str, Floats]]:
    """Decode what `encode` returned, now or in an earlier version.

    Raises:
        ValueError: The bytes are not from `encode`.
    """
    if data.startswith(first_archive.MAGIC):
        return first_archive.decode(data)
    if not data.startswith(MAGIC):
        raise ValueError("this is no archive of a run")
    body = data[len(MAGIC) + 4 :]
    if zlib.crc32(body) != int.from_bytes(data[len(MAGIC) : len(MAGIC) + 4], "little"):
        raise ValueError("the archive is damaged (it lost its check sum)")
    try:
        return _decoded(body)
    except (TypeError, LookupError, ArithmeticError, RecursionError, MemoryError, zlib.error) as error:
        raise ValueError(f"the archive is damaged ({error})") from None


def _decoded(body: bytes) -> tuple[str, dict[str, Floats]]:
    inflate = zlib.decompressobj(-15, zdict=HEAD)
    line, _, rest = inflate.decompress(body, LARGEST).partition(b"\n")
    listed, length = json.loads(line)
    for (_, before, *_), (_, shape, *_) in pairwise(listed):
        shape[0] = before[0] if shape[0] == _SAME else shape[0]
    sizes = [int(np.prod(shape)) for _, shape, *_ in listed]
    if not inflate.eof or min(sizes, default=0) < 0 or 8 * sum(sizes) > LARGEST:
        raise ValueError("the archive is damaged (it ends too early, or is too large)")
    found: dict[str, Floats] = {}
    coded: dict[str, tuple[int, int]] = {}
    at = length
    for (name, shape, decimals, *_), size in zip(listed, sizes, strict=True):
        if decimals is not None:
            coded[name] = (shape[0], size // shape[0])
            continue
        found[name] = np.frombuffer(rest[at : at + 8 * size], "<f8").reshape(shape).astype(np.float64)
        at += 8 * size
    left = dict(zip(coded, byte_planes.decode(inflate.unused_data, list(coded.values()), LARGEST), strict=True))
    how: dict[str, How] = {name: tuple(rule[0]) for name, _, _, *rule in listed if rule}
    steps = add_foretold(left, how)
    for name, shape, decimals, *_ in listed:
        if decimals is not None:
            found[name] = steps[name].reshape(shape) / 10.0**decimals
    return rest[:length].decode(), {name: found[name] for name, *_ in listed}


def _decimals(name: str) -> int | None:
    return DECIMALS.get(name.rpartition(".")[2])


def _groups(arrays: Mapping[str, Floats]) -> Iterable[tuple[list[tuple[str, int, int]], Floats, Floats]]:
    """Arrays of one length side by side: their names with first and last column, the values, and each column's scale.

    Those that are never rounded, and empty ones, are left out.
    """
    alike: dict[int, list[str]] = {}
    for name, array in arrays.items():
        if array.size and _decimals(name) is not None:
            alike.setdefault(len(array), []).append(name)
    for length, names in alike.items():
        flat = [arrays[name].reshape(length, -1) for name in names]
        ends = np.cumsum([each.shape[1] for each in flat]).tolist()
        scale = np.repeat([10.0 ** (_decimals(name) or 0) for name in names], [each.shape[1] for each in flat])
        yield list(zip(names, [0, *ends[:-1]], ends, strict=True)), np.concatenate(flat, axis=1), scale
