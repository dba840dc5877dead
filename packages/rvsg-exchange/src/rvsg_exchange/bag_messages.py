"""ROS 2 messages made from plain numbers.

A trace as ROS 2 messages: what the robot sees, plans and tries, under the topics of Nav2.

Topics: `/scan_K` for every lidar, `/cmd_vel`, `/plan`, `/local_costmap/costmap` (5 Hz), `/global_costmap/costmap`
(when it changes), `/evaluation` (dwb_msgs/LocalPlanEvaluation, with the score of every critic) and
`/local_trajectories` (a marker for Foxglove and RViz), both at 1 Hz, `/local_plan` (the chosen trajectory),
`/behavior_tree_log` (nav2_msgs/BehaviorTreeLog) and `/rvsg/navigation` (std_msgs/String: the phase and the number of
recoveries as JSON, when they change).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rvsg.core.errors import InputError, how_to_install

if TYPE_CHECKING:
    from rvsg.robots.robot import Lidar
    from rvsg.simulation.embedded.trace import Evaluation, Frame, Trace


START_S = 10
"""Time 0 of a run is second 10 of the bag: ROS has no negative time, and the map comes before the first sample."""
BASE_FRAME = "base_footprint"


class Messages:
    """Makes the messages of a bag. Times are those of the run, lengths in metres, angles in radians."""

    def __init__(self, types: Any) -> None:
        self.types, self.T = types, types.types

    def make(self, kind: str, **values: Any) -> Any:
        """Return a message of a kind, such as `nav_msgs/Path`."""
        package, name = kind.split("/")
        return self.T[f"{package}/msg/{name}"](**values)

    def time(self, t: float) -> tuple[Any, int]:
        """Return the stamp of a time of the run, and the same in nanoseconds."""
        nanoseconds = round((t + START_S) * 1e9)
        return self.make("builtin_interfaces/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9), nanoseconds

    def header(self, stamp: Any, frame: str) -> Any:
        """Return a header."""
        return self.make("std_msgs/Header", stamp=stamp, frame_id=frame)

    def turn(self, yaw: float) -> Any:
        """Return the quaternion of a turn about the vertical."""
        return self.make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))

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

    def transform(self, stamp: Any, parent: str, child: str, x: float, y: float, yaw: float) -> Any:
        """Return the transform from a child frame to its parent."""
        transform = self.make("geometry_msgs/Transform", translation=self.vector(x, y), rotation=self.turn(yaw))
        return self.make(
            "geometry_msgs/TransformStamped",
            header=self.header(stamp, parent),
            child_frame_id=child,
            transform=transform,
        )

    def grid(
        self, stamp: Any, frame: str, cells: NDArray[np.int8], resolution: float, origin: tuple[float, float, float]
    ) -> Any:
        """Return an occupancy grid; `origin` is the pose of the corner of cell (0, 0)."""
        rows, columns = cells.shape
        info = self.make(
            "nav_msgs/MapMetaData",
            map_load_time=stamp,
            resolution=resolution,
            width=columns,
            height=rows,
            origin=self.pose(*origin),
        )
        return self.make("nav_msgs/OccupancyGrid", header=self.header(stamp, frame), info=info, data=cells.ravel())

    def marker(
        self, stamp: Any, frame: str, namespace: str, number: int, kind: int, pose: Any,
        scale: tuple[float, float, float], *, text: str = "",
    ) -> Any:  # fmt: skip
        """Return a visualization_msgs/Marker of a kind (3: cylinder, 5: list of lines), orange."""
        none = np.zeros(0, np.uint8)
        return self.make(
            "visualization_msgs/Marker",
            header=self.header(stamp, frame),
            ns=namespace,
            id=number,
            type=kind,
            action=0,
            pose=pose,
            scale=self.vector(*scale),
            color=self.make("std_msgs/ColorRGBA", r=0.9, g=0.4, b=0.1, a=0.8),
            lifetime=self.make("builtin_interfaces/Duration", sec=0, nanosec=0),
            frame_locked=False,
            points=[],
            colors=[],
            texture_resource="",
            texture=self.make("sensor_msgs/CompressedImage", header=self.header(stamp, ""), format="", data=none),
            uv_coordinates=[],
            text=text,
            mesh_resource="",
            mesh_file=self.make("visualization_msgs/MeshFile", filename="", data=none),
            mesh_use_embedded_materials=False,
        )


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

NAV2_TYPES = {
    "nav_2d_msgs/msg/Twist2D": "float64 x\nfloat64 y\nfloat64 theta\n",
    "dwb_msgs/msg/Trajectory2D": """nav_2d_msgs/Twist2D velocity
