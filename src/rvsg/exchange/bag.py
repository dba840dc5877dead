"""A run as a rosbag2 (MCAP): what Foxglove, RViz and `ros2 bag play` show. Needs rosbags (extra `bag`).

Topics: `/clock`, `/tf`, `/tf_static`, `/odom`, `/accel`, `/imu`, `/people` (visualization_msgs/MarkerArray),
`/human_states` (hunav_msgs/Agents), `/map` (latched), `/goal_pose`, and `/rvsg/run` (std_msgs/String: scenario id,
seed, simulator options, outcome, time limit and the study's 2 Hz log as JSON).

With a trace also `/scan_K` for every lidar, `/cmd_vel`, `/plan`, `/local_costmap/costmap` and `/rvsg/navigation`
(std_msgs/String: the phase of the behaviour tree, when it changes).
"""

from __future__ import annotations

import json
import math
import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import FileError, InputError, how_to_install
from rvsg.simulation.archive import PER_HUMAN, PER_SAMPLE, header_of
from rvsg.simulation.run import Run, Trajectory
from rvsg.world.world import OCCUPIED, UNKNOWN, World

if TYPE_CHECKING:
    from rvsg.robots import Lidar
    from rvsg.simulation.embedded.trace import Frame, Trace

BASE_FRAME = "base_footprint"
START_S = 10
"""Time 0 of a run is second 10 of the bag: ROS has no negative time, and the map comes before the first sample."""

IMU_RATE_HZ = 100.0
LATCHED_OFFSET_S = 1.0

HUNAV_TYPES = {
    "hunav_msgs/msg/AgentBehavior": """uint8 type
uint8 state
uint8 configuration
float32 duration
bool once
float32 vel
float32 dist
float32 social_force_factor
float32 goal_force_factor
float32 obstacle_force_factor
float32 other_force_factor
""",
    "hunav_msgs/msg/Agent": """std_msgs/Header header
int32 id
uint8 type
uint8 skin
string name
int8 group_id
geometry_msgs/Pose position
float32 yaw
geometry_msgs/Twist velocity
float32 desired_velocity
float32 radius
float32 linear_vel
float32 angular_vel
hunav_msgs/AgentBehavior behavior
geometry_msgs/Pose[] goals
bool cyclic_goals
float32 goal_radius
geometry_msgs/Point[] closest_obs
""",
    "hunav_msgs/msg/Agents": "std_msgs/Header header\nhunav_msgs/Agent[] agents\n",
}
"""The message definitions of HuNavSim 1.x (hunav_msgs), written from its interface description."""


