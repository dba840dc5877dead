"""Everything that changes in a run, as arrays that the kernels share and change in place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.simulation import dwb
from rvsg.simulation.costmap import FREE, LOCAL_CELLS, UNKNOWN
from rvsg.simulation.lidar import ray_directions
from rvsg.simulation.navfn import BUFFER
from rvsg.simulation.robot import BODY_SIZE
from rvsg.simulation.scene import Scene

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

NOISE_TABLE = 32_768

# What the navigator is doing.
DRIVE, SPIN, WAIT, BACK_UP, DONE = range(5)
# How it ended (0: it has not).
RUNNING, REACHED, ABORTED = range(3)
# Indices of the navigator's integers.
(MODE, RESULT, RECOVERIES, NEXT_ACTION, FAILED_ACTIONS, RETRIED, GOAL, PLANNED, NEED_PLAN, WINDOW_COLUMN, WINDOW_ROW,
 NOISE_AT) = range(12)  # fmt: skip
NAVIGATOR_INTS = 12
# ... and of its reals: times in s, places in m.
(PLAN_T, CONTROL_T, PROGRESS_X, PROGRESS_Y, PROGRESS_T, VALID_T, ACTION_T, ACTION_DONE, ACTION_X, ACTION_Y, ACTION_YAW,
 ACTION_DUE, LOCAL_T, GLOBAL_T, SMOOTH_T) = range(15)  # fmt: skip
NAVIGATOR_REALS = 15


class Settings(NamedTuple):
    """The numbers of one run: drawn noise and options. Seconds of simulated time, metres, radians.

    `clock`: simulated over wall seconds; `offset_x`, `offset_y`: world - map; `closed`: every lidar ray returns.
    """

    clock: float
    offset_x: float
    offset_y: float
    yaw_gain: float
    time_limit_s: float
    result_delay_s: float
    people_phase_s: float
    robot_start_s: float
    lidar_noise_m: float
    closed: bool


class State(NamedTuple):
    """The robot's side of a run. Local grids are (60, 60), global ones as the map.

    `goals` (G, 3) poses to drive through in the map frame, the last one the goal; `path` (P, 2) the plan, first in
    the map frame, then in the local one.
    """

    body: Floats
    nav: Ints
    times: Floats
    control: Ints
    reals: Floats
    goals: Floats
    path: Floats
    front: Bytes
    rear: Bytes
    master: Bytes
    global_front: Bytes
    global_rear: Bytes
    global_master: Bytes
    costs: Bytes
    potential: NDArray[np.float32]
    pending: Bytes
    buffers: NDArray[np.int32]
    cells_x: NDArray[np.float32]
    cells_y: NDArray[np.float32]
    spans: Ints
    ranges: Floats
    directions: Floats
    legs: Floats
    noise: Floats
    samples: dwb.Samples
    memo: dwb.Rollouts
    maps: dwb.LocalMaps


def new_state(scene: Scene, goals: Floats, humans: int, rays: int) -> State:
    """All arrays of a run, before it is `reset` by the episode."""
    rows, columns = scene.static.shape
    longest = 4 * max(rows, columns) + 2
    samples = dwb.samples()
    count = len(samples.v)
    span = max(columns, LOCAL_CELLS)
    return State(
        body=np.zeros(BODY_SIZE),
        nav=np.zeros(NAVIGATOR_INTS, np.int64),
        times=np.zeros(NAVIGATOR_REALS),
        control=np.zeros(dwb.CONTROLLER_INTS, np.int64),
        reals=np.zeros(dwb.CONTROLLER_REALS),
        goals=goals,
        path=np.zeros((longest * len(goals), 2)),
        front=np.full((LOCAL_CELLS, LOCAL_CELLS), FREE, np.uint8),
        rear=np.full((LOCAL_CELLS, LOCAL_CELLS), FREE, np.uint8),
        master=np.full((LOCAL_CELLS, LOCAL_CELLS), FREE, np.uint8),
        global_front=np.full((rows, columns), UNKNOWN, np.uint8),
        global_rear=np.full((rows, columns), UNKNOWN, np.uint8),
        global_master=np.zeros((rows, columns), np.uint8),
        costs=np.zeros(rows * columns, np.uint8),
        potential=np.zeros(rows * columns, np.float32),
        pending=np.zeros(rows * columns, np.uint8),
        buffers=np.zeros((3, BUFFER), np.int32),
        cells_x=np.zeros(longest, np.float32),
        cells_y=np.zeros(longest, np.float32),
        spans=np.zeros((span, 2), np.int64),
        ranges=np.zeros(rays),
        directions=ray_directions(rays),
        legs=np.zeros((2 * humans, 2)),
        noise=np.zeros(NOISE_TABLE),
        samples=samples,
        memo=dwb.rollouts(count),
        maps=dwb.local_maps(count),
    )
