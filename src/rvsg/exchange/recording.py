"""Read a recording of a robot (rosbag2 as MCAP or SQLite) as a Run, so that it is judged like a simulated one.

What is used, in this order:

* robot: `/tf` from the map to the base frame where both parts are recorded, else a nav_msgs/Odometry topic;
* people: hunav_msgs/Agents, people_msgs/People, or a visualization_msgs/MarkerArray topic that you name;
* acceleration: geometry_msgs/AccelStamped, else sensor_msgs/Imu, else the change of the measured speed;
* goal and time limit: a route that you name, else `/rvsg/run` of a bag that RVSG wrote, else the last `/goal_pose`.

Every choice and everything missing is in the notes of the result.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError, UnknownName
from rvsg.core.records import text_id
from rvsg.exchange.bag import log_of
from rvsg.exchange.bag_reading import bag_messages, open_bag
from rvsg.simulation.archive import RunHeader
from rvsg.simulation.run import Outcome, Run, Trajectory
from rvsg.world.world import Route, World

Floats = NDArray[np.float64]

ODOMETRY, IMU, ACCELERATION = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped"
AGENTS, PEOPLE, MARKERS = "hunav_msgs/msg/Agents", "people_msgs/msg/People", "visualization_msgs/msg/MarkerArray"
TRANSFORMS, GOAL, TEXT = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseStamped", "std_msgs/msg/String"

BASE_FRAMES = ("base_footprint", "base_link")
GOAL_TOLERANCE_M = 0.25
GAP_S = 0.5
RATE_HZ = 20.0
PERSON_RADIUS_M, ROBOT_RADIUS_M = 0.4, 0.35


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recorded run, and in words what it rests on and what the recording lacks."""

    run: Run
    notes: tuple[str, ...]


@dataclass
class _Track:
    """Poses and speeds of one body over time: time s, x m, y m, yaw rad, speed m/s, turning rad/s."""

    rows: list[tuple[float, float, float, float, float, float]]

    def array(self) -> Floats:
        found = np.array(sorted(self.rows), dtype=np.float64).reshape(-1, 6)
        return found[np.concatenate([[True], np.diff(found[:, 0]) > 0])] if len(found) else found


class _Contents:
    """What of a recording matters, read in one pass."""

    def __init__(self) -> None:
        self.odometry: dict[str, _Track] = defaultdict(lambda: _Track([]))
        self.transforms: dict[tuple[str, str], list[tuple[float, float, float, float]]] = defaultdict(list)
        self.people: dict[str, _Track] = defaultdict(lambda: _Track([]))
        self.people_frame = ""
        self.radii: dict[str, float] = {}
        self.groups: dict[str, int | None] = {}
        self.acceleration: list[tuple[float, float]] = []
        self.imu: list[tuple[float, float]] = []
        self.goal: tuple[float, float, float] | None = None
        self.facts: dict[str, Any] | None = None


def read_recording(
    path: Path,
    *,
    world: World | None = None,
    route: Route | None = None,
    people_topic: str | None = None,
    robot_topic: str | None = None,
) -> Recording:
    """Read a recording as a Run.

    Args:
        path: a rosbag2 folder, or one `.mcap` or `.db3` file.
        world: the world of the recording; its map offset turns map coordinates into world coordinates.
        route: the route the robot was to drive; its goal and time limit decide whether it arrived.
        people_topic: the topic with the people, where it is a MarkerArray or there are several.
        robot_topic: the odometry topic, where there are several.

    Raises:
        FileError: the file is no recording, or holds no pose of a robot or no goal.
        UnknownName: a topic that you name is not in the recording.
    """
    contents, notes = _read(path, people_topic, robot_topic)
    offset = np.array(world.map_offset if world is not None else (0.0, 0.0))
    facts = contents.facts
    header = RunHeader.model_validate(facts["header"]) if facts is not None else None
    robot = _robot_track(path, contents, offset, notes)
    start = float(facts["t0"]) - robot[0, 0] if facts is not None else -robot[0, 0]
    shift = start
    robot[:, 0] += shift
    times = robot[:, 0]
    if np.any(gaps := np.diff(times) > GAP_S):
        longest = float(np.max(np.diff(times)))
        notes.append(f"The robot's pose has {int(gaps.sum())} gaps of more than {GAP_S:g} s (longest {longest:.1f} s).")
    names = header.human_names if header is not None else tuple(sorted(contents.people))
    humans = _human_arrays(contents, names, times, shift, offset)
    trajectory = Trajectory(
        t=times,
        x=robot[:, 1],
        y=robot[:, 2],
        yaw=robot[:, 3],
        v=robot[:, 4],
        omega=robot[:, 5],
        acceleration=_acceleration(contents, times, robot[:, 4], shift, notes),
        human_x=humans[0],
        human_y=humans[1],
        human_yaw=humans[2],
        human_speed=humans[3],
    )
    imu = np.array([value for _, value in sorted(contents.imu)])
    if header is not None and facts is not None:
        log = log_of(facts, len(names))
        values = header.model_dump(exclude={"same_log", "outcome"})
        return Recording(
            run=Run(**values, outcome=header.outcome, trajectory=trajectory, log=log or trajectory, imu=imu),
            notes=tuple(notes),
        )
    goal, limit = _task(path, contents, route, offset, times)
    outcome = _outcome(trajectory, goal, limit, notes)
    run = Run(
        scenario_id=text_id("scenario", str(path.name)),
        simulator="recording",
        options={"recording": path.name},
        seed=0,
        outcome=outcome,
        trajectory=trajectory,
        log=trajectory,
        imu=imu,
        human_names=names,
        robot_radius_m=ROBOT_RADIUS_M,
        human_radius_m=tuple(contents.radii.get(name, PERSON_RADIUS_M) for name in names),
        goal=goal,
        time_limit_s=limit,
        human_groups=tuple(contents.groups.get(name) for name in names),
    )
    return Recording(run=run, notes=tuple(notes))


