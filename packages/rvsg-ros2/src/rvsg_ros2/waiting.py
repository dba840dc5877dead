"""Which lifecycle nodes a system has, and whether they are active and alive."""

from __future__ import annotations

import time
from collections.abc import Iterable

from rvsg_ros2.dds import Bus, Client

GET_STATE = "lifecycle_msgs/srv/GetState"
ACTIVE = 3
STATES = {0: "unknown", 1: "unconfigured", 2: "inactive", ACTIVE: "active", 4: "finalized"}
"""Primary states, from lifecycle_msgs/msg/State; others are transitions."""
NAVIGATOR = "bt_navigator"


class Lifecycle:
    """The lifecycle nodes of a system, asked without waiting; call `poll` again and again."""

    def __init__(self, bus: Bus, required: Iterable[str] = ()) -> None:
        self._bus = bus
        self._required = tuple(name.strip("/") for name in required)
        self._clients: dict[str, Client] = {}
        self._asked: dict[str, tuple[int, float]] = {}
        self.states: dict[str, int] = {}
        """The last known state of every node."""

    def poll(self, period_s: float = 0.5) -> None:
        """Find nodes, ask each whose last answer is older than `period_s` of wall time, and take over answers."""
        found = {name.removesuffix("/get_state") for name in self._bus.graph().services(GET_STATE)}
        for name in found | set(self._required):
            if name not in self._clients:
                self._clients[name] = self._bus.client(f"{name}/get_state", GET_STATE)
        for name, client in self._clients.items():
            number, at = self._asked.get(name, (0, -1e9))
            if number and (answer := client.reply(number)) is not None:
                self.states[name] = int(answer.current_state.id)
                self._asked[name] = (0, at)
            elif time.monotonic() - at > period_s and client.is_matched:
                self._asked[name] = (client.send(), time.monotonic())

    def waiting_for(self, navigator: str = NAVIGATOR) -> list[str]:
        """Return what is not active yet, each with its state: `controller_server is inactive`."""
        # A node that has been there and is gone is missing.
        wanted = self._required or tuple(sorted({*self._clients, *self.found(), navigator}))
        said = []
        for name in wanted:
            state = self.states.get(name)
            if state is None:
                said.append(f"{name} {'does not answer' if name in self.found() else 'was not found'}")
            elif state != ACTIVE:
                said.append(f"{name} is {STATES.get(state, 'in transition')}")
        return said

    def found(self) -> set[str]:
        """Return the names of all lifecycle nodes that are there now."""
        return {name.removesuffix("/get_state") for name in self._bus.graph().services(GET_STATE)}

    def silent(self, limit_s: float) -> list[str]:
        """Ask every node that has been active; return those that are gone or do not answer within `limit_s`."""
        numbers = {name: client.send() for name, client in self._clients.items() if self.states.get(name) == ACTIVE}
        until = time.monotonic() + limit_s
        open_ = dict(numbers)
        while open_ and time.monotonic() < until:
            for name, number in list(open_.items()):
                if self._clients[name].reply(number) is not None:
                    del open_[name]
            time.sleep(0.01)
        return sorted(open_)
