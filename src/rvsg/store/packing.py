"""Compresses the records of a campaign against one of them, which most of the others repeat.

A record is packed with a dictionary (`deflateSetDictionary`): an earlier record of the same campaign, kept once. A
record needs only the dictionary, no other record.
"""

from __future__ import annotations

import zlib

LARGEST = 256 * 2**20
"""Bytes that a record may unpack to; a campaign's are below 1 MB."""
_WINDOW = 2**15
"""How far back the compression looks; a longer dictionary adds nothing."""


def dictionary_of(record: bytes) -> bytes:
    """Return the part of a record that others are packed with."""
    return record[-_WINDOW:]


def pack(record: bytes, dictionary: bytes = b"") -> bytes:
    """Return a record compressed."""
    compressor = zlib.compressobj(zdict=dictionary) if dictionary else zlib.compressobj()
    return compressor.compress(record) + compressor.flush()


def unpack(packed: bytes, dictionary: bytes = b"") -> bytes:
    """Return the record that `pack` was given, packed with this dictionary or with none.

    Raises:
        ValueError: The bytes are damaged, unpack to more than `LARGEST`, or need another dictionary.
    """
    decompressor = zlib.decompressobj(zdict=dictionary) if dictionary else zlib.decompressobj()
    try:
        record = decompressor.decompress(packed, LARGEST)
    except zlib.error as error:
        raise ValueError(f"it is damaged ({error})") from None
    if not decompressor.eof or decompressor.unused_data:
        raise ValueError("it is damaged (it has another length than it should)")
    return record
