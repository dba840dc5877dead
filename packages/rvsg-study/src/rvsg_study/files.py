"""Reader of files in the study's layout: every name, text, table and number of a foreign folder is read here.

Nothing but `Unreadable` leaves these functions, whatever a damaged folder holds.
"""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Any

from rvsg.core.errors import FileError, InputError
from rvsg.core.inputs import parse_json, read_text

LARGEST_LOG = 256 * 1024 * 1024
LARGEST_VALUE = 1e9
"""No position, speed, time or count of a run is larger; beyond it formulas overflow."""
MOST_DIGITS = 6
"""Digits of the number of a log, a configuration, a scenario or a worker."""


class Unreadable(Exception):
    """Why a file or a part of it cannot be used; the message is for the findings."""


def children(folder: Path) -> list[Path]:
    """Return what a folder holds, sorted by name; FileError if it cannot be listed."""
    try:
        return sorted(folder.iterdir())
    except OSError as error:
        raise FileError(folder, f"the folder cannot be read: {error.strerror}") from None


def folders(folder: Path) -> list[Path]:
    """Return the folders in a folder, sorted by name; FileError if it cannot be listed."""
    return [path for path in children(folder) if path.is_dir()]


def shown(path: Path, root: Path | None = None) -> str:
    """Return a path as text that every file and store can hold; bytes that are no text become `?`."""
    text = (path.relative_to(root) if root is not None else path).as_posix()
    return text.encode("utf-8", errors="replace").decode("utf-8")


def small_number(text: str) -> int | None:
    """Return the number that ASCII digits stand for; None if it is none or has more than `MOST_DIGITS` digits."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= MOST_DIGITS else None


def read_json(path: Path) -> Any:
    """Return the value of a JSON file; Unreadable says why there is none."""
    try:
        return parse_json(read_text(path), path)
    except (FileError, InputError) as error:
        raise Unreadable(getattr(error, "reason", str(error))) from None


def read_table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of a CSV file; Unreadable where it is none or a column occurs twice."""
    try:
        text = read_text(path, largest=LARGEST_LOG)
        lines = [line for line in csv.reader(io.StringIO(text, newline=""), strict=True) if line]
    except csv.Error as error:
        raise Unreadable(f"cannot be read: {error}") from None
    except (FileError, InputError) as error:
        raise Unreadable(getattr(error, "reason", str(error))) from None
    if not lines:
        raise Unreadable("the file is empty")
    header, *rows = lines
    doubled = sorted({name for name in header if header.count(name) > 1})
    if doubled:
        raise Unreadable(f"the column {doubled[0]!r} occurs twice")
    return header, rows


def as_number(text: str) -> float | None:
    """Return a finite number of a size that a run can have, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and abs(value) <= LARGEST_VALUE else None
