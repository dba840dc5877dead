"""A connection to one ROS 2 navigation system: start it or attach to it, get it ready for a run, end it."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rvsg.core.errors import InputError, SimulationError
from rvsg.robots.robot import Robot
from rvsg_ros2.dds import ActionClient, Bus, Client, Graph, Subscription
from rvsg_ros2.interfaces import RELEASES, Release, interfaces
from rvsg_ros2.launching import Launched, ros_environment
from rvsg_ros2.node_parameters import NodeParameters, ask_nodes
from rvsg_ros2.options import Ros2Options
from rvsg_ros2.robot_side import RobotSide
from rvsg_ros2.scaling import BY_THE_CLOCK, CONTROL_HZ, Scaled, scale_file
from rvsg_ros2.turns import Turn
from rvsg_ros2.waiting import Lifecycle

TO_POSE, THROUGH_POSES = "nav2_msgs/action/NavigateToPose", "nav2_msgs/action/NavigateThroughPoses"
CLEAR = "nav2_msgs/srv/ClearEntireCostmap"
_TRIED_DOMAINS = 64
_ASKED_S = 2.0
"""How long nodes are asked for their states where the action is missing."""
_OLDEST_HASHED: Release = "jazzy"


class Session:
    """One system, for the runs of one process.

    Raises:
        InputError: an option or the environment does not allow it.
        SimulationError: the system cannot be started, or no domain is free.
    """

    def __init__(self, options: Ros2Options, speed: float, tell: Callable[[str], None]) -> None:
        self.options, self.speed, self.tell = options, speed, tell
        self.launched: Launched | None = None
        self.scaled: Scaled | None = None
        self.robot_side: RobotSide | None = None
        self.checked_worlds: set[str] = set()
        """Worlds whose map the system was seen to have."""
        self._parameters: NodeParameters | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._clients: list[Client] = []
        self.domain = options.first_domain
        self.turn = Turn(self.domain)
        if options.launch is not None:
            self._start()
        try:
            self.bus = Bus(self.domain)
        except InputError:
            self._end_launched()
            raise
        self.lifecycle = Lifecycle(self.bus, options.nodes)

    def _start(self) -> None:
        """Take the first free domain and start the system in it."""
        for domain in range(self.domain, min(self.domain + _TRIED_DOMAINS, 233)):
            turn = Turn(domain)
            try:
                turn.take(0.0)
            except SimulationError:
                continue
            self.domain, self.turn = domain, turn
            break
        else:
            raise SimulationError(f"No DDS domain from {self.domain} on is free. End other runs, or set domain.")
        command = str(self.options.launch).replace("{speed}", f"{self.speed:g}")
        if self.options.params is not None:
            self._folder = tempfile.TemporaryDirectory(prefix="rvsg-nav2-")
            self.scaled = scale_file(Path(self.options.params), self.speed, self._expected_release())
            command = command.replace("{params}", str(self.scaled.write(Path(self._folder.name))))
        self.tell(f"starting {command} in domain {self.domain}")
        self.launched = Launched(command, ros_environment(self.domain))

    def _expected_release(self) -> Release:
        """Return the release that will be launched: the option, else the sourced one."""
        if self.options.release != "auto":
            return self.options.release
        named = os.environ.get("ROS_DISTRO", "")
        return next((release for release in RELEASES if release == named), _OLDEST_HASHED)

    def find(self, pump: Callable[[], None]) -> None:
        """Wait until the action of the goal is there, and learn the release from it.

        Raises:
            SimulationError: it is not there in time, or the launched command ended.
        """
        until = time.monotonic() + self.options.start_limit_s
        while True:
            graph = self.bus.graph()
            if any(graph.servers(f"{name}/_action/send_goal") for name in self.actions()):
                break
            self._check_launched()
            if time.monotonic() > until:
                raise SimulationError(
                    f"No action server {' or '.join(self.actions())} in DDS domain {self.domain} after "
                    f"{self.options.start_limit_s:g} s. {self._why_not_there(pump)}"
                )
            pump()
        self.bus.set_release(release_of(graph, self.options))

    def _why_not_there(self, pump: Callable[[], None]) -> str:
        """Return what keeps the navigation from offering its action, as far as its nodes tell."""
        until = time.monotonic() + _ASKED_S
        while time.monotonic() < until:
            self.lifecycle.poll()
            pump()
        if not self.lifecycle.found():
            return (
                "Start your navigation with RMW_IMPLEMENTATION=rmw_cyclonedds_cpp and this ROS_DOMAIN_ID; "
                "`rvsg ros2 check` lists what is found."
            )
        waiting = ", ".join(self.lifecycle.waiting_for())
        tail = self.launched.tail() if self.launched is not None else ""
        said = f" The last lines of the launch command:\n{tail}" if tail else ""
        return f"Not active: {waiting or 'no node'}. A node that refuses its parameters says so in its log.{said}"

    def parameters(self, pump: Callable[[], None]) -> NodeParameters:
        """Return what the nodes tell of their parameters; they are asked once."""
        if self._parameters is None:
            self._parameters = ask_nodes(self.bus, self.options.answer_limit_s, pump)
        return self._parameters

    def control_hz(self, pump: Callable[[], None]) -> float:
        """Return the rate at which velocity commands are due, in simulated time."""
        if self.options.control_hz is not None:
            return self.options.control_hz
        if self.scaled is not None:
            return self.scaled.control_hz
        told = self.parameters(pump).control_hz
        if told is None:
            return CONTROL_HZ
        return told if self.bus.types.release in BY_THE_CLOCK else told / self.speed

    def actions(self) -> tuple[str, ...]:
        """Return the names of the actions that can get the goal."""
        names = {"to_pose": (self.options.to_pose_action,), "through_poses": (self.options.through_poses_action,)}
        return names.get(self.options.goal, (self.options.to_pose_action, self.options.through_poses_action))

    def connect(self, robot: Robot) -> RobotSide:
        """Make the publishers of a robot, once for runs of the same robot."""
        if self.robot_side is not None and self.robot_side.robot != robot:
            self.robot_side.close()
            self.robot_side = None
        if self.robot_side is None:
            self.robot_side = RobotSide(self.bus, self.options, robot)
        return self.robot_side

    def action(self, through: bool) -> ActionClient:
        """Return a client for one goal or one goal with poses to drive through."""
        if through:
            return self.bus.action(self.options.through_poses_action, THROUGH_POSES)
        return self.bus.action(self.options.to_pose_action, TO_POSE)

    def commands(self) -> Subscription:
        """Subscribe to the velocity commands, of the type that the system publishes."""
        kind = self.options.cmd_vel_type
        if kind == "auto":
            kinds = {writer.type_name for writer in self.bus.graph().publishers(self.options.cmd_vel)}
            stamped = "geometry_msgs/msg/TwistStamped" in kinds
            kind = "TwistStamped" if stamped else "Twist"
        wanted = self.options.reliable.get(self.options.cmd_vel)
        return self.bus.subscribe(self.options.cmd_vel, f"geometry_msgs/msg/{kind}", reliable=wanted)

    def clear_costmaps(self, limit_s: float, pump: Callable[[], None]) -> list[str]:
        """Clear the costmaps that can be cleared; return the services that did not answer."""
        failed = []
        graph = self.bus.graph()
        for name in self.options.clear_costmaps:
            if graph.servers(name):
                client = next((c for c in self._clients if c.service == name), None)
                if client is None:
                    client = self.bus.client(name, CLEAR)
                    self._clients.append(client)
                if client.call(limit_s, pump) is None:
                    failed.append(name)
        return failed

    def check(self) -> None:
        """Raise SimulationError where the launched command has ended."""
        self._check_launched()

    def _check_launched(self) -> None:
        if self.launched is not None and (code := self.launched.ended) is not None:
            tail = self.launched.tail()
            said = f" Its last lines:\n{tail}" if tail else ""
            raise SimulationError(f"The launch command ended with code {code}.{said}")

    def close(self) -> None:
        """Leave the domain and end what was started. May be called again."""
        self.bus.close()
        self._end_launched()

    def _end_launched(self) -> None:
        if self.launched is not None:
            self.launched.close()
            self.launched = None
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None
        self.turn.give_back(time.time_ns())


def release_of(graph: Graph, options: Ros2Options) -> Release:
    """Return the release whose definitions the system uses: as asked, else by the hashes that its nodes announce.

    Raises:
        SimulationError: the announced hashes are of no known release.
    """
    if options.release != "auto":
        return options.release
    announced: dict[str, set[str]] = {}
    endpoints = (*graph.readers, *graph.writers)
    goals = [each for each in endpoints if each.type_name.startswith("nav2_msgs/action/Navigate")]
    for endpoint in goals:
        if endpoint.type_hash:
            announced.setdefault(endpoint.type_name, set()).add(endpoint.type_hash)
    if not announced:  # Humble announces none; before the navigator is configured, other nodes tell
        return _OLDEST_HASHED if not goals and any(each.type_hash for each in endpoints) else "humble"
    for release in RELEASES[1:]:
        known = interfaces(release)
        if all(known.type_hash(name) in hashes for name, hashes in announced.items()):
            return release
    raise SimulationError(
        f"The running system announces definitions of {', '.join(sorted(announced))} that are of no known release "
        f"({', '.join(RELEASES)}). Set the option release to the nearest one if their fields are the same."
    )