builtin_interfaces/Duration[] time_offsets
geometry_msgs/Pose2D[] poses
""",
    "dwb_msgs/msg/CriticScore": "string name\nfloat32 raw_score\nfloat32 scale\n",
    "dwb_msgs/msg/TrajectoryScore": "dwb_msgs/Trajectory2D traj\ndwb_msgs/CriticScore[] scores\nfloat32 total\n",
    "dwb_msgs/msg/LocalPlanEvaluation": """std_msgs/Header header
dwb_msgs/TrajectoryScore[] twists
uint16 best_index
uint16 worst_index
""",
    "nav2_msgs/msg/BehaviorTreeStatusChange": """builtin_interfaces/Time timestamp
string node_name
string previous_status
string current_status
""",
    "nav2_msgs/msg/BehaviorTreeLog": """builtin_interfaces/Time timestamp
nav2_msgs/BehaviorTreeStatusChange[] event_log
""",
}
"""The message definitions of Nav2 (Humble), written from its interface description."""


def rosbags_types() -> Any:
    """Return the ROS 2 message types with those of HuNavSim and Nav2; InputError where rosbags is not installed."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise InputError(f"Bags need rosbags: {how_to_install('bag')}.") from None
    types = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in (HUNAV_TYPES | NAV2_TYPES).items():
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
            time_increment=0.0,
            scan_time=1.0 / lidar.rate_hz,
            range_min=lidar.min_range_m,
            range_max=lidar.max_range_m,
            ranges=ranges.astype(np.float32),
            intensities=np.zeros(0, np.float32),
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
                    time_offsets=[],
                    poses=[start, self.make("geometry_msgs/Pose2D", x=float(ex), y=float(ey), theta=0.0)],
                ),
                scores=self._critics(tried, k) if math.isfinite(score) else [],
                total=float(score) if math.isfinite(score) else -1.0,
            )
            for k, ((v, w, *side), (ex, ey), score) in enumerate(samples)
        ]
        yield (
            at,
            "/evaluation",
            self.make(
                "dwb_msgs/LocalPlanEvaluation",
                header=self.header(stamp, "odom"),
                twists=twists,
                best_index=max(0, tried.best),
                worst_index=worst,
            ),
        )
        yield at, "/local_trajectories", self._lines(stamp, tried)
        if tried.best >= 0:
            yield at, "/local_plan", self._path(stamp, "odom", arc(tried.pose, tried.end[tried.best]))

    def _critics(self, tried: Evaluation, sample: int) -> list[Any]:
        """Return what each critic says of a sample; scale times raw score adds up to the total."""
        rows = zip(tried.critics, tried.scales, tried.raw[sample] if tried.critics else (), strict=True)
        return [
            self.make("dwb_msgs/CriticScore", name=name, raw_score=float(raw), scale=float(scale))
            for name, scale, raw in rows
        ]

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
            stamp, "odom", "local trajectories", 0, LINE_LIST, self.pose(0.0, 0.0, 0.0), (0.01, 0.0, 0.0)
        )
        lines.points, lines.colors = points, colours
        return self.make("visualization_msgs/MarkerArray", markers=[lines])

    def _tree(self) -> Iterator[Event]:
        """Yield the changes of the behaviour tree's nodes, one message for each time."""
        times = dict.fromkeys(change.t for change in self.trace.nodes)
        for t in times:
            stamp, at = self.time(t)
            changes = [
                self.make(
                    "nav2_msgs/BehaviorTreeStatusChange",
                    timestamp=stamp,
                    node_name=change.node,
                    previous_status=change.before,
                    current_status=change.after,
                )
                for change in self.trace.nodes
                if change.t == t
            ]
            yield at, "/behavior_tree_log", self.make("nav2_msgs/BehaviorTreeLog", timestamp=stamp, event_log=changes)


def arc(pose: tuple[float, float, float], end: NDArray[np.float64], points: int = 12) -> NDArray[np.float64]:
    """Return points on the arc that leaves a pose in its direction and ends at a place, (points, 2)."""
    x, y, yaw = pose
    dx, dy = float(end[0]) - x, float(end[1]) - y
    ahead, left = math.cos(yaw) * dx + math.sin(yaw) * dy, -math.sin(yaw) * dx + math.cos(yaw) * dy
    share = np.linspace(0.0, 1.0, points)
    if abs(left) < 1e-6:
        u, v = ahead * share, 0.0 * share
    else:
        radius = (ahead**2 + left**2) / (2.0 * left)
        turned = 2.0 * math.atan2(left, ahead) * share
        u, v = radius * np.sin(turned), radius * (1.0 - np.cos(turned))
    return np.column_stack([x + math.cos(yaw) * u - math.sin(yaw) * v, y + math.sin(yaw) * u + math.cos(yaw) * v])
