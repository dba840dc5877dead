"""What a test asks of an error besides its class: the code, which stays when a message is reworded."""

from __future__ import annotations

from collections.abc import Callable


def coded(code: str) -> Callable[[Exception], bool]:
    """Return a check for `pytest.raises(..., check=coded("store-absent"))`."""
    return lambda error: getattr(error, "code", None) == code
