"""Recordings of a robot (rosbag2 as MCAP or SQLite) as runs, which are judged like simulated ones.

What is used, in this order:

* robot: a nav_msgs/Odometry topic, moved to the map by `/tf`; without one, `/tf` from the map to the base frame;
* people: hunav_msgs/Agents, people_msgs/People, or a visualization_msgs/MarkerArray topic that you name;
* acceleration: geometry_msgs/AccelStamped, else sensor_msgs/Imu, else the change of the measured speed;
* goal and time limit: a route that you name, else `/rvsg/run` of a bag that RVSG wrote, else the last `/goal_pose`.

Every choice and everything missing is in the notes of the result. Messages are read one at a time and other topics are
skipped, so the size of a recording is not limited by memory.
"""

from __future__ import annotations

import math
from array import array
from collections import defaultdict, deque
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError, UnknownName
from rvsg.core.inputs import parse_json
from rvsg.core.records import text_id
from rvsg.simulation.archive import RunHeader
from rvsg.simulation.run import Outcome, Run, Trajectory
from rvsg.world.world import Route, World
from rvsg_exchange.bag import log_of, rosbags_types

Floats = NDArray[np.float64]
Way = tuple[tuple[tuple[str, str], bool], ...]
"""The transforms from one frame to another, (parent, child), each with whether it is inverted."""

ODOMETRY, IMU, ACCELERATION = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped"
AGENTS, PEOPLE, MARKERS = "hunav_msgs/msg/Agents", "people_msgs/msg/People", "visualization_msgs/msg/MarkerArray"
TRANSFORMS, GOAL, TEXT = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseStamped", "std_msgs/msg/String"
SIDEWAYS_M_S = 0.02
"""Less lateral speed than this in an odometry is noise: the base does not move sideways."""
BACK_S = 1.0
"""Stamps that go back by more than this begin another run."""
MAP = "map"
BASE_FRAMES = ("base_footprint", "base_link")
GOAL_TOLERANCE_M = 0.25
GAP_S = 0.5
RATE_HZ = 20.0
PERSON_RADIUS_M, ROBOT_RADIUS_M = 0.4, 0.35


@contextmanager
def open_bag(path: Path) -> Iterator[Any]:
    """Open a rosbag2 (a folder, or one `.mcap` or `.db3` file) for reading; FileError where it is none."""
    types = rosbags_types()
    from rosbags.highlevel import AnyReader

    if not path.exists():
        raise FileError(path, "the recording does not exist.")
    try:
        reader = AnyReader([path], default_typestore=types)
        reader.open()
    except Exception as error:  # whatever the library raises on a file that is no bag
        said = f"this is no recording that rosbags can read ({_reason(error)})."
        raise FileError(
            path, f"{said} One that was cut off is repaired by `mcap recover` or `ros2 bag reindex`."
        ) from error
    try:
        yield reader
    finally:
        reader.close()


def bag_messages(reader: Any, path: Path, topics: Collection[str]) -> Iterator[tuple[Any, float, Any]]:
    """Yield connection, time of receipt (s) and message of the topics, in order; FileError where the bag is damaged."""
    chosen = [connection for connection in reader.connections if connection.topic in topics]
    stream = iter(reader.messages(connections=chosen)) if chosen else iter(())
    while True:
        try:
            connection, stamp, raw = next(stream)
            message = reader.deserialize(raw, connection.msgtype)
        except StopIteration:
            return
        except Exception as error:  # whatever the library raises on damaged data
            raise FileError(path, f"the recording is damaged ({_reason(error)}).") from error
        yield connection, stamp / 1e9, message


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


