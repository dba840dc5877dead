"""Options that several verbs share, from text to values."""

from __future__ import annotations

import contextlib
from typing import Any

from rvsg.core.errors import InputError


def pairs(kind: str, given: list[str] | None) -> dict[str, Any]:
    """`NAME=VALUE` options of a plug-in of a kind, the values read as YAML."""
    return dict(_pair(kind, pair) for pair in given or [])


def _pair(kind: str, pair: str) -> tuple[str, Any]:
    import yaml

    name, equals, value = pair.partition("=")
    if not equals or not name:
        raise InputError(f"--{kind}-option {pair!r}: expected NAME=VALUE")
    try:
        read = yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise InputError(f"--{kind}-option {pair!r}: the value cannot be read: {error}") from None
    if isinstance(read, str):
        with contextlib.suppress(ValueError):
            return name, float(read)  # 1e2 and nan, which YAML takes for words
    return name, read
