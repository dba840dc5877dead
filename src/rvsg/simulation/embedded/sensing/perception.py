"""What the robot's costmaps learn: scans of both lidars entered into the local and the global map."""

from __future__ import annotations

import math

from rvsg.simulation.embedded import base
from rvsg.simulation.embedded import state as st
from rvsg.simulation.embedded.compiled import inner
from rvsg.simulation.embedded.navigation.costmap import (
    CLEARING_RANGE_M,
    FREE,
    LOCAL_CELLS,
    LOCAL_RESOLUTION_M,
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
from rvsg.simulation.embedded.sensing.lidar import FAR, FIELD_OF_VIEW_RAD, FRONT, REAR, scan
from rvsg.simulation.embedded.sensing.localisation import MAP_YAW, to_map
from rvsg.simulation.embedded.state import NOISE_AT, WINDOW_COLUMN, WINDOW_ROW, Settings, State


@inner
def sense(
    scene: Scene, state: State, settings: Settings, mount: tuple[float, float, float]
) -> tuple[float, float, float]:
    """The latest noisy scan of a lidar into `state.ranges`.

    Returns the lidar's position (x, y) in the world and the first ray's bearing when the scan was taken.
    """
    yaw = state.scanned[2]
    x = state.scanned[0] + mount[0] * math.cos(yaw) - mount[1] * math.sin(yaw)
    y = state.scanned[1] + mount[0] * math.sin(yaw) + mount[1] * math.cos(yaw)
    bearing = yaw + mount[2] - 0.5 * FIELD_OF_VIEW_RAD
    tile = 0
    if scene.tile_columns * scene.tile_rows > 1:
        column = min(scene.tile_columns - 1, max(0, int((x - scene.tile_x) / TILE_M)))
        row = min(scene.tile_rows - 1, max(0, int((y - scene.tile_y) / TILE_M)))
        tile = row * scene.tile_columns + column
    near = scene.tile_edges[scene.tile_start[tile] : scene.tile_start[tile + 1]]
    scan(state.ranges, state.directions, x, y, bearing, scene.edges, near, state.legs, settings.closed)
    at = state.nav[NOISE_AT]
    for k in range(state.ranges.size):
        if 0.0 < state.ranges[k] < FAR:
            state.ranges[k] += settings.lidar_noise_m * state.noise[at % state.noise.size]
            at += 1
    state.nav[NOISE_AT] = at
    return x, y, bearing


@inner
def move_window(state: State) -> None:
    """Let the local window follow the robot by whole cells, truncated towards zero, as Nav2 does.

    The wanted corner lies (60 - 0.5) cells / 2 below the robot.
    """
    half = 0.5 * (LOCAL_CELLS - 0.5)
    columns = int(state.body[base.X] / LOCAL_RESOLUTION_M - half - state.nav[WINDOW_COLUMN])
    rows = int(state.body[base.Y] / LOCAL_RESOLUTION_M - half - state.nav[WINDOW_ROW])
    shift(state.local[st.FRONT], columns, rows)
    shift(state.local[st.REAR], columns, rows)
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
    for side in range(2):
        layer = state.local[side]
        x, y, bearing = sense(scene, state, settings, FRONT if side == 0 else REAR)
        observe(
            layer, state.ranges, state.directions, x / LOCAL_RESOLUTION_M - left, y / LOCAL_RESOLUTION_M - low, bearing,
            LOCAL_RESOLUTION_M, VOXEL_SHORTENING_CELLS,
        )  # fmt: skip
        clear_footprint(
            layer, state.spans, state.body[base.X] / LOCAL_RESOLUTION_M - left,
            state.body[base.Y] / LOCAL_RESOLUTION_M - low, state.body[base.YAW], LOCAL_RESOLUTION_M,
        )  # fmt: skip
    inflate_marks(state.local[st.MASTER], state.local[st.FRONT], state.local[st.REAR], scene.local_costs)


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
    for side in range(2):
        layer = state.layers[side]
        x, y, bearing = sense(scene, state, settings, FRONT if side == 0 else REAR)
        x, y = to_map(state.own.present, x, y)
        observe(
            layer, state.ranges, state.directions, (x - scene.origin_x) / scene.resolution,
            (y - scene.origin_y) / scene.resolution, bearing + turn, scene.resolution, 0.0,
        )  # fmt: skip
        clear_footprint(layer, state.spans, column, row, state.body[base.YAW] + turn, scene.resolution)
    rows, columns = state.global_master.shape
    # Rays change cells up to their clearing range from a lidar, which sits 0.33 m from the centre; one metre spare
    # covers what the robot moved since.
    half = max(rows, columns) if everywhere else int((CLEARING_RANGE_M + 1.5) / scene.resolution)
    top, left, bottom, right = merge_global(
        state.global_master, scene.static, scene.inflated, state.layers[0], state.layers[1], scene.global_costs,
        int(row), int(column), half,
    )  # fmt: skip
    convert(state.costs, state.global_master, scene.table, top, left, bottom, right)
