"""A process with rclpy between RVSG's stack protocol and a running ROS 2 navigation."""

from __future__ import annotations

import math
import time
from array import array
from collections.abc import Callable
from typing import Any

import rclpy
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseStamped, PoseWithCovarianceStamped, TransformStamped, Twist, TwistStamped
from lifecycle_msgs.srv import GetState
from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
from nav2_msgs.srv import ClearEntireCostmap
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from rvsg_ros2 import rvsg_client

OCCUPIED, UNKNOWN = 100, 255
"""Cells of the map that RVSG sends; every other value is free."""
VARIANCES = [{0: 0.01, 7: 0.01, 35: 0.005}.get(k, 0.0) for k in range(36)]
"""Of the start of a run, which is known within a few centimetres."""


def time_of(nanoseconds: int) -> Time:
    """Return a ROS time."""
    seconds, rest = divmod(nanoseconds, 10**9)
    return Time(sec=seconds, nanosec=rest)


def pose_of(x: float, y: float, yaw: float) -> Pose:
    """Return a pose in the plane."""
    pose = Pose()
    pose.position.x, pose.position.y = float(x), float(y)
    pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return pose


def stamped(message: Any, now: int, frame: str) -> Any:
    """Return a message with time and frame in its header."""
    message.header.stamp, message.header.frame_id = time_of(now), frame
    return message


def transform_of(now: int, parent: str, child: str, x: float, y: float, yaw: float) -> TransformStamped:
    """Return the place of `child` in `parent`."""
    made = stamped(TransformStamped(), now, parent)
    made.child_frame_id, place, turn = child, made.transform.translation, made.transform.rotation
    place.x, place.y = float(x), float(y)
    turn.z, turn.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return made


def laser_scan(now: int, frame: str, scan: Any, lidar: dict[str, Any]) -> LaserScan:
    """Return a scan; `lidar` is its part of the robot's record."""
    made = stamped(LaserScan(), now, frame)
    made.angle_min, made.angle_increment = float(scan.angle_min), float(scan.angle_increment)
    made.angle_max = made.angle_min + made.angle_increment * (len(scan.ranges) - 1)
    made.scan_time = 1.0 / lidar["rate_hz"]
    made.range_min, made.range_max = float(lidar["min_range_m"]), float(lidar["max_range_m"])
    made.ranges = array("f", scan.ranges)
    return made


def occupancy_grid(now: int, frame: str, world: Any) -> OccupancyGrid:
    """Return the map of a task."""
    made = stamped(OccupancyGrid(), now, frame)
    made.info.resolution, made.info.width, made.info.height = float(world.resolution), world.columns, world.rows
    made.info.origin = pose_of(world.origin[0], world.origin[1], 0.0)
    values = {OCCUPIED: 100, UNKNOWN: -1}
    made.data = array("b", (values.get(cell, 0) for cell in world.cells))
    return made


DEFAULTS: dict[str, Any] = {
    "speed": 1.0,  # simulated over wall time
    "cmd_vel": "/cmd_vel",
    "stamped": False,  # whether cmd_vel is TwistStamped
    "odom": "/odom",
    "scan": "/scan",  # first lidar; the others are on scan_NAME
    "map": "/map",
    "initial_pose": "/initialpose",
    "to_pose_action": "/navigate_to_pose",
    "through_poses_action": "/navigate_through_poses",
    "clear_costmaps": [
        "/global_costmap/clear_entirely_global_costmap",
        "/local_costmap/clear_entirely_local_costmap",
    ],
    "map_frame": "map",
    "odom_frame": "odom",
    "base_frame": "base_link",
    "footprint_frame": "base_footprint",
    "nodes": ["controller_server", "planner_server", "bt_navigator"],
    "localises": True,  # whether the system finds its place itself; else the transform from map to odom is given
    "publish_map": False,
    "start_limit_s": 60.0,
    "settle_s": 1.0,
}
ACTIVE = 3
ASK_S = 2.0
PUMP_S = 0.02


