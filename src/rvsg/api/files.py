"""Write files atomically and read what comes from outside with care."""

from __future__ import annotations

from rvsg.core.files import write_whole
from rvsg.core.inputs import is_too_deep, open_standard_streams

__all__ = ["is_too_deep", "open_standard_streams", "write_whole"]
