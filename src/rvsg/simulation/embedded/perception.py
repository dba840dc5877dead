"""Updates of the costmaps, the safety zones and the collision monitor by the scans of the lidars."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner
from rvsg.simulation.costmap import (
    FAR,
    FREE,
    UNKNOWN,
    VOXEL_SHORTENING_CELLS,
    clear_footprint,
    inflate_marks,
    merge_global,
    observe,
    shift,
)
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.dwb import SHARE
from rvsg.simulation.embedded.lidar import NO_RETURN, first_ray, scan
from rvsg.simulation.embedded.localisation import MAP_YAW, to_map
from rvsg.simulation.embedded.navfn import convert
from rvsg.simulation.embedded.robot_parameters import (
    LIDAR_DROPOUT,
    LIDAR_MAX,
    LIDAR_MIN,
    LIDAR_NOISE,
    LIDAR_RAYS,
    LIDAR_VIEW,
)
from rvsg.simulation.embedded.state import (
    DROPOUT_AT,
    NOISE_AT,
    TILE_M,
    WINDOW_COLUMN,
    WINDOW_ROW,
    Scene,
    Settings,
    State,
)
from rvsg.simulation.embedded.walls import is_inside

Floats = NDArray[np.float64]


@inner
def sense(scene: Scene, state: State, settings: Settings, side: int) -> tuple[Floats, float, float, float]:
    """Return the latest noisy scan of a lidar, the lidar's position (x, y) in the world and the first ray's bearing."""
    mount = state.stack.lidars[side]
    x, y, bearing = first_ray(mount, state.scanned[side])
    rays = int(mount[LIDAR_RAYS])
    tile = 0
    if scene.tile_columns * scene.tile_rows > 1:
        column = min(scene.tile_columns - 1, max(0, int((x - scene.tile_x) / TILE_M)))
        row = min(scene.tile_rows - 1, max(0, int((y - scene.tile_y) / TILE_M)))
        tile = row * scene.tile_columns + column
    near = scene.tile_edges[scene.tile_start[tile] : scene.tile_start[tile + 1]]
    ranges = state.ranges[side, :rays]
    scan(
        ranges, state.directions[side], x, y, bearing, scene.edges, near, state.legs[side], settings.closed,
        mount[LIDAR_VIEW], state.stack.scan_reach,
    )  # fmt: skip
    at = state.nav[NOISE_AT]
    noise = state.noise
    for k in range(rays):
        if 0.0 < ranges[k] < FAR:
            if ranges[k] > mount[LIDAR_MAX]:
                ranges[k] = NO_RETURN
                continue
            if mount[LIDAR_DROPOUT] > 0.0:
                state.nav[DROPOUT_AT] = (state.nav[DROPOUT_AT] + 1) % state.dropouts.size
                if state.dropouts[state.nav[DROPOUT_AT]] < mount[LIDAR_DROPOUT]:
                    ranges[k] = NO_RETURN
                    continue
            ranges[k] += settings.lidar_noise * mount[LIDAR_NOISE] * noise[at % noise.size]
            at += 1
    state.nav[NOISE_AT] = at
    return ranges, x, y, bearing


@inner
def update_local(scene: Scene, state: State, settings: Settings) -> None:
    """Update of the local costmap: window, both voxel layers, footprint, inflation; first clear all if asked to."""
    if state.nav[st.CLEAR_LOCAL] != 0:
        state.nav[st.CLEAR_LOCAL] = 0
        state.local[:] = FREE
    # The window follows the robot by whole cells, truncated towards zero, as Nav2 does; the wanted corner lies half of
    # the cells, less a quarter of one, below the robot.
    half = 0.5 * (state.stack.cells - 0.5)
    columns = int(state.body[base.X] / state.stack.resolution - half - state.nav[WINDOW_COLUMN])
    rows = int(state.body[base.Y] / state.stack.resolution - half - state.nav[WINDOW_ROW])
    for side in range(state.stack.lidars.shape[0]):
        shift(state.local[side], columns, rows)
    state.nav[WINDOW_COLUMN] += columns
    state.nav[WINDOW_ROW] += rows
    left = state.nav[WINDOW_COLUMN]
    low = state.nav[WINDOW_ROW]
    for side in range(state.stack.lidars.shape[0]):
        layer = state.local[side]
        ranges, x, y, bearing = sense(scene, state, settings, side)
        observe(
            layer, ranges, state.directions[side],
            x / state.stack.resolution - left, y / state.stack.resolution - low, bearing,
            state.stack.resolution, VOXEL_SHORTENING_CELLS, state.stack.maps.obstacle_range_m,
            state.stack.maps.clearing_range_m, state.stack.lidars[side, LIDAR_MIN],
        )  # fmt: skip
        clear_footprint(
            layer, state.spans, state.body[base.X] / state.stack.resolution - left,
            state.body[base.Y] / state.stack.resolution - low, state.body[base.YAW], state.stack.resolution,
            state.stack.footprint,
        )  # fmt: skip
    inflate_marks(state.local[st.MASTER], state.local[: st.MASTER], scene.local_costs)
    if scene.keepout.size > 0:
        keep_out(scene, state)
    if scene.local_shares.size > 0:
        limit_speed(scene, state, scene.local_shares)


@inner
def cell_at(scene: Scene, state: State, x: float, y: float) -> tuple[int, int]:
    """Return row and column of the map where the robot believes a place to be; (-1, -1) where that is off the map."""
    x, y = to_map(state.own.present, x, y)
    row = math.floor((y - scene.origin_y) / scene.resolution)
    column = math.floor((x - scene.origin_x) / scene.resolution)
    rows, columns = scene.static.shape
    return (row, column) if 0 <= row < rows and 0 <= column < columns else (-1, -1)


@inner
def keep_out(scene: Scene, state: State) -> None:
    """Raise the cells of the local costmap to what keepout filters say of their centres; nothing inflates them."""
    master = state.local[st.MASTER]
    side = state.stack.resolution
    for r in range(master.shape[0]):
        for c in range(master.shape[1]):
            row, column = cell_at(
                scene, state, (state.nav[WINDOW_COLUMN] + c + 0.5) * side, (state.nav[WINDOW_ROW] + r + 0.5) * side
            )
            if row >= 0 and scene.keepout[row, column] != UNKNOWN:
                master[r, c] = max(master[r, c], scene.keepout[row, column])


@inner
def limit_speed(scene: Scene, state: State, shares: Floats) -> None:
    """Take over the limit of a speed filter where the robot believes itself; without one there the limit stays."""
    row, column = cell_at(scene, state, state.body[base.X], state.body[base.Y])
    if row >= 0 and shares[row, column] >= 0.0:
        state.times[SHARE] = shares[row, column]


@inner
def update_global(scene: Scene, state: State, settings: Settings) -> None:
    """Update of the global costmap around the robot, or everywhere where it is to be cleared first; map frame."""
    everywhere = state.nav[st.CLEAR_GLOBAL] != 0
    if everywhere:
        state.nav[st.CLEAR_GLOBAL] = 0
        state.layers[:] = UNKNOWN
    turn = state.own.present[MAP_YAW]
    x, y = to_map(state.own.present, state.body[base.X], state.body[base.Y])
    column = (x - scene.origin_x) / scene.resolution
    row = (y - scene.origin_y) / scene.resolution
    for side in range(state.stack.lidars.shape[0]):
        layer = state.layers[side]
        ranges, x, y, bearing = sense(scene, state, settings, side)
        x, y = to_map(state.own.present, x, y)
        observe(
            layer, ranges, state.directions[side],
            (x - scene.origin_x) / scene.resolution, (y - scene.origin_y) / scene.resolution, bearing + turn,
            scene.resolution, 0.0, state.stack.maps.obstacle_range_m, state.stack.maps.clearing_range_m,
            state.stack.lidars[side, LIDAR_MIN],
        )  # fmt: skip
        clear_footprint(
            layer, state.spans, column, row, state.body[base.YAW] + turn, scene.resolution, state.stack.footprint
        )
    rows, columns = state.global_master.shape
    # Rays change cells up to their clearing range from a lidar; the rest covers the lidar's place on the robot and what
    # the robot moved since.
    reach = state.stack.maps.clearing_range_m + state.stack.margin
    half = max(rows, columns) if everywhere else int(reach / scene.resolution)
    top, left, bottom, right = merge_global(
        state.global_master, scene.static, scene.inflated, state.layers, scene.global_costs,
        int(row), int(column), half,
    )  # fmt: skip
    convert(state.costs, state.global_master, scene.table, top, left, bottom, right)
    if scene.global_shares.size > 0:
        limit_speed(scene, state, scene.global_shares)


# Columns of the table of zones.
SPEED, FROM_SPEED, RELEASE, ZONE_FIRST, ZONE_END, SIDE = range(6)


@inner
def watch_zones(scene: Scene, state: State, settings: Settings, side: int, t: float) -> None:
    """Look for returns of the latest scan of a lidar in the safety zones, and set the speed limits of the base.

    A zone is watched from its speed on, and after that until it has been clear for its release time. A zone ahead of
    the base limits the forward speed, one behind it the reverse speed, one around it both.
    """
    zones = state.stack.zones
    ranges, x, y, bearing = sense(scene, state, settings, side)
    scanned = state.scanned[side]
    cos = math.cos(scanned[2])
    sin = math.sin(scanned[2])
    from_x = cos * (x - scanned[0]) + sin * (y - scanned[1])
    from_y = cos * (y - scanned[1]) - sin * (x - scanned[0])
    turn_cos = math.cos(bearing - scanned[2])
    turn_sin = math.sin(bearing - scanned[2])
    directions = state.directions[side]
    least = state.stack.lidars[side, LIDAR_MIN]
    for k in range(ranges.size):
        if ranges[k] < least or ranges[k] >= FAR:
            continue
        px = from_x + ranges[k] * (turn_cos * directions[k, 0] - turn_sin * directions[k, 1])
        py = from_y + ranges[k] * (turn_sin * directions[k, 0] + turn_cos * directions[k, 1])
        for zone in range(zones.shape[0]):
            corners = state.stack.zone_corners[int(zones[zone, ZONE_FIRST]) : int(zones[zone, ZONE_END])]
            speed = max(abs(state.body[base.V]), abs(state.body[base.SIDE]))
            watched = speed >= zones[zone, FROM_SPEED] or t < state.zone_until[zone]
            if watched and is_inside(corners, px, py):
                state.zone_until[zone] = t + zones[zone, RELEASE]
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


# Columns of the table of polygons; LINEAR and ANGULAR are limits (m/s, rad/s), TIME and STEP of the simulated motion.
ACTION, MIN_POINTS, RATIO, LINEAR, ANGULAR, TIME, STEP, FIRST, END = range(9)
STOP, SLOWDOWN, LIMIT, APPROACH = range(4)
NOWHERE = 1e9


@inner
def keep_returns(scene: Scene, state: State, settings: Settings, side: int) -> None:
    """Keep where the latest scan of a lidar returned near the robot, in the world frame."""
    ranges, x, y, bearing = sense(scene, state, settings, side)
    cos, sin = math.cos(bearing), math.sin(bearing)
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
    row = state.stack.monitor[polygon]
    corners = state.stack.monitor_corners[int(row[FIRST]) : int(row[END])]
    cos, sin = math.cos(yaw), math.sin(yaw)
    found = 0
    for side in range(state.returns.shape[0]):
        for k in range(state.returns.shape[1]):
            dx, dy = state.returns[side, k, 0] - x, state.returns[side, k, 1] - y
            if dx < NOWHERE / 2 and is_inside(corners, cos * dx + sin * dy, cos * dy - sin * dx):
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
