"""What a test asks of an error besides its class: the code, which stays when a message is reworded."""

from __future__ import annotations

from collections.abc import Callable


def coded(code: str) -> Callable[[Exception], bool]:
    """Return a check for `pytest.raises(..., check=coded("store-absent"))`."""
    return lambda error: getattr(error, "code", None) == code


def nearest(name: str) -> Callable[[Exception], bool]:
    """Return a check for `pytest.raises(UnknownName, check=nearest("jerk"))`: what is suggested instead."""
    return lambda error: getattr(error, "nearest", None) == name


def at_key(*key: str | int) -> Callable[[Exception], bool]:
    """Return a check for `pytest.raises(DocumentError, check=at_key("near", "unit"))`: the first problem's key."""
    return lambda error: error.problems[0].key == key  # type: ignore[attr-defined]