class Frames:
    """The transforms of a recording. Between two of them the earlier one holds."""

    def __init__(self, transforms: Mapping[tuple[str, str], Floats]) -> None:
        """Take the poses of each child frame in its parent by (parent, child): time s, x m, y m, yaw rad, (N, 4)."""
        self.edges = {pair: rows for pair, rows in transforms.items() if len(rows)}

    def way(self, source: str, target: str) -> Way | None:
        """Return the transforms that lead from a frame to another; None without."""
        ways: dict[str, Way] = {source: ()}
        waiting = deque([source])
        while waiting and target not in ways:
            frame = waiting.popleft()
            for parent, child in self.edges:
                for here, there, inverted in ((child, parent, False), (parent, child, True)):
                    if here == frame and there not in ways:
                        ways[there] = (*ways[frame], ((parent, child), inverted))
                        waiting.append(there)
        return ways.get(target)

    def moved(self, track: Floats, source: str, target: str) -> Floats | None:
        """Return a track (rows begin with t, x, y, yaw) in another frame; None where no transforms lead there."""
        way = self.way(source, target)
        if way is None:
            return None
        for pair, inverted in way:
            transform = self.edges[pair]
            at = np.clip(np.searchsorted(transform[:, 0], track[:, 0], side="right") - 1, 0, None)
            dx, dy, turn = transform[at, 1], transform[at, 2], transform[at, 3]
            cos, sin = np.cos(turn), np.sin(turn)
            moved = track.copy()
            if inverted:
                x, y = track[:, 1] - dx, track[:, 2] - dy
                moved[:, 1], moved[:, 2], yaw = cos * x + sin * y, -sin * x + cos * y, track[:, 3] - turn
            else:
                moved[:, 1] = dx + cos * track[:, 1] - sin * track[:, 2]
                moved[:, 2] = dy + sin * track[:, 1] + cos * track[:, 2]
                yaw = track[:, 3] + turn
            moved[:, 3] = np.arctan2(np.sin(yaw), np.cos(yaw))
            track = moved
        return track


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

    def array(self, *, distinct: bool = False) -> Floats:
        """Return the finite rows in the order of time, (N, width); with `distinct` one for each time."""
        found = np.array(self._values, dtype=np.float64).reshape(-1, self._width)
        found = found[np.isfinite(found[:, :4]).all(axis=1)]
        found = found[np.argsort(found[:, 0], kind="stable")]
        return found[np.diff(found[:, 0], prepend=-math.inf) > 0] if distinct else found