def _read(path: Path, people_topic: str | None, robot_topic: str | None) -> tuple[_Contents, list[str]]:
    notes: list[str] = []
    contents = _Contents()
    with open_bag(path) as reader:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        for name in (people_topic, robot_topic):
            if name is not None and name not in kinds:
                raise UnknownName("topic", name, kinds)
        odometry = robot_topic or _only(path, [t for t, k in kinds.items() if k == ODOMETRY], "--robot-topic")
        people = people_topic or _people_topic(path, kinds)
        if people is None:
            notes.append("The recording holds no people (hunav_msgs/Agents or people_msgs/People); none are judged.")
        if "/clock" not in kinds:
            notes.append("The recording has no /clock; the stamps of its messages are used.")
        wanted = {each for each in (odometry, people) if each} | {
            t for t, k in kinds.items() if k in (TRANSFORMS, IMU, ACCELERATION)
        }
        wanted |= {"/goal_pose", "/rvsg/run"} & kinds.keys()
        for connection, received, message in bag_messages(reader, path, wanted):
            _take(contents, connection.topic, connection.msgtype, received, message, odometry, people)
    return contents, notes


def _only(path: Path, found: list[str], option: str) -> str | None:
    if len(found) > 1:
        raise FileError(path, f"there are several topics of that kind: {', '.join(sorted(found))}. Name one: {option}.")
    return found[0] if found else None


def _people_topic(path: Path, kinds: dict[str, str]) -> str | None:
    for kind in (AGENTS, PEOPLE):
        found = [topic for topic, each in kinds.items() if each == kind]
        if found:
            return _only(path, found, "--people-topic")
    return None


def _take(
    contents: _Contents, topic: str, kind: str, received: float, message: Any, odometry: str | None, people: str | None
) -> None:
    """Take what matters out of one message."""
    header = getattr(message, "header", None)
    t = header.stamp.sec + header.stamp.nanosec / 1e9 if header is not None else received
    if topic == odometry:
        pose, twist = message.pose.pose, message.twist.twist
        row = (pose.position.x, pose.position.y, _yaw(pose.orientation), twist.linear.x, twist.angular.z)
        contents.odometry[message.header.frame_id].rows.append((t, *row))
    elif topic == people:
        _take_people(contents, kind, t, message)
    elif kind == TRANSFORMS:
        for each in message.transforms:
            at = each.header.stamp.sec + each.header.stamp.nanosec / 1e9
            move, turn = each.transform.translation, _yaw(each.transform.rotation)
            pair = (each.header.frame_id.lstrip("/"), each.child_frame_id.lstrip("/"))
            contents.transforms[pair].append((at, move.x, move.y, turn))
    elif kind == ACCELERATION:
        contents.acceleration.append((t, math.hypot(message.accel.linear.x, message.accel.linear.y)))
    elif kind == IMU:
        contents.imu.append((t, math.hypot(message.linear_acceleration.x, message.linear_acceleration.y)))
    elif kind == GOAL:
        contents.goal = (message.pose.position.x, message.pose.position.y, _yaw(message.pose.orientation))
    elif kind == TEXT:
        contents.facts = json.loads(message.data)


def _take_people(contents: _Contents, kind: str, t: float, message: Any) -> None:
    if kind == AGENTS:
        contents.people_frame = message.header.frame_id
        for agent in message.agents:
            place = agent.position.position
            contents.people[agent.name].rows.append(
                (t, place.x, place.y, _yaw(agent.position.orientation), agent.linear_vel, agent.angular_vel)
            )
            if agent.radius > 0:
                contents.radii[agent.name] = float(agent.radius)
            contents.groups[agent.name] = None if agent.group_id < 0 else agent.group_id
    elif kind == PEOPLE:
        contents.people_frame = message.header.frame_id
        for person in message.people:
            vx, vy = person.velocity.x, person.velocity.y
            row = (t, person.position.x, person.position.y, math.atan2(vy, vx), math.hypot(vx, vy), 0.0)
            contents.people[person.name].rows.append(row)
    else:
        for marker in message.markers:
            contents.people_frame = marker.header.frame_id
            at = marker.header.stamp.sec + marker.header.stamp.nanosec / 1e9
            place = marker.pose.position
            name = marker.text or f"{marker.ns or 'person'} {marker.id}"
            contents.people[name].rows.append((at or t, place.x, place.y, _yaw(marker.pose.orientation), math.nan, 0.0))


