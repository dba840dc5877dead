"""Reader of recordings of a robot (rosbag2 as MCAP or SQLite) as a Run, so that it is judged like a simulated one.

What is used, in this order:

* robot: a nav_msgs/Odometry topic, moved to the map by `/tf`; without one, `/tf` from the map to the base frame;
* people: hunav_msgs/Agents, people_msgs/People, or a visualization_msgs/MarkerArray topic that you name;
* acceleration: geometry_msgs/AccelStamped, else sensor_msgs/Imu, else the change of the measured speed;
* goal and time limit: a route that you name, else `/rvsg/run` of a bag that RVSG wrote, else the last `/goal_pose`.

Every choice and everything missing is in the notes of the result.

What of a recording matters, read in one pass: poses, people, transforms, accelerations, the goal.

Messages are read one at a time and other topics are skipped, so the size of a recording is not limited by memory.
"""

from __future__ import annotations

import math
from array import array
from collections import defaultdict, deque
from collections.abc import Collection, Iterable, Iterator, Mapping
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
from rvsg_exchange.bag import log_of
from rvsg_exchange.bag_messages import rosbags_types


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


Floats = NDArray[np.float64]


class Frames:
    """The transforms of a recording. Between two of them the earlier one holds."""

    def __init__(self, transforms: Mapping[tuple[str, str], Floats]) -> None:
        """Take the poses of each child frame in its parent by (parent, child): time s, x m, y m, yaw rad, (N, 4)."""
        self._edges = {pair: rows for pair, rows in transforms.items() if len(rows)}

    @property
    def children(self) -> tuple[str, ...]:
        """The frames whose pose in another is recorded."""
        return tuple(dict.fromkeys(child for _, child in self._edges))

    def way(self, source: str, target: str) -> list[tuple[tuple[str, str], bool]] | None:
        """Return the transforms that lead from a frame to another, each with whether it is inverted; None without."""
        before: dict[str, tuple[str, tuple[str, str], bool]] = {}
        waiting = deque([source])
        while waiting:
            frame = waiting.popleft()
            if frame == target:
                break
            for parent, child in self._edges:
                for here, there, inverted in ((child, parent, False), (parent, child, True)):
                    if here == frame and there not in before and there != source:
                        before[there] = (frame, (parent, child), inverted)
                        waiting.append(there)
        if target != source and target not in before:
            return None
        found = []
        while target != source:
            target, pair, inverted = before[target]
            found.append((pair, inverted))
        return found[::-1]

    def moved(self, track: Floats, source: str, target: str) -> Floats | None:
        """Return a track (rows begin with t, x, y, yaw) in another frame; None where no transforms lead there."""
        way = self.way(source, target)
        if way is None:
            return None
        for pair, inverted in way:
            track = _applied(track, self._edges[pair], inverted)
        return track

    def times(self, way: Iterable[tuple[tuple[str, str], bool]]) -> Floats:
        """Return the times of the transform on a way that was recorded most often."""
        return max((self._edges[pair][:, 0] for pair, _ in way), key=len)


def _applied(track: Floats, transform: Floats, inverted: bool) -> Floats:
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
    return moved


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


MAP = "map"
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
    contents, notes = read_contents(path, people_topic, robot_topic)
    frames = Frames({pair: rows.array() for pair, rows in contents.transforms.items()})
    offset = np.array(world.map_offset if world is not None else (0.0, 0.0))
    facts = contents.facts
    header = _header(path, facts) if facts is not None else None
    robot, there = _robot_track(path, contents, frames, offset, notes)
    shift = (float(facts["t0"]) if facts is not None else 0.0) - robot[0, 0]
    robot[:, 0] += shift
    times = robot[:, 0]
    if said := _gaps(times):
        notes.append(f"The robot's pose has {said}.")
    names = header.human_names if header is not None else tuple(sorted(contents.people))
    humans = _human_arrays(path, contents, frames, there, names, times, shift, offset, notes)
    trajectory = Trajectory(
        t=times,
        x=robot[:, 1],
        y=robot[:, 2],
        yaw=robot[:, 3],
        v=robot[:, 4],
        omega=robot[:, 5],
        lateral=robot[:, 6] if np.abs(robot[:, 6]).max() > SIDEWAYS_M_S else np.empty(0),
        acceleration=_acceleration(contents, times, robot[:, 4], shift, notes),
        human_x=humans[0],
        human_y=humans[1],
        human_yaw=humans[2],
        human_speed=humans[3],
    )
    imu = contents.imu.array()[:, 1]
    if header is not None and facts is not None:
        log = log_of(facts, len(names))
        imu = np.array(facts.get("imu", imu), dtype=np.float64)
        values = header.model_dump(exclude={"same_log", "outcome"})
        return Recording(
            run=Run(**values, outcome=header.outcome, trajectory=trajectory, log=log or trajectory, imu=imu),
            notes=tuple(notes),
        )
    notes.append(_bodies(names, contents.radii))
    goal, limit = _task(path, contents, frames, there, route, offset, times)
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


