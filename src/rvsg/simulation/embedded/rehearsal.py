"""A tiny episode in an empty room: enough to compile every kernel."""

from __future__ import annotations

import numpy as np

from rvsg.core.records import Pose
from rvsg.scenario.scenario import HumanAgent
from rvsg.world.grid import Grid
from rvsg.world.world import OccupancyMap, Route, World


def empty_room() -> World:
    """A walled room of 6 x 6 m that is nothing but an occupancy map."""
    cells = np.zeros((120, 120), np.uint8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    return World(
        name="room",
        title="An empty room",
        objects=(),
        occupancy=OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=-3.0, y=-3.0)),
        lidar_height_m=0.2,
        grid=Grid(rows=(), columns=(), waypoints=(), hops=()),
        areas=(),
        routes=(),
    )


def rehearsal() -> tuple[World, Route, list[HumanAgent]]:
    """The room, a route of half a second through it, and one human."""
    route = Route(name="rehearsal", start=Pose(x=-1.0, y=0.0), goal=Pose(x=1.5, y=0.5), time_limit_s=0.5)
    human = HumanAgent(name="human", start=(0.5, 1.0), goals=((0.5, 1.0), (0.5, -1.0)), pauses_s=(0.0, 0.0))
    return empty_room(), route, [human]