def rosbags_types() -> Any:
    """Return the ROS 2 message types with those of HuNavSim; InputError where rosbags is not installed."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise InputError(f"Bags need rosbags: {how_to_install('bag')}.") from None
    types = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in HUNAV_TYPES.items():
        types.register(get_types_from_msg(text, name))
    return types


def write_bag(run: Run, world: World, path: Path, *, trace: Trace | None = None) -> None:
    """Write a run as one MCAP file.

    Args:
        run: the run; its trajectory is written at its own rate (20 Hz).
        world: the world of the run, for the map and its offset.
        path: the file, `*.mcap`; an existing one is replaced when the new one is complete.
        trace: what the robot sees and plans in the same run; see `rvsg.simulation.embedded.trace`.

    Raises:
        InputError: rosbags is not installed.
        FileError: the file cannot be written.
    """
    types = rosbags_types()
    from rosbags.rosbag2 import StoragePlugin, Writer

    if path.is_dir():
        raise FileError(path, "this is a folder; give the name of a file, such as run.mcap.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            with Writer(Path(folder) / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
                _Bag(writer, types).write(run, world, trace)
            made = next((Path(folder) / "bag").glob("*.mcap"))
            shutil.move(made, path)
    except OSError as error:
        raise FileError(path, f"the file cannot be written: {error.strerror or error}.") from None


class _Bag:
    """An open bag: makes messages of a run and writes them under their topics."""

    def __init__(self, writer: Any, types: Any) -> None:
        self.writer, self.types, self.T = writer, types, types.types
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

    def make(self, kind: str, **values: Any) -> Any:
        package, name = kind.split("/")
        return self.T[f"{package}/msg/{name}"](**values)

    def time(self, t: float) -> tuple[Any, int]:
        nanoseconds = round((t + START_S) * 1e9)
        return self.make("builtin_interfaces/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9), nanoseconds

    def header(self, stamp: Any, frame: str) -> Any:
        return self.make("std_msgs/Header", stamp=stamp, frame_id=frame)

    def turn(self, yaw: float) -> Any:
        return self.make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))

    def point(self, x: float, y: float, z: float = 0.0) -> Any:
        return self.make("geometry_msgs/Point", x=float(x), y=float(y), z=z)

    def vector(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        return self.make("geometry_msgs/Vector3", x=float(x), y=float(y), z=float(z))

    def pose(self, x: float, y: float, yaw: float, z: float = 0.0) -> Any:
        return self.make("geometry_msgs/Pose", position=self.point(x, y, z), orientation=self.turn(yaw))

    def twist(self, forward: float, turning: float) -> Any:
        return self.make("geometry_msgs/Twist", linear=self.vector(forward), angular=self.vector(z=turning))

    def write(self, run: Run, world: World, trace: Trace | None) -> None:
        """Write everything, in the order of time."""
        self.offset = world.map_offset
        events = [*self._latched_ones(run, world, trace), *self._samples(run), *self._imu(run)]
        if trace is not None:
            events += self._frames(trace)
        for nanoseconds, topic, message in sorted(events, key=lambda event: (event[0], event[1])):
            self.put(topic, nanoseconds, message)

    def _latched_ones(self, run: Run, world: World, trace: Trace | None) -> Iterator[tuple[int, str, Any]]:
        stamp, at = self.time(float(run.trajectory.t[0]) - LATCHED_OFFSET_S)
        dx, dy = self.offset
        fixed = [self._transform(stamp, "map", "odom", -dx, -dy, 0.0)]
        for k, lidar in enumerate(trace.robot.lidars if trace is not None else ()):
            fixed.append(self._transform(stamp, BASE_FRAME, f"lidar_{k}", lidar.x, lidar.y, lidar.yaw))
        yield at, "/tf_static", self.make("tf2_msgs/TFMessage", transforms=fixed)
        yield at, "/map", self._map(stamp, world)
        x, y, yaw = run.goal
        goal = self.make(
            "geometry_msgs/PoseStamped", header=self.header(stamp, "map"), pose=self.pose(x - dx, y - dy, yaw)
        )
        yield at, "/goal_pose", goal
        yield at, "/rvsg/run", self.make("std_msgs/String", data=json.dumps(run_facts(run), allow_nan=False))

    def _samples(self, run: Run) -> Iterator[tuple[int, str, Any]]:
        path = run.trajectory
        for k in range(len(path)):
            stamp, at = self.time(float(path.t[k]))
            x, y, yaw = float(path.x[k]), float(path.y[k]), float(path.yaw[k])
            yield at, "/clock", self.make("rosgraph_msgs/Clock", clock=stamp)
            moved = self._transform(stamp, "odom", BASE_FRAME, x, y, yaw)
            yield at, "/tf", self.make("tf2_msgs/TFMessage", transforms=[moved])
            yield at, "/odom", self._odometry(stamp, x, y, yaw, float(path.v[k]), float(path.omega[k]))
            accel = self.make(
                "geometry_msgs/Accel", linear=self.vector(float(path.acceleration[k])), angular=self.vector()
            )
            yield (
                at,
                "/accel",
                self.make("geometry_msgs/AccelStamped", header=self.header(stamp, BASE_FRAME), accel=accel),
            )
            if run.human_names:
                yield at, "/human_states", self._agents(stamp, run, k)
                if k % 2 == 0:
                    yield at, "/people", self._markers(stamp, run, k)

    def _frames(self, trace: Trace) -> Iterator[tuple[int, str, Any]]:
        dx, dy = self.offset
        phase = ""
        for number, frame in enumerate(trace.frames):
            stamp, at = self.time(frame.t)
            yield at, "/cmd_vel", self.twist(*frame.command)
            for k, ranges in enumerate(frame.scans):
                yield at, f"/scan_{k}", self._scan(stamp, k, trace.robot.lidars[k], ranges)
            if number % 2 == 0:
                yield at, "/local_costmap/costmap", self._costmap(stamp, frame, trace.resolution)
            if frame.plan is not None:
                header = self.header(stamp, "map")
                poses = [
                    self.make("geometry_msgs/PoseStamped", header=header, pose=self.pose(x - dx, y - dy, 0.0))
                    for x, y in frame.plan
                ]
                yield at, "/plan", self.make("nav_msgs/Path", header=header, poses=poses)
            if frame.phase != phase:
                phase = frame.phase
                said = json.dumps({"phase": phase, "recoveries": frame.recoveries})
                yield at, "/rvsg/navigation", self.make("std_msgs/String", data=said)

    def _scan(self, stamp: Any, number: int, lidar: Lidar, ranges: NDArray[np.float64]) -> Any:
        return self.make(
            "sensor_msgs/LaserScan",
            header=self.header(stamp, f"lidar_{number}"),
            angle_min=-lidar.field_of_view_rad / 2,
            angle_max=lidar.field_of_view_rad / 2,
            angle_increment=lidar.field_of_view_rad / (lidar.rays - 1),
            time_increment=0.0,
            scan_time=1.0 / lidar.rate_hz,
            range_min=lidar.min_range_m,
            range_max=lidar.max_range_m,
            ranges=ranges.astype(np.float32),
            intensities=np.zeros(0, np.float32),
        )

    def _costmap(self, stamp: Any, frame: Frame, resolution: float) -> Any:
        """The local costmap as Nav2 publishes it: costs 0 to 252 become 0 to 98, 253 is 99, 254 is 100, 255 is -1."""
        costs = frame.costmap.astype(np.int32)
        scaled = np.where(costs == 255, -1, np.where(costs >= 253, costs - 154, 1 + 97 * (costs - 1) // 251))
        scaled[costs == 0] = 0
        rows, columns = costs.shape
        x, y = frame.costmap_origin
        info = self.make(
            "nav_msgs/MapMetaData",
            map_load_time=stamp,
            resolution=resolution,
            width=columns,
            height=rows,
            origin=self.pose(x, y, 0.0),
        )
        data = scaled.astype(np.int8).ravel()
        return self.make("nav_msgs/OccupancyGrid", header=self.header(stamp, "odom"), info=info, data=data)

    def _imu(self, run: Run) -> Iterator[tuple[int, str, Any]]:
        none = np.zeros(9)
        for k, value in enumerate(run.imu):
            stamp, at = self.time(k / IMU_RATE_HZ)
            message = self.make(
                "sensor_msgs/Imu",
                header=self.header(stamp, BASE_FRAME),
                orientation=self.turn(0.0),
                orientation_covariance=none,
                angular_velocity=self.vector(),
                angular_velocity_covariance=none,
                linear_acceleration=self.vector(float(value)),
                linear_acceleration_covariance=none,
            )
            yield at, "/imu", message

    def _transform(self, stamp: Any, parent: str, child: str, x: float, y: float, yaw: float) -> Any:
        transform = self.make("geometry_msgs/Transform", translation=self.vector(x, y), rotation=self.turn(yaw))
        return self.make(
            "geometry_msgs/TransformStamped",
            header=self.header(stamp, parent),
            child_frame_id=child,
            transform=transform,
        )

    def _odometry(self, stamp: Any, x: float, y: float, yaw: float, v: float, omega: float) -> Any:
        none = np.zeros(36)
        return self.make(
            "nav_msgs/Odometry",
            header=self.header(stamp, "odom"),
            child_frame_id=BASE_FRAME,
            pose=self.make("geometry_msgs/PoseWithCovariance", pose=self.pose(x, y, yaw), covariance=none),
            twist=self.make("geometry_msgs/TwistWithCovariance", twist=self.twist(v, omega), covariance=none),
        )

    def _map(self, stamp: Any, world: World) -> Any:
        occupancy = world.occupancy
        rows, columns = occupancy.cells.shape
        cells = np.zeros((rows, columns), np.int8)
        cells[occupancy.cells == OCCUPIED] = 100
        cells[occupancy.cells == UNKNOWN] = -1
        origin = occupancy.origin
        info = self.make(
            "nav_msgs/MapMetaData",
            map_load_time=stamp,
            resolution=occupancy.resolution,
            width=columns,
            height=rows,
            origin=self.pose(origin.x, origin.y, origin.yaw),
        )
        return self.make("nav_msgs/OccupancyGrid", header=self.header(stamp, "map"), info=info, data=cells.ravel())

    def _agents(self, stamp: Any, run: Run, k: int) -> Any:
        path = run.trajectory
        dx, dy = self.offset
        agents = []
        for i, name in enumerate(run.human_names):
            yaw, speed = float(path.human_yaw[k, i]), float(path.human_speed[k, i])
            group = run.human_groups[i] if run.human_groups else None
            velocity = self.make(
                "geometry_msgs/Twist",
                linear=self.vector(speed * math.cos(yaw), speed * math.sin(yaw)),
                angular=self.vector(),
            )
            agents.append(
                self.make(
                    "hunav_msgs/Agent",
                    header=self.header(stamp, "map"),
                    id=i + 1,
                    type=1,
                    skin=0,
                    name=name,
                    group_id=-1 if group is None else group,
                    position=self.pose(float(path.human_x[k, i]) - dx, float(path.human_y[k, i]) - dy, yaw),
                    yaw=yaw,
                    velocity=velocity,
                    desired_velocity=0.0,
                    radius=run.human_radius_m[i],
                    linear_vel=speed,
                    angular_vel=0.0,
                    behavior=self._no_behaviour(),
                    goals=[],
                    cyclic_goals=True,
                    goal_radius=0.3,
                    closest_obs=[],
                )
            )
        return self.make("hunav_msgs/Agents", header=self.header(stamp, "map"), agents=agents)

    def _no_behaviour(self) -> Any:
        names = ("duration", "vel", "dist", "social_force_factor", "goal_force_factor", "obstacle_force_factor")
        zeros = dict.fromkeys((*names, "other_force_factor"), 0.0)
        return self.make("hunav_msgs/AgentBehavior", type=1, state=0, configuration=0, once=True, **zeros)

    def _markers(self, stamp: Any, run: Run, k: int) -> Any:
        path = run.trajectory
        dx, dy = self.offset
        none = np.zeros(0, np.uint8)
        markers = []
        for i in range(len(run.human_names)):
            radius = run.human_radius_m[i]
            markers.append(
                self.make(
                    "visualization_msgs/Marker",
                    header=self.header(stamp, "map"),
                    ns="people",
                    id=i,
                    type=3,
                    action=0,
                    pose=self.pose(path.human_x[k, i] - dx, path.human_y[k, i] - dy, float(path.human_yaw[k, i]), 0.85),
                    scale=self.vector(2 * radius, 2 * radius, 1.7),
                    color=self.make("std_msgs/ColorRGBA", r=0.9, g=0.4, b=0.1, a=0.8),
                    lifetime=self.make("builtin_interfaces/Duration", sec=0, nanosec=0),
                    frame_locked=False,
                    points=[],
                    colors=[],
                    texture_resource="",
                    texture=self.make(
                        "sensor_msgs/CompressedImage", header=self.header(stamp, ""), format="", data=none
                    ),
                    uv_coordinates=[],
                    text=run.human_names[i],
                    mesh_resource="",
                    mesh_file=self.make("visualization_msgs/MeshFile", filename="", data=none),
                    mesh_use_embedded_materials=False,
                )
            )
        return self.make("visualization_msgs/MarkerArray", markers=markers)


def run_facts(run: Run) -> dict[str, Any]:
    """Return what of a run no message type holds, as plain data: its header, the study's log and the sample times."""
    facts: dict[str, Any] = {"header": header_of(run).model_dump(mode="json"), "t0": float(run.trajectory.t[0])}
    if run.log is not run.trajectory:
        facts["log"] = {name: getattr(run.log, name).tolist() for name in (*PER_SAMPLE, *PER_HUMAN)}
    return facts


def log_of(facts: dict[str, Any], humans: int) -> Trajectory | None:
    """Return the study's log that `run_facts` kept; None where the run had none of its own."""
    kept = facts.get("log")
    if kept is None:
        return None
    arrays = {name: np.asarray(kept[name], dtype=np.float64) for name in (*PER_SAMPLE, *PER_HUMAN)}
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
        raise FileError(path, f"this is no recording that rosbags can read ({_reason(error)}).") from error
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