def _bodies(names: tuple[str, ...], radii: dict[str, float]) -> str:
    """Say which bodies gaps are measured between; a recording holds no outline of the robot."""
    said = f"Gaps are measured from a disc with a radius of {ROBOT_RADIUS_M:g} m around the robot's pose"
    unknown = [name for name in names if name not in radii]
    if unknown:
        who = "people" if len(unknown) == len(names) else ", ".join(unknown)
        said += f", to discs with a radius of {PERSON_RADIUS_M:g} m around {who}"
    return f"The recording does not hold the robot's outline. {said}."


def _robot_track(
    path: Path, contents: Contents, frames: Frames, offset: Floats, notes: list[str]
) -> tuple[Floats, str]:
    """Return the robot in the world frame, (N, 7), and the frame that counts as the map."""
    found = list(contents.odometry)
    if len(found) > 1:
        raise FileError(path, f"the odometry is given in several frames: {', '.join(found)}. Record one robot.")
    there = MAP
    if found:
        track = contents.odometry[found[0]].array()
        moved = frames.moved(track, found[0], MAP)
        if moved is not None:
            track = moved
        else:
            there = found[0]
            notes.append(f'There is no transform from "{MAP}" to "{there}"; odometry is used as map coordinates.')
    else:
        track = _track_of_transforms(path, frames)
        notes.append("The recording has no odometry; pose and speed come from the transforms.")
    if len(track) < 2:
        raise FileError(path, f"the recording holds {len(track)} poses of the robot; at least two are needed.")
    period = float(np.median(np.diff(track[:, 0])))
    if period < 0.8 / RATE_HZ:
        track = track[:: max(1, round(1.0 / (RATE_HZ * period)))]
    track[:, 1:3] += offset
    return track, there


def _track_of_transforms(path: Path, frames: Frames) -> Floats:
    """Return the robot's base in the map by transforms alone, (N, 7); its speed is the change of its pose."""
    bases = [frame for frame in frames.children if frame.rpartition("/")[2] in BASE_FRAMES]
    ways = {base: way for base in bases if (way := frames.way(base, MAP))}
    if len({base.rpartition("/")[0] for base in ways}) > 1:
        raise FileError(path, f"there are several robots: {', '.join(ways)}. Name the odometry of one: --robot-topic.")
    if not ways:
        said = "the pose of the robot is not known: the recording holds no nav_msgs/Odometry, and no transforms lead"
        raise FileError(path, f'{said} from "{MAP}" to {" or ".join(BASE_FRAMES)}.')
    base, way = next(iter(ways.items()))
    times = np.unique(frames.times(way))
    moved = frames.moved(np.column_stack([times, np.zeros((len(times), 6))]), base, MAP)
    assert moved is not None, "there is a way"
    if len(moved) > 1:
        moved[:, 4] = np.hypot(np.gradient(moved[:, 1], times), np.gradient(moved[:, 2], times))
        moved[:, 5] = np.gradient(np.unwrap(moved[:, 3]), times)
    return moved


def _human_arrays(
    path: Path,
    contents: Contents,
    frames: Frames,
    there: str,
    names: tuple[str, ...],
    times: Floats,
    shift: float,
    offset: Floats,
    notes: list[str],
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return x, y, yaw and speed of people at the robot's times, each (N, H), world frame."""
    shape = (len(times), len(names))
    x, y, yaw, speed = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)
    given = list(contents.people_frames)
    if len(given) > 1:
        raise FileError(path, f"people are given in several frames: {', '.join(given)}. Record one of them.")
    for i, name in enumerate(names):
        track = contents.people[name].array()
        if not len(track):
            raise FileError(path, f"the recording holds no pose of {name}.")
        track = _in_map(path, track, frames, given[0], there, "people")
        track[:, 0] += shift
        _check_overlap(path, name, track[:, 0], times)
        _note_absence(name, track[:, 0], times, notes)
        if np.isnan(track[:, 4]).any() and len(track) > 1:
            step = np.hypot(np.gradient(track[:, 1], track[:, 0]), np.gradient(track[:, 2], track[:, 0]))
            track[:, 4] = step
        x[:, i] = np.interp(times, track[:, 0], track[:, 1]) + offset[0]
        y[:, i] = np.interp(times, track[:, 0], track[:, 2]) + offset[1]
        yaw[:, i] = np.interp(times, track[:, 0], np.unwrap(track[:, 3]))
        yaw[:, i] = np.arctan2(np.sin(yaw[:, i]), np.cos(yaw[:, i]))
        speed[:, i] = np.interp(times, track[:, 0], np.nan_to_num(track[:, 4]))
    return x, y, yaw, speed


