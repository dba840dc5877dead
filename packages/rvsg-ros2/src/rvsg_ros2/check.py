"""The check of a running ROS 2 navigation system: names that are found, missing, or of another type."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from rvsg.core.errors import SimulationError
from rvsg.robots.robot import DEFAULT_ROBOT, Robot, load_robot
from rvsg_ros2.dds import Bus, Endpoint, Graph
from rvsg_ros2.interfaces import Release, interfaces
from rvsg_ros2.nodes import ACTIVE, GET_STATE, OTHER_ROBOT_M, STATES, Lifecycle, NodeParameters, ask_nodes
from rvsg_ros2.options import Ros2Options, read_options, scan_topic
from rvsg_ros2.session import CLEAR, THROUGH_POSES, TO_POSE, release_of

ANSWER_S = 1.0
"""Wall time in which a node tells a parameter."""
TWISTS = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")


class Status(str, Enum):
    """What became of one thing that was looked for."""

    FOUND = "found"
    ABSENT = "not found, not needed"
    MISSING = "missing"
    OTHER_TYPE = "of another type"
    CONFLICT = "also published by somebody else"
    INACTIVE = "not active"
    OTHER_ROBOT = "for another robot"


FAULTS = (Status.MISSING, Status.OTHER_TYPE, Status.CONFLICT)
"""What keeps a run from working; a node that is not active may become so with the clock that RVSG publishes."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked for."""

    name: str
    status: Status
    detail: str = ""


@dataclass(frozen=True)
class Found:
    """A running system as RVSG sees it."""

    domain: int
    release: Release | None
    """None: nothing is heard in the domain."""
    findings: tuple[Finding, ...]

    @property
    def is_usable(self) -> bool:
        """Whether a run can work."""
        return not any(finding.status in FAULTS for finding in self.findings)


def check_ros2(
    options: Mapping[str, Any] | None = None, robot: Robot | str | Path = DEFAULT_ROBOT, *, seconds: float = 5.0
) -> Found:
    """Return what of the running system is found, missing, or of another type.

    It is looked at for some seconds of wall time, and sent nothing but questions for states and parameters.

    Args:
        options: those of the stack `ros2`.
        robot: whose lidars the system must read.
        seconds: how long to look.

    Raises:
        InputError: cyclonedds is missing, or the domain cannot be joined.
    """
    known = read_options(dict(options or {}))
    given = robot if isinstance(robot, Robot) else load_robot(robot)
    bus = Bus(known.first_domain)
    try:
        lifecycle = Lifecycle(bus, known.nodes)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            lifecycle.poll()
            time.sleep(0.05)
        graph = bus.graph()
        findings: list[Finding] = []
        try:
            release = release_of(graph, known)
        except SimulationError as error:
            release = "lyrical"
            findings.append(Finding("release", Status.OTHER_TYPE, str(error)))
        findings += [
            *_goals(graph, known),
            *_sensors(graph, known, given, release, lifecycle),
            *_map(graph, known),
            *_nodes(lifecycle, known),
            *_parameters(ask_nodes(bus, ANSWER_S), given),
        ]
        is_heard = bool(graph.readers or graph.writers)
        return Found(bus.domain, release if is_heard else None, tuple(findings))
    finally:
        bus.close()


def _goals(graph: Graph, options: Ros2Options) -> Iterable[Finding]:
    """Look for the actions, and for the velocity commands."""
    for key, name, kind in (
        ("to_pose", options.to_pose_action, TO_POSE),
        ("through_poses", options.through_poses_action, THROUGH_POSES),
    ):
        servers = graph.servers(f"{name}/_action/send_goal")
        optional = options.goal not in ("auto", key)
        yield _typed(f"action {name}", servers, (f"{kind}_SendGoal_Request",), optional=optional)
    wanted = TWISTS if options.cmd_vel_type == "auto" else (f"geometry_msgs/msg/{options.cmd_vel_type}",)
    yield _typed(f"velocity commands on {options.cmd_vel}", graph.publishers(options.cmd_vel), wanted)


