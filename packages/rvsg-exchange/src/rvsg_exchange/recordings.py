"""The reader of recordings: rosbag2 (MCAP, SQLite), and by its ending files of tracks (`track_files`).

What is used of a bag, in this order:

* robot: a nav_msgs/Odometry topic, moved to the map by `/tf`; without one, `/tf` from the map to the base frame;
* people: hunav_msgs/Agents, people_msgs/People, vision_msgs/Detection3DArray, else a visualization_msgs/MarkerArray or
  geometry_msgs/PoseArray topic that you name, or frames of `/tf` by a pattern; else what moves in the laser scans;
* acceleration: geometry_msgs/AccelStamped, else sensor_msgs/Imu;
* goal: the run that RVSG wrote as `/rvsg/run`, else the last `/goal_pose`; map: `/map`.

Every choice and everything missing is in the notes of the result. Messages are read one at a time and other topics are
skipped, so the size of a recording is not limited by memory.
"""

from __future__ import annotations

import fnmatch
import math
from array import array
from collections import defaultdict, deque
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError, UnknownName
from rvsg.core.inputs import parse_json
from rvsg.core.records import Pose
from rvsg.recording.recorded_run import speed_of
from rvsg.recording.tracker import LaserScan, people_in_scans, track_places
from rvsg.recording.tracks import Note, PersonTrack, Recording, Stream
from rvsg.simulation.archive import RunHeader
from rvsg.simulation.events import Contact
from rvsg.world.world import OCCUPIED, UNKNOWN, OccupancyMap, World
from rvsg_exchange.bag import log_of, rosbags_types
from rvsg_exchange.track_files import ENDINGS, read_tracks

Floats = NDArray[np.float64]
Way = tuple[tuple[tuple[str, str], bool], ...]
"""The transforms from one frame to another, (parent, child), each with whether it is inverted."""