class Contents:
    """What of a recording matters, read in one pass."""

    def __init__(self, path: Path, people_topic: str | None, robot_topic: str | None) -> None:
        self.path = path
        self.notes: list[str] = []
        self.odometry: dict[str, Rows] = defaultdict(lambda: Rows(7))
        """By frame: time s, x m, y m, yaw rad, speed m/s, turning rad/s, speed to the left m/s."""
        self.transforms: dict[tuple[str, str], Rows] = defaultdict(lambda: Rows(4))
        """By parent and child frame: time s, x m, y m, yaw rad."""
        self.people: dict[str, Rows] = defaultdict(lambda: Rows(5))
        """By name: time s, x m, y m, yaw rad, speed m/s."""
        self.people_frames: dict[str, None] = {}
        self.radii: dict[str, float] = {}
        self.groups: dict[str, int | None] = {}
        self.acceleration, self.imu = Rows(2), Rows(2)
        self.goal: tuple[float, float, float] | None = None
        self.goal_frame = ""
        self.facts: dict[str, Any] | None = None
        with open_bag(path) as reader:
            self._read(reader, people_topic, robot_topic)

    def _read(self, reader: Any, people_topic: str | None, robot_topic: str | None) -> None:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        people = self._topic(kinds, people_topic, "people", "--people-topic", (AGENTS, PEOPLE), (MARKERS,))
        odometry = self._topic(kinds, robot_topic, "odometry", "--robot-topic", (ODOMETRY,))
        if people is None:
            said = "The recording holds no people (hunav_msgs/Agents or people_msgs/People); none are judged."
            markers = sorted(topic for topic, kind in kinds.items() if kind == MARKERS)
            if markers:
                said += f" If {' or '.join(markers)} shows people as markers, name it: --people-topic."
            self.notes.append(said)
        if "/clock" not in kinds:
            self.notes.append("The recording has no /clock; the stamps of its messages are used.")
        named = {odometry: ODOMETRY, "/goal_pose": GOAL, "/rvsg/run": TEXT}
        wanted = {topic for topic, kind in kinds.items() if kind in (TRANSFORMS, IMU, ACCELERATION, named.get(topic))}
        wanted |= {people} & kinds.keys()
        latest: dict[str, float] = {}
        for connection, received, message in bag_messages(reader, self.path, wanted):
            topic, kind = connection.topic, connection.msgtype
            if kind == TRANSFORMS:
                for each in message.transforms:
                    move, turn = each.transform.translation, _yaw(each.transform.rotation)
                    pair = (each.header.frame_id.lstrip("/"), each.child_frame_id.lstrip("/"))
                    self.transforms[pair].add(_seconds(each.header), move.x, move.y, turn)
                continue
            if kind == TEXT:
                self.facts = parse_json(message.data, self.path)
                continue
            t = (0.0 if kind == MARKERS else _seconds(message.header)) or received
            if topic in (odometry, people):
                before = latest.get(topic, t)
                if t < before - BACK_S:
                    said = f"the time of {topic} goes back from {before:.1f} s to {t:.1f} s"
                    advice = "Cut it into one recording for each."
                    raise FileError(self.path, f"{said}, so the recording holds several runs. {advice}")
                latest[topic] = max(before, t)
            if topic == odometry:
                pose, twist = message.pose.pose, message.twist.twist
                row = (pose.position.x, pose.position.y, _yaw(pose.orientation), twist.linear.x, twist.angular.z)
                self.odometry[message.header.frame_id.lstrip("/")].add(t, *row, twist.linear.y)
            elif topic == people:
                self._take_people(kind, t, message)
            elif kind == ACCELERATION:
                self.acceleration.add(t, math.hypot(message.accel.linear.x, message.accel.linear.y))
            elif kind == IMU:
                self.imu.add(t, math.hypot(message.linear_acceleration.x, message.linear_acceleration.y))
            elif kind == GOAL:
                self.goal_frame = message.header.frame_id.lstrip("/")
                self.goal = (message.pose.position.x, message.pose.position.y, _yaw(message.pose.orientation))

    def _topic(
        self,
        kinds: Mapping[str, str],
        named: str | None,
        what: str,
        option: str,
        usual: tuple[str, ...],
        also: tuple[str, ...] = (),
    ) -> str | None:
        """Return the topic that was named, or the only one of a usual type; refuse one that cannot say what it must."""
        if named is None:
            for kind in usual:
                found = sorted(topic for topic, each in kinds.items() if each == kind)
                if len(found) > 1:
                    said = f"there are several topics with {what}: {', '.join(found)}. Name one: {option}."
                    raise FileError(self.path, said)
                if found:
                    return found[0]
            return None
        if named not in kinds:
            raise UnknownName("topic", named, kinds)
        if kinds[named] in (*usual, *also):
            return named
        fitting = sorted(topic for topic, kind in kinds.items() if kind in (*usual, *also))
        there = f"There is {', '.join(fitting)}" if fitting else "The recording holds none"
        wanted = " or ".join((*usual, *also)).replace("/msg", "")
        given = kinds[named].replace("/msg", "")
        raise FileError(self.path, f"{option} {named}: its messages are {given}, not {wanted}. {there}.")

    def _take_people(self, kind: str, t: float, message: Any) -> None:
        if kind == MARKERS:
            for marker in message.markers:
                self.people_frames[marker.header.frame_id.lstrip("/")] = None
                place, yaw = marker.pose.position, _yaw(marker.pose.orientation)
                name = marker.text or f"{marker.ns or 'person'} {marker.id}"
                self.people[name].add(_seconds(marker.header) or t, place.x, place.y, yaw, math.nan)
            return
        self.people_frames[message.header.frame_id.lstrip("/")] = None
        if kind == PEOPLE:
            for person in message.people:
                (x, y), (vx, vy) = ((each.x, each.y) for each in (person.position, person.velocity))
                self.people[person.name].add(t, x, y, math.atan2(vy, vx), math.hypot(vx, vy))
            return
        for agent in message.agents:
            place, yaw = agent.position.position, _yaw(agent.position.orientation)
            self.people[agent.name].add(t, place.x, place.y, yaw, agent.linear_vel)
            if agent.radius > 0:
                self.radii[agent.name] = float(agent.radius)
            self.groups[agent.name] = None if agent.group_id < 0 else agent.group_id


