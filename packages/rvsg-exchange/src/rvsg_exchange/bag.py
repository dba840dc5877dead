"""A run as a rosbag2 (MCAP): what Foxglove, RViz and `ros2 bag play` show. Needs rosbags (extra `bag`).

Topics: `/clock`, `/tf`, `/tf_static`, `/odom`, `/accel`, `/imu`, `/people` (visualization_msgs/MarkerArray),
`/human_states` (hunav_msgs/Agents), `/map` (latched), `/goal_pose`, and `/rvsg/run` (std_msgs/String: scenario id,
seed, simulator options, outcome, time limit, the study's 2 Hz log and the acceleration of every 10 ms as JSON).

With a trace also the topics of `rvsg_exchange.bag_messages`. The chunks of the file are compressed with zstd.
"""

from __future__ import annotations

import json
import math
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rvsg.core.errors import FileError
from rvsg.simulation.archive import LATERAL, PER_HUMAN, PER_SAMPLE, header_of, series_of
from rvsg.simulation.run import Run, Trajectory
from rvsg.world.world import OCCUPIED, UNKNOWN, World
from rvsg_exchange.bag_messages import BASE_FRAME, Messages, TraceMessages, rosbags_types

if TYPE_CHECKING:
    from rvsg.simulation.embedded.trace import Trace

GRAVITY_M_S2 = 9.80665
LATCHED_OFFSET_S = 1.0
CYLINDER = 3
"""visualization_msgs/Marker.CYLINDER."""


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
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    if path.is_dir():
        raise FileError(path, "this is a folder; give the name of a file, such as run.mcap.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".") as folder:
            writer = Writer(Path(folder) / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            with writer:
                _Bag(writer, types).write(run, world, trace)
            made = next((Path(folder) / "bag").glob("*.mcap"))
            shutil.move(made, path)
    except OSError as error:
        raise FileError(path, f"the file cannot be written: {error.strerror or error}.") from None


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
        events = [*self._latched_ones(run, world, trace), *self._samples(run), *self._imu(run)]
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
            moved = self.transform(stamp, "odom", BASE_FRAME, x, y, yaw)
            yield at, "/tf", self.make("tf2_msgs/TFMessage", transforms=[moved])
            side = float(path.lateral[k]) if path.lateral.size else 0.0
            twist = self.twist(float(path.v[k]), float(path.omega[k]), side)
            yield at, "/odom", self._odometry(stamp, x, y, yaw, twist)
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

    def _imu(self, run: Run) -> Iterator[tuple[int, str, Any]]:
        """Yield what an IMU at the base's origin measures, averaged over the time between two samples.

        The base of the simulator takes on a commanded speed within 10 ms, so accelerations over less than a control
        period are no measure of what a robot feels.
        """
        path, none = run.trajectory, np.zeros(9)
        step = np.maximum(np.diff(path.t, prepend=path.t[:1] - 1.0), 1e-9)
        forward, left = np.diff(path.v, prepend=path.v[:1]) / step, path.v * path.omega
        if path.lateral.size:
            forward = forward - path.lateral * path.omega
            left = left + np.diff(path.lateral, prepend=path.lateral[:1]) / step
        for k in range(len(path)):
            stamp, at = self.time(float(path.t[k]))
            message = self.make(
                "sensor_msgs/Imu",
                header=self.header(stamp, BASE_FRAME),
                orientation=self.turn(float(path.yaw[k])),
                orientation_covariance=none,
                angular_velocity=self.vector(0.0, 0.0, float(path.omega[k])),
                angular_velocity_covariance=none,
                linear_acceleration=self.vector(float(forward[k]), float(left[k]), GRAVITY_M_S2),
                linear_acceleration_covariance=none,
            )
            yield at, "/imu", message

    def _odometry(self, stamp: Any, x: float, y: float, yaw: float, twist: Any) -> Any:
        none = np.zeros(36)
        return self.make(
            "nav_msgs/Odometry",
            header=self.header(stamp, "odom"),
            child_frame_id=BASE_FRAME,
            pose=self.make("geometry_msgs/PoseWithCovariance", pose=self.pose(x, y, yaw), covariance=none),
            twist=self.make("geometry_msgs/TwistWithCovariance", twist=twist, covariance=none),
        )

    def _map(self, stamp: Any, world: World) -> Any:
        occupancy = world.occupancy
        cells = np.zeros(occupancy.cells.shape, np.int8)
        cells[occupancy.cells == OCCUPIED] = 100
        cells[occupancy.cells == UNKNOWN] = -1
        origin = occupancy.origin
        return self.grid(stamp, "map", cells, occupancy.resolution, (origin.x, origin.y, origin.yaw))

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
        markers = []
        for i, name in enumerate(run.human_names):
            across = 2 * run.human_radius_m[i]
            place = self.pose(path.human_x[k, i] - dx, path.human_y[k, i] - dy, float(path.human_yaw[k, i]), 0.85)
            markers.append(self.marker(stamp, "map", "people", i, CYLINDER, place, (across, across, 1.7), text=name))
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
