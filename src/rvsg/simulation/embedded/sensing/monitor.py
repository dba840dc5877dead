"""Nav2's collision monitor: what the lidars see in its polygons, or soon will, scales the command to the base."""

from __future__ import annotations

import math

from rvsg.core.kernels import inner
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded.scene import Scene
from rvsg.simulation.embedded.sensing.lidar import FAR
from rvsg.simulation.embedded.sensing.perception import rays_of, sense
from rvsg.simulation.embedded.sensing.safety import encloses
from rvsg.simulation.embedded.stack import LIDAR_MIN
from rvsg.simulation.embedded.state import Settings, State

# Columns of the table of polygons; LINEAR and ANGULAR are limits (m/s, rad/s), TIME and STEP of the simulated motion.
ACTION, MIN_POINTS, RATIO, LINEAR, ANGULAR, TIME, STEP, FIRST, END = range(9)
STOP, SLOWDOWN, LIMIT, APPROACH = range(4)
NOWHERE = 1e9


@inner
def keep_returns(scene: Scene, state: State, settings: Settings, side: int) -> None:
    """Keep where the latest scan of a lidar returned near the robot, in the world frame."""
    x, y, bearing = sense(scene, state, settings, side)
    cos, sin = math.cos(bearing), math.sin(bearing)
    ranges = state.ranges[side, : rays_of(state, side)]
    directions, kept = state.directions[side], state.returns[side]
    kept[:] = NOWHERE
    least, reach = state.stack.lidars[side, LIDAR_MIN], state.stack.monitor_reach
    for k in range(ranges.size):
        if least <= ranges[k] < FAR:
            px = x + ranges[k] * (cos * directions[k, 0] - sin * directions[k, 1])
            py = y + ranges[k] * (sin * directions[k, 0] + cos * directions[k, 1])
            if math.hypot(px - state.body[base.X], py - state.body[base.Y]) <= reach:
                kept[k, 0], kept[k, 1] = px, py


@inner
def points_inside(state: State, polygon: int, x: float, y: float, yaw: float) -> int:
    """Return how many returns lie in a polygon of a base at a pose."""
    row, corners = state.stack.monitor[polygon], state.stack.monitor_corners
    cos, sin = math.cos(yaw), math.sin(yaw)
    found = 0
    for side in range(state.returns.shape[0]):
        for k in range(state.returns.shape[1]):
            dx, dy = state.returns[side, k, 0] - x, state.returns[side, k, 1] - y
            if dx < NOWHERE / 2 and encloses(
                corners, int(row[FIRST]), int(row[END]), cos * dx + sin * dy, cos * dy - sin * dx
            ):
                found += 1
    return found


@inner
def collision_time(state: State, polygon: int, v: float, side: float, w: float) -> float:
    """Return when a base at (v, side, w) gets something into a polygon; -1 where not within its time."""
    row = state.stack.monitor[polygon]
    x, y, yaw = state.body[base.X], state.body[base.Y], state.body[base.YAW]
    if points_inside(state, polygon, x, y, yaw) >= row[MIN_POINTS]:
        return 0.0
    t = 0.0
    while t <= row[TIME]:
        x += v * row[STEP] * math.cos(yaw) - side * row[STEP] * math.sin(yaw)
        y += v * row[STEP] * math.sin(yaw) + side * row[STEP] * math.cos(yaw)
        yaw += w * row[STEP]
        if points_inside(state, polygon, x, y, yaw) >= row[MIN_POINTS]:
            return t
        t += float(row[STEP])
    return -1.0


@inner
def ratio_of(state: State, polygon: int, v: float, side: float, w: float) -> float:
    """Return by what a polygon scales the command (v, side, w)."""
    row, body = state.stack.monitor[polygon], state.body
    if row[ACTION] == APPROACH:
        t = collision_time(state, polygon, v, side, w)
        return 1.0 if t < 0.0 else min(1.0, t / float(row[TIME]))
    if points_inside(state, polygon, body[base.X], body[base.Y], body[base.YAW]) < row[MIN_POINTS]:
        return 1.0
    if row[ACTION] == STOP:
        return 0.0
    if row[ACTION] == SLOWDOWN:
        return float(row[RATIO])
    ratio = 1.0
    if side != 0.0:
        ratio = min(ratio, row[LINEAR] / math.hypot(v, side))
    elif v != 0.0:
        ratio = min(ratio, row[LINEAR] / abs(v))
    if w != 0.0:
        ratio = min(ratio, row[ANGULAR] / abs(w))
    return ratio


@inner
def scale_command(state: State) -> None:
    """Scale the command that the base carries out now by the most restrictive polygon."""
    body = state.body
    v, side, w = body[base.SMOOTH_V], body[base.SMOOTH_SIDE], body[base.SMOOTH_W]
    if body[base.DIRECT] != 0.0:
        v, side, w = body[base.COMMAND_V], body[base.COMMAND_SIDE], body[base.COMMAND_W]
    ratio = 1.0
    if v != 0.0 or side != 0.0 or w != 0.0:
        for polygon in range(state.stack.monitor.shape[0]):
            ratio = min(ratio, ratio_of(state, polygon, v, side, w))
    body[base.RATIO] = ratio
