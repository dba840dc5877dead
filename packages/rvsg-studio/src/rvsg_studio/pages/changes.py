"""What changed from one side of a comparison to the other: a matrix of before and after, and a paired scatter."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from rvsg.campaign.comparison import Change
from rvsg_studio.frame import chip, tag

SIZE = 320
LEFT, BELOW, AIR = 46, 40, 10
"""Free space around the scatter, in its own units."""


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A scenario or case on both sides."""

    violations: tuple[int, int]
    """Violating runs of the first and of the second side."""
    place: tuple[float, float] | None
    """Where it is in the scatter: the value on the first side, and on the second."""
    change: Change


def matrix(found: Sequence[Compared], sides: tuple[str, str]) -> None:
    """Lay out how many were violated before and after, and what that is worth."""
    cells: dict[tuple[bool, bool], Counter[Change]] = {}
    for each in found:
        violated = (each.violations[0] > 0, each.violations[1] > 0)
        cells.setdefault(violated, Counter())[each.change] += 1
    words = {True: "violated in", False: "kept in"}
    holder = tag("div", cls="scroll", tabindex="0", role="region", aria_label="Before and after")
    with holder, tag("table", cls="st-plain", id="matrix"):
        with tag("thead"), tag("tr"):
            tag("td", "")
            for after in (True, False):
                tag("th", f"{words[after]} {sides[1]}", scope="col")
        with tag("tbody"):
            for before in (True, False):
                with tag("tr"):
                    tag("th", f"{words[before]} {sides[0]}", scope="row")
                    for after in (True, False):
                        with tag("td"):
                            _counts(cells.get((before, after), Counter()))


def _counts(found: Counter[Change]) -> None:
    if not found:
        tag("span", "none", cls="soft")
    for change in Change:
        if found[change]:
            change_chip(change, f"{found[change]} {change.value}")


def change_chip(change: Change, text: str = "") -> None:
    """Add a chip with a change in its colour."""
    chip(text or change.value, bad=change is Change.BROKEN, good=change is Change.FIXED)


def scatter(found: Sequence[Compared], said: str, across: str, up: str) -> None:
    """Draw the value of each pair; on the line both sides are equal. A larger circle holds several pairs.

    Args:
        said: what the axes are, for those who do not see the drawing.
    """
    known = Counter(each.place for each in found if each.place is not None)
    if not known:
        return
    values = [value for pair in known for value in pair]
    low, high = min(values), max(values)
    air = 0.08 * (high - low) or 0.5
    low, high = low - air, high + air

    def at(value: float) -> float:
        return (value - low) / (high - low) * (SIZE - LEFT - AIR)

    with tag("svg", viewBox=f"0 0 {SIZE} {SIZE}", role="img", aria_label=said, cls="chart narrow", id="scatter"):
        base = SIZE - BELOW
        tag("line", x1=LEFT, y1=base, x2=LEFT + at(high), y2=base - at(high), cls="grid")
        tag("line", x1=LEFT, y1=base, x2=SIZE - AIR, y2=base, cls="grid")
        tag("line", x1=LEFT, y1=base, x2=LEFT, y2=AIR, cls="grid")
        for (x, y), count in known.items():
            r = 4 + math.sqrt(count)
            tag("circle", cx=f"{LEFT + at(x):.1f}", cy=f"{base - at(y):.1f}", r=f"{r:.1f}", cls="new")
        middle = (SIZE + LEFT) / 2
        tag("text", across, x=middle, y=SIZE - 12, cls="axis", text_anchor="middle")
        turned = f"rotate(-90 18 {base / 2})"
        tag("text", up, x=18, y=base / 2, cls="axis", text_anchor="middle", transform=turned)
