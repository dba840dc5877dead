"""Damage to bytes, as disks, editors, other programs and models cause it."""

from __future__ import annotations

import random
import re

TOKENS = (
    *(b"-1", b"0", b"1e400", b"-1e308", b"NaN", b".nan", b".inf", b"Infinity", b"9" * 400, b"9" * 5000, b"1e-320"),
    *(b"null", b"~", b"true", b"[]", b"{}", b'""', b"''", b"[" * 200, b"{" * 200, b"[" * 5000, b'{"a":' * 2000),
    *(b"\\ud800", b'"\\udfff"', b"\xed\xa0\x80", b"\xff\xfe", b"\xef\xbb\xbf", b"\x00", b"\r\n", b"\n" * 50, b"\t"),
    *(b"../../../etc/passwd", b"/dev/zero", b"/dev/full", b"a" * 300, b"a/" * 3000, b"x" * 121, b"\xc2\xb2"),
    *(b"&a [*a]", b"!!python/object:os.system", b"<<: *a", b"%TAG", b"---", b"2026-13-45", b"0o777", b"1_000", b"1:30"),
    *(b"<!DOCTYPE a [<!ENTITY b 'c'>]>&b;", b"<![CDATA[", b"model://ground", b"http://[::1", b"file:///dev/zero"),
)
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")
_WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*")


def damaged(content: bytes, chance: random.Random) -> bytes:
    """Return the content with one to four kinds of damage."""
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        content = chance.choice(DAMAGE)(content, chance)
    return content


def _flip(content: bytes, chance: random.Random) -> bytes:
    changed = bytearray(content)
    for _ in range(chance.choice((1, 1, 8, 100))):
        if changed:
            changed[chance.randrange(len(changed))] = chance.randrange(256)
    return bytes(changed)


def _cut(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randrange(len(content) + 1)]


def _remove(content: bytes, chance: random.Random) -> bytes:
    begin = chance.randrange(len(content) + 1)
    return content[:begin] + content[begin + chance.choice((1, 10, 1000)) :]


def _repeat(content: bytes, chance: random.Random) -> bytes:
    begin = chance.randrange(len(content) + 1)
    end = begin + chance.choice((1, 10, 1000))
    return content[:end] + content[begin:end] * chance.choice((1, 3)) + content[end:]


def _insert(content: bytes, chance: random.Random) -> bytes:
    at = chance.randrange(len(content) + 1)
    return content[:at] + chance.choice(TOKENS) + content[at:]


def _replace(content: bytes, chance: random.Random) -> bytes:
    found = list(chance.choice((_NUMBER, _NUMBER, _WORD)).finditer(content))
    if not found:
        return _insert(content, chance)
    place = chance.choice(found)
    return content[: place.start()] + chance.choice(TOKENS) + content[place.end() :]


def _swap(content: bytes, chance: random.Random) -> bytes:
    found = list(_NUMBER.finditer(content))
    if len(found) < 2:
        return _flip(content, chance)
    one, other = sorted(chance.sample(found, 2), key=lambda place: place.start())
    return content[: one.start()] + other[0] + content[one.end() : other.start()] + one[0] + content[other.end() :]


def _lines(content: bytes, chance: random.Random) -> bytes:
    lines = content.splitlines(keepends=True)
    if len(lines) < 2:
        return _cut(content, chance)
    one, other = chance.randrange(len(lines)), chance.randrange(len(lines))
    if chance.random() < 0.5:
        del lines[one]
    else:
        lines.insert(other, lines[one])
    return b"".join(lines)


DAMAGE = (_flip, _cut, _remove, _repeat, _insert, _replace, _replace, _replace, _swap, _lines)
