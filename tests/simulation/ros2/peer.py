"""A process that plays Nav2 for the tests: lifecycle, localisation, actions and a simple controller, over raw DDS.

`python peer.py OPTIONS.json`. It shares the message types with RVSG (their encoding is tested against rosbags) and
nothing else: names, headers and the order of an action's messages are written down here a second time.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from rvsg_ros2.interfaces import interfaces

NODES = ("map_server", "amcl", "controller_server", "planner_server", "behavior_server", "bt_navigator")
ACCEPTED, EXECUTING, SUCCEEDED, CANCELED, ABORTED = 1, 2, 4, 5, 6


@dataclass
class Options:
    domain: int = 0
    release: str = "humble"
    announce: bool = True
    """Whether the type hash is in the user data of endpoints, as from Iron on; Humble has none."""
    stamped: bool = False
    localises: bool = True
    map: bool = True
    active_after_s: float = 0.3
    inactive: tuple[str, ...] = ()
    twice: tuple[str, ...] = ()
    """Nodes of which another one of the same name is there, which does not answer."""
    period_s: float = 0.05
    """Simulated time between commands."""
    miss_every: int = 0
    """Leave out every so many commands."""
    die_at_s: float = math.inf
    """The process ends so long (simulated) after the goal."""
    lose_controller_at_s: float = math.inf
    """The participant of controller_server is deleted."""
    hang_at_s: float = math.inf
    """controller_server answers and commands no more."""
    abort_at_s: float = math.inf
    reject: bool = False
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    """What nodes tell of their parameters, by node and name."""
    speed_m_s: float = 0.5
    report: str = ""
    """File to which what was heard is written, at the end."""


def qos(kind: str, types: Any, announce: bool, latched: bool = False, reliable: bool = True) -> Qos:
    data = f"typehash={types.type_hash(kind)};" if announce else ""
    return Qos(
        Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(1000),
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.Userdata(data.encode()),
    )


class Peer:
    def __init__(self, options: Options) -> None:
        self.o, self.T = options, interfaces(options.release)  # type: ignore[arg-type]
        self.dp = DomainParticipant(options.domain)
        self.controller_dp = DomainParticipant(options.domain)
        announce = options.announce and options.release != "humble"
        self.announce = announce
        self.begun = time.monotonic()
        self.now = 0.0
        self.odom: tuple[float, float, float] | None = None
        self.map_odom: tuple[float, float, float] | None = None
        self.goal: dict[str, Any] | None = None
        self.heard: dict[str, Any] = {"scans": {}, "clears": 0, "cancels": 0, "goals": 0, "initial": [], "map": None}
        self.clock = self.reader("rt/clock", "rosgraph_msgs/msg/Clock", reliable=False)
        self.tf = self.reader("rt/tf", "tf2_msgs/msg/TFMessage")
        self.tf_static = self.reader("rt/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
        self.scan = self.reader("rt/scan", "sensor_msgs/msg/LaserScan", reliable=False)
        self.odometry = self.reader("rt/odom", "nav_msgs/msg/Odometry")
        self.tf_out = self.writer("rt/tf", "tf2_msgs/msg/TFMessage")
        if options.localises:
            self.initial = self.reader("rt/initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped")
        if options.map:
            self.map_out = self.writer("rt/map", "nav_msgs/msg/OccupancyGrid", latched=True)
        else:
            self.map_in = self.reader("rt/map", "nav_msgs/msg/OccupancyGrid", latched=True)
        self.plan = self.writer("rt/plan", "nav_msgs/msg/Path")
        self.costmap = self.writer("rt/local_costmap/costmap", "nav_msgs/msg/OccupancyGrid", latched=True)
        self.costmap_sent = -math.inf
        self.tree = self.writer("rt/behavior_tree_log", "nav2_msgs/msg/BehaviorTreeLog")
        twist = "geometry_msgs/msg/TwistStamped" if options.stamped else "geometry_msgs/msg/Twist"
        self.twist = self.T[twist]
        self.cmd = self.writer("rt/cmd_vel", twist, participant=self.controller_dp)
        self.states = {
            node: self.server(f"{node}/get_state", "lifecycle_msgs/srv/GetState", node == "controller_server")
            for node in NODES
            if options.localises or node != "amcl"
        }
        self.stale = [self.server(f"{node}/get_state", "lifecycle_msgs/srv/GetState", True) for node in options.twice]
        self.clears = [
            self.server(f"{which}_costmap/clear_entirely_{which}_costmap", "nav2_msgs/srv/ClearEntireCostmap")
            for which in ("global", "local")
        ]
        self.parameters = {
            node: self.server(f"{node}/get_parameters", "rcl_interfaces/srv/GetParameters")
            for node in options.parameters
        }
        self.actions = {name: self.action(name, kind) for name, kind in (
            ("navigate_to_pose", "nav2_msgs/action/NavigateToPose"),
            ("navigate_through_poses", "nav2_msgs/action/NavigateThroughPoses"),
        )}  # fmt: skip

    def reader(self, topic: str, kind: str, *, latched: bool = False, reliable: bool = True, made: Any = None) -> Any:
        made = made or self.T[kind]
        return DataReader(self.dp, Topic(self.dp, topic, made), qos=qos(kind, self.T, self.announce, latched, reliable))

    def writer(self, topic: str, kind: str, *, latched: bool = False, made: Any = None, participant: Any = None) -> Any:
        dp, made = participant or self.dp, made or self.T[kind]
        return DataWriter(dp, Topic(dp, topic, made), qos=qos(kind, self.T, self.announce, latched))

    def server(self, name: str, kind: str, on_controller: bool = False) -> tuple[Any, Any, Any]:
        dp = self.controller_dp if on_controller else self.dp
        request, reply = (self.T.part_of_service(f"{kind}_{part}") for part in ("Request", "Response"))
        asked = DataReader(
            dp, Topic(dp, f"rq/{name}Request", request), qos=qos(f"{kind}_Request", self.T, self.announce)
        )
        answers = DataWriter(
            dp, Topic(dp, f"rr/{name}Reply", reply), qos=qos(f"{kind}_Response", self.T, self.announce)
        )
        return asked, answers, reply

    def action(self, name: str, kind: str) -> dict[str, Any]:
        return {
            "kind": kind,
            "send": self.server(f"{name}/_action/send_goal", f"{kind}_SendGoal"),
            "result": self.server(f"{name}/_action/get_result", f"{kind}_GetResult"),
            "cancel": self.server(f"{name}/_action/cancel_goal", "action_msgs/srv/CancelGoal"),
            "feedback": self.writer(f"rt/{name}/_action/feedback", f"{kind}_FeedbackMessage"),
        }

    def answer(self, server: tuple[Any, Any, Any], make: Any) -> None:
        asked, answers, reply = server
        for request in asked.take(20):
            if request.sample_info.valid_data:
                fields = make(request)
                if fields is not None:
                    answers.write(reply(rmw_guid=request.rmw_guid, rmw_sequence=request.rmw_sequence, **fields))

    @property
    def since_goal(self) -> float:
        return self.now - self.goal["at"] if self.goal else -1.0

    def state_of(self, node: str) -> Any:
        active = time.monotonic() - self.begun > self.o.active_after_s and node not in self.o.inactive
        return self.T["lifecycle_msgs/msg/State"](id=3 if active else 2, label="active" if active else "inactive")

    def run(self) -> None:
        last = -1.0
        while True:
            if os.getppid() == 1:
                break
            self.listen()
            self.serve()
            if self.now != last:
                last = self.now
                self.tick()
            if self.since_goal > self.o.die_at_s:
                os._exit(7)
            time.sleep(0.0005)

    def listen(self) -> None:
        for message in valid(self.clock, 50):
            self.now = message.clock.sec % 100000 + message.clock.nanosec / 1e9
            self.stamp = message.clock
        for message in valid(self.tf, 100):
            for each in message.transforms:
                z = each.transform.rotation
                at = each.transform.translation
                pose = (at.x, at.y, 2 * math.atan2(z.z, z.w))
                if each.child_frame_id == "base_footprint":
                    self.odom = pose
                elif each.child_frame_id == "odom" and not self.o.localises:
                    self.map_odom = pose
        for message in valid(self.scan, 50):
            self.heard["scans"][message.header.frame_id] = len(message.ranges)
        for message in valid(self.odometry, 50):
            self.heard["velocity"] = message.twist.twist.linear.x
        for message in valid(self.tf_static, 10):
            self.heard["static"] = [each.child_frame_id for each in message.transforms]
        if self.o.localises:
            for message in valid(self.initial, 10):
                p, q = message.pose.pose.position, message.pose.pose.orientation
                self.heard["initial"].append([p.x, p.y])
                if self.odom is not None:
                    self.map_odom = between((p.x, p.y, 2 * math.atan2(q.z, q.w)), self.odom)
        if not self.o.map:
            for message in valid(self.map_in, 2):
                self.heard["map"] = [message.info.width, message.info.height]

    def serve(self) -> None:
        hung = self.since_goal > self.o.hang_at_s
        if self.since_goal > self.o.lose_controller_at_s and self.controller_dp is not None:
            del self.states["controller_server"], self.cmd
            self.controller_dp.__del__()
            self.controller_dp = None
        for node, server in self.states.items():
            if not (hung and node == "controller_server"):
                self.answer(server, lambda _, node=node: {"current_state": self.state_of(node)})
        for server in self.clears:
            self.answer(server, self.cleared)
        for node, server in self.parameters.items():
            self.answer(server, lambda request, node=node: self.tell(node, request.names))
        for action in self.actions.values():
            self.answer(action["send"], lambda request, action=action: self.accept(request, action))
            self.answer(action["result"], lambda request: self.wait_for_result(request))
            self.answer(action["cancel"], lambda _: self.cancel())

    def tell(self, node: str, names: list[str]) -> dict[str, Any]:
        """As rclcpp does: nothing at all where one of the names is not declared."""
        known = self.o.parameters[node]
        return {"values": [self.value(known[name]) for name in names] if all(n in known for n in names) else []}

    def value(self, given: Any) -> Any:
        kind = {int: (2, "integer_value"), float: (3, "double_value"), str: (4, "string_value")}[type(given)]
        return self.T["rcl_interfaces/msg/ParameterValue"](type=kind[0], **{kind[1]: given})

    def cleared(self, _: Any) -> dict[str, Any]:
        self.heard["clears"] += 1
        return {}

    def accept(self, request: Any, action: dict[str, Any]) -> dict[str, Any]:
        self.heard["goals"] += 1
        if self.o.reject:
            return {"accepted": False}
        goal = request.goal
        poses = [goal.pose] if hasattr(goal, "pose") else getattr(goal.poses, "goals", goal.poses)
        self.goal = {
            "id": request.goal_id, "action": action, "at": self.now, "status": EXECUTING, "waiting": None,
            "poses": deque((p.pose.position.x, p.pose.position.y) for p in poses), "next": self.now, "number": 0,
        }  # fmt: skip
        assert all(p.header.frame_id == "map" for p in poses)
        change = self.T["nav2_msgs/msg/BehaviorTreeStatusChange"](node_name="FollowPath", current_status="RUNNING")
        self.tree.write(self.T["nav2_msgs/msg/BehaviorTreeLog"](event_log=[change]))
        pose = self.T["geometry_msgs/msg/PoseStamped"]
        self.plan.write(self.T["nav_msgs/msg/Path"](poses=[pose(), *poses]))
        return {"accepted": True}

    def wait_for_result(self, request: Any) -> None:
        if self.goal is not None and request.goal_id.uuid == self.goal["id"].uuid:
            self.goal["waiting"] = (request.rmw_guid, request.rmw_sequence)
            if self.goal["status"] != EXECUTING:
                self.end(self.goal["status"])

    def cancel(self) -> dict[str, Any]:
        self.heard["cancels"] += 1
        if self.goal is not None and self.goal["status"] == EXECUTING:
            self.end(CANCELED)
        return {}

    def end(self, status: int) -> None:
        assert self.goal is not None
        self.goal["status"] = status
        if self.goal["waiting"] is not None:
            guid, sequence = self.goal["waiting"]
            _, answers, reply = self.goal["action"]["result"]
            message = reply(rmw_guid=guid, rmw_sequence=sequence, status=status)
            if status == ABORTED and hasattr(message.result, "error_code"):
                message.result.error_code, message.result.error_msg = 9000, "stuck"
            answers.write(message)

    def tick(self) -> None:
        if self.o.localises and self.map_odom is not None:
            self.tf_out.write(self.T["tf2_msgs/msg/TFMessage"](transforms=[self.transform()]))
        goal = self.goal
        if goal is None or goal["status"] != EXECUTING or self.odom is None or self.map_odom is None:
            return
        self.feed_back(goal)
        self.publish_costmap()
        if self.since_goal > self.o.abort_at_s:
            self.end(ABORTED)
            return
        if self.now < goal["next"] or self.since_goal > self.o.hang_at_s or self.controller_dp is None:
            return
        goal["next"] += self.o.period_s
        goal["number"] += 1
        x, y, yaw = compose(self.map_odom, self.odom)
        gx, gy = goal["poses"][0]
        if math.hypot(gx - x, gy - y) < (0.25 if len(goal["poses"]) == 1 else 0.7):
            goal["poses"].popleft()
            if not goal["poses"]:
                self.command(0.0, 0.0)
                self.end(SUCCEEDED)
            return
        turn = math.remainder(math.atan2(gy - y, gx - x) - yaw, 2 * math.pi)
        if not self.o.miss_every or goal["number"] % self.o.miss_every:
            self.command(self.o.speed_m_s if abs(turn) < 0.5 else 0.0, max(-1.0, min(1.0, 2 * turn)))

    def publish_costmap(self) -> None:
        """A costmap of two rows, twice a second."""
        if self.now < self.costmap_sent + 0.5:
            return
        self.costmap_sent = self.now
        grid = self.T["nav_msgs/msg/OccupancyGrid"](data=[0, 99, 100, -1, 0, 0])
        grid.header.frame_id = "odom"
        grid.info.width, grid.info.height, grid.info.resolution = 3, 2, 0.05
        self.costmap.write(grid)

    def command(self, v: float, w: float) -> None:
        message = self.twist()
        twist = getattr(message, "twist", message)
        twist.linear.x, twist.angular.z = v, w
        self.cmd.write(message)

    def feed_back(self, goal: dict[str, Any]) -> None:
        kind = goal["action"]["kind"]
        feedback = self.T[f"{kind}_Feedback"](number_of_recoveries=2)
        if hasattr(feedback, "number_of_poses_remaining"):
            feedback.number_of_poses_remaining = len(goal["poses"])
        message = self.T[f"{kind}_FeedbackMessage"](goal_id=goal["id"], feedback=feedback)
        goal["action"]["feedback"].write(message)

    def transform(self) -> Any:
        assert self.map_odom is not None
        x, y, yaw = self.map_odom
        each = self.T["geometry_msgs/msg/TransformStamped"](child_frame_id="odom")
        each.header.frame_id, each.header.stamp = "map", self.stamp
        each.transform.translation.x, each.transform.translation.y = x, y
        each.transform.rotation.z, each.transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
        return each

    def report(self) -> None:
        if self.o.report:
            Path(self.o.report).write_text(json.dumps(self.heard))


def valid(reader: Any, most: int) -> list[Any]:
    return [sample for sample in reader.take(most) if sample.sample_info.valid_data]


def compose(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    cos, sin = math.cos(a[2]), math.sin(a[2])
    return a[0] + cos * b[0] - sin * b[1], a[1] + sin * b[0] + cos * b[1], a[2] + b[2]


def between(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    """The transform t with compose(t, b) == a."""
    yaw = a[2] - b[2]
    cos, sin = math.cos(yaw), math.sin(yaw)
    return a[0] - cos * b[0] + sin * b[1], a[1] - sin * b[0] - cos * b[1], yaw


if __name__ == "__main__":
    import signal

    given = json.loads(Path(sys.argv[1]).read_text())
    peer = Peer(Options(**{"domain": int(os.environ.get("ROS_DOMAIN_ID", "0")), **given}))

    def stop(*_: object) -> None:
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    try:
        peer.run()
    finally:
        peer.report()