ODOMETRY, IMU, ACCELERATION = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "geometry_msgs/msg/AccelStamped"
AGENTS, PEOPLE, MARKERS = "hunav_msgs/msg/Agents", "people_msgs/msg/People", "visualization_msgs/msg/MarkerArray"
DETECTIONS, POSES = "vision_msgs/msg/Detection3DArray", "geometry_msgs/msg/PoseArray"
TRANSFORMS, GOAL, TEXT = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseStamped", "std_msgs/msg/String"
GRID, SCAN = "nav_msgs/msg/OccupancyGrid", "sensor_msgs/msg/LaserScan"
COMMANDS = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
MCAP = b"\x89MCAP0\r\n"
"""The first and the last bytes of an MCAP file."""
NO_BODIES = (0, 4, 5, 8, 9)
"""Types of visualization_msgs/Marker that show no body: arrow, lines, points, text."""
BACK_S = 1.0
"""Stamps that go back by more than this begin another run."""
MAP = "map"
BASE_FRAMES = ("base_footprint", "base_link")
RATE_HZ = 20.0


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
        raise FileError(
            path, f"this is no recording that rosbags can read ({_reason(error)}). {_repair(path)}"
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


def _repair(path: Path) -> str:
    """Return what to do about a bag that cannot be opened: how it is repaired where it is one, else what is read."""
    beginning = end = b""
    if path.is_file():
        with path.open("rb") as file:
            beginning = file.read(16)
            file.seek(max(len(MCAP), path.stat().st_size - len(MCAP)))
            end = file.read()
    if beginning.startswith(MCAP) and end != MCAP:
        return "It was cut off: repair it with `mcap recover`."
    bags = path.is_dir() and any(any(path.glob(pattern)) for pattern in ("*.mcap", "*.db3"))
    if beginning.startswith(b"SQLite format 3") or bags:
        return "Repair it with `ros2 bag reindex`."
    return f"Name a rosbag2 (.mcap, .db3, or its folder), or tracks ({', '.join(ENDINGS)})."


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
    """What of a bag matters, read in one pass."""

    def __init__(
        self, path: Path, people_topic: str | None, robot_topic: str | None, people_frames: str | None = None
    ) -> None:
        self.path = path
        self.notes: list[Note] = []
        self.streams: tuple[Stream, ...] = ()
        self.odometry: dict[str, Rows] = defaultdict(lambda: Rows(7))
        """By frame: time s, x m, y m, yaw rad, speed m/s, turning rad/s, speed to the left m/s."""
        self.transforms: dict[tuple[str, str], Rows] = defaultdict(lambda: Rows(4))
        """By parent and child frame: time s, x m, y m, yaw rad."""
        self.people: dict[str, Rows] = defaultdict(lambda: Rows(5))
        """By name: time s, x m, y m, yaw rad, speed m/s."""
        self.places = Rows(4)
        """Of people without names: time s, x m, y m, 0."""
        self.people_frames: dict[str, None] = {}
        self.radii: dict[str, float] = {}
        self.groups: dict[str, int | None] = {}
        self.acceleration, self.imu, self.commands = Rows(2), Rows(2), Rows(3)
        self.goal: tuple[float, float, float] | None = None
        self.goal_frame = ""
        self.goal_s: float | None = None
        self.occupancy: OccupancyMap | None = None
        self.facts: dict[str, Any] | None = None
        self.scan_topics: tuple[str, ...] = ()
        self._people_frames = people_frames
        with open_bag(path) as reader:
            self._read(reader, people_topic, robot_topic)

    def note(self, kind: str, text: str, count: int = 1) -> None:
        """Add a note."""
        self.notes.append(Note(kind=kind, text=text, count=count))

    def _read(self, reader: Any, people_topic: str | None, robot_topic: str | None) -> None:
        kinds = {connection.topic: connection.msgtype for connection in reader.connections}
        people = None
        if self._people_frames is None:
            usual, also = (AGENTS, PEOPLE, DETECTIONS), (MARKERS, POSES, SCAN)
            people = self._topic(kinds, people_topic, "people", "--people-topic", usual, also)
        odometry = self._topic(kinds, robot_topic, "odometry", "--robot-topic", (ODOMETRY,))
        scans = sorted(topic for topic, kind in kinds.items() if kind == SCAN)
        if people is None and self._people_frames is None:
            said = (
                "The recording holds no people (hunav_msgs/Agents, people_msgs/People, vision_msgs/Detection3DArray)."
            )
            shown = sorted(topic for topic, kind in kinds.items() if kind in (MARKERS, POSES))
            if shown:
                said += f" If {' or '.join(shown)} shows people, name it: --people-topic."
            self.note("no-people", said)
            self.scan_topics = tuple(scans)
        elif kinds.get(people or "") == SCAN:
            self.scan_topics, people = tuple(scans), None
        if "/clock" not in kinds:
            self.note("clock", "The recording has no /clock; the stamps of its messages are used.")
        named = {odometry: ODOMETRY, "/goal_pose": GOAL, "/rvsg/run": TEXT, "/map": GRID}
        named |= {"/cmd_vel": kinds["/cmd_vel"]} if kinds.get("/cmd_vel") in COMMANDS else {}
        wanted = {topic for topic, kind in kinds.items() if kind in (TRANSFORMS, IMU, ACCELERATION, named.get(topic))}
        wanted |= {people} & kinds.keys()
        self._list(reader, wanted | set(self.scan_topics))
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
            if kind in COMMANDS:
                twist = message.twist if kind == COMMANDS[1] else message
                self.commands.add(received, twist.linear.x, twist.angular.z)
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
            elif kind == GRID:
                self.occupancy = _occupancy(message, self.path)
            elif kind == GOAL:
                self.goal_frame, self.goal_s = message.header.frame_id.lstrip("/"), t
                self.goal = (message.pose.position.x, message.pose.position.y, _yaw(message.pose.orientation))

    def _list(self, reader: Any, used: set[str | None]) -> None:
        """List the topics of the bag for people."""
        seconds = max(1e-9, (reader.end_time - reader.start_time) / 1e9)
        counts: dict[tuple[str, str], int] = defaultdict(int)
        for connection in reader.connections:
            counts[(connection.topic, connection.msgtype)] += connection.msgcount
        self.streams = tuple(
            Stream(
                name=topic,
                kind=kind.replace("/msg/", "/"),
                messages=count,
                rate_hz=round(count / seconds, 2) if count > 1 else None,
                used_for="read" if topic in used else "",
            )
            for (topic, kind), count in sorted(counts.items())
        )

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
                if marker.action != 0 or marker.type in NO_BODIES:
                    continue
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
        elif kind == POSES:
            for pose in message.poses:
                self.places.add(t, pose.position.x, pose.position.y, 0.0)
        elif kind == DETECTIONS:
            for each in message.detections:
                at = each.bbox.center.position
                name = str(each.id) if "id" in each.__dataclass_fields__ else ""
                if name:
                    self.people[f"Person {name}"].add(t, at.x, at.y, 0.0, math.nan)
                else:
                    self.places.add(t, at.x, at.y, 0.0)
        else:
            for agent in message.agents:
                place, yaw = agent.position.position, _yaw(agent.position.orientation)
                self.people[agent.name].add(t, place.x, place.y, yaw, agent.linear_vel)
                if agent.radius > 0:
                    self.radii[agent.name] = float(agent.radius)
                self.groups[agent.name] = None if agent.group_id < 0 else agent.group_id


def _occupancy(message: Any, path: Path) -> OccupancyMap:
    """Return an occupancy grid as a map; Nav2's usual thresholds say what is free and what is occupied."""
    info, at, values = message.info, message.info.origin.position, np.asarray(message.data, np.int16)
    yaw = _yaw(info.origin.orientation)
    if not 0 < values.size == info.height * info.width or not np.isfinite([at.x, at.y, yaw]).all():
        said = f"{values.size} values for {info.width} x {info.height} cells at ({at.x:g}, {at.y:g})"
        raise FileError(path, f"the map of the recording cannot be used: {said}. Record it again.", code="bag-map")
    values = values.reshape(info.height, info.width)
    cells = np.full(values.shape, UNKNOWN, np.uint8)
    cells[(values >= 0) & (values <= 25)] = 0
    cells[values >= 65] = OCCUPIED
    origin = Pose(x=float(at.x), y=float(at.y), yaw=yaw)
    return OccupancyMap(cells=cells, resolution=round(float(info.resolution), 6), origin=origin)


def _seconds(header: Any) -> float:
    return float(header.stamp.sec + header.stamp.nanosec / 1e9)


def _yaw(q: Any) -> float:
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))


