"""The nodes of a running system: their lifecycle states, and their parameters held against the robot under test."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rvsg.robots.robot import Robot
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
        for name in self.found() | set(self._required):
            if name not in self._clients:
                self._clients[name] = self._bus.client(f"{name}/get_state", GET_STATE)
        for name, client in self._clients.items():
            number, at = self._asked.get(name, (0, -1e9))
            if number and (answer := client.reply(number)) is not None:
                self.states[name] = int(answer.current_state.id)
                self._asked[name] = (0, at)
            elif time.monotonic() - at > period_s and client.is_matched:
                self._asked[name] = (client.send(), time.monotonic())

    def waiting_for(self) -> list[str]:
        """Return what is not active yet, each with its state: `controller_server is inactive`."""
        # A node that has been there and is gone is missing.
        wanted = self._required or tuple(sorted({*self._clients, *self.found(), NAVIGATOR}))
        said = []
        for name in wanted:
            state = self.states.get(name)
            if state is None:
                said.append(f"{name} {'does not answer' if name in self.found() else 'was not found'}")
            elif state != ACTIVE:
                said.append(f"{name} is {STATES.get(state, 'in transition')}")
        return said + self.doubled()

    def doubled(self) -> list[str]:
        """Return which names more than one node has: `bt_navigator is there 2 times`."""
        graph = self._bus.graph()
        there = {name: len(graph.servers(f"{name}/get_state")) for name in sorted(self.found())}
        return [f"{name} is there {count} times" for name, count in there.items() if count > 1]

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


GET_PARAMETERS = "rcl_interfaces/srv/GetParameters"
OTHER_ROBOT_M = 0.1
"""Where the outline of a costmap and that of the robot are farther apart, the system plans for another robot."""
_INTEGER, _DOUBLE, _STRING = 2, 3, 4
"""Types of a value, from rcl_interfaces/msg/ParameterType."""
_DIRECTIONS = 72

Body = float | tuple[tuple[float, float], ...]
"""A radius, or the corners of a footprint, m."""


@dataclass(frozen=True)
class NodeParameters:
    """Parameters of a running system, as far as its nodes tell them."""

    control_hz: float | None = None
    """Rate of the velocity commands, by the clock of their node's loop: that of the last node that shapes them."""
    bodies: Mapping[str, Body] = field(default_factory=dict)
    """What each costmap takes for the robot, by the name of its node."""

    def of_another_robot(self, robot: Robot) -> dict[str, str]:
        """Return what is wrong with a costmap whose robot has another outline, by the name of its node."""
        found = {}
        for node, body in self.bodies.items():
            short = shortfall(body, robot.footprint)
            if abs(short) > OTHER_ROBOT_M:
                kind = "radius" if isinstance(body, float) else "footprint"
                found[node] = (
                    f"its {kind} is up to {abs(short):.2f} m {'smaller' if short > 0.0 else 'larger'} than the "
                    f"footprint of {robot.name}, so it plans for another robot. Name yours with --robot, or start it "
                    "with the parameters of this one"
                )
        return found


def shortfall(body: Body, footprint: Sequence[tuple[float, float]]) -> float:
    """Return by how much (m) a body reaches less far than a footprint, in the direction where they differ most.

    Negative: it reaches farther.
    """
    angles = [2.0 * math.pi * k / _DIRECTIONS for k in range(_DIRECTIONS)]
    differences = [_support(footprint, a) - (body if isinstance(body, float) else _support(body, a)) for a in angles]
    return max(differences, key=abs)


def _support(corners: Sequence[tuple[float, float]], angle: float) -> float:
    """Return how far a polygon reaches in a direction, m."""
    return max(x * math.cos(angle) + y * math.sin(angle) for x, y in corners)


def ask_nodes(bus: Bus, limit_s: float, meanwhile: Callable[[], None] | None = None) -> NodeParameters:
    """Ask controller, velocity smoother and costmaps; what a node does not tell within `limit_s` stays unknown."""
    services = bus.graph().services(GET_PARAMETERS)

    def value(node: str, name: str) -> Any:
        """Return a parameter; None where the node has none of that name."""
        reply = bus.client(f"{node}/get_parameters", GET_PARAMETERS).call(limit_s, meanwhile, names=[name])
        values = list(reply.values) if reply is not None else []
        fields = {_INTEGER: "integer_value", _DOUBLE: "double_value", _STRING: "string_value"}
        return getattr(values[0], fields.get(values[0].type, ""), None) if values else None

    nodes = {service.removesuffix("/get_parameters") for service in services}
    named: dict[str, list[str]] = {}
    for node in sorted(nodes):
        named.setdefault(node.rpartition("/")[2], []).append(node)
    rate = None
    for node in named.get("velocity_smoother", []):
        rate = rate or _kept_by_a_timer(value(node, "smoothing_frequency"))
    for node in named.get("controller_server", []):
        rate = rate or _positive(value(node, "controller_frequency"))
    bodies: dict[str, Body] = {}
    for node in (*named.get("local_costmap", []), *named.get("global_costmap", [])):
        body = corners(value(node, "footprint")) or _positive(value(node, "robot_radius"))
        if body is not None:
            bodies[node] = body
    return NodeParameters(rate, bodies)


def corners(text: Any) -> tuple[tuple[float, float], ...] | None:
    """Read Nav2's text of a footprint, `[[x, y], ...]`; None where it holds fewer than three corners."""
    try:
        read = json.loads(text) if isinstance(text, str) else None
        found = tuple((float(x), float(y)) for x, y in read or ())
    except (ValueError, TypeError):
        return None  # as Nav2 does: it takes the radius then
    return found if len(found) >= 3 else None


def _positive(rate: Any) -> float | None:
    return float(rate) if isinstance(rate, int | float) and rate > 0 else None


def _kept_by_a_timer(rate: Any) -> float | None:
    """Return the rate of a loop whose timer cuts the period to whole milliseconds."""
    known = _positive(rate)
    return known if known is None or known > 1000.0 else 1000.0 / int(1000.0 / known + 1e-6)
