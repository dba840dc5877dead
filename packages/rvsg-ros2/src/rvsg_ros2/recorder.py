"""Read the robot's pose and the people of a world that speaks ROS 2, as trajectories."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import SimulationError
from rvsg.simulation.run import Trajectory
from rvsg.world.world import Route, World
from rvsg_exchange.recording_contents import SIDEWAYS_M_S
from rvsg_ros2.dds import ActionClient, Bus, Subscription

if TYPE_CHECKING:
    from rvsg_ros2.world import WorldOptions

Floats = NDArray[np.float64]

ROW_S = 0.05
LOG_S = 0.5
AGENTS, PEOPLE = "hunav_msgs/msg/Agents", "people_msgs/msg/People"
QUEUE = 1000
"""Messages kept until they are read: a recorder that gets no processor for seconds loses none."""
ROBOT = 2
"""The type of a robot in hunav_msgs/Agent."""


class Recorder:
    """Collects poses with their times. Times are those of the world's clock, or wall time where it has none."""

    def __init__(self, bus: Bus, options: WorldOptions, world: World, names: tuple[str, ...]) -> None:
        self._options, self._names = options, names
        self._offset = world.map_offset
        self._bus = bus
        self._clock = bus.subscribe("/clock", "rosgraph_msgs/msg/Clock", reliable=False, depth=1)
        self._has_clock = False
        self._tf = bus.subscribe("/tf", "tf2_msgs/msg/TFMessage", reliable=True, depth=QUEUE)
        self._static = bus.subscribe("/tf_static", "tf2_msgs/msg/TFMessage", reliable=True, latched=True)
        self._robot = bus.subscribe(options.robot or options.odom, "nav_msgs/msg/Odometry", depth=QUEUE)
        self._people: Subscription | None = None
        self._links: dict[str, tuple[str, tuple[float, float, float]]] = {}
        self._now = 0.0
        self._velocity = (0.0, 0.0, 0.0)
        self._rows: list[tuple[float, ...]] = []
        self._humans: dict[str, list[tuple[float, float, float, float, float]]] = {name: [] for name in names}
        self._others: set[str] = set()
        self._begin: float | None = None
        self._heard = time.monotonic()
        self.recoveries = 0

    @property
    def t(self) -> float:
        """Time of the world since the goal was accepted, s."""
        return 0.0 if self._begin is None else self._now - self._begin

    @property
    def silent_s(self) -> float:
        """Wall time since the robot's pose was heard last."""
        return time.monotonic() - self._heard

    def missing(self) -> list[str]:
        """Return what was not heard yet."""
        lacks = [] if self._rows else [f"no pose of the robot ({self._source()})"]
        silent = [name for name, rows in self._humans.items() if not rows]
        if silent:
            heard = f"; heard {', '.join(sorted(self._others))}" if self._others else ""
            lacks.append(f"no {', '.join(silent)} on {self._options.people}{heard}")
        return lacks

    def _source(self) -> str:
        return self._options.robot or f"transform from {self._options.map_frame} to {self._options.base_frame}"

    def begin(self) -> None:
        """Let the run begin now: what was recorded before is left out, except for the last pose."""
        self._begin = self._rows[-1][0]
        self._rows = self._rows[-1:]
        self._heard = time.monotonic()

    def feedback(self, feedback: Any) -> None:
        """Take over the number of recoveries."""
        if feedback is not None:
            self.recoveries = max(self.recoveries, int(feedback.number_of_recoveries))

    def listen(self) -> None:
        """Take over what arrived."""
        for message in self._clock.take():
            self._now, self._has_clock = message.clock.sec + message.clock.nanosec / 1e9, True
        if not self._has_clock:
            self._now = time.time()
        for message in (*self._static.take(), *self._tf.take()):
            for each in message.transforms:
                at = each.transform.translation
                pose = (at.x, at.y, _yaw(each.transform.rotation))
                self._links[each.child_frame_id.strip("/")] = (each.header.frame_id.strip("/"), pose)
                if self._options.robot is None and self._moves_robot(each.child_frame_id):
                    self._from_transforms(each.header.stamp.sec + each.header.stamp.nanosec / 1e9)
        for message in self._robot.take():
            twist = message.twist.twist
            self._velocity = (twist.linear.x, twist.angular.z, twist.linear.y)
            if self._options.robot is not None:
                place = message.pose.pose
                stamp = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
                pose = (place.position.x, place.position.y, _yaw(place.orientation))
                self._row(stamp, pose, self._options.robot_frame == "map")
        self._listen_to_people()

    def _listen_to_people(self) -> None:
        """Subscribe to the people as soon as somebody publishes them, and take over what arrived."""
        if self._people is None:
            kinds = {writer.type_name for writer in self._bus.graph().publishers(self._options.people)}
            wanted = {"hunav": AGENTS, "people": PEOPLE}.get(self._options.people_type)
            kind = wanted or next((name for name in (AGENTS, PEOPLE) if name in kinds), None)
            if kind not in kinds:
                return
            self._people = self._bus.subscribe(self._options.people, kind, depth=QUEUE)
        for message in self._people.take():
            self._hear_people(message)

    def _moves_robot(self, child: str) -> bool:
        return child.strip("/") in (self._options.base_frame, self._options.footprint_frame)

    def _from_transforms(self, stamp: float) -> None:
        frame, pose = self._options.base_frame, (0.0, 0.0, 0.0)
        for _ in range(10):
            if frame not in self._links:
                return
            frame, link = self._links[frame]
            pose = _composed(link, pose)
            if frame == self._options.map_frame:
                self._row(stamp, pose, True)
                return

    def _row(self, stamp: float, pose: tuple[float, float, float], in_map: bool) -> None:
        self._heard = time.monotonic()
        if self._rows and stamp < self._rows[-1][0] + 0.9 * ROW_S:
            return
        dx, dy = self._offset if in_map else (0.0, 0.0)
        self._rows.append((stamp, pose[0] + dx, pose[1] + dy, pose[2], *self._velocity))

    def _hear_people(self, message: Any) -> None:
        stamp = message.header.stamp.sec + message.header.stamp.nanosec / 1e9 or self._now
        dx, dy = self._offset if self._options.people_frame == "map" else (0.0, 0.0)
        for each in getattr(message, "agents", None) or getattr(message, "people", []):
            if getattr(each, "type", 1) == ROBOT:
                continue
            if each.name not in self._humans:
                self._others.add(each.name)
                continue
            if hasattr(each, "yaw"):
                row = (each.position.position.x, each.position.position.y, each.yaw, each.linear_vel)
            else:
                speed = math.hypot(each.velocity.x, each.velocity.y)
                row = (each.position.x, each.position.y, math.atan2(each.velocity.y, each.velocity.x), speed)
            rows = self._humans[each.name]
            if not rows or stamp > rows[-1][0]:
                rows.append((stamp, row[0] + dx, row[1] + dy, float(row[2]), float(row[3])))

    def trajectories(self, route: Route) -> tuple[Trajectory, Trajectory]:
        """Return the trajectory and its rows every 0.5 s; times since the goal was accepted, to the time limit."""
        assert self._begin is not None
        rows = np.array(self._rows, np.float64)
        rows[:, 0] -= self._begin
        rows = rows[rows[:, 0] <= route.time_limit_s + 1.0]
        if not np.isfinite(rows).all():
            raise SimulationError("The world reports a pose of the robot that is not finite.")
        t, v, w = rows[:, 0], rows[:, 4], rows[:, 5]
        change = np.gradient(v, t) if len(t) > 1 else np.zeros(len(t))
        humans = [self._person(name, t) for name in self._names]
        parts = [np.stack([each[k] for each in humans], 1) if humans else np.empty((len(t), 0)) for k in range(4)]
        path = Trajectory(
            t=t, x=rows[:, 1].copy(), y=rows[:, 2].copy(), yaw=rows[:, 3].copy(), v=v.copy(), omega=w.copy(),
            acceleration=np.hypot(change, v * w), human_x=parts[0], human_y=parts[1], human_yaw=parts[2],
            human_speed=parts[3],
            lateral=rows[:, 6].copy() if np.abs(rows[:, 6]).max() > SIDEWAYS_M_S else np.empty(0),
        )  # fmt: skip
        marks = np.unique(np.append(np.searchsorted(t, np.arange(0.0, t[-1], LOG_S)), len(t) - 1))
        log = path.at(marks)
        return path, log

    def _person(self, name: str, t: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return x, y, yaw and speed of a person at the robot's times, interpolated between messages."""
        rows = np.array(self._humans[name], np.float64)
        at = rows[:, 0] - (self._begin or 0.0)
        x, y, speed = (np.interp(t, at, rows[:, k]) for k in (1, 2, 4))
        yaw = np.interp(t, at, np.unwrap(rows[:, 3]))
        return x, y, np.arctan2(np.sin(yaw), np.cos(yaw)), np.abs(speed)


def goal_of(client: ActionClient, route: Route, world: World, frame: str) -> Any:
    """Return the goal of a route, in the map frame."""
    goal = client.new_goal()
    dx, dy = world.map_offset
    poses = []
    for place in (*route.through, route.goal):
        pose = client.types["geometry_msgs/msg/PoseStamped"]()
        pose.header.frame_id = frame
        pose.pose.position.x, pose.pose.position.y = float(place.x - dx), float(place.y - dy)
        pose.pose.orientation.z, pose.pose.orientation.w = math.sin(place.yaw / 2), math.cos(place.yaw / 2)
        poses.append(pose)
    if hasattr(goal, "pose"):
        goal.pose = poses[-1]
    elif isinstance(goal.poses, list):
        goal.poses = poses
    else:
        goal.poses.goals = poses
    return goal


def _yaw(turn: Any) -> float:
    return math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))


def _composed(a: tuple[float, float, float], b: tuple[float, float, float]) -> tuple[float, float, float]:
    cos, sin = math.cos(a[2]), math.sin(a[2])
    return a[0] + cos * b[0] - sin * b[1], a[1] + sin * b[0] + cos * b[1], a[2] + b[2]