def _seconds(header: Any) -> float:
    return float(header.stamp.sec + header.stamp.nanosec / 1e9)


def _yaw(q: Any) -> float:
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recorded run, and in words what it rests on and what the recording lacks."""

    run: Run
    notes: tuple[str, ...]


def read_recording(
    path: Path,
    *,
    world: World | None = None,
    route: Route | None = None,
    people_topic: str | None = None,
    robot_topic: str | None = None,
) -> Recording:
    """Read a recording (a rosbag2 folder, or one `.mcap` or `.db3` file) as a Run.

    Args:
        world: its map offset turns map coordinates into world coordinates.
        route: its goal and time limit decide whether the robot arrived.
        people_topic: the topic with the people, where it is a MarkerArray or there are several.
        robot_topic: the odometry topic, where there are several.

    Raises:
        FileError: the file is no recording, or holds no pose of a robot or no goal.
        UnknownName: a topic that you name is not in the recording.
    """
    reading = _Reading(Contents(path, people_topic, robot_topic), world)
    return Recording(run=reading.run(route), notes=tuple(reading.notes))


class _Reading:
    """The run of a recording, in the world frame and at the times of the robot's poses."""

    def __init__(self, contents: Contents, world: World | None) -> None:
        self.path, self.contents, self.notes = contents.path, contents, contents.notes
        self.frames = Frames({pair: rows.array() for pair, rows in contents.transforms.items()})
        self.offset = np.array(world.map_offset if world is not None else (0.0, 0.0))
        self.there = MAP
        """The frame that counts as the map."""
        facts = contents.facts
        self.header = self._header(facts) if facts is not None else None
        robot = self._robot()
        self.shift = (float(facts["t0"]) if facts is not None else 0.0) - robot[0, 0]
        robot[:, 0] += self.shift
        self.robot, self.times = robot, robot[:, 0]

    def _header(self, facts: dict[str, Any]) -> RunHeader:
        """Return the run that RVSG wrote into a bag."""
        try:
            float(facts["t0"])
            return RunHeader.model_validate(facts["header"])
        except (KeyError, TypeError, ValueError) as error:  # pydantic's ValidationError is a ValueError
            raise self._damaged(error) from None

    def _damaged(self, error: Exception) -> FileError:
        return FileError(self.path, f"/rvsg/run is not what RVSG writes ({type(error).__name__}).")

    def run(self, route: Route | None) -> Run:
        contents, robot, header = self.contents, self.robot, self.header
        if said := _gaps(self.times):
            self.notes.append(f"The robot's pose has {said}.")
        names = header.human_names if header is not None else tuple(sorted(contents.people))
        if len(contents.people_frames) > 1:
            given = ", ".join(contents.people_frames)
            raise FileError(self.path, f"people are given in several frames: {given}. Record one of them.")
        humans = [self._person(name) for name in names]
        x, y, yaw, speed = np.stack(humans, axis=2) if humans else np.zeros((4, len(robot), 0))
        trajectory = Trajectory(
            t=self.times,
            x=robot[:, 1],
            y=robot[:, 2],
            yaw=robot[:, 3],
            v=robot[:, 4],
            omega=robot[:, 5],
            lateral=robot[:, 6] if np.abs(robot[:, 6]).max() > SIDEWAYS_M_S else np.empty(0),
            acceleration=self._acceleration(),
            human_x=x,
            human_y=y,
            human_yaw=yaw,
            human_speed=speed,
        )
        imu = contents.imu.array()[:, 1]
        if header is not None and contents.facts is not None:
            try:
                log = log_of(contents.facts, len(names)) or trajectory
                imu = np.array(contents.facts.get("imu", imu), dtype=np.float64)
            except (KeyError, TypeError, ValueError) as error:
                raise self._damaged(error) from None
            values = {name: getattr(header, name) for name in RunHeader.model_fields.keys() - {"same_log", "outcome"}}
            return Run(**values, outcome=header.outcome, trajectory=trajectory, log=log, imu=imu)
        self.notes.append(_bodies(names, contents.radii))
        goal, limit = self._task(route)
        return Run(
            scenario_id=text_id("scenario", str(self.path.name)),
            simulator="recording",
            options={"recording": self.path.name},
            seed=0,
            outcome=self._outcome(goal, limit),
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

    def _robot(self) -> Floats:
        """Return the robot in the world frame, (N, 7)."""
        found = list(self.contents.odometry)
        if len(found) > 1:
            said = f"the odometry is given in several frames: {', '.join(found)}. Record one robot."
            raise FileError(self.path, said)
        if found:
            track = self.contents.odometry[found[0]].array(distinct=True)
            moved = self.frames.moved(track, found[0], MAP)
            if moved is None:
                self.there = found[0]
                said = f'There is no transform from "{MAP}" to "{found[0]}"'
                self.notes.append(f"{said}; odometry is used as map coordinates.")
            track = track if moved is None else moved
        else:
            track = self._base_by_transforms()
            self.notes.append("The recording has no odometry; pose and speed come from the transforms.")
        if len(track) < 2:
            raise FileError(self.path, f"the recording holds {len(track)} poses of the robot; at least two are needed.")
        period = float(np.median(np.diff(track[:, 0])))
        if period < 0.8 / RATE_HZ:
            track = track[:: max(1, round(1.0 / (RATE_HZ * period)))]
        track[:, 1:3] += self.offset
        return track

    def _base_by_transforms(self) -> Floats:
        """Return the robot's base in the map, (N, 7); its speed is the change of its pose."""
        children = dict.fromkeys(child for _, child in self.frames.edges)
        bases = [frame for frame in children if frame.rpartition("/")[2] in BASE_FRAMES]
        ways = {base: way for base in bases if (way := self.frames.way(base, MAP))}
        if len({base.rpartition("/")[0] for base in ways}) > 1:
            said = f"there are several robots: {', '.join(ways)}. Name the odometry of one: --robot-topic."
            raise FileError(self.path, said)
        if not ways:
            said = "the pose of the robot is not known: the recording holds no nav_msgs/Odometry, and no transforms"
            raise FileError(self.path, f'{said} lead from "{MAP}" to {" or ".join(BASE_FRAMES)}.')
        base, way = next(iter(ways.items()))
        times = np.unique(max((self.frames.edges[pair][:, 0] for pair, _ in way), key=len))
        moved = self.frames.moved(np.column_stack([times, np.zeros((len(times), 6))]), base, MAP)
        assert moved is not None, "there is a way"
        if len(moved) > 1:
            moved[:, 4] = _speed(moved)
            moved[:, 5] = np.gradient(np.unwrap(moved[:, 3]), times)
        return moved

    def _person(self, name: str) -> Floats:
        """Return x, y, yaw and speed of a person at the robot's times, (4, N), world frame."""
        times = self.times
        track = self.contents.people[name].array(distinct=True)
        if not len(track):
            raise FileError(self.path, f"the recording holds no pose of {name}.")
        track = self._in_map(track, next(iter(self.contents.people_frames)), "people")
        track[:, 0] += self.shift
        seen = track[:, 0]
        if seen[0] > times[-1] or seen[-1] < times[0]:
            raise FileError(
                self.path,
                f"the stamps of {name} are {seen[0] - times[0]:.0f} to {seen[-1] - times[0]:.0f} s after the robot's "
                f"first pose, and the robot is recorded for {times[-1] - times[0]:.0f} s. Both must use one clock: "
                "record with use_sim_time in all nodes, or in none.",
            )
        if seen[0] - times[0] > GAP_S or times[-1] - seen[-1] > GAP_S:
            self.notes.append(
                f"{name} is seen from {max(0.0, seen[0]):.1f} s to {seen[-1]:.1f} s only; before and after, the person "
                "is taken to stand at the nearest place seen."
            )
        if said := _gaps(seen):
            self.notes.append(f"{name} is not seen in {said}; there the person is taken to walk straight on.")
        if np.isnan(track[:, 4]).any() and len(track) > 1:
            track[:, 4] = _speed(track)
        yaw = np.interp(times, seen, np.unwrap(track[:, 3]))
        return np.stack(
            [
                np.interp(times, seen, track[:, 1]) + self.offset[0],
                np.interp(times, seen, track[:, 2]) + self.offset[1],
                np.arctan2(np.sin(yaw), np.cos(yaw)),
                np.interp(times, seen, np.nan_to_num(track[:, 4])),
            ]
        )

    def _in_map(self, track: Floats, frame: str, what: str) -> Floats:
        """Return a track in the frame that counts as the map; FileError where no transforms lead there."""
        if not frame or frame == self.there:
            return track
        moved = self.frames.moved(track, frame, self.there)
        if moved is not None:
            return moved
        if frame == MAP:  # nothing is recorded between the map and the odometry, which is used as map coordinates
            return track
        said = f'{what}: poses are in the frame "{frame}", and no transforms lead from there to "{self.there}".'
        raise FileError(self.path, f"{said} Record /tf and /tf_static, too.")

    def _acceleration(self) -> Floats:
        source = self.contents.acceleration if len(self.contents.acceleration) else self.contents.imu
        if len(source):
            found = source.array()
            return np.asarray(np.interp(self.times, found[:, 0] + self.shift, found[:, 1]), dtype=np.float64)
        self.notes.append("The recording has no acceleration; it is derived from the measured speed.")
        return np.abs(np.gradient(self.robot[:, 4], self.times))

    def _task(self, route: Route | None) -> tuple[tuple[float, float, float], float]:
        """Return the goal in the world frame and the time limit."""
        if route is not None:
            return (route.goal.x, route.goal.y, route.goal.yaw), route.time_limit_s
        if self.contents.goal is None:
            said = "the recording holds no goal. Name the route the robot drove: --world and --route."
            raise FileError(self.path, said)
        row = np.array([[math.inf, *self.contents.goal]])
        _, x, y, yaw = self._in_map(row, self.contents.goal_frame, "/goal_pose")[0]
        return (float(x + self.offset[0]), float(y + self.offset[1]), float(yaw)), float(self.times[-1]) + 1.0

    def _outcome(self, goal: tuple[float, float, float], limit: float) -> Outcome:
        t, x, y = self.robot[-1, :3]
        distance = math.hypot(x - goal[0], y - goal[1])
        if distance <= GOAL_TOLERANCE_M and t <= limit:
            return Outcome.REACHED
        self.notes.append(f"The recording ends {distance:.2f} m from the goal after {t:.1f} s.")
        return Outcome.TIMED_OUT if t >= limit else Outcome.ABORTED


def _speed(track: Floats) -> Floats:
    t, x, y = track[:, 0], track[:, 1], track[:, 2]
    return np.asarray(np.hypot(np.gradient(x, t), np.gradient(y, t)))


def _bodies(names: tuple[str, ...], radii: dict[str, float]) -> str:
    """Say which bodies gaps are measured between; a recording holds no outline of the robot."""
    said = f"Gaps are measured from a disc with a radius of {ROBOT_RADIUS_M:g} m around the robot's pose"
    unknown = [name for name in names if name not in radii]
    if unknown:
        who = "people" if len(unknown) == len(names) else ", ".join(unknown)
        said += f", to discs with a radius of {PERSON_RADIUS_M:g} m around {who}"
    return f"The recording does not hold the robot's outline. {said}."


def _gaps(times: Floats) -> str:
    """Say how many gaps there are and the longest; empty without any."""
    gaps = [float(gap) for gap in np.diff(times) if gap > GAP_S]
    many = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    return f"{many} of more than {GAP_S:g} s (longest {max(gaps):.1f} s)" if gaps else ""