class Bridge(rvsg_client.Planner):
    """Drives RVSG's robot by a ROS 2 navigation that runs already."""

    people = costmap = False

    def hello(self, parameters: dict[str, Any]) -> None:
        """Check the parameters, and join the ROS graph."""
        unknown = sorted(set(parameters) - set(DEFAULTS))
        if unknown:
            raise SystemExit(f"unknown parameter {unknown[0]!r}; known: {', '.join(DEFAULTS)}")
        self.o = {**DEFAULTS, **parameters}
        rclpy.init()
        self.node = Node("rvsg")
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        latched.reliability = QoSReliabilityPolicy.RELIABLE
        publish = self.node.create_publisher
        self.clock = publish(Clock, "/clock", 10)
        self.tf = publish(TFMessage, "/tf", 100)
        self.tf_static = publish(TFMessage, "/tf_static", latched)
        self.odom = publish(Odometry, self.o["odom"], 10)
        self.initial = publish(PoseWithCovarianceStamped, self.o["initial_pose"], 10)
        self.grid = publish(OccupancyGrid, self.o["map"], latched) if self.o["publish_map"] else None
        self.scan_topics: list[Any] = []
        self.node.create_subscription(
            TwistStamped if self.o["stamped"] else Twist, self.o["cmd_vel"], self._commanded, 10
        )
        self.node.create_subscription(TFMessage, "/tf", self._transformed, 100)
        self.actions = {
            False: ActionClient(self.node, NavigateToPose, self.o["to_pose_action"]),
            True: ActionClient(self.node, NavigateThroughPoses, self.o["through_poses_action"]),
        }
        self.now = time.time_ns()
        self.handle: Any = None
        self.task: Any = None

    def reset(self, task: Any) -> None:
        """Keep the task; the system is made ready with the first observation."""
        self._cancel()
        self.task, self.ready = task, False

    def command(self, seen: Any) -> Any:
        """Send what the robot senses, keep pace, and return the newest velocity or how the goal ended."""
        if not self.ready:
            self._get_ready(seen)
        self.now = self.base + round(seen.t * 1e9)
        self._publish(seen)
        self.due += self.task.period / self.o["speed"]
        self._spin_until(self.due)
        self.due = max(self.due, time.monotonic() - self.task.period)
        if self.result.done():
            self.handle = None
            succeeded = self.result.result().status == GoalStatus.STATUS_SUCCEEDED
            return rvsg_client.REACHED if succeeded else rvsg_client.GAVE_UP
        newest, self.velocity = self.velocity, None
        return newest

    def _get_ready(self, seen: Any) -> None:
        until = time.monotonic() + self.o["start_limit_s"]
        self.velocity, self.estimate = None, None
        self._static()
        if self.grid is not None:
            self.grid.publish(occupancy_grid(self.now, self.o["map_frame"], self.task.map))
        for name in self.o["nodes"]:
            self._wait_for(seen, until, f"{name} is not active", self._asking(name))
        if self.o["localises"]:
            self.estimate = None
            self._wait_for(seen, until, "the system is not localised", lambda: self._is_localised(seen))
        for name in self.o["clear_costmaps"]:
            self._clear(name, seen, until)
        settled = self.now + round(self.o["settle_s"] * 1e9)
        while self.now < settled:
            self._pump(seen)
        self._send_goal(seen, until)
        self.ready = True
        self.base = self.now - round(seen.t * 1e9)
        self.due = time.monotonic()
        self.velocity = None

    def _asking(self, node: str) -> Callable[[], bool]:
        """Return a function that asks a lifecycle node again and again whether it is active."""
        client = self.node.create_client(GetState, f"{node}/get_state")
        asked: list[Any] = []

        def is_active() -> bool:
            if asked and asked[-1].done() and asked.pop().result().current_state.id == ACTIVE:
                return True
            if not asked and client.service_is_ready():
                asked.append(client.call_async(GetState.Request()))
            return False

        return is_active

    def _wait_for(self, seen: Any, until: float, otherwise: str, is_so: Callable[[], bool]) -> None:
        sent = -math.inf
        while not is_so():
            if self.o["localises"] and time.monotonic() - sent > ASK_S:
                sent = time.monotonic()
                start = stamped(PoseWithCovarianceStamped(), self.now, self.o["map_frame"])
                start.pose.pose = pose_of(*self.task.start)
                start.pose.covariance = VARIANCES
                self.initial.publish(start)
            if time.monotonic() > until:
                raise SystemExit(f"{otherwise} after {self.o['start_limit_s']:g} s")
            self._pump(seen)

    def _is_localised(self, seen: Any) -> bool:
        if self.estimate is None:
            return False
        x, y, yaw = self.estimate
        px = x + math.cos(yaw) * seen.pose[0] - math.sin(yaw) * seen.pose[1]
        py = y + math.sin(yaw) * seen.pose[0] + math.cos(yaw) * seen.pose[1]
        turned = math.remainder(seen.pose[2] + yaw - self.task.start[2], 2 * math.pi)
        return math.hypot(px - self.task.start[0], py - self.task.start[1]) < 0.5 and abs(turned) < 0.35

    def _clear(self, name: str, seen: Any, until: float) -> None:
        client = self.node.create_client(ClearEntireCostmap, name)
        if client.service_is_ready():
            answer = client.call_async(ClearEntireCostmap.Request())
            self._wait_for(seen, until, f"{name} did not answer", answer.done)

    def _send_goal(self, seen: Any, until: float) -> None:
        through = len(self.task.goals) > 1
        client = self.actions[through]
        self._wait_for(seen, until, "the action of the goal is not there", client.server_is_ready)
        poses = [stamped(PoseStamped(), 0, self.o["map_frame"]) for _ in self.task.goals]
        for made, place in zip(poses, self.task.goals, strict=True):
            made.pose = pose_of(*place)
        goal = (NavigateThroughPoses if through else NavigateToPose).Goal()
        if not through:
            goal.pose = poses[-1]
        elif hasattr(goal.poses, "goals"):
            goal.poses.goals = poses  # nav_msgs/Goals, from Kilted on
        else:
            goal.poses = poses
        sent = client.send_goal_async(goal)
        self._wait_for(seen, until, "the goal was not answered", sent.done)
        self.handle = sent.result()
        if not self.handle.accepted:
            raise SystemExit("the goal was rejected")
        self.result = self.handle.get_result_async()

    def _cancel(self) -> None:
        if self.handle is not None:
            cancelled = self.handle.cancel_goal_async()
            until = time.monotonic() + 1.0
            while not cancelled.done() and time.monotonic() < until:
                rclpy.spin_once(self.node, timeout_sec=0.05)
            self.handle = None

    def _static(self) -> None:
        o, robot = self.o, self.task.robot
        if len(self.scan_topics) != len(robot["lidars"]):
            topics = [o["scan"]] + [f"{o['scan']}_{plain(lidar['name'])}" for lidar in robot["lidars"][1:]]
            self.scan_topics = [self.node.create_publisher(LaserScan, topic, 5) for topic in topics]
        fixed = [transform_of(0, o["footprint_frame"], o["base_frame"], 0.0, 0.0, 0.0)]
        for lidar in robot["lidars"]:
            frame = plain(lidar["name"])
            fixed.append(transform_of(0, o["base_frame"], frame, lidar["x"], lidar["y"], lidar["yaw"]))
        self.tf_static.publish(TFMessage(transforms=fixed))
        self.scanned = [-math.inf] * len(self.scan_topics)

    def _publish(self, seen: Any, *, frozen: bool = False) -> None:
        o, now = self.o, self.now
        self.clock.publish(Clock(clock=time_of(now)))
        moved = [transform_of(now, o["odom_frame"], o["footprint_frame"], *seen.pose)]
        if not o["localises"]:
            moved.append(transform_of(now, o["map_frame"], o["odom_frame"], *seen.map_from_odom))
        self.tf.publish(TFMessage(transforms=moved))
        odometry = stamped(Odometry(), now, o["odom_frame"])
        odometry.child_frame_id, odometry.pose.pose = o["footprint_frame"], pose_of(*seen.pose)
        twist = odometry.twist.twist
        twist.linear.x, twist.angular.z = (float(value) for value in seen.velocity)
        self.odom.publish(odometry)
        for k, (scan, lidar) in enumerate(zip(seen.scans, self.task.robot["lidars"], strict=True)):
            taken = now if frozen else now + round((scan.t - seen.t) * 1e9)
            if taken > self.scanned[k] + 0.9e9 / lidar["rate_hz"]:
                self.scanned[k] = taken
                self.scan_topics[k].publish(laser_scan(taken, plain(lidar["name"]), scan, lidar))

    def _pump(self, seen: Any) -> None:
        """Let PUMP_S of ROS time pass while the robot stands."""
        self.now += round(PUMP_S * 1e9)
        self._publish(seen, frozen=True)
        self._spin_until(time.monotonic() + PUMP_S / self.o["speed"])

    def _spin_until(self, due: float) -> None:
        """Handle what arrives until then, at least once."""
        rclpy.spin_once(self.node, timeout_sec=0.0)
        while (rest := due - time.monotonic()) > 0.0:
            rclpy.spin_once(self.node, timeout_sec=rest)

    def _commanded(self, message: Any) -> None:
        twist = getattr(message, "twist", message)
        self.velocity = (twist.linear.x, twist.angular.z)

    def _transformed(self, message: Any) -> None:
        for each in message.transforms:
            if (each.header.frame_id, each.child_frame_id) == (self.o["map_frame"], self.o["odom_frame"]):
                at, turn = each.transform.translation, each.transform.rotation
                self.estimate = (at.x, at.y, 2 * math.atan2(turn.z, turn.w))


def plain(name: str) -> str:
    """Return a name that ROS accepts."""
    return "".join(letter if letter.isalnum() else "_" for letter in name)


def main() -> None:
    """Answer RVSG until it closes."""
    bridge = Bridge()
    try:
        rvsg_client.serve(bridge)
    finally:
        if rclpy.ok():
            bridge._cancel()
            rclpy.shutdown()


if __name__ == "__main__":
    main()
