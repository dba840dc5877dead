"""What people do at a place where a task of theirs ends, and how long it takes."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

import numpy as np


class Activity(str, Enum):
    """What a person does while standing at a place."""

    HAND_OVER = "hand over"
    PICK = "pick"
    SORT = "sort"
    INSPECT = "inspect"
    TALK = "talk"
    WAIT = "wait"

    @property
    def words(self) -> str:
        """What the person does, as in `hands over`."""
        verb, _, rest = self.value.partition(" ")
        return f"{verb}s {rest}".strip()

    @property
    def seconds(self) -> tuple[float, float]:
        """The shortest and the longest usual time."""
        return TIMES[self].seconds

    def drawn_s(self, rng: np.random.Generator) -> float:
        """Return a time in seconds, each of the usual ones as likely as the other."""
        return round(float(rng.uniform(*self.seconds)), 1)


class Usual(NamedTuple):
    """How long an activity takes, in seconds, and why."""

    seconds: tuple[float, float]
    reason: str


TIMES: Mapping[Activity, Usual] = {
    Activity.HAND_OVER: Usual((3.0, 8.0), "1 to 2 s for the hands, and a word or a set-down"),
    Activity.PICK: Usual((4.0, 15.0), "search, reach and grasp of an item whose place is known, or of a few"),
    Activity.SORT: Usual((5.0, 20.0), "2 to 3 s to reach, grasp, move and release one item; two to seven items"),
    Activity.INSPECT: Usual((4.0, 12.0), "a label of 10 to 30 words, and a note"),
    Activity.TALK: Usual((6.0, 25.0), "one to four turns of some 6 s"),
    Activity.WAIT: Usual((4.0, 20.0), "for a door, a lift or somebody who comes"),
}
"""Estimates from what is done; no recording of these activities was at hand."""
