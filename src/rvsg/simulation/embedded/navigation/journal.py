"""Journal of the navigation, as rows that compiled code fills: clear changes of the path, and recoveries."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.state import State
from rvsg.simulation.events import Recovery, Replan

Floats = NDArray[np.float64]

REPLANNED, RECOVERED = range(2)
# Columns: kind, first and last time (s), place of the robot (m), length and deviation of the path (m) or the action.
KIND, FROM, UNTIL, X, Y, FIRST, SECOND = range(7)
CLEARLY_M = 0.5
"""A new path that leaves the one before by more than this is an event."""
NEW_STRIDE, OLD_STRIDE = 16, 6
"""Of the poses of the paths, some 0.025 m apart, every so many are compared."""
ACTIONS: tuple[Literal["clear_costmaps", "spin", "wait", "back_up"], ...] = (
    "clear_costmaps", "spin", "wait", "back_up",
)  # fmt: skip


@inner
def _note(state: State, kind: int, t: float, first: float, second: float) -> None:
    """Add a row for what begins at time t where the robot is."""
    n = state.nav[st.NOTED]
    if n >= state.journal.shape[0]:
        return
    row = state.journal[n]
    row[KIND] = kind
    row[FROM] = t
    row[UNTIL] = t
    row[X] = state.body[base.X]
    row[Y] = state.body[base.Y]
    row[FIRST] = first
    row[SECOND] = second
    state.nav[st.NOTED] = n + 1


@inner
def note_recovery(state: State, action: int, t: float) -> None:
    """Note that a recovery begins."""
    _note(state, RECOVERED, t, float(action), 0.0)


@inner
def go_on_recovery(state: State, t: float) -> None:
    """Note that the present recovery still goes on, or ends, at time t."""
    n = state.nav[st.NOTED]
    if n > 0 and state.journal[n - 1, KIND] == RECOVERED:
        state.journal[n - 1, UNTIL] = t


@inner
def keep_path(state: State, count: int) -> None:
    """Keep the present path, in the map, before the planner writes the next one."""
    for i in range(count):
        state.path[2, i, 0] = state.path[0, i, 0]
        state.path[2, i, 1] = state.path[0, i, 1]


@inner
def note_path(state: State, before: int, count: int, t: float) -> None:
    """Note a new path of `count` poses to the same goal that leaves the one before, of `before` poses, clearly."""
    goal = state.nav[st.GOAL]
    same = before > 0 and state.nav[st.PLANNED_GOAL] == goal
    state.nav[st.PLANNED_GOAL] = goal
    if not same:
        return
    far = deviation(state.path[2], before, state.path[0], count)
    if far > CLEARLY_M:
        _note(state, REPLANNED, t, length(state.path[0], count), far)


@inner
def deviation(old: Floats, before: int, new: Floats, count: int) -> float:
    """Return the largest distance (m) of poses of a path from the nearest poses of another one."""
    found = 0.0
    for i in range(0, count, NEW_STRIDE):
        best = math.inf
        for j in range(0, before, OLD_STRIDE):
            best = min(best, (new[i, 0] - old[j, 0]) ** 2 + (new[i, 1] - old[j, 1]) ** 2)
            if best <= found:
                break
        found = max(found, best)
    return math.sqrt(found)


@inner
def length(path: Floats, count: int) -> float:
    """Return the length of a path, m."""
    found = 0.0
    for i in range(1, count):
        found += math.sqrt((path[i, 0] - path[i - 1, 0]) ** 2 + (path[i, 1] - path[i - 1, 1]) ** 2)
    return found


def navigation_events(state: State) -> tuple[Replan | Recovery, ...]:
    """Return what was noted in a run, in order of time."""
    return tuple(_event(row) for row in state.journal[: int(state.nav[st.NOTED])])


def _event(row: Floats) -> Replan | Recovery:
    time_s, until_s, x, y = (round(float(row[column]), 3) for column in (FROM, UNTIL, X, Y))
    if row[KIND] == REPLANNED:
        return Replan(
            time_s=time_s, x=x, y=y, length_m=round(float(row[FIRST]), 2), deviation_m=round(float(row[SECOND]), 2)
        )
    return Recovery(time_s=time_s, until_s=until_s, x=x, y=y, action=ACTIONS[int(row[FIRST])])
