"""The robot's side of a ROS 2 system: clock, transforms, odometry, scans and map go out as a real robot sends them.

The odometry frame is the frame that the simulator moves the robot in; it does not drift.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from rvsg.robots.robot import Lidar, Robot
from rvsg.simulation.stacks.protocol import Observation, Scan
from rvsg.world.world import OCCUPIED, UNKNOWN, World
from rvsg_ros2.dds import Bus
from rvsg_ros2.options import Ros2Options

TRANSFORMS_FIRST_S = 1.0
"""Wall time in which transforms go out before the clock does. A costmap that was started without a clock waits for its
transform until 60 s after time 0: where the clock comes first, that time is over at once."""
INITIAL_POSE_VARIANCE = (0.01, 0.01, 0.005)
"""x, y, yaw: the start of a run is known."""


class RobotSide:
    """Publishers of a robot. Times are ROS time in nanoseconds."""

    def __init__(self, bus: Bus, options: Ros2Options, robot: Robot) -> None:
        self.bus, self.options, self.robot = bus, options, robot
        self.T = bus.types
        self._clock = bus.advertise("/clock", "rosgraph_msgs/msg/Clock", depth=1)
        self._tf = bus.advertise("/tf", "tf2_msgs/msg/TFMessage", depth=100)
        self._tf_static = bus.advertise("/tf_static", "tf2_msgs/msg/TFMessage", latched=True, depth=1)
        self._odom = bus.advertise(options.odom, "nav_msgs/msg/Odometry")
        self._initial = bus.advertise(options.initial_pose, "geometry_msgs/msg/PoseWithCovarianceStamped")
        self._scans = [
            bus.advertise(scan_topic(options, robot.lidars, k), "sensor_msgs/msg/LaserScan", depth=5)
            for k in range(len(robot.lidars))
        ]
        self._joints = bus.advertise("/joint_states", "sensor_msgs/msg/JointState") if options.joint_states else None
        self._map: Any = None
        self._scanned = [-math.inf] * len(robot.lidars)
        self.gives_transform = False
        """Whether the transform from map to odom is published, too."""
        self._clock_from = time.monotonic() + TRANSFORMS_FIRST_S
        self._static()

    def close(self) -> None:
        """Publish no more."""
        for each in (self._clock, self._tf, self._tf_static, self._odom, self._initial, *self._scans):
            each.close()
        for optional in (self._joints, self._map):
            if optional is not None:
                optional.close()

    def publish(self, now: int, seen: Observation, *, at: float | None = None) -> None:
        """Send everything that is due.

        Args:
            now: ROS time in nanoseconds, at the observation's time.
            at: seconds since simulated time stands still, where it does: scans are sent again as they pass.
        """
        T, stamp = self.T, self._time(now)
        if at is None or time.monotonic() >= self._clock_from:
            self._clock.publish(T["rosgraph_msgs/msg/Clock"](clock=stamp))
        x, y, yaw = seen.pose
        transforms = [self._transform(now, self.options.odom_frame, self.options.footprint_frame, x, y, yaw)]
        if self.gives_transform:
            transforms.append(
                self._transform(now, self.options.map_frame, self.options.odom_frame, *seen.map_from_odom)
            )
        self._tf.publish(T["tf2_msgs/msg/TFMessage"](transforms=transforms))
        self._odom.publish(self._odometry(now, seen))
        for k, lidar in enumerate(self.robot.lidars):
            self._publish_scan(k, lidar, now, seen, at)

    def _publish_scan(self, k: int, lidar: Lidar, now: int, seen: Observation, at: float | None) -> None:
        if at is not None:
            if at < self._scanned[k] + 1.0 / lidar.rate_hz - 1e-6:
                return
            self._scanned[k] = at
            self._scans[k].publish(self._scan(now, k, lidar, seen.scan(k)))
            return
        scan = seen.scan(k)
        if scan.t > self._scanned[k]:
            self._scanned[k] = scan.t
            self._scans[k].publish(self._scan(now + round((scan.t - seen.t) * 1e9), k, lidar, scan))

    def start_over(self) -> None:
        """Forget when the scans were taken; call it where the clock of the scans begins again."""
        self._scanned = [-math.inf] * len(self.robot.lidars)

    def publish_joints(self, now: int) -> None:
        """Send the joints' positions, all 0, where they are asked for."""
        if self._joints is not None:
            names = list(self.options.joint_states)
            zeros = [0.0] * len(names)
            self._joints.publish(
                self.T["sensor_msgs/msg/JointState"](
                    header=self._header(now, ""), name=names, position=zeros, velocity=zeros, effort=[]
                )
            )

    def publish_map(self, now: int, world: World) -> None:
        """Send the occupancy map, latched."""
        if self._map is None:
            self._map = self.bus.advertise(self.options.map, "nav_msgs/msg/OccupancyGrid", latched=True, depth=1)
        occupancy = world.occupancy
        rows, columns = occupancy.cells.shape
        cells = np.zeros((rows, columns), np.int8)
        cells[occupancy.cells == OCCUPIED] = 100
        cells[occupancy.cells == UNKNOWN] = -1
        origin = occupancy.origin
        info = self.T["nav_msgs/msg/MapMetaData"](
            map_load_time=self._time(now), resolution=float(occupancy.resolution), width=columns, height=rows,
            origin=self.pose(origin.x, origin.y, origin.yaw),
        )  # fmt: skip
        header = self._header(now, self.options.map_frame)
        self._map.publish(self.T["nav_msgs/msg/OccupancyGrid"](header=header, info=info, data=cells.ravel().tolist()))

    def publish_initial_pose(self, now: int, x: float, y: float, yaw: float) -> None:
        """Tell localisation where the robot is in the map."""
        message = self.T["geometry_msgs/msg/PoseWithCovarianceStamped"](
            header=self._header(now, self.options.map_frame)
        )
        message.pose.pose = self.pose(x, y, yaw)
        for index, variance in zip((0, 7, 35), INITIAL_POSE_VARIANCE, strict=True):
            message.pose.covariance[index] = variance
        self._initial.publish(message)

    def pose_stamped(self, now: int, x: float, y: float, yaw: float) -> Any:
        """Return a geometry_msgs/PoseStamped in the map frame."""
        header = self._header(now, self.options.map_frame)
        return self.T["geometry_msgs/msg/PoseStamped"](header=header, pose=self.pose(x, y, yaw))

    def pose(self, x: float, y: float, yaw: float) -> Any:
        """Return a geometry_msgs/Pose."""
        T = self.T
        return T["geometry_msgs/msg/Pose"](
            position=T["geometry_msgs/msg/Point"](x=float(x), y=float(y)),
            orientation=T["geometry_msgs/msg/Quaternion"](z=math.sin(yaw / 2), w=math.cos(yaw / 2)),
        )

    def _static(self) -> None:
        options = self.options
        fixed = []
        if options.footprint_frame != options.base_frame:
            fixed.append(self._transform(0, options.footprint_frame, options.base_frame, 0.0, 0.0, 0.0))
        for k, lidar in enumerate(self.robot.lidars):
            frame = lidar_frame(options, self.robot.lidars, k)
            height = lidar.height_m or 0.0
            fixed.append(self._transform(0, options.base_frame, frame, lidar.x, lidar.y, lidar.yaw, height))
        self._tf_static.publish(self.T["tf2_msgs/msg/TFMessage"](transforms=fixed))

    def _odometry(self, now: int, seen: Observation) -> Any:
        message = self.T["nav_msgs/msg/Odometry"](
            header=self._header(now, self.options.odom_frame), child_frame_id=self.options.footprint_frame
        )
        message.pose.pose = self.pose(*seen.pose)
        message.twist.twist.linear.x, message.twist.twist.angular.z = seen.velocity
        message.twist.twist.linear.y = seen.lateral
        return message

    def _scan(self, now: int, k: int, lidar: Lidar, scan: Scan) -> Any:
        return self.T["sensor_msgs/msg/LaserScan"](
            header=self._header(now, lidar_frame(self.options, self.robot.lidars, k)),
            angle_min=scan.angle_min, angle_max=scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1),
            angle_increment=scan.angle_increment, time_increment=0.0, scan_time=1.0 / lidar.rate_hz,
            range_min=scan.range_min, range_max=scan.range_max, ranges=scan.ranges.tolist(), intensities=[],
        )  # fmt: skip

    def _transform(self, now: int, parent: str, child: str, x: float, y: float, yaw: float, z: float = 0.0) -> Any:
        T = self.T
        return T["geometry_msgs/msg/TransformStamped"](
            header=self._header(now, parent),
            child_frame_id=child,
            transform=T["geometry_msgs/msg/Transform"](
                translation=T["geometry_msgs/msg/Vector3"](x=float(x), y=float(y), z=float(z)),
                rotation=T["geometry_msgs/msg/Quaternion"](z=math.sin(yaw / 2), w=math.cos(yaw / 2)),
            ),
        )

    def _time(self, nanoseconds: int) -> Any:
        seconds, rest = divmod(nanoseconds, 10**9)
        return self.T["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)

    def _header(self, now: int, frame: str) -> Any:
        return self.T["std_msgs/msg/Header"](stamp=self._time(now), frame_id=frame)


def scan_topic(options: Ros2Options, lidars: Sequence[Lidar], index: int) -> str:
    """Return the topic of a lidar."""
    return _filled(options.scan if index == 0 else options.further_scans, lidars[index].name, index)


def lidar_frame(options: Ros2Options, lidars: Sequence[Lidar], index: int) -> str:
    """Return the frame of a lidar."""
    return _filled(options.lidar_frame, lidars[index].name, index)


def _filled(pattern: str, name: str, index: int) -> str:
    plain = "".join(letter if letter.isalnum() else "_" for letter in name)
    return pattern.replace("{name}", plain).replace("{index}", str(index))
