"""What of a recording matters, read in one pass: poses, people, transforms, accelerations, the goal.

Messages are read one at a time and other topics are skipped, so the size of a recording is not limited by memory.
"""

from __future__ import annotations

import math
from array import array
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError, UnknownName
from rvsg.core.inputs import parse_json
from rvsg_exchange.bag_reading import bag_messages, open_bag

Floats = NDArray[np.float64]

ODOMETRY, IMU, ACCELERATION = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped"
AGENTS, PEOPLE, MARKERS = "hunav_msgs/msg/Agents", "people_msgs/msg/People", "visualization_msgs/msg/MarkerArray"
TRANSFORMS, GOAL, TEXT = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseStamped", "std_msgs/msg/String"
SIDEWAYS_M_S = 0.02
"""Less lateral speed than this in an odometry is noise: the base does not move sideways."""
BACK_S = 1.0
"""Stamps that go back by more than this begin another run."""


class Rows:
    """Rows of `width` numbers that begin with a time, s, in 8 bytes a number: a recording may hold millions."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._values) // self._width

    def add(self, *row: float) -> None:
        """Add a row."""
        assert len(row) == self._width
        self._values.extend(row)

    def array(self) -> Floats:
        """Return the rows in the order of time, (N, width), without those whose time or pose is no finite number."""
        found = np.array(self._values, dtype=np.float64).reshape(-1, self._width)
        found = found[np.isfinite(found[:, :4]).all(axis=1)]
        return found[np.argsort(found[:, 0], kind="stable")]


class Track(Rows):
    """Poses and speeds of one body over time: time s, x m, y m, yaw rad, speed m/s, turning rad/s.

    The robot's have a seventh number: its speed to the left, m/s.
    """

    def __init__(self, width: int = 6) -> None:
        super().__init__(width)

    def array(self) -> Floats:
        """Return the rows in the order of time, one for each time, (N, width)."""
        found = super().array()
        return found[np.concatenate([[True], np.diff(found[:, 0]) > 0])] if len(found) else found


class Contents:
    """What of a recording matters, read in one pass."""

    def __init__(self) -> None:
        self.odometry: dict[str, Track] = defaultdict(lambda: Track(7))
        self.transforms: dict[tuple[str, str], Rows] = defaultdict(lambda: Rows(4))
        """Time s, x m, y m, yaw rad by parent and child frame."""
        self.people: dict[str, Track] = defaultdict(Track)
        self.people_frames: dict[str, None] = {}
        self.radii: dict[str, float] = {}
        self.groups: dict[str, int | None] = {}
        self.acceleration = Rows(2)
        self.imu = Rows(2)
        self.goal: tuple[float, float, float] | None = None
        self.goal_frame = ""
        self.latest: dict[str, float] = {}
        self.facts: dict[str, Any] | None = None


def read_contents(path: Path, people_topic: str | None, robot_topic: str | None) -> tuple[Contents, list[str]]:
    """Read a recording; return what matters in it, and notes on what it lacks."""
    notes: list[str] = []
    contents = Contents()
    with open_bag(path) as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        for name in (people_topic, robot_topic):
            if name is not None and name not in kinds:
                raise UnknownName("topic", name, kinds)
        _check_kind(path, kinds, robot_topic, "--robot-topic", (ODOMETRY,))
        _check_kind(path, kinds, people_topic, "--people-topic", (AGENTS, PEOPLE, MARKERS))
        odometry = robot_topic or _only(
            path, [t for t, k in kinds.items() if k == ODOMETRY], "odometry", "--robot-topic"
        )
        people = people_topic or _people_topic(path, kinds)
        if people is None:
            notes.append(_no_people([topic for topic, kind in kinds.items() if kind == MARKERS]))
        if "/clock" not in kinds:
            notes.append("The recording has no /clock; the stamps of its messages are used.")
        wanted = {each for each in (odometry, people) if each} | {
            t for t, k in kinds.items() if k in (TRANSFORMS, IMU, ACCELERATION)
        }
        wanted |= {"/goal_pose", "/rvsg/run"} & kinds.keys()
        for connection, received, message in bag_messages(reader, path, wanted):
            if connection.topic == "/rvsg/run" and connection.msgtype == TEXT:
                contents.facts = parse_json(message.data, path)
                continue
            if connection.topic in (odometry, people):
                _check_order(path, contents, connection.topic, stamp_of(message, received))
            _take(contents, connection.topic, connection.msgtype, received, message, odometry, people)
    return contents, notes


def _check_kind(path: Path, kinds: dict[str, str], topic: str | None, option: str, known: tuple[str, ...]) -> None:
    """Refuse a topic whose messages cannot say what it is named for."""
    if topic is None or kinds[topic] in known:
        return
    fitting = sorted(each for each, kind in kinds.items() if kind in known)
    there = f"There is {', '.join(fitting)}" if fitting else "The recording holds none"
    wanted = " or ".join(kind.replace("/msg", "") for kind in known)
    raise FileError(
        path, f"{option} {topic}: its messages are {kinds[topic].replace('/msg', '')}, not {wanted}. {there}."
    )


def _no_people(markers: list[str]) -> str:
    """Return the note on a recording without a topic of people; its markers may show them."""
    said = "The recording holds no people (hunav_msgs/Agents or people_msgs/People); none are judged."
    if not markers:
        return said
    return f"{said} If {' or '.join(sorted(markers))} shows people as markers, name it: --people-topic."


def _only(path: Path, found: list[str], what: str, option: str) -> str | None:
    if len(found) > 1:
        raise FileError(path, f"there are several topics with {what}: {', '.join(sorted(found))}. Name one: {option}.")
    return found[0] if found else None


def _people_topic(path: Path, kinds: dict[str, str]) -> str | None:
    for kind in (AGENTS, PEOPLE):
        found = [topic for topic, each in kinds.items() if each == kind]
        if found:
            return _only(path, found, "people", "--people-topic")
    return None


def stamp_of(message: Any, received: float) -> float:
    """Return the time of a message, s: its stamp, or when it was received where it has none."""
    header = getattr(message, "header", None)
    stamped = float(header.stamp.sec + header.stamp.nanosec / 1e9) if header is not None else 0.0
    return stamped or received


def _check_order(path: Path, contents: Contents, topic: str, t: float) -> None:
    """Refuse a recording that holds several runs, one after the other."""
    latest = contents.latest.get(topic, t)
    if t < latest - BACK_S:
        said = f"the time of {topic} goes back from {latest:.1f} s to {t:.1f} s, so the recording holds several runs."
        raise FileError(path, f"{said} Cut it into one recording for each.")
    contents.latest[topic] = max(latest, t)


def _take(
    contents: Contents, topic: str, kind: str, received: float, message: Any, odometry: str | None, people: str | None
) -> None:
    """Take what matters out of one message."""
    t = stamp_of(message, received)
    if topic == odometry:
        pose, twist = message.pose.pose, message.twist.twist
        place, turned = pose.position, _yaw(pose.orientation)
        row = (place.x, place.y, turned, twist.linear.x, twist.angular.z, twist.linear.y)
        contents.odometry[message.header.frame_id.lstrip("/")].add(t, *row)
    elif topic == people:
        _take_people(contents, kind, t, message)
    elif kind == TRANSFORMS:
        for each in message.transforms:
            at = each.header.stamp.sec + each.header.stamp.nanosec / 1e9
            move, turn = each.transform.translation, _yaw(each.transform.rotation)
            pair = (each.header.frame_id.lstrip("/"), each.child_frame_id.lstrip("/"))
            contents.transforms[pair].add(at, move.x, move.y, turn)
    elif kind == ACCELERATION:
        contents.acceleration.add(t, math.hypot(message.accel.linear.x, message.accel.linear.y))
    elif kind == IMU:
        contents.imu.add(t, math.hypot(message.linear_acceleration.x, message.linear_acceleration.y))
    elif kind == GOAL:
        contents.goal_frame = message.header.frame_id.lstrip("/")
        contents.goal = (message.pose.position.x, message.pose.position.y, _yaw(message.pose.orientation))


def _take_people(contents: Contents, kind: str, t: float, message: Any) -> None:
    if kind == AGENTS:
        contents.people_frames[message.header.frame_id.lstrip("/")] = None
        for agent in message.agents:
            place = agent.position.position
            yaw = _yaw(agent.position.orientation)
            contents.people[agent.name].add(t, place.x, place.y, yaw, agent.linear_vel, agent.angular_vel)
            if agent.radius > 0:
                contents.radii[agent.name] = float(agent.radius)
            contents.groups[agent.name] = None if agent.group_id < 0 else agent.group_id
    elif kind == PEOPLE:
        contents.people_frames[message.header.frame_id.lstrip("/")] = None
        for person in message.people:
            vx, vy = person.velocity.x, person.velocity.y
            row = (t, person.position.x, person.position.y, math.atan2(vy, vx), math.hypot(vx, vy), 0.0)
            contents.people[person.name].add(*row)
    else:
        for marker in message.markers:
            contents.people_frames[marker.header.frame_id.lstrip("/")] = None
            at = marker.header.stamp.sec + marker.header.stamp.nanosec / 1e9
            place = marker.pose.position
            name = marker.text or f"{marker.ns or 'person'} {marker.id}"
            contents.people[name].add(at or t, place.x, place.y, _yaw(marker.pose.orientation), math.nan, 0.0)


def _yaw(q: Any) -> float:
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
