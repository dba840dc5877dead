"""A stand-in for rclpy with a navigation in it, and the bridge of rvsg-ros2 on top: `python fake_ros.py [BEHAVIOUR]`.

BEHAVIOUR: `works`, `aborts` (after 1 s), `rejects`, `sleeps` (controller_server never becomes active).
"""

from __future__ import annotations

import math
import sys
import time
from types import ModuleType
from typing import Any


class Message:
    """A message whose fields appear when they are used."""

    absent: tuple[str, ...] = ()

    def __init__(self, **fields: Any) -> None:
        self.__dict__.update(fields)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name in type(self).absent:
            raise AttributeError(name)
        self.__dict__[name] = Message()
        return self.__dict__[name]


class Future:
    """A result that is there, or comes later."""

    def __init__(self, value: Any = None) -> None:
        self.value = value

    def done(self) -> bool:
        return self.value is not None

    def result(self) -> Any:
        return self.value


class System:
    """The navigation behind the stand-in: it takes the goal and drives straight at it."""

    def __init__(self, behaviour: str) -> None:
        self.behaviour = behaviour
        self.callbacks: dict[str, Any] = {}
        self.base = (0.0, 0.0, 0.0)
        self.frame: tuple[float, float, float] | None = None
        self.goals: list[tuple[float, float]] = []
        self.result = Future()
        self.now = self.begun = 0.0
        self.scans = 0

    def publish(self, topic: str, message: Any) -> None:
        if topic == "/clock":
            self.now = message.clock.sec % 100000 + message.clock.nanosec / 1e9
        elif topic == "/tf":
            place = message.transforms[0].transform
            yaw = 2 * math.atan2(place.rotation.z, place.rotation.w)
            self.base = (place.translation.x, place.translation.y, yaw)
            for each in message.transforms[1:]:
                self.frame = (each.transform.translation.x, each.transform.translation.y, 0.0)
        elif topic == "/initialpose":
            place = message.pose.pose.position
            self.frame = (place.x - self.base[0], place.y - self.base[1], 0.0)
        elif topic == "/scan":
            assert len(message.ranges) > 100
            self.scans += 1

    def spin(self) -> None:
        if self.frame is not None:
            each = Message(child_frame_id="odom")
            each.header.frame_id = "map"
            each.transform.translation.x, each.transform.translation.y = self.frame[:2]
            each.transform.rotation.z, each.transform.rotation.w = 0.0, 1.0
            self.callbacks["/tf"](Message(transforms=[each]))
        if not self.goals or self.result.done() or self.frame is None:
            return
        if self.behaviour == "aborts" and self.now - self.begun > 1.0:
            self.result.value = Message(status=6)
            return
        x, y = self.base[0] + self.frame[0], self.base[1] + self.frame[1]
        gx, gy = self.goals[0]
        if math.hypot(gx - x, gy - y) < 0.3:
            self.goals.pop(0)
            if not self.goals:
                assert self.scans > 10
                self.result.value = Message(status=4)
            return
        turn = math.remainder(math.atan2(gy - y, gx - x) - self.base[2], 2 * math.pi)
        twist = Twist()
        twist.linear.x, twist.angular.z = 0.5 if abs(turn) < 0.5 else 0.0, max(-1.0, min(1.0, 2 * turn))
        self.callbacks["/cmd_vel"](twist)


class Twist(Message):
    absent = ("twist",)


class Publisher:
    def __init__(self, topic: str) -> None:
        self.topic = topic

    def publish(self, message: Any) -> None:
        SYSTEM.publish(self.topic, message)


class Client:
    def __init__(self, name: str) -> None:
        self.name = name

    def service_is_ready(self) -> bool:
        return True

    def call_async(self, _: Any) -> Future:
        asleep = SYSTEM.behaviour == "sleeps" and self.name.startswith("controller_server")
        return Future(Message(current_state=Message(id=2 if asleep else 3)))


class Node:
    def __init__(self, name: str) -> None:
        self.name = name

    def create_publisher(self, _: Any, topic: str, __: Any) -> Publisher:
        return Publisher(topic)

    def create_subscription(self, _: Any, topic: str, callback: Any, __: Any) -> None:
        SYSTEM.callbacks[topic] = callback

    def create_client(self, _: Any, name: str) -> Client:
        return Client(name)


class Handle:
    accepted = True

    def get_result_async(self) -> Future:
        return SYSTEM.result

    def cancel_goal_async(self) -> Future:
        SYSTEM.goals.clear()
        return Future(True)


class ActionClient:
    def __init__(self, node: Node, kind: Any, name: str) -> None:
        self.name = name

    def server_is_ready(self) -> bool:
        return True

    def send_goal_async(self, goal: Any) -> Future:
        poses = [goal.pose] if self.name == "/navigate_to_pose" else goal.poses
        SYSTEM.goals = [(pose.pose.position.x, pose.pose.position.y) for pose in poses]
        SYSTEM.result, SYSTEM.begun = Future(), SYSTEM.now
        handle = Handle()
        handle.accepted = SYSTEM.behaviour != "rejects"
        return Future(handle)


class Poses(Message):
    def __init__(self) -> None:
        super().__init__(poses=[], pose=None)


def spin_once(node: Node, timeout_sec: float) -> None:
    SYSTEM.spin()
    time.sleep(timeout_sec)


def kind(name: str) -> Any:
    return type(name, (Message,), {"Request": Message, "Goal": Poses, "STATUS_SUCCEEDED": 4})


def install() -> None:
    """Put the stand-ins where ROS 2 has its modules."""
    content: dict[str, dict[str, Any]] = {
        "rclpy": {"init": lambda: None, "ok": lambda: True, "shutdown": lambda: None, "spin_once": spin_once},
        "rclpy.node": {"Node": Node},
        "rclpy.action": {"ActionClient": ActionClient},
        "rclpy.qos": {name: kind(name) for name in ("QoSDurabilityPolicy", "QoSProfile", "QoSReliabilityPolicy")},
        "rvsg_ros2.rvsg_client": {},
    }
    content["rclpy.qos"]["QoSDurabilityPolicy"] = Message(TRANSIENT_LOCAL=1)
    content["rclpy.qos"]["QoSReliabilityPolicy"] = Message(RELIABLE=1)
    for module, names in {
        "builtin_interfaces.msg": "Time",
        "geometry_msgs.msg": "Pose PoseStamped PoseWithCovarianceStamped TransformStamped TwistStamped",
        "nav_msgs.msg": "OccupancyGrid Odometry",
        "sensor_msgs.msg": "LaserScan",
        "rosgraph_msgs.msg": "Clock",
        "tf2_msgs.msg": "TFMessage",
        "action_msgs.msg": "GoalStatus",
        "lifecycle_msgs.srv": "GetState",
        "nav2_msgs.srv": "ClearEntireCostmap",
        "nav2_msgs.action": "NavigateToPose NavigateThroughPoses",
    }.items():
        content[module] = {name: kind(name) for name in names.split()}
    content["geometry_msgs.msg"]["Twist"] = Twist
    for name, members in content.items():
        if name != "rvsg_ros2.rvsg_client":
            sys.modules.setdefault(name.partition(".")[0], ModuleType(name.partition(".")[0]))
            module = sys.modules.setdefault(name, ModuleType(name))
            module.__dict__.update(members)


if __name__ == "__main__":
    SYSTEM = System(sys.argv[1] if len(sys.argv) > 1 else "works")
    install()
    from run_bridge import main

    main()
