"""Safety scanners: what the lidars see in a zone of the robot limits the speed of its base."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.scene import Scene
from rvsg.simulation.embedded.sensing.lidar import FAR
from rvsg.simulation.embedded.sensing.perception import rays_of, sense
from rvsg.simulation.embedded.stack import LIDAR_MIN, Stack
from rvsg.simulation.embedded.state import Settings, State

Floats = NDArray[np.float64]

# Columns of the table of zones.
SPEED, FROM_SPEED, RELEASE, FIRST, END, SIDE = range(6)


@inner
def encloses(corners: Floats, first: int, end: int, x: float, y: float) -> bool:
    """Whether the polygon of the corners `first` to `end` encloses a point."""
    found = False
    j = end - 1
    for i in range(first, end):
        ax, ay = corners[i, 0], corners[i, 1]
        bx, by = corners[j, 0], corners[j, 1]
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            found = not found
        j = i
    return found


@inner
def is_in_zone(stack: Stack, zone: int, x: float, y: float) -> bool:
    """Whether a point in the base frame lies in a safety zone."""
    return encloses(stack.zone_corners, int(stack.zones[zone, FIRST]), int(stack.zones[zone, END]), x, y)


@inner
def watch_zones(scene: Scene, state: State, settings: Settings, side: int, t: float) -> None:
    """Look for returns of the latest scan of a lidar in the safety zones, and set the speed limits of the base.

    A zone is watched from its speed on, and after that until it has been clear for its release time. A zone ahead of
    the base limits the forward speed, one behind it the reverse speed, one around it both.
    """
    zones = state.stack.zones
    x, y, bearing = sense(scene, state, settings, side)
    scanned = state.scanned[side]
    cos = math.cos(scanned[2])
    sin = math.sin(scanned[2])
    from_x = cos * (x - scanned[0]) + sin * (y - scanned[1])
    from_y = cos * (y - scanned[1]) - sin * (x - scanned[0])
    turn_cos = math.cos(bearing - scanned[2])
    turn_sin = math.sin(bearing - scanned[2])
    ranges = state.ranges[side, : rays_of(state, side)]
    directions = state.directions[side]
    least = state.stack.lidars[side, LIDAR_MIN]
    for k in range(ranges.size):
        if ranges[k] < least or ranges[k] >= FAR:
            continue
        px = from_x + ranges[k] * (turn_cos * directions[k, 0] - turn_sin * directions[k, 1])
        py = from_y + ranges[k] * (turn_sin * directions[k, 0] + turn_cos * directions[k, 1])
        for zone in range(zones.shape[0]):
            speed = max(abs(state.body[base.V]), abs(state.body[base.SIDE]))
            watched = speed >= zones[zone, FROM_SPEED] or t < state.zone_until[zone]
            if watched and is_in_zone(state.stack, zone, px, py):
                state.zone_until[zone] = t + zones[zone, RELEASE]
    limit_speed(state, t)


@inner
def limit_speed(state: State, t: float) -> None:
    """Set the speed limits of the base from the zones that hold now."""
    zones = state.stack.zones
    ahead = base.NO_CAP
    behind = base.NO_CAP
    for zone in range(zones.shape[0]):
        if t < state.zone_until[zone]:
            if zones[zone, SIDE] >= 0.0:
                ahead = min(ahead, zones[zone, SPEED])
            if zones[zone, SIDE] <= 0.0:
                behind = min(behind, zones[zone, SPEED])
    state.body[base.CAP_AHEAD] = ahead
    state.body[base.CAP_BEHIND] = behind
