"""Input from outside: files, text and JSON, checked for size, encoding, depth and numbers.

Every reader of a file that a person, a model or another program wrote goes through these functions, so that nothing
but a FileError can leave them: no file larger than `LARGEST_FILE` is read into memory, no device without end is read,
and JSON that Python's own parser accepts but nothing else does (lone surrogates, NaN, numbers of thousands of digits,
nesting that exhausts the stack) is refused.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NoReturn, cast

from rvsg.core.errors import FileError, InputError

LARGEST_FILE = 20_000_000
"""Bytes of a file that a person writes."""
LONGEST_LINE = 250_000_000
"""Bytes of a line in a file that is read line by line; a run of an hour with 30 people has about 200 million."""
DEEPEST = 60
"""Levels of nesting in JSON and in the values of options."""
LONGEST_NUMBER = 400
"""Characters of a number; the longest that a computer writes has 24."""
LARGEST_NUMBER = 1e12
"""Largest number with a decimal point or exponent; what is measured in SI units, or in seconds since 1970, is far below
it, and calculations above it overflow."""
LARGEST_INTEGER = 2**64
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def read_bytes(path: Path, *, largest: int = LARGEST_FILE) -> bytes:
    """Return the content of a file.

    Raises:
        FileError: The file is absent, unreadable, a folder, or has more than `largest` bytes.
    """
    with _opened(path) as file:
        try:
            return _at_most(file, path, largest)
        except OSError as error:
            raise FileError(_shortened(path), f"the file cannot be read: {error.strerror}") from None


def read_text(path: Path, *, largest: int = LARGEST_FILE) -> str:
    """Return the text of a UTF-8 file, or of standard input where the path is `-`; a byte order mark is skipped."""
    standard = str(path) == "-"
    data = _at_most(_standard_input(), path, largest) if standard else read_bytes(path, largest=largest)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(
            path, f"the file is not UTF-8 text ({error.reason} at byte {error.start})", code="file-not-text"
        ) from None


def read_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield number and text of each line of a UTF-8 file, or of standard input where the path is `-`.

    One line is in memory at a time, so the file may be larger than that.

    Raises:
        FileError: The file is absent or unreadable, or a line has more than `LONGEST_LINE` bytes or is not UTF-8.
    """
    with _opened(path) as file:
        number = 0
        while True:
            try:
                line = file.readline(LONGEST_LINE + 1)
            except OSError as error:
                raise FileError(_shortened(path), f"the file cannot be read: {error.strerror}") from None
            if not line:
                return
            number += 1
            if len(line) > LONGEST_LINE:
                reason = f"the line has more than {LONGEST_LINE} bytes; at most {LONGEST_LINE} are read"
                raise FileError(path, reason, line=number)
            try:
                yield number, line.decode("utf-8-sig" if number == 1 else "utf-8")
            except UnicodeDecodeError as error:
                reason = f"the line is not UTF-8 text ({error.reason} at byte {error.start})"
                raise FileError(path, reason, line=number) from None


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a file or standard input to be read; FileError says why it cannot be."""
    if str(path) == "-":
        yield _standard_input()
        return
    try:
        file = path.open("rb")
    except FileNotFoundError:
        raise FileError(path, "the file does not exist", code="file-missing") from None
    except IsADirectoryError:
        raise FileError(path, "this is a folder; expected a file") from None
    except OSError as error:
        raise FileError(_shortened(path), f"the file cannot be read: {error.strerror}") from None
    except ValueError as error:  # a NUL character or a lone surrogate in the path
        raise InputError(f"{str(_shortened(path))!r} cannot be the path of a file: {error}") from None
    with file:
        yield file


def _standard_input() -> IO[bytes]:
    if sys.stdin is None:
        raise InputError("Standard input is closed; give a file instead of -.")
    stream = getattr(sys.stdin, "buffer", None)
    if stream is None:  # replaced by a stream of text
        return io.BytesIO(sys.stdin.read().encode(errors="surrogatepass"))
    return cast(IO[bytes], stream)


def parse_json(text: str, path: Path, *, line: int | None = None) -> Any:
    """Return the value of JSON text that came from `path`; FileError says where it is wrong.

    Args:
        text: One JSON value.
        path: Where the text is from.
        line: The line of the file, where the text is one line of several.
    """

    def refuse(reason: str, at: int | None = None) -> NoReturn:
        raise FileError(path, f"this is not JSON: {reason}", line=line if line is not None else at, code="json")

    def number(digits: str) -> Any:
        if len(digits) > LONGEST_NUMBER:
            refuse(f"a number has {len(digits)} digits, it begins {digits[:20]}")
        if is_too_large(digits):
            refuse(f"{digits[:20]} is too large; at most {LARGEST_NUMBER:.0e} is read")
        return float(digits) if any(c in digits for c in ".eE") else int(digits)

    if not text.strip():
        raise FileError(path, "the file is empty", line=line, code="file-empty")
    try:
        value = json.loads(text, parse_int=number, parse_float=number, parse_constant=lambda name: refuse(f"{name}"))
    except json.JSONDecodeError as error:
        what = error.msg.removesuffix(" starting at").lower()
        refuse(f"{what}, at character {error.colno}", error.lineno)
    except RecursionError:
        refuse(f"it is nested more than {DEEPEST} levels deep")
    if _SURROGATE.search(text) or not is_text(text):
        _refuse_surrogates(value, refuse)
    if is_too_deep(value):
        refuse(f"it is nested more than {DEEPEST} levels deep")
    return value


def is_too_large(digits: str) -> bool:
    """Return whether a number, as it is written in a file, is larger than any that a record holds."""
    try:
        value = float(digits)
    except ValueError:  # another notation of YAML, such as 0x1F or .inf
        return False
    return abs(value) > (LARGEST_NUMBER if any(c in digits for c in ".eE") else LARGEST_INTEGER)


def is_too_deep(value: Any) -> bool:
    """Return whether lists and mappings are nested deeper than any reader needs; never exhausts the stack."""
    level = [value]
    for _ in range(DEEPEST):
        inner = (item.values() if isinstance(item, dict) else item for item in level if isinstance(item, dict | list))
        level = [value for values in inner for value in values]
        if not level:
            return False
    return any(isinstance(item, dict | list) for item in level)


def exists(path: Path) -> bool:
    """Return whether there is a file or a folder; False for a path that no file system can hold."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def is_dir(path: Path) -> bool:
    """Return whether there is a folder; False for a path that no file system can hold."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def whole_text(text: str) -> str:
    """Return a text whose lone surrogates (halves of a character) are replaced, so that it can be written as UTF-8."""
    return text if is_text(text) else text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


def is_text(text: str) -> bool:
    """Return whether a text can be written as UTF-8: it holds no lone surrogate."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def open_standard_streams() -> None:
    """Replace standard streams that were closed before the program began, so that writing to them does no harm.

    Without this, the next file that is opened would take the place of a closed stream, and receive its output.
    """
    for number, name, flags in ((0, "stdin", os.O_RDONLY), (1, "stdout", os.O_WRONLY), (2, "stderr", os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, flags)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            os.set_inheritable(number, True)
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "r" if number == 0 else "w", encoding="utf-8", closefd=False))


def _at_most(stream: IO[bytes], path: Path, largest: int) -> bytes:
    parts, left = [], largest + 1
    while left and (part := stream.read(min(left, 1 << 20))):
        parts.append(part)
        left -= len(part)
    if not left:
        raise FileError(
            path, f"the file has more than {largest} bytes; at most {largest} are read", code="file-too-large"
        )
    return b"".join(parts)


def _shortened(path: Path) -> Path:
    text = str(path)
    return path if len(text) <= 200 else Path(f"{text[:80]}...{text[-40:]}")


def _refuse_surrogates(value: Any, refuse: Any) -> None:
    stack = [value]
    while stack:
        each = stack.pop()
        if isinstance(each, str) and not is_text(each):
            refuse(f"a text holds half a character (a lone surrogate): {ascii(each)[:60]}")
        if isinstance(each, dict):
            stack.extend([*each, *each.values()])
        elif isinstance(each, list):
            stack.extend(each)
