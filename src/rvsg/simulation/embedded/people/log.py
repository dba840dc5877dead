"""Log of events of people, as rows of a buffer of fixed size that compiled code fills."""

from __future__ import annotations

import math

from rvsg.core.kernels import inner
from rvsg.simulation.embedded.people.crowd import Crowd

TOUCHED, STUCK, PAUSED, REACTED, REACHED = range(5)
# Columns: kind, person, first and last time (s), place (m), and numbers that depend on the kind.
KIND, PERSON, FROM, UNTIL, X, Y, FIRST = range(7)
AGAIN_S = 0.5
"""What happens again after less than this is the same event."""


@inner
def note_until(crowd: Crowd, kind: int, i: int, start: float, t: float, x: float, y: float, value: float) -> int:
    """Extend the person's present event of this kind to `t`, or start one; return its row, -1 where none is free."""
    row = crowd.open[i, kind]
    if row >= 0 and start - crowd.events[row, UNTIL] < AGAIN_S and crowd.events[row, FIRST] == value:
        crowd.events[row, UNTIL] = t
        return row
    row = crowd.event_count[0]
    if row >= crowd.events.shape[0]:
        crowd.event_count[1] += 1
        return -1
    crowd.event_count[0] = row + 1
    crowd.open[i, kind] = row
    crowd.events[row, :] = 0.0
    crowd.events[row, KIND] = kind
    crowd.events[row, PERSON] = i
    crowd.events[row, FROM] = start
    crowd.events[row, UNTIL] = t
    crowd.events[row, X] = x
    crowd.events[row, Y] = y
    crowd.events[row, FIRST] = value
    return row


@inner
def note_once(crowd: Crowd, kind: int, i: int, t: float, x: float, y: float, goal: int) -> None:
    """Note that a person reaches a goal, the first time in a run."""
    if math.isnan(crowd.reached[i, goal]):
        crowd.reached[i, goal] = t
        crowd.open[i, kind] = -1
        note_until(crowd, kind, i, t, t, x, y, float(goal))


@inner
def close(crowd: Crowd, kind: int, i: int) -> None:
    """End the person's present event of this kind: what follows is another one."""
    crowd.open[i, kind] = -1