def read_recording(
    path: Path,
    *,
    world: World | None = None,
    people_topic: str | None = None,
    robot_topic: str | None = None,
    people_frames: str | None = None,
) -> Recording:
    """Read a recording: a rosbag2 folder, an `.mcap` or `.db3` file, or a file of tracks; see `load_recording`."""
    if path.suffix.lower() in ENDINGS:
        return read_tracks(path, world=world)
    return _Alignment(Contents(path, people_topic, robot_topic, people_frames), world, people_frames).recording()


class _Alignment:
    """Everything of a bag in the world frame, on the clock of the robot."""

    def __init__(self, contents: Contents, world: World | None, people_frames: str | None) -> None:
        self.path, self.contents = contents.path, contents
        self.frames = Frames({pair: rows.array() for pair, rows in contents.transforms.items()})
        self.world, self.pattern = world, people_frames
        self.offset = np.array(world.map_offset if world is not None else (0.0, 0.0))
        self.there = MAP
        """The frame that counts as the map."""
        facts = contents.facts
        self.header = self._header(facts) if facts is not None else None
        self.robot = self._robot()
        self.shift = (float(facts["t0"]) if facts is not None else 0.0) - self.robot[0, 0]
        self.robot[:, 0] += self.shift

    def recording(self) -> Recording:
        contents = self.contents
        if len(contents.people_frames) > 1:
            given = ", ".join(contents.people_frames)
            raise FileError(self.path, f"people are given in several frames: {given}. Record one of them.")
        people = self._people()
        source = contents.acceleration if len(contents.acceleration) else contents.imu
        imu, log, header = contents.imu.array()[:, 1], None, self.header
        if header is not None and header.human_names != tuple(person.name for person in people):
            header = None  # the people are taken from elsewhere, so this is another run than the one that was written
        if header is not None and contents.facts is not None:
            try:
                log = log_of(contents.facts, len(people))
                imu = np.array(contents.facts.get("imu", imu), dtype=np.float64)
            except (KeyError, TypeError, ValueError) as error:
                raise self._damaged(error) from None
        return Recording(
            source=str(self.path),
            people=people,
            robot=self.robot,
            odometry=bool(contents.odometry),
            acceleration=self._timed(source),
            commands=self._timed(contents.commands),
            goal=self._goal(),
            goal_s=None if contents.goal_s is None else contents.goal_s + self.shift,
            occupancy=contents.occupancy,
            streams=contents.streams,
            notes=tuple(contents.notes),
            header=header,
            contacts=tuple(each for each in header.events if isinstance(each, Contact)) if header else (),
            log=log,
            imu=imu,
        )

    def _timed(self, rows: Rows) -> Floats:
        found = rows.array()
        found[:, 0] += self.shift
        return found

    def _header(self, facts: dict[str, Any]) -> RunHeader:
        """Return the run that RVSG wrote into a bag."""
        try:
            float(facts["t0"])
            return RunHeader.model_validate(facts["header"])
        except (KeyError, TypeError, ValueError) as error:  # pydantic's ValidationError is a ValueError
            raise self._damaged(error) from None

    def _damaged(self, error: Exception) -> FileError:
        return FileError(self.path, f"/rvsg/run is not what RVSG writes ({type(error).__name__}).")

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
                self.contents.note("frame", f"{said}; odometry is used as map coordinates.")
            track = track if moved is None else moved
        else:
            track = self._base_by_transforms()
            said = "The recording has no odometry; pose and speed come from the transforms."
            self.contents.note("no-odometry", said)
        if len(track) < 2:
            raise FileError(self.path, f"the recording holds {len(track)} poses of the robot; at least two are needed.")
        period = float(np.median(np.diff(track[:, 0])))
        if period < 0.8 / RATE_HZ:
            track = track[:: max(1, round(1.0 / (RATE_HZ * period)))]
        track[:, 1:3] += self.offset
        return track

    def _base(self) -> str:
        """Return the frame of the robot's base."""
        children = dict.fromkeys(child for _, child in self.frames.edges)
        bases = [frame for frame in children if frame.rpartition("/")[2] in BASE_FRAMES]
        ways = [base for base in bases if self.frames.way(base, self.there)]
        if len({base.rpartition("/")[0] for base in ways}) > 1:
            said = f"there are several robots: {', '.join(ways)}. Name the odometry of one: --robot-topic."
            raise FileError(self.path, said)
        if not ways:
            said = "the pose of the robot is not known: the recording holds no nav_msgs/Odometry, and no transforms"
            raise FileError(self.path, f'{said} lead from "{MAP}" to {" or ".join(BASE_FRAMES)}.')
        return ways[0]

    def _base_by_transforms(self) -> Floats:
        """Return the robot's base in the map, (N, 7); its speed is the change of its pose."""
        moved = self._frame_track(self._base(), 7)
        if len(moved) > 1:
            moved[:, 4] = speed_of(moved)
            moved[:, 5] = np.gradient(np.unwrap(moved[:, 3]), moved[:, 0])
        return moved

    def _frame_track(self, frame: str, width: int) -> Floats:
        """Return where a frame is in the map, at the times of its most frequent transform."""
        way = self.frames.way(frame, self.there)
        if not way:
            raise FileError(self.path, f'no transforms lead from "{frame}" to "{self.there}".')
        times = np.unique(max((self.frames.edges[pair][:, 0] for pair, _ in way), key=len))
        return self._in_map(np.column_stack([times, np.zeros((len(times), width - 1))]), frame, frame)

    def _people(self) -> tuple[PersonTrack, ...]:
        """Return the people: those with names, those of frames, those without names, else those in the scans."""
        contents, tracks = self.contents, {}
        frame = next(iter(contents.people_frames), MAP)
        for name in self.header.human_names if self.header is not None and contents.people else sorted(contents.people):
            track = contents.people[name].array(distinct=True)
            if not len(track):
                raise FileError(self.path, f"the recording holds no pose of {name}.")
            tracks[name] = self._in_map(track, frame, "people")
        if self.pattern is not None:
            children = sorted({child for _, child in self.frames.edges})
            frames = fnmatch.filter(children, self.pattern)
            if not frames:
                raise UnknownName("frame", self.pattern, children, hint="Frames of the recording.")
            for name in frames:
                tracks[name] = self._frame_track(name, 5)
                tracks[name][:, 4] = math.nan
        people = [
            PersonTrack(name=name, rows=rows, radius_m=contents.radii.get(name), group=contents.groups.get(name))
            for name, rows in tracks.items()
        ]
        if len(contents.places):
            rows = self._in_map(contents.places.array(), frame, "people")
            stamps, first = np.unique(rows[:, 0], return_index=True)
            found = track_places(zip(stamps, np.split(rows[:, 1:3], first[1:]), strict=True))
            people += found
            contents.note("tracked", f"{len(found)} people without names were tracked by their places.", len(found))
        if contents.scan_topics:
            people += self._people_in_scans()
        return tuple(PersonTrack(**{**vars(each), "rows": self._placed(each.rows)}) for each in people)

    def _placed(self, rows: Floats) -> Floats:
        return np.asarray(rows + np.array([self.shift, *self.offset, 0.0, 0.0]))

    def _people_in_scans(self) -> tuple[PersonTrack, ...]:
        """Return who moves in the laser scans, in a second pass; a note says what that cannot know."""
        contents = self.contents
        occupancy = self.world.occupancy if self.world is not None else contents.occupancy
        listed = ", ".join(contents.scan_topics)
        if occupancy is None:
            contents.note("no-map", f"People in the scans of {listed} are found with a map only: give --world.")
            return ()
        found = people_in_scans(self._scans(), occupancy)
        error = max((each.spread_m for each in found), default=0.0)
        contents.note(
            "scans",
            f"{len(found)} people were found by what moves in {listed} (standard error {error:.2f} m). "
            "People who stood still, and those the lidar never saw, are not among them.",
            len(found),
        )
        return found

    def _scans(self) -> Iterator[LaserScan]:
        with open_bag(self.path) as reader:
            for _, received, message in bag_messages(reader, self.path, self.contents.scan_topics):
                t, frame = _seconds(message.header) or received, message.header.frame_id.lstrip("/")
                ranges = np.asarray(message.ranges, np.float64)
                angles = message.angle_min + message.angle_increment * np.arange(len(ranges))
                x, y, yaw = self._in_map(np.array([[t, 0.0, 0.0, 0.0]]), frame, "scans")[0, 1:4]
                yield LaserScan(t, (float(x), float(y), float(yaw)), angles, ranges)

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

    def _goal(self) -> tuple[float, float, float] | None:
        if self.contents.goal is None:
            return None
        row = np.array([[math.inf, *self.contents.goal]])
        _, x, y, yaw = self._in_map(row, self.contents.goal_frame, "/goal_pose")[0]
        return float(x + self.offset[0]), float(y + self.offset[1]), float(yaw)
