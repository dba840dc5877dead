"""Colours for people: as many as are needed, no two alike, readable on the light and on the dark page."""

from __future__ import annotations

import math

FIRST = ("#c4570a", "#0b8270", "#a23bb8", "#8a6d00", "#c2255c", "#3f7d20", "#6a5acd", "#9c4a2f")
"""Enough for most scenarios, chosen by hand: none is near the blue of the robot."""
ROBOT_HUES = (235.0, 285.0)
"""Hues (degrees in OKLCH) that the robot's blue keeps for itself."""


def distinct_colours(count: int) -> list[str]:
    """Return `count` different colours as `#rrggbb`."""
    if count <= len(FIRST):
        return list(FIRST[:count])
    free = 360.0 - (ROBOT_HUES[1] - ROBOT_HUES[0])
    hues = math.ceil(count / 2)
    found = []
    for place in range(count):
        hue = (ROBOT_HUES[1] + (place % hues + 0.5 * (place // hues)) * free / hues) % 360.0
        found.append(_hex(0.5 if place < hues else 0.64, 0.125, math.radians(hue)))
    return found


def _hex(lightness: float, chroma: float, hue: float) -> str:
    """Convert OKLCH to sRGB by the matrices of Ottosson (2020); values outside sRGB are cut off."""
    a, b = chroma * math.cos(hue), chroma * math.sin(hue)
    long = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3
    medium = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3
    short = (lightness - 0.0894841775 * a - 1.2914855480 * b) ** 3
    linear = (
        4.0767416621 * long - 3.3077115913 * medium + 0.2309699292 * short,
        -1.2684380046 * long + 2.6097574011 * medium - 0.3413193965 * short,
        -0.0041960863 * long - 0.7034186147 * medium + 1.7076147010 * short,
    )
    return "#" + "".join(f"{round(255 * _gamma(min(1.0, max(0.0, value)))):02x}" for value in linear)


def _gamma(value: float) -> float:
    return 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055
