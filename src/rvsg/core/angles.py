"""Angles in radians."""

import math

from rvsg.core.kernels import kernel


@kernel
def wrap(angle: float) -> float:
    """Return the angle in (-π, π]."""
    turned = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return turned if turned > -math.pi else turned + 2.0 * math.pi
