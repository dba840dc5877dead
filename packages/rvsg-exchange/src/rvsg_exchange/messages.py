"""ROS 2 messages made from plain numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