def _robot_track(path: Path, contents: _Contents, offset: Floats, notes: list[str]) -> Floats:
    """The robot in the world frame, (N, 6): from the transforms where they lead from the map to the base."""
    frames = list(contents.odometry)
    if not frames:
        raise FileError(path, "the recording holds no nav_msgs/Odometry, so the robot's pose is not known.")
    track = contents.odometry[frames[0]].array()
    to_odom = contents.transforms.get(("map", frames[0]))
    if to_odom:
        track = _moved(track, np.array(sorted(to_odom)))
    else:
        notes.append(f'There is no transform from "map" to "{frames[0]}"; odometry is used as map coordinates.')
    period = np.median(np.diff(track[:, 0])) if len(track) > 1 else 1.0
    if period < 0.8 / RATE_HZ:
        track = track[:: max(1, round(1.0 / (RATE_HZ * period)))]
    track[:, 1:3] += offset
    return track


def _moved(track: Floats, transform: Floats) -> Floats:
    """A track under a transform that changes over time: the latest one at each of its times."""
    at = np.clip(np.searchsorted(transform[:, 0], track[:, 0], side="right") - 1, 0, None)
    dx, dy, turn = transform[at, 1], transform[at, 2], transform[at, 3]
    moved = track.copy()
    moved[:, 1] = dx + np.cos(turn) * track[:, 1] - np.sin(turn) * track[:, 2]
    moved[:, 2] = dy + np.sin(turn) * track[:, 1] + np.cos(turn) * track[:, 2]
    moved[:, 3] = np.arctan2(np.sin(track[:, 3] + turn), np.cos(track[:, 3] + turn))
    return moved


def _human_arrays(
    contents: _Contents, names: tuple[str, ...], times: Floats, shift: float, offset: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """x, y, yaw and speed of people at the robot's times, each (N, H), world frame."""
    shape = (len(times), len(names))
    x, y, yaw, speed = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    to_odom = contents.transforms.get(("map", contents.people_frame))
    for i, name in enumerate(names):
        track = contents.people[name].array()
        if to_odom:
            track = _moved(track, np.array(sorted(to_odom)))
        track[:, 0] += shift
        if np.isnan(track[:, 4]).any() and len(track) > 1:
            step = np.hypot(np.gradient(track[:, 1], track[:, 0]), np.gradient(track[:, 2], track[:, 0]))
            track[:, 4] = step
        x[:, i] = np.interp(times, track[:, 0], track[:, 1]) + offset[0]
        y[:, i] = np.interp(times, track[:, 0], track[:, 2]) + offset[1]
        yaw[:, i] = np.interp(times, track[:, 0], np.unwrap(track[:, 3]))
        yaw[:, i] = np.arctan2(np.sin(yaw[:, i]), np.cos(yaw[:, i]))
        speed[:, i] = np.interp(times, track[:, 0], np.nan_to_num(track[:, 4]))
    return x, y, yaw, speed


def _acceleration(contents: _Contents, times: Floats, v: Floats, shift: float, notes: list[str]) -> Floats:
    source = contents.acceleration or contents.imu
    if source:
        found = np.array(sorted(source))
        return np.asarray(np.interp(times, found[:, 0] + shift, found[:, 1]), dtype=np.float64)
    notes.append("The recording has no acceleration; it is derived from the measured speed.")
    return np.abs(np.gradient(v, times)) if len(times) > 1 else np.zeros(len(times))


def _task(
    path: Path, contents: _Contents, route: Route | None, offset: Floats, times: Floats
) -> tuple[tuple[float, float, float], float]:
    """The goal in the world frame and the time limit."""
    if route is not None:
        return (route.goal.x, route.goal.y, route.goal.yaw), route.time_limit_s
    if contents.goal is None:
        raise FileError(path, "the recording holds no goal. Name the route the robot drove: --world and --route.")
    x, y, yaw = contents.goal
    return (x + offset[0], y + offset[1], yaw), float(times[-1]) + 1.0


def _outcome(path: Trajectory, goal: tuple[float, float, float], limit: float, notes: list[str]) -> Outcome:
    distance = math.hypot(path.x[-1] - goal[0], path.y[-1] - goal[1])
    if distance <= GOAL_TOLERANCE_M and path.t[-1] <= limit:
        return Outcome.REACHED
    notes.append(f"The recording ends {distance:.2f} m from the goal after {path.t[-1]:.1f} s.")
    return Outcome.TIMED_OUT if path.t[-1] >= limit else Outcome.ABORTED


def _yaw(q: Any) -> float:
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
