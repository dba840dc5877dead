"""A connection to one ROS 2 navigation system: its DDS domain, its start and end, and the robot's topics.

The odometry frame is the frame that the simulator moves the robot in; it does not drift.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from rvsg.core.errors import InputError, SimulationError
from rvsg.robots.robot import Lidar, Robot
from rvsg.simulation.stacks.protocol import Observation, Scan
from rvsg.world.world import World
from rvsg_exchange.bag import Messages
from rvsg_ros2.dds import ActionClient, Bus, Client, Graph, Publisher, Subscription
from rvsg_ros2.interfaces import RELEASES, Release, interfaces
from rvsg_ros2.launch import Launched, ros_environment
from rvsg_ros2.nav2_file import BY_THE_CLOCK, CONTROL_HZ, Scaled, scale_nav2_params
from rvsg_ros2.nodes import Lifecycle, NodeParameters, ask_nodes
from rvsg_ros2.options import Ros2Options, lidar_frame, scan_topic

FORGET_S = 12.0
"""Wall time after which a killed process is gone from the DDS domain: the lease of its participant is 10 s."""
TRANSFORMS_FIRST_S = 1.0
"""Wall time in which transforms go out before the clock does. A costmap that was started without a clock waits for its
transform until 60 s after time 0: where the clock comes first, that time is over at once."""
INITIAL_POSE_VARIANCE = (0.01, 0.01, 0.005)
"""x, y, yaw: the start of a run is known."""


class DdsMessages(Messages):
    """Makes messages that DDS can send."""

    def make(self, kind: str, **values: Any) -> Any:
        """Return a message of a kind, such as `nav_msgs/Path`; fields that are not given are zero or empty."""
        lists = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in values.items()}
        return self.types[kind.replace("/", "/msg/")](**lists)


class RobotSide(DdsMessages):
    """Publishers of a robot. Times are ROS time in nanoseconds."""

    def __init__(self, bus: Bus, options: Ros2Options, robot: Robot) -> None:
        super().__init__(bus.types)
        self.bus, self.options, self.robot = bus, options, robot
        self._clock = bus.advertise("/clock", "rosgraph_msgs/msg/Clock", depth=1)
        self._tf = bus.advertise("/tf", "tf2_msgs/msg/TFMessage", depth=100)
        self._tf_static = bus.advertise("/tf_static", "tf2_msgs/msg/TFMessage", latched=True, depth=1)
        self._odom = bus.advertise(options.odom, "nav_msgs/msg/Odometry")
        self._initial = bus.advertise(options.initial_pose, "geometry_msgs/msg/PoseWithCovarianceStamped")
        self._scans = [
            bus.advertise(scan_topic(options, robot.lidars, k), "sensor_msgs/msg/LaserScan", depth=5)
            for k in range(len(robot.lidars))
        ]
        self._publishers = [self._clock, self._tf, self._tf_static, self._odom, self._initial, *self._scans]
        self._joints = bus.advertise("/joint_states", "sensor_msgs/msg/JointState") if options.joint_states else None
        self._map: Publisher | None = None
        self.start_over()
        self.gives_transform = False
        """Whether the transform from map to odom is published, too."""
        self._clock_from = time.monotonic() + TRANSFORMS_FIRST_S
        stamp, fixed = self.stamp(0), []
        if options.footprint_frame != options.base_frame:
            fixed.append(self.transform(stamp, options.footprint_frame, options.base_frame, 0.0, 0.0, 0.0))
        for k, lidar in enumerate(robot.lidars):
            frame = lidar_frame(options, robot.lidars, k)
            place = (lidar.x, lidar.y, lidar.yaw, lidar.height_m or 0.0)
            fixed.append(self.transform(stamp, options.base_frame, frame, *place))
        self._tf_static.publish(self.make("tf2_msgs/TFMessage", transforms=fixed))

    def close(self) -> None:
        """Publish no more."""
        for each in (*self._publishers, self._joints, self._map):
            if each is not None:
                each.close()

    def publish(self, now: int, seen: Observation, *, at: float | None = None) -> None:
        """Send everything that is due.

        Args:
            now: ROS time in nanoseconds, at the observation's time.
            at: seconds since simulated time stands still, where it does: scans are sent again as they pass.
        """
        options, stamp = self.options, self.stamp(now)
        if at is None or time.monotonic() >= self._clock_from:
            self._clock.publish(self.make("rosgraph_msgs/Clock", clock=stamp))
        moved = [self.transform(stamp, options.odom_frame, options.footprint_frame, *seen.pose)]
        if self.gives_transform:
            moved.append(self.transform(stamp, options.map_frame, options.odom_frame, *seen.map_from_odom))
        self._tf.publish(self.make("tf2_msgs/TFMessage", transforms=moved))
        pose, twist = self.pose(*seen.pose), self.twist(*seen.velocity, seen.lateral)
        self._odom.publish(self.odometry(stamp, options.odom_frame, options.footprint_frame, pose, twist))
        for k, lidar in enumerate(self.robot.lidars):
            scan = seen.scan(k)
            t = scan.t if at is None else at
            if t <= self._scanned[k] or (at is not None and at < self._scanned[k] + 1.0 / lidar.rate_hz - 1e-6):
                continue
            self._scanned[k] = t
            taken = now if at is not None else now + round((scan.t - seen.t) * 1e9)
            self._scans[k].publish(self._scan(taken, k, lidar, scan))

    def start_over(self) -> None:
        """Forget when the scans were taken; call it where the clock of the scans begins again."""
        self._scanned = [-math.inf] * len(self.robot.lidars)

    def publish_joints(self, now: int) -> None:
        """Send the joints' positions, all 0, where they are asked for."""
        if self._joints is not None:
            names, header = list(self.options.joint_states), self.header(self.stamp(now), "")
            zeros = [0.0] * len(names)
            self._joints.publish(
                self.make("sensor_msgs/JointState", header=header, name=names, position=zeros, velocity=zeros)
            )

    def publish_map(self, now: int, world: World) -> None:
        """Send the occupancy map, latched."""
        if self._map is None:
            self._map = self.bus.advertise(self.options.map, "nav_msgs/msg/OccupancyGrid", latched=True, depth=1)
        self._map.publish(self.map(self.stamp(now), self.options.map_frame, world.occupancy))

    def publish_initial_pose(self, now: int, x: float, y: float, yaw: float) -> None:
        """Tell localisation where the robot is in the map."""
        header = self.header(self.stamp(now), self.options.map_frame)
        message = self.make("geometry_msgs/PoseWithCovarianceStamped", header=header)
        message.pose.pose = self.pose(x, y, yaw)
        for index, variance in zip((0, 7, 35), INITIAL_POSE_VARIANCE, strict=True):
            message.pose.covariance[index] = variance
        self._initial.publish(message)

    def _scan(self, now: int, k: int, lidar: Lidar, scan: Scan) -> Any:
        return self.make(
            "sensor_msgs/LaserScan",
            header=self.header(self.stamp(now), lidar_frame(self.options, self.robot.lidars, k)),
            angle_min=scan.angle_min,
            angle_max=scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1),
            angle_increment=scan.angle_increment,
            scan_time=1.0 / lidar.rate_hz,
            range_min=scan.range_min,
            range_max=scan.range_max,
            ranges=scan.ranges,
        )


