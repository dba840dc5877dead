"""What the nodes of a running system say of their parameters, held against the robot under test."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rvsg.robots.robot import Robot
from rvsg_ros2.dds import Bus

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
