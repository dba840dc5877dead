"""Doors: leaves that stand open or closed, or open by themselves when somebody is near."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rvsg.core.records import Record

Point = tuple[float, float]
Who = Literal["people", "robot"]
State = Literal["open", "closed", "automatic"]

HEIGHT_M = 2.0
WIDTHS_M = (0.4, 8.0)


class Door(Record):
    """One leaf. `hinge` and `end` are the ends of the closed leaf in metres, world frame.

    A swing door turns about its hinge by 90°, seen from the hinge to the `left` or `right`. A sliding door moves
    beyond its hinge by its own width, into the wall. The robot's map does not show leaves: maps are made with the doors
    open. A double door is two leaves.
    """

    name: Annotated[str, Field(min_length=1, max_length=120)]
    hinge: Point
    end: Point
    kind: Literal["swing", "sliding"] = "swing"
    state: State = "automatic"
    turns: Literal["left", "right"] = "left"
    thickness_m: Annotated[float, Field(ge=0.01, le=0.5)] = 0.05
    range_m: Annotated[float, Field(gt=0, le=10)] = 2.5
    """An automatic door opens when somebody is this near to the middle of the closed leaf."""
    opening_s: Annotated[float, Field(ge=0.2, le=30)] = 1.5
    """How long the leaf moves from closed to open, and back."""
    hold_s: Annotated[float, Field(ge=0, le=600)] = 3.0
    """How long it stays open after the last one is out of range."""
    opens_for: Annotated[tuple[Who, ...], Field(min_length=1)] = ("people", "robot")

    @model_validator(mode="after")
    def _has_a_leaf(self) -> Self:
        if not all(math.isfinite(v) for v in (*self.hinge, *self.end)):
            raise ValueError("hinge and end must be finite numbers")
        low, high = WIDTHS_M
        if not low <= self.width_m <= high:
            raise ValueError(f"the leaf is {self.width_m:.2f} m wide, expected {low:g} to {high:g} m from hinge to end")
        return self

    @property
    def width_m(self) -> float:
        """Return the width of the leaf."""
        return math.dist(self.hinge, self.end)

    @property
    def middle(self) -> Point:
        """Return the middle of the closed leaf."""
        return (0.5 * (self.hinge[0] + self.end[0]), 0.5 * (self.hinge[1] + self.end[1]))

    def leaf(self, share: float) -> tuple[Point, ...]:
        """Return the four corners of the leaf, opened by this share of its way: 0 closed, 1 open."""
        (x, y), (ex, ey) = self.hinge, self.end
        dx, dy = ex - x, ey - y
        if self.kind == "sliding":
            x, y = x - share * dx, y - share * dy
        else:
            angle = share * math.pi / 2 * (1 if self.turns == "left" else -1)
            cos, sin = math.cos(angle), math.sin(angle)
            dx, dy = cos * dx - sin * dy, sin * dx + cos * dy
        half = 0.5 * self.thickness_m / self.width_m
        ax, ay = -half * dy, half * dx
        return ((x - ax, y - ay), (x + dx - ax, y + dy - ay), (x + dx + ax, y + dy + ay), (x + ax, y + ay))

    @property
    def still(self) -> tuple[Point, ...] | None:
        """Return the leaf of a door that never moves; None where it moves, or is in the wall."""
        if self.state == "automatic" or (self.state == "open" and self.kind == "sliding"):
            return None
        return tuple((round(px, 4), round(py, 4)) for px, py in self.leaf(1.0 if self.state == "open" else 0.0))