GAP_S = 5
"""ROS time between the end of a run and the next."""
TELL_S = 5.0
"""After so long a user is told what is waited for."""
POLL_S = 0.02
COURTESY_S = 0.06
"""Who has just used the domain lets others who wait for it see that it is free."""


class Turn:
    """The right to use one DDS domain, shared by all processes that have the same network."""

    def __init__(self, domain: int) -> None:
        from filelock import FileLock

        self.domain = domain
        folder = Path(tempfile.gettempdir())
        name = f"rvsg-ros2-{domain}"
        with suppress(OSError):  # not Linux: one network
            name += f"-{Path('/proc/self/ns/net').stat().st_ino}"
        self._clock = folder / f"{name}.clock"
        self._lock = FileLock(folder / f"{name}.lock", mode=0o666)
        self._given_back = 0.0

    def take(self, limit_s: float, tell: Callable[[str], None] = lambda _: None) -> int:
        """Wait for the domain; return the ROS time (ns) to begin at, later than any that was used before.

        Raises:
            SimulationError: another process used it for longer than `limit_s`.
        """
        time.sleep(max(0.0, self._given_back + COURTESY_S - time.monotonic()))
        if not self._acquire(min(TELL_S, limit_s)):
            if limit_s > TELL_S:
                tell(
                    f"waiting for DDS domain {self.domain}: another process uses it, and runs take turns "
                    "(ROS_DOMAIN_ID or the option domain chooses another)"
                )
            if not self._acquire(limit_s - TELL_S):
                raise SimulationError(
                    f"Another process has used DDS domain {self.domain} for over {limit_s:g} s. Use one worker "
                    "(--jobs 1), or end the other process."
                )
        try:
            last = int(self._clock.read_text())
        except (OSError, ValueError):
            last = 0
        return max(time.time_ns(), last + GAP_S * 10**9)

    def _acquire(self, limit_s: float) -> bool:
        from filelock import Timeout

        try:
            self._lock.acquire(timeout=max(0.0, limit_s), poll_interval=POLL_S)
        except Timeout:
            return False
        return True

    def give_back(self, now_ns: int) -> None:
        """Let others use the domain; `now_ns` is the ROS time that was reached. May be called again."""
        if self._lock.is_locked:
            self._clock.write_text(str(now_ns))
            self._lock.release()
            self._given_back = time.monotonic()


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
        command = str(self.options.launch).replace("{speed}", f"{self.speed:g}")
        if self.options.params is not None:
            file, text = self.options.params, self.options.parameter_text()
            self.scaled = scale_nav2_params(file, self.speed, self._expected_release(), text)
            if self.speed > 1.0 and self.scaled.missing_trees:
                raise InputError(
                    f"speed {self.speed:g}: the behaviour tree {self.scaled.missing_trees[0]} was not found, so it "
                    f"would plan at 1/{self.speed:g} of its rate. Source your ROS 2 before you start RVSG, give the "
                    f"path of the file in {self.options.params}, or set speed to 1.",
                    code="ros2-tree",
                )
            self._folder = tempfile.TemporaryDirectory(prefix="rvsg-nav2-")
            command = command.replace("{params}", str(self.scaled.write(Path(self._folder.name))))
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
            self.check()
            if time.monotonic() > until:
                raise SimulationError(
                    f"No action server {' or '.join(self.actions())} in DDS domain {self.domain} after "
                    f"{self.options.start_limit_s:g} s. {self._why_not_there(pump)}"
                )
            pump()
        self.wait_until_alone(pump)
        self.bus.set_release(release_of(graph, self.options))

    def wait_until_alone(self, pump: Callable[[], None]) -> None:
        """Wait until no two nodes have one name: DDS forgets a process that was killed after some seconds.

        Raises:
            SimulationError: another system is there, and stays.
        """
        until = 0.0
        while doubled := self.lifecycle.doubled():
            said = f"Two navigation systems are in DDS domain {self.domain}: {', '.join(doubled)}."
            if not until:
                until = time.monotonic() + FORGET_S
                self.tell(f"{said} Waiting {FORGET_S:g} s, in case one has just ended")
            if time.monotonic() > until:
                raise SimulationError(f"{said} End one of them, or set ROS_DOMAIN_ID or the option domain.")
            pump()

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
        names = {"to_pose": self.options.to_pose_action, "through_poses": self.options.through_poses_action}
        return (names[self.options.goal],) if self.options.goal in names else tuple(names.values())

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

    def send_goal(
        self, client: ActionClient, poses: Iterable[tuple[float, float, float]], pump: Callable[[], object]
    ) -> None:
        """Send poses in the map frame as the goal of an action, and wait until it is accepted.

        Raises:
            SimulationError: the action is not there, does not answer, or rejects the goal.
        """
        until = time.monotonic() + self.options.answer_limit_s
        while not client.is_matched:
            if time.monotonic() > until:
                raise SimulationError(f"The action {client.name} is not there.")
            pump()
        messages = DdsMessages(client.types)
        header = messages.header(messages.stamp(0), self.options.map_frame)
        stamped = [
            messages.make("geometry_msgs/PoseStamped", header=header, pose=messages.pose(x, y, yaw))
            for x, y, yaw in poses
        ]
        goal = client.types[f"{client.kind}_Goal"]()
        if client.kind == TO_POSE:
            goal.pose = stamped[-1]
        elif isinstance(goal.poses, list):
            goal.poses = stamped
        else:
            goal.poses.goals = stamped
        client.send_goal(goal)
        while client.accepted is None:
            if time.monotonic() > until + self.options.answer_limit_s:
                raise SimulationError(f"The action {client.name} did not answer the goal.")
            pump()
            client.poll()
        if not client.accepted:
            raise SimulationError(f"The action {client.name} rejected the goal.")

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
