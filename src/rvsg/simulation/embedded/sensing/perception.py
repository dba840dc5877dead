"""Updates of the robot's costmaps: scans of both lidars, entered into the local and the global map."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rvsg.core.kernels import inner
from rvsg.simulation.embedded import base
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.navigation.costmap import (
    FREE,
    UNKNOWN,
    VOXEL_SHORTENING_CELLS,
    clear_footprint,
    inflate_marks,
    merge_global,
    observe,
    shift,
)
from rvsg.simulation.embedded.navigation.planners.navfn import convert
from rvsg.simulation.embedded.scene import TILE_M, Scene
from rvsg.simulation.embedded.sensing.lidar import FAR, NO_RETURN, scan
from rvsg.simulation.embedded.sensing.localisation import MAP_YAW, to_map
from rvsg.simulation.embedded.stack import (
    LIDAR_DROPOUT,
    LIDAR_MAX,
    LIDAR_MIN,
    LIDAR_NOISE,
    LIDAR_RAYS,
    LIDAR_VIEW,
    LIDAR_X,
    LIDAR_Y,
    LIDAR_YAW,
)
from rvsg.simulation.embedded.state import DROPOUT_AT, NOISE_AT, WINDOW_COLUMN, WINDOW_ROW, Settings, State

Floats = NDArray[np.float64]


@inner
def sense(scene: Scene, state: State, settings: Settings, side: int) -> tuple[float, float, float]:
    """The latest noisy scan of a lidar into `state.ranges`.

    Returns the lidar's position (x, y) in the world and the first ray's bearing when the scan was taken.
    """
    mount = state.stack.lidars[side]
    scanned = state.scanned[side]
    yaw = scanned[2]
    x = scanned[0] + mount[LIDAR_X] * math.cos(yaw) - mount[LIDAR_Y] * math.sin(yaw)
    y = scanned[1] + mount[LIDAR_X] * math.sin(yaw) + mount[LIDAR_Y] * math.cos(yaw)
    bearing = yaw + mount[LIDAR_YAW] - 0.5 * mount[LIDAR_VIEW]
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
    return x, y, bearing


@inner
def rays_of(state: State, side: int) -> int:
    """Return how many ranges a scan of a lidar has."""
    return int(state.stack.lidars[side, LIDAR_RAYS])


@inner
def move_window(state: State) -> None:
    """Let the local window follow the robot by whole cells, truncated towards zero, as Nav2 does.

    The wanted corner lies (60 - 0.5) cells / 2 below the robot.
    """
    half = 0.5 * (state.stack.cells - 0.5)
    columns = int(state.body[base.X] / state.stack.resolution - half - state.nav[WINDOW_COLUMN])
    rows = int(state.body[base.Y] / state.stack.resolution - half - state.nav[WINDOW_ROW])
    for side in range(state.stack.lidars.shape[0]):
        shift(state.local[side], columns, rows)
    state.nav[WINDOW_COLUMN] += columns
    state.nav[WINDOW_ROW] += rows


@inner
def update_local(scene: Scene, state: State, settings: Settings) -> None:
    """Update of the local costmap: window, both voxel layers, footprint, inflation; first clear all if asked to."""
    if state.nav[st.CLEAR_LOCAL] != 0:
        state.nav[st.CLEAR_LOCAL] = 0
        state.local[:] = FREE
    move_window(state)
    left = state.nav[WINDOW_COLUMN]
    low = state.nav[WINDOW_ROW]
    for side in range(state.stack.lidars.shape[0]):
        layer = state.local[side]
        x, y, bearing = sense(scene, state, settings, side)
        observe(
            layer, state.ranges[side, : rays_of(state, side)], state.directions[side],
            x / state.stack.resolution - left, y / state.stack.resolution - low, bearing,
            state.stack.resolution, VOXEL_SHORTENING_CELLS, state.stack.obstacle_range,
            state.stack.clearing_range, state.stack.lidars[side, LIDAR_MIN],
        )  # fmt: skip
        clear_footprint(
            layer, state.spans, state.body[base.X] / state.stack.resolution - left,
            state.body[base.Y] / state.stack.resolution - low, state.body[base.YAW], state.stack.resolution,
            state.stack.footprint,
        )  # fmt: skip
    inflate_marks(state.local[st.MASTER], state.local[: st.MASTER], scene.local_costs)


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
        x, y, bearing = sense(scene, state, settings, side)
        x, y = to_map(state.own.present, x, y)
        observe(
            layer, state.ranges[side, : rays_of(state, side)], state.directions[side],
            (x - scene.origin_x) / scene.resolution, (y - scene.origin_y) / scene.resolution, bearing + turn,
            scene.resolution, 0.0, state.stack.obstacle_range, state.stack.clearing_range,
            state.stack.lidars[side, LIDAR_MIN],
        )  # fmt: skip
        clear_footprint(
            layer, state.spans, column, row, state.body[base.YAW] + turn, scene.resolution, state.stack.footprint
        )
    rows, columns = state.global_master.shape
    # Rays change cells up to their clearing range from a lidar; the rest covers the lidar's place on the robot and what
    # the robot moved since.
    half = (
        max(rows, columns) if everywhere else int((state.stack.clearing_range + state.stack.margin) / scene.resolution)
    )
    top, left, bottom, right = merge_global(
        state.global_master, scene.static, scene.inflated, state.layers, scene.global_costs,
        int(row), int(column), half,
    )  # fmt: skip
    convert(state.costs, state.global_master, scene.table, top, left, bottom, right)
