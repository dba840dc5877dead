"""A system that drives by the map of another place is refused."""

from __future__ import annotations

import numpy as np
import pytest

from rvsg.world.world import OCCUPIED
from rvsg.world.world_folder import load_world
from rvsg_ros2.interfaces import interfaces
from rvsg_ros2.stack import SAME, share_of_obstacles

T = interfaces("jazzy")


def grid(world: str, *, resolution: float = 0.05, aside_m: float = 0.0) -> object:
    """The map of a shipped world as a map server publishes it."""
    shown = load_world(world).occupancy
    rows, columns = shown.cells.shape
    step = round(resolution / shown.resolution)
    cells = np.where(shown.cells == OCCUPIED, 100, 0)[: rows - rows % step, : columns - columns % step]
    cells = cells.reshape(rows // step, step, columns // step, step).max(axis=(1, 3))
    point = T["geometry_msgs/msg/Point"](x=shown.origin.x + aside_m, y=shown.origin.y, z=0.0)
    level = T["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    origin = T["geometry_msgs/msg/Pose"](position=point, orientation=level)
    at, (height, width) = T["builtin_interfaces/msg/Time"](sec=0, nanosec=0), cells.shape
    info = T["nav_msgs/msg/MapMetaData"](
        map_load_time=at, resolution=resolution, width=width, height=height, origin=origin
    )
    header = T["std_msgs/msg/Header"](stamp=at, frame_id="map")
    return T["nav_msgs/msg/OccupancyGrid"](header=header, info=info, data=cells.ravel().tolist())


@pytest.mark.parametrize(("resolution", "aside_m"), [(0.05, 0.0), (0.1, 0.0), (0.05, 0.1)])
def test_the_map_of_the_world_is_taken_in_other_resolutions_too(resolution: float, aside_m: float) -> None:
    shown = grid("warehouse", resolution=resolution, aside_m=aside_m)
    assert share_of_obstacles(shown, load_world("warehouse").occupancy) > 0.95


@pytest.mark.parametrize("world", ["hospital", "office"])
def test_the_map_of_another_world_is_not(world: str) -> None:
    assert share_of_obstacles(grid(world), load_world("warehouse").occupancy) < SAME
