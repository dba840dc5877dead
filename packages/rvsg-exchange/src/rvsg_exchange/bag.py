"""A run as a rosbag2 (MCAP): what Foxglove, RViz and `ros2 bag play` show. Needs rosbags (extra `bag`).

Topics: `/clock`, `/tf`, `/tf_static`, `/odom`, `/accel`, `/imu`, `/people` (visualization_msgs/MarkerArray),
`/human_states` (hunav_msgs/Agents), `/map` (latched), `/goal_pose`, and `/rvsg/run` (std_msgs/String: scenario id,
seed, simulator options, outcome, time limit, the study's 2 Hz log and the acceleration of every 10 ms as JSON).

With a trace also: `/scan_K` for every lidar, `/cmd_vel`, `/plan`, `/local_costmap/costmap` (5 Hz),
`/global_costmap/costmap` (when it changes), `/evaluation` (dwb_msgs/LocalPlanEvaluation, with the score of every
critic) and `/local_trajectories` (a marker for Foxglove and RViz), both at 1 Hz, `/local_plan` (the chosen
trajectory), `/behavior_tree_log` (nav2_msgs/BehaviorTreeLog) and `/rvsg/navigation` (std_msgs/String: the phase and
the number of recoveries as JSON, when they change). The chunks of the file are compressed with zstd.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError, how_to_install
from rvsg.core.files import write_whole
from rvsg.simulation.archive import LATERAL, PER_HUMAN, PER_SAMPLE, header_of, series_of
from rvsg.simulation.run import Run, Trajectory
from rvsg.world.world import OCCUPIED, UNKNOWN, OccupancyMap, World

if TYPE_CHECKING:
    from rvsg.robots.robot import Lidar
    from rvsg.simulation.embedded.trace import Evaluation, Frame, Trace


START_S = 10
"""Time 0 of a run is second 10 of the bag: ROS has no negative time, and the map comes before the first sample."""
BASE_FRAME = "base_footprint"


class Messages:
    """Makes the messages of a bag. Times are those of the run, lengths in metres, angles in radians."""

    def __init__(self, types: Any) -> None:
        self.types = types

    def make(self, kind: str, **values: Any) -> Any:
        """Return a message of a kind, such as `nav_msgs/Path`; fields that are not given are zero or empty."""
        package, name = kind.replace("/msg/", "/").split("/")
        full = f"{package}/msg/{name}"
        for field, (node, of) in self.types.fielddefs[full][1]:
            if field not in values:
                values[field] = self._zero(node.name, of)
        return self.types.types[full](**values)

    def _zero(self, node: str, of: Any) -> Any:
        if node == "NAME":
            return self.make(of)
        if node in ("ARRAY", "SEQUENCE"):
            (element, inner), size = of
            numeric = element.name == "BASE" and inner[0] != "string"
            return np.zeros(size if node == "ARRAY" else 0, inner[0]) if numeric else []
        return {"string": "", "bool": False}.get(of[0], 0)

    def time(self, t: float) -> tuple[Any, int]:
        """Return the stamp of a time of the run, and the same in nanoseconds."""
        nanoseconds = round((t + START_S) * 1e9)
        return self.stamp(nanoseconds), nanoseconds

    def stamp(self, nanoseconds: int) -> Any:
        """Return a ROS time."""
        return self.make("builtin_interfaces/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)

    def header(self, stamp: Any, frame: str) -> Any:
        """Return a header."""
        return self.make("std_msgs/Header", stamp=stamp, frame_id=frame)

    def turn(self, yaw: float) -> Any:
        """Return the quaternion of a turn about the vertical."""
        return self.make("geometry_msgs/Quaternion", z=math.sin(yaw / 2), w=math.cos(yaw / 2))

    def point(self, x: float, y: float, z: float = 0.0) -> Any:
        """Return a point."""
        return self.make("geometry_msgs/Point", x=float(x), y=float(y), z=z)

    def vector(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        """Return a vector."""
        return self.make("geometry_msgs/Vector3", x=float(x), y=float(y), z=float(z))

    def pose(self, x: float, y: float, yaw: float, z: float = 0.0) -> Any:
        """Return a pose."""
        return self.make("geometry_msgs/Pose", position=self.point(x, y, z), orientation=self.turn(yaw))

    def twist(self, forward: float, turning: float, left: float = 0.0) -> Any:
        """Return a velocity: m/s and rad/s."""
        return self.make("geometry_msgs/Twist", linear=self.vector(forward, left), angular=self.vector(z=turning))

    def odometry(self, stamp: Any, frame: str, child: str, pose: Any, twist: Any) -> Any:
        """Return where the frame `child` is in another, and how fast it moves."""
        posed = self.make("geometry_msgs/PoseWithCovariance", pose=pose)
        moved = self.make("geometry_msgs/TwistWithCovariance", twist=twist)
        header = self.header(stamp, frame)
        return self.make("nav_msgs/Odometry", header=header, child_frame_id=child, pose=posed, twist=moved)

    def transform(self, stamp: Any, parent: str, child: str, x: float, y: float, yaw: float, z: float = 0.0) -> Any:
        """Return the transform from a child frame to its parent."""
        transform = self.make("geometry_msgs/Transform", translation=self.vector(x, y, z), rotation=self.turn(yaw))
        header = self.header(stamp, parent)
        return self.make("geometry_msgs/TransformStamped", header=header, child_frame_id=child, transform=transform)

    def grid(
        self, stamp: Any, frame: str, cells: NDArray[np.int8], resolution: float, origin: tuple[float, float, float]
    ) -> Any:
        """Return an occupancy grid; `origin` is the pose of the corner of cell (0, 0)."""
        (rows, columns), corner = cells.shape, self.pose(*origin)
        sizes = {"resolution": resolution, "width": columns, "height": rows}
        info = self.make("nav_msgs/MapMetaData", map_load_time=stamp, origin=corner, **sizes)
        return self.make("nav_msgs/OccupancyGrid", header=self.header(stamp, frame), info=info, data=cells.ravel())

    def map(self, stamp: Any, frame: str, occupancy: OccupancyMap) -> Any:
        """Return an occupancy map as an occupancy grid: 100 is occupied, -1 unknown."""
        cells = np.zeros(occupancy.cells.shape, np.int8)
        cells[occupancy.cells == OCCUPIED] = 100
        cells[occupancy.cells == UNKNOWN] = -1
        origin = occupancy.origin
        return self.grid(stamp, frame, cells, occupancy.resolution, (origin.x, origin.y, origin.yaw))

    def marker(self, stamp: Any, frame: str, kind: int, scale: tuple[float, float, float], **values: Any) -> Any:
        """Return a visualization_msgs/Marker of a kind (3: cylinder, 5: list of lines), orange."""
        header, colour = self.header(stamp, frame), self.make("std_msgs/ColorRGBA", r=0.9, g=0.4, b=0.1, a=0.8)
        texture = self.make("sensor_msgs/CompressedImage", header=self.header(stamp, ""))
        same = {"header": header, "type": kind, "scale": self.vector(*scale), "color": colour, "texture": texture}
        return self.make("visualization_msgs/Marker", **same, **values)


def definitions(package: str = "") -> dict[str, str]:
    """Return the message definitions of HuNavSim and Nav2 by name, or those of one package."""
    text = Path(__file__).with_name("messages.msg").read_text(encoding="utf-8")
    parts = re.split(r"^=+\nMSG: (.+)\n", text, flags=re.MULTILINE)[1:]
    return {name: body for name, body in zip(parts[::2], parts[1::2], strict=True) if name.startswith(package)}


def rosbags_types() -> Any:
    """Return the ROS 2 message types with those of HuNavSim and Nav2; InputError where rosbags is not installed."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise InputError(f"Bags need rosbags: {how_to_install('bag')}.") from None
    types = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in definitions().items():
        types.register(get_types_from_msg(text, name))
    return types


