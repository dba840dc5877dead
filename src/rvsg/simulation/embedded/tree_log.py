"""Log of the behaviour tree in a traced run: the changes of its nodes, named as in Nav2's trees."""

from __future__ import annotations

import math
from typing import NamedTuple

from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.state import State

IDLE, RUNNING, SUCCESS, FAILURE = "IDLE", "RUNNING", "SUCCESS", "FAILURE"
NAVIGATE, PLAN, FOLLOW = "NavigateThroughPoses", "ComputePathToPose", "FollowPath"
CLEAR_GLOBAL, CLEAR_LOCAL = "ClearGlobalCostmap-Context", "ClearLocalCostmap-Context"
ACTIONS = ("ClearingActions", "Spin", "Wait", "BackUp")
"""The recoveries in their order; the first ends at once."""
WATCHED = (st.MODE, st.RESULT, st.RECOVERIES, st.NEXT_ACTION, st.FAILED_ACTIONS, st.FOLLOW_RETRIED, st.PLAN_RETRIED)
OF_MODE = {st.SPIN: "Spin", st.WAIT: "Wait", st.BACK_UP: "BackUp"}


class NodeChange(NamedTuple):
    """A node of the behaviour tree changes its status at a time (s)."""

    t: float
    node: str
    before: str
    after: str


class TreeLog:
    """Watches the navigator's state, tick by tick, and keeps the changes of the tree's nodes."""

    def __init__(self) -> None:
        self.changes: list[NodeChange] = []
        self._status: dict[str, str] = {}
        self._known = (st.DRIVE, *(0 for _ in WATCHED[1:]))
        self._planned_at = -math.inf

    def watch(self, state: State, t: float) -> None:
        """Compare the state with that of the tick before."""
        nav = state.nav
        now = tuple(int(nav[k]) for k in WATCHED)
        planned_at = float(state.times[st.PLAN_T])
        planned = planned_at != self._planned_at and bool(nav[st.PLANNED])
        if planned or now != self._known:
            self._compare(
                dict(zip(WATCHED, self._known, strict=True)), dict(zip(WATCHED, now, strict=True)), planned, t
            )
        self._known = now
        if planned:
            self._planned_at = planned_at

    def _compare(self, old: dict[int, int], new: dict[int, int], planned: bool, t: float) -> None:
        if self._status.get(NAVIGATE) is None:
            self._set(NAVIGATE, RUNNING, t)
        recovering = new[st.RECOVERIES] > old[st.RECOVERIES] or new[st.FAILED_ACTIONS] > old[st.FAILED_ACTIONS]
        self._end_of_action(old, new, t)
        if planned:
            self._set(PLAN, SUCCESS, t)
        if new[st.PLAN_RETRIED] > old[st.PLAN_RETRIED] or (old[st.PLAN_RETRIED] and recovering):
            self._set(PLAN, FAILURE, t)
        if new[st.PLAN_RETRIED] > old[st.PLAN_RETRIED]:
            self._set(CLEAR_GLOBAL, SUCCESS, t)
        if new[st.FOLLOW_RETRIED] > old[st.FOLLOW_RETRIED]:
            self._set(FOLLOW, FAILURE, t)
            self._set(CLEAR_LOCAL, SUCCESS, t)
        elif new[st.RECOVERIES] > old[st.RECOVERIES]:
            self._set(FOLLOW, FAILURE, t)
        if new[st.NEXT_ACTION] != old[st.NEXT_ACTION]:
            begun = OF_MODE.get(new[st.MODE], ACTIONS[0])
            self._set(begun, RUNNING if new[st.MODE] in OF_MODE else SUCCESS, t)
        if new[st.MODE] == st.DRIVE and (planned or new[st.FOLLOW_RETRIED] > old[st.FOLLOW_RETRIED]):
            self._set(FOLLOW, RUNNING, t)

    def _end_of_action(self, old: dict[int, int], new: dict[int, int], t: float) -> None:
        """The recovery under way, or the whole task, ends."""
        if old[st.MODE] in OF_MODE and new[st.MODE] != old[st.MODE]:
            failed = new[st.FAILED_ACTIONS] > old[st.FAILED_ACTIONS]
            self._set(OF_MODE[old[st.MODE]], FAILURE if failed else SUCCESS, t)
        if new[st.MODE] == st.DONE and old[st.MODE] != st.DONE:
            end = SUCCESS if new[st.RESULT] == st.REACHED else FAILURE
            self._set(FOLLOW, end, t)
            self._set(NAVIGATE, end, t)

    def _set(self, node: str, status: str, t: float) -> None:
        """Note a status; a node that ends again begins again first."""
        before = self._status.get(node, IDLE)
        if status != before or status != RUNNING:
            self.changes.append(NodeChange(t, node, RUNNING if before == status else before, status))
        self._status[node] = status
