"""Names of areas on a narrow screen: letters keep their size there, so some names have to give way."""

from __future__ import annotations

import re

from rvsg.world.drawing.svg import FloorPlan

NARROW_PX = 342
"""Width of a map on a phone 390 px wide."""
SMALLEST_PX = 11.5
LETTER = 0.6
"""Width of a letter against its height."""

LINE = 1.15
"""Distance of the lines of a name against the height of a letter."""

_NAME = re.compile(r'<text class="area-name" font-size="([\d.]+)"( transform=)?.*?</text>', re.DOTALL)
_LINE = re.compile(r'<tspan x="(-?[\d.]+)" y="(-?[\d.]+)">(.*?)</tspan>', re.DOTALL)


def narrow_size(floor: FloorPlan) -> float:
    """Return the size of letters, in units of the plan, that is 11.5 px on a phone."""
    return SMALLEST_PX * float(floor.view_box.split()[2]) / NARROW_PX


def _apart(name: str, lines: list[tuple[str, str, str]], y: float) -> str:
    """Return a name whose lines are as far apart as its letters are high, at every size of the letters."""
    spans = "".join(
        f'<tspan x="{x}" y="{y:.2f}" dy="{(k - (len(lines) - 1) / 2) * LINE:.2f}em">{text}</tspan>'
        for k, (x, _, text) in enumerate(lines)
    )
    return f"{name[: name.index('<tspan')]}{spans}</text>"


def narrow_names(floor: FloorPlan) -> str:
    """Return the plan's names; those that would cover another one on a phone have the class `minor`."""
    size = narrow_size(floor)
    taken: list[tuple[float, float, float, float]] = []

    def placed(found: re.Match[str]) -> str:
        lines = _LINE.findall(found[0])
        x = sum(float(line[0]) for line in lines) / len(lines)
        y = sum(float(line[1]) for line in lines) / len(lines)
        wide, high = max(len(line[2]) for line in lines) * size * LETTER, len(lines) * size * 1.2
        if found[2]:
            wide, high = high, wide
        found_name = _apart(found[0], lines, y)
        box = (x - wide / 2, y - high / 2, x + wide / 2, y + high / 2)
        left, top, width, height = (float(v) for v in floor.view_box.split())
        inside = left <= box[0] and top <= box[1] and box[2] <= left + width and box[3] <= top + height
        if inside and all(box[2] < o[0] or o[2] < box[0] or box[3] < o[1] or o[3] < box[1] for o in taken):
            taken.append(box)
            return found_name
        return found_name.replace('class="area-name"', 'class="area-name minor"', 1)

    return _NAME.sub(placed, floor.names)