Event = tuple[int, str, Any]

COSTMAP_FRAMES = 2
"""The local costmap is written in every second frame, 5 Hz."""
EVALUATION_FRAMES = 10
"""The samples of the local planner are written in every tenth frame, 1 Hz."""
LINE_LIST = 5
"""visualization_msgs/Marker.LINE_LIST."""


def occupancy(costs: NDArray[np.uint8]) -> NDArray[np.int8]:
    """Return costs as Nav2 publishes them: 0 to 252 become 0 to 98, 253 is 99, 254 is 100, 255 (unknown) is -1."""
    wide = costs.astype(np.int32)
    scaled = np.where(wide == 255, -1, np.where(wide >= 253, wide - 154, 1 + 97 * (wide - 1) // 251))
    scaled[wide == 0] = 0
    return scaled.astype(np.int8)


class TraceMessages(Messages):
    """Makes the messages of a trace; `offset` is where the map frame is in the world (m)."""

    def __init__(self, types: Any, trace: Trace, offset: tuple[float, float]) -> None:
        super().__init__(types)
        self.trace, self.offset = trace, offset

    def all(self) -> Iterator[Event]:
        """Yield time (ns), topic and message of everything, each topic in the order of time."""
        trace = self.trace
        phase = ("", -1)
        master = np.zeros((0, 0), np.uint8)
        for number, frame in enumerate(trace.frames):
            yield from self._senses(frame)
            stamp, at = self.time(frame.t)
            if number % COSTMAP_FRAMES == 0:
                costs, origin = occupancy(frame.costmap), (*frame.costmap_origin, 0.0)
                yield at, "/local_costmap/costmap", self.grid(stamp, "odom", costs, trace.resolution, origin)
            if frame.global_costmap is not None:
                master = frame.global_costmap.onto(master)
                costs, origin = occupancy(master), (*trace.global_origin, 0.0)
                yield at, "/global_costmap/costmap", self.grid(stamp, "map", costs, trace.global_resolution, origin)
            if frame.evaluation is not None and number % EVALUATION_FRAMES == 0:
                yield from self._tried(frame.evaluation)
            if (frame.phase, frame.recoveries) != phase:
                phase = (frame.phase, frame.recoveries)
                said = json.dumps({"phase": frame.phase, "recoveries": frame.recoveries})
                yield at, "/rvsg/navigation", self.make("std_msgs/String", data=said)
        yield from self._tree()

    def _senses(self, frame: Frame) -> Iterator[Event]:
        """Yield command, scans and, where it is new, the plan."""
        stamp, at = self.time(frame.t)
        yield at, "/cmd_vel", self.twist(*frame.command)
        for k, ranges in enumerate(frame.scans):
            yield at, f"/scan_{k}", self._scan(stamp, k, self.trace.robot.lidars[k], ranges)
        if frame.plan is not None:
            dx, dy = self.offset
            yield at, "/plan", self._path(stamp, "map", frame.plan - (dx, dy))

    def _scan(self, stamp: Any, number: int, lidar: Lidar, ranges: NDArray[np.float64]) -> Any:
        return self.make(
            "sensor_msgs/LaserScan",
            header=self.header(stamp, f"lidar_{number}"),
            angle_min=-lidar.field_of_view_rad / 2,
            angle_max=lidar.field_of_view_rad / 2,
            angle_increment=lidar.field_of_view_rad / (lidar.rays - 1),
            scan_time=1.0 / lidar.rate_hz,
            range_min=lidar.min_range_m,
            range_max=lidar.max_range_m,
            ranges=ranges.astype(np.float32),
        )

    def _path(self, stamp: Any, frame: str, points: NDArray[np.float64]) -> Any:
        header = self.header(stamp, frame)
        poses = [
            self.make("geometry_msgs/PoseStamped", header=header, pose=self.pose(float(x), float(y), 0.0))
            for x, y in points
        ]
        return self.make("nav_msgs/Path", header=header, poses=poses)

    def _tried(self, tried: Evaluation) -> Iterator[Event]:
        """Yield the samples with their scores, as data and as lines, and the chosen one."""
        stamp, at = self.time(tried.t)
        x, y, yaw = tried.pose
        finite = np.flatnonzero(np.isfinite(tried.score))
        worst = int(finite[np.argmax(tried.score[finite])]) if len(finite) else 0
        start = self.make("geometry_msgs/Pose2D", x=x, y=y, theta=yaw)
        samples = zip(tried.velocity, tried.end, tried.score, strict=True)
        twists = [
            self.make(
                "dwb_msgs/TrajectoryScore",
                traj=self.make(
                    "dwb_msgs/Trajectory2D",
                    velocity=self.make("nav_2d_msgs/Twist2D", x=float(v), y=float(sum(side)), theta=float(w)),
                    poses=[start, self.make("geometry_msgs/Pose2D", x=float(ex), y=float(ey))],
                ),
                scores=[
                    self.make("dwb_msgs/CriticScore", name=name, raw_score=float(raw), scale=float(scale))
                    for name, scale, raw in zip(tried.critics, tried.scales, tried.raw[k], strict=True)
                ]
                if tried.critics and math.isfinite(score)
                else [],
                total=float(score) if math.isfinite(score) else -1.0,
            )
            for k, ((v, w, *side), (ex, ey), score) in enumerate(samples)
        ]
        chosen = {"best_index": max(0, tried.best), "worst_index": worst}
        header = self.header(stamp, "odom")
        yield at, "/evaluation", self.make("dwb_msgs/LocalPlanEvaluation", header=header, twists=twists, **chosen)
        yield at, "/local_trajectories", self._lines(stamp, tried)
        if tried.best >= 0:
            yield at, "/local_plan", self._path(stamp, "odom", arc(tried.pose, tried.end[tried.best]))

    def _lines(self, stamp: Any, tried: Evaluation) -> Any:
        """Draw the samples as lines from the robot to their ends: green is best, red is worst, grey is forbidden."""
        finite = np.isfinite(tried.score)
        low = float(tried.score[finite].min()) if finite.any() else 0.0
        spread = max(1e-9, float(tried.score[finite].max()) - low) if finite.any() else 1.0
        start = self.point(tried.pose[0], tried.pose[1], 0.05)
        points, colours = [], []
        for k, (ex, ey) in enumerate(tried.end):
            share = (float(tried.score[k]) - low) / spread if finite[k] else 0.0
            rgba = (share, 1.0 - share, 0.0, 0.8) if finite[k] else (0.5, 0.5, 0.5, 0.3)
            colour = self.make("std_msgs/ColorRGBA", **dict(zip("rgba", rgba, strict=True)))
            points += [start, self.point(ex, ey, 0.05)]
            colours += [colour, colour]
        lines = self.marker(
            stamp, "odom", LINE_LIST, (0.01, 0.0, 0.0), ns="local trajectories", points=points, colors=colours,
            pose=self.pose(0.0, 0.0, 0.0),
        )  # fmt: skip
        return self.make("visualization_msgs/MarkerArray", markers=[lines])

    def _tree(self) -> Iterator[Event]:
        """Yield the changes of the behaviour tree's nodes, one message for each time."""
        changes: dict[float, list[Any]] = {}
        for each in self.trace.nodes:
            stamp, _ = self.time(each.t)
            status = {"node_name": each.node, "previous_status": each.before, "current_status": each.after}
            changes.setdefault(each.t, []).append(
                self.make("nav2_msgs/BehaviorTreeStatusChange", timestamp=stamp, **status)
            )
        for t, events in changes.items():
            stamp, at = self.time(t)
            yield at, "/behavior_tree_log", self.make("nav2_msgs/BehaviorTreeLog", timestamp=stamp, event_log=events)


def arc(pose: tuple[float, float, float], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points on the arc that leaves a pose in its direction and ends at a place, (12, 2)."""
    x, y, yaw = pose
    dx, dy = float(end[0]) - x, float(end[1]) - y
    ahead, left = math.cos(yaw) * dx + math.sin(yaw) * dy, -math.sin(yaw) * dx + math.cos(yaw) * dy
    share = np.linspace(0.0, 1.0, 12)
    if abs(left) < 1e-6:
        u, v = ahead * share, 0.0 * share
    else:
        radius = (ahead**2 + left**2) / (2.0 * left)
        turned = 2.0 * math.atan2(left, ahead) * share
        u, v = radius * np.sin(turned), radius * (1.0 - np.cos(turned))
    return np.column_stack([x + math.cos(yaw) * u - math.sin(yaw) * v, y + math.sin(yaw) * u + math.cos(yaw) * v])


GRAVITY_M_S2 = 9.80665
LATCHED_OFFSET_S = 1.0
CYLINDER = 3
"""visualization_msgs/Marker.CYLINDER."""


def write_bag(run: Run, world: World, path: Path, *, trace: Trace | None = None) -> None:
    """Write a run as one MCAP file `path`, with what the robot sees and plans where a trace is given.

    Raises InputError where rosbags is not installed, FileError where the file cannot be written.
    """
    types = rosbags_types()
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    with tempfile.TemporaryDirectory() as folder:
        writer = Writer(Path(folder) / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            _Bag(writer, types).write(run, world, trace)
        write_whole(path, next((Path(folder) / "bag").glob("*.mcap")).read_bytes())


class _Bag(Messages):
    """An open bag: makes messages of a run and writes them under their topics."""

    def __init__(self, writer: Any, types: Any) -> None:
        super().__init__(types)
        self.writer = writer
        self.topics: dict[str, Any] = {}
        self.offset = (0.0, 0.0)  # world - map; the odometry starts as the world frame

    def put(self, topic: str, nanoseconds: int, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self.topics:
            options: dict[str, Any] = {}
            if topic in ("/map", "/tf_static", "/rvsg/run"):
                options["offered_qos_profiles"] = [_latched()]
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.types, **options)
        self.writer.write(self.topics[topic], nanoseconds, self.types.serialize_cdr(message, kind))

    def write(self, run: Run, world: World, trace: Trace | None) -> None:
        """Write everything, in the order of time."""
        self.offset = world.map_offset
        events = [*self._latched_ones(run, world, trace), *self._samples(run)]
        if trace is not None:
            events += TraceMessages(self.types, trace, self.offset).all()
        for nanoseconds, topic, message in sorted(events, key=lambda event: (event[0], event[1])):
            self.put(topic, nanoseconds, message)

    def _latched_ones(self, run: Run, world: World, trace: Trace | None) -> Iterator[tuple[int, str, Any]]:
        stamp, at = self.time(float(run.trajectory.t[0]) - LATCHED_OFFSET_S)
        dx, dy = self.offset
        fixed = [self.transform(stamp, "map", "odom", -dx, -dy, 0.0)]
        for k, lidar in enumerate(trace.robot.lidars if trace is not None else ()):
            fixed.append(self.transform(stamp, BASE_FRAME, f"lidar_{k}", lidar.x, lidar.y, lidar.yaw))
        yield at, "/tf_static", self.make("tf2_msgs/TFMessage", transforms=fixed)
        yield at, "/map", self.map(stamp, "map", world.occupancy)
        x, y, yaw = run.goal
        goal = self.make(
            "geometry_msgs/PoseStamped", header=self.header(stamp, "map"), pose=self.pose(x - dx, y - dy, yaw)
        )
        yield at, "/goal_pose", goal
        yield at, "/rvsg/run", self.make("std_msgs/String", data=json.dumps(run_facts(run), allow_nan=False))

    def _samples(self, run: Run) -> Iterator[tuple[int, str, Any]]:
        """Yield clock, pose, speed, acceleration and people of every sample.

        The simulator's base takes on a commanded speed within 10 ms, so `/imu` is averaged between two samples.
        """
        path = run.trajectory
        side = path.lateral if path.lateral.size else np.zeros(len(path))
        step = np.maximum(np.diff(path.t, prepend=path.t[:1] - 1.0), 1e-9)
        forward = np.diff(path.v, prepend=path.v[:1]) / step - side * path.omega
        left = path.v * path.omega + np.diff(side, prepend=side[:1]) / step
        for k in range(len(path)):
            stamp, at = self.time(float(path.t[k]))
            x, y, yaw, omega = float(path.x[k]), float(path.y[k]), float(path.yaw[k]), float(path.omega[k])
            base = self.header(stamp, BASE_FRAME)
            yield at, "/clock", self.make("rosgraph_msgs/Clock", clock=stamp)
            moved = self.transform(stamp, "odom", BASE_FRAME, x, y, yaw)
            yield at, "/tf", self.make("tf2_msgs/TFMessage", transforms=[moved])
            twist = self.twist(float(path.v[k]), omega, float(side[k]))
            yield at, "/odom", self.odometry(stamp, "odom", BASE_FRAME, self.pose(x, y, yaw), twist)
            accel = self.make("geometry_msgs/Accel", linear=self.vector(float(path.acceleration[k])))
            yield at, "/accel", self.make("geometry_msgs/AccelStamped", header=base, accel=accel)
            imu = self.make(
                "sensor_msgs/Imu",
                header=base,
                orientation=self.turn(yaw),
                angular_velocity=self.vector(0.0, 0.0, omega),
                linear_acceleration=self.vector(float(forward[k]), float(left[k]), GRAVITY_M_S2),
            )
            yield at, "/imu", imu
            if run.human_names:
                yield at, "/human_states", self._agents(stamp, run, k)
                if k % 2 == 0:
                    yield at, "/people", self._markers(stamp, run, k)

    def _agents(self, stamp: Any, run: Run, k: int) -> Any:
        path = run.trajectory
        dx, dy = self.offset
        agents = []
        for i, name in enumerate(run.human_names):
            yaw, speed = float(path.human_yaw[k, i]), float(path.human_speed[k, i])
            group = run.human_groups[i] if run.human_groups else None
            ahead = self.vector(speed * math.cos(yaw), speed * math.sin(yaw))
            agents.append(
                self.make(
                    "hunav_msgs/Agent",
                    header=self.header(stamp, "map"),
                    id=i + 1,
                    type=1,
                    name=name,
                    group_id=-1 if group is None else group,
                    position=self.pose(float(path.human_x[k, i]) - dx, float(path.human_y[k, i]) - dy, yaw),
                    yaw=yaw,
                    velocity=self.make("geometry_msgs/Twist", linear=ahead),
                    radius=run.human_radius_m[i],
                    linear_vel=speed,
                    behavior=self.make("hunav_msgs/AgentBehavior", type=1, once=True),
                    cyclic_goals=True,
                    goal_radius=0.3,
                )
            )
        return self.make("hunav_msgs/Agents", header=self.header(stamp, "map"), agents=agents)

    def _markers(self, stamp: Any, run: Run, k: int) -> Any:
        path = run.trajectory
        dx, dy = self.offset
        markers = []
        for i, name in enumerate(run.human_names):
            across = 2 * run.human_radius_m[i]
            place = self.pose(path.human_x[k, i] - dx, path.human_y[k, i] - dy, float(path.human_yaw[k, i]), 0.85)
            size = (across, across, 1.7)
            markers.append(self.marker(stamp, "map", CYLINDER, size, ns="people", id=i, pose=place, text=name))
        return self.make("visualization_msgs/MarkerArray", markers=markers)


def run_facts(run: Run) -> dict[str, Any]:
    """Return what of a run no message type holds, as plain data: header, time of the first sample, IMU, study's log."""
    facts: dict[str, Any] = {"header": header_of(run).model_dump(mode="json"), "t0": float(run.trajectory.t[0])}
    facts["imu"] = run.imu.tolist()
    if run.log is not run.trajectory:
        facts["log"] = {name: array.tolist() for name, array in series_of(run.log).items()}
    return facts


def log_of(facts: dict[str, Any], humans: int) -> Trajectory | None:
    """Return the study's log that `run_facts` kept; None where the run had none of its own."""
    kept = facts.get("log")
    if kept is None:
        return None
    names = (*PER_SAMPLE, *PER_HUMAN, *((LATERAL,) if LATERAL in kept else ()))
    arrays = {name: np.asarray(kept[name], dtype=np.float64) for name in names}
    rows = len(arrays["t"])
    return Trajectory(**{k: v.reshape(rows, humans) if k in PER_HUMAN else v for k, v in arrays.items()})


def _latched() -> Any:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    forever = QosTime(sec=2147483647, nsec=4294967295)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL,
        deadline=forever,
        lifespan=forever,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=forever,
        avoid_ros_namespace_conventions=False,
    )