def _in_map(path: Path, track: Floats, frames: Frames, frame: str, there: str, what: str) -> Floats:
    """Return a track in the frame that counts as the map; FileError where no transforms lead there."""
    if not frame or frame == there:
        return track
    moved = frames.moved(track, frame, there)
    if moved is not None:
        return moved
    if frame == MAP:  # nothing is recorded between the map and the odometry, which is used as map coordinates
        return track
    said = f'{what}: poses are in the frame "{frame}", and no transforms lead from there to "{there}".'
    raise FileError(path, f"{said} Record /tf and /tf_static, too.")


def _check_overlap(path: Path, name: str, seen: Floats, times: Floats) -> None:
    """Refuse people whose stamps say that they were not there while the robot drove."""
    if seen[0] > times[-1] or seen[-1] < times[0]:
        raise FileError(
            path,
            f"the stamps of {name} are {seen[0] - times[0]:.0f} to {seen[-1] - times[0]:.0f} s after the robot's first "
            f"pose, and the robot is recorded for {times[-1] - times[0]:.0f} s. Both must use one clock: record with "
            "use_sim_time in all nodes, or in none.",
        )


def _note_absence(name: str, seen: Floats, times: Floats, notes: list[str]) -> None:
    """Note when a person is not seen: there the recording does not say where the person is."""
    if seen[0] - times[0] > GAP_S or times[-1] - seen[-1] > GAP_S:
        notes.append(
            f"{name} is seen from {max(0.0, seen[0]):.1f} s to {seen[-1]:.1f} s only; before and after, the person is "
            "taken to stand at the nearest place seen."
        )
    if said := _gaps(seen):
        notes.append(f"{name} is not seen in {said}; there the person is taken to walk straight on.")


def _gaps(times: Floats) -> str:
    """Say how many gaps there are and the longest; empty without any."""
    gaps = [float(gap) for gap in np.diff(times) if gap > GAP_S]
    many = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    return f"{many} of more than {GAP_S:g} s (longest {max(gaps):.1f} s)" if gaps else ""


def _acceleration(contents: Contents, times: Floats, v: Floats, shift: float, notes: list[str]) -> Floats:
    source = contents.acceleration if len(contents.acceleration) else contents.imu
    if len(source):
        found = source.array()
        return np.asarray(np.interp(times, found[:, 0] + shift, found[:, 1]), dtype=np.float64)
    notes.append("The recording has no acceleration; it is derived from the measured speed.")
    return np.abs(np.gradient(v, times)) if len(times) > 1 else np.zeros(len(times))


def _task(
    path: Path, contents: Contents, frames: Frames, there: str, route: Route | None, offset: Floats, times: Floats
) -> tuple[tuple[float, float, float], float]:
    """Return the goal in the world frame and the time limit."""
    if route is not None:
        return (route.goal.x, route.goal.y, route.goal.yaw), route.time_limit_s
    if contents.goal is None:
        raise FileError(path, "the recording holds no goal. Name the route the robot drove: --world and --route.")
    row = np.array([[math.inf, *contents.goal, 0.0, 0.0]])
    _, x, y, yaw, *_ = _in_map(path, row, frames, contents.goal_frame, there, "/goal_pose")[0]
    return (float(x + offset[0]), float(y + offset[1]), float(yaw)), float(times[-1]) + 1.0


def _header(path: Path, facts: dict[str, Any]) -> RunHeader:
    """Return the run that RVSG wrote into a bag."""
    try:
        float(facts["t0"])
        return RunHeader.model_validate(facts["header"])
    except (KeyError, TypeError, ValueError) as error:  # pydantic's ValidationError is a ValueError
        raise FileError(path, f"/rvsg/run is not what RVSG writes ({type(error).__name__}).") from None


def _outcome(path: Trajectory, goal: tuple[float, float, float], limit: float, notes: list[str]) -> Outcome:
    distance = math.hypot(path.x[-1] - goal[0], path.y[-1] - goal[1])
    if distance <= GOAL_TOLERANCE_M and path.t[-1] <= limit:
        return Outcome.REACHED
    notes.append(f"The recording ends {distance:.2f} m from the goal after {path.t[-1]:.1f} s.")
    return Outcome.TIMED_OUT if path.t[-1] >= limit else Outcome.ABORTED