def _sensors(
    graph: Graph, options: Ros2Options, robot: Robot, release: Release, lifecycle: Lifecycle
) -> Iterable[Finding]:
    # Until every node is active, costmaps have not subscribed to their sensors.
    is_up = all(lifecycle.states.get(name) == ACTIVE for name in lifecycle.found())
    scans = [scan_topic(options, robot.lidars, k) for k in range(len(robot.lidars))]
    kinds = {
        "/clock": "rosgraph_msgs/msg/Clock",
        "/tf": "tf2_msgs/msg/TFMessage",
        options.odom: "nav_msgs/msg/Odometry",
    }
    for topic, kind in (kinds | dict.fromkeys(scans, "sensor_msgs/msg/LaserScan")).items():
        if graph.publishers(topic) and topic != "/tf":
            yield Finding(topic, Status.CONFLICT, "end the simulator or robot driver that publishes it")
        readers, known = graph.subscribers(topic), interfaces(release).type_hash(kind)
        found = _typed(f"reader of {topic}", readers, (kind,), topic in (options.odom, *scans[1:]), known)
        if found.status is Status.MISSING and topic == options.scan and not is_up:
            found = Finding(found.name, Status.INACTIVE, "costmaps subscribe when they become active")
        yield found


def _map(graph: Graph, options: Ros2Options) -> Iterable[Finding]:
    publishers = graph.publishers(options.map)
    if publishers and options.publish_map == "always":
        yield Finding(options.map, Status.CONFLICT, "publish_map is always, and the system has a map of its own")
    elif publishers:
        yield Finding(options.map, Status.FOUND, "the system's own map is used; it must be that of the world")
    else:
        yield Finding(options.map, Status.ABSENT, "RVSG publishes the map of the world")
    own = graph.subscribers(options.initial_pose)
    said = "the system localises itself" if own else "RVSG gives the transform from map to odom"
    yield Finding(f"reader of {options.initial_pose}", Status.FOUND if own else Status.ABSENT, said)
    for name in options.clear_costmaps:
        yield _typed(f"service {name}", graph.servers(name), (f"{CLEAR}_Request",), optional=True)
    yield _typed(f"plan on {options.plan}", graph.publishers(options.plan), ("nav_msgs/msg/Path",), optional=True)


def _nodes(lifecycle: Lifecycle, options: Ros2Options) -> Iterable[Finding]:
    found = sorted({*lifecycle.found(), *(name.strip("/") for name in options.nodes)})
    if not found:
        where = f"ROS_DOMAIN_ID={options.first_domain} and RMW_IMPLEMENTATION=rmw_cyclonedds_cpp"
        yield Finding("lifecycle nodes", Status.MISSING, f"no service of {GET_STATE} answers; start them with {where}")
    for name in found:
        state = lifecycle.states.get(name)
        if state == ACTIVE:
            yield Finding(f"node {name}", Status.FOUND, "active")
        elif state is None and name in lifecycle.found():
            # A node answers no question while it becomes active, and costmaps wait there for clock and transforms.
            said = "does not answer now: hangs, or waits for clock and transforms"
            yield Finding(f"node {name}", Status.INACTIVE, said)
        elif state is None:
            yield Finding(f"node {name}", Status.MISSING)
        else:
            yield Finding(f"node {name}", Status.INACTIVE, STATES.get(state, "in transition"))


def _parameters(told: NodeParameters, robot: Robot) -> Iterable[Finding]:
    if told.control_hz is not None:
        yield Finding("rate of velocity commands", Status.FOUND, f"{told.control_hz:g} Hz, as its node says")
    wrong = told.of_another_robot(robot)
    fits = f"the footprint of {robot.name}, to {OTHER_ROBOT_M:g} m"
    for node in told.bodies:
        status = Status.OTHER_ROBOT if node in wrong else Status.FOUND
        yield Finding(f"robot of {node}", status, wrong.get(node, fits))


def _typed(
    name: str, endpoints: Sequence[Endpoint], kinds: tuple[str, ...], optional: bool = False, type_hash: str = ""
) -> Finding:
    """Compare what is there with the expected types."""
    if not endpoints:
        return Finding(name, Status.ABSENT if optional else Status.MISSING)
    found = sorted({endpoint.type_name for endpoint in endpoints})
    if others := [kind for kind in found if kind not in kinds]:
        return Finding(name, Status.OTHER_TYPE, f"{', '.join(others)}; expected {' or '.join(kinds)}")
    if type_hash and any(endpoint.type_hash not in ("", type_hash) for endpoint in endpoints):
        return Finding(name, Status.OTHER_TYPE, f"{found[0]} has other fields than ROS 2 defines")
    return Finding(name, Status.FOUND, found[0])
