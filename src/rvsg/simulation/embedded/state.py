"""Everything that changes in a run, as arrays that the kernels share and change in place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rvsg.robots.robot import Robot
from rvsg.simulation.embedded.base import new_body
from rvsg.simulation.embedded.navigation.controllers import dwb
from rvsg.simulation.embedded.navigation.controllers.rollouts import Rollouts, rollouts
from rvsg.simulation.embedded.navigation.controllers.samples import sample_table
from rvsg.simulation.embedded.navigation.costmap import FREE, UNKNOWN
from rvsg.simulation.embedded.navigation.planners.navfn import BUFFER, HIGH
from rvsg.simulation.embedded.scene import Scene
from rvsg.simulation.embedded.sensing.lidar import ray_directions
from rvsg.simulation.embedded.sensing.localisation import Localisation
from rvsg.simulation.embedded.stack import Stack, stack_of
from rvsg.simulation.embedded.walls import Walls

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

NOISE_TABLE = 32_768
JOURNAL = 4096
"""Rows of the journal: a path per second for an hour, the longest run, and all recoveries."""

# What the navigator is doing.
DRIVE, SPIN, WAIT, BACK_UP, DONE = range(5)
# How it ended (0: it has not).
RUNNING, REACHED, ABORTED = range(3)
# Layers of the local maps.
MASTER = -1
# Indices of the integers, behind those of the controller.
(MODE, RESULT, RECOVERIES, NEXT_ACTION, FAILED_ACTIONS, FOLLOW_RETRIED, PLAN_RETRIED, GOAL, PLANNED, NEED_PLAN,
 CLEAR_LOCAL, CLEAR_GLOBAL, WINDOW_COLUMN, WINDOW_ROW, NOISE_AT, DROPOUT_AT, NOTED, PLANNED_GOAL,
 OUTSIDE_PLAN) = range(dwb.CONTROLLER_INTS, dwb.CONTROLLER_INTS + 19)  # fmt: skip
INTS = dwb.CONTROLLER_INTS + 19
# ... and of the reals: times in s, places in m.
(PLAN_T, CONTROL_T, PROGRESS_X, PROGRESS_Y, PROGRESS_T, VALID_T, ACTION_T, ACTION_DONE, ACTION_X, ACTION_Y, ACTION_YAW,
 ACTION_DUE, LOCAL_T, GLOBAL_T, SMOOTH_T, PLAN_X, PLAN_Y) = range(
    dwb.CONTROLLER_REALS, dwb.CONTROLLER_REALS + 17)  # fmt: skip
REALS = dwb.CONTROLLER_REALS + 17
# What is to be done outside of the navigation at a time.
NOTHING, COMMAND, PLAN = range(3)
# The answer of a planner outside of the compiled loop: none yet, else the number of points and this.
NOT_PLANNED, PLANNED_FROM = 0, 1


class Settings(NamedTuple):
    """The numbers of one run: drawn noise and options. Seconds of simulated time, metres, radians.

    `clock`: simulated over wall seconds; `scan_phase_ticks`: when in its period of 0.1 s a scan is taken (10 ms);
    `humans_displayed_late`, `solid_walls`: see `SimulatorOptions`; `closed`: every lidar ray returns.
    """

    clock: float
    yaw_gain: float
    time_limit_s: float
    result_delay_s: float
    people_phase_s: float
    scan_phase_ticks: int
    robot_start_s: float
    lidar_noise: float
    humans_displayed_late: bool
    solid_walls: bool
    closed: bool


class State(NamedTuple):
    """The robot's side of a run.

    `body`, `nav`, `times`: vectors indexed by the names above (and those of `base` and `dwb`). `goals` (G, 3) poses to
    drive through in the map frame, the last one the goal; `path` (3, P, 2) the plan in the map, in the world, where
    `own` localises the robot, and the plan before in the map; `journal` (J, 7), see `navigation.journal`. `local`
    (L + 1, cells, cells) a voxel layer for each of L lidars and, last, the master map; `layers` (L, rows, columns) the
    global obstacle layers and `global_master` their merger with the static map; `costs`, `potential`, `waiting` flat
    grids and `buffers`, `cells` scratch space of NavFn; `rest` its least cost from every cell to the goal, 1e10 where
    that is not known.
    `scanned` (L, 3) the robot's pose and `legs` (L, 2N, 2) what a lidar sees of people, both at its latest scan;
    `ranges` (L, rays) and `directions` (L, rays, 2) its rays. `dropouts` uniform numbers for rays without a return.
    `delayed` (ticks, 3): commands on their way to the base. `zone_until` (Z,): until when each safety zone limits
    the speed. `returns` (L, rays, 2): where the latest scans returned, in the world, for the collision monitor.
    `stack` the robot's numbers, `walls` what its body cannot enter.
    """

    body: Floats
    nav: Ints
    times: Floats
    goals: Floats
    path: Floats
    journal: Floats
    local: Bytes
    layers: Bytes
    global_master: Bytes
    costs: Bytes
    rest: NDArray[np.float32]
    potential: NDArray[np.float32]
    waiting: Bytes
    buffers: NDArray[np.int32]
    cells: NDArray[np.float32]
    spans: Ints
    ranges: Floats
    directions: Floats
    scanned: Floats
    legs: Floats
    noise: Floats
    dropouts: Floats
    delayed: Floats
    zone_until: Floats
    returns: Floats
    samples: Floats
    memo: Rollouts
    scratch: dwb.Scratch
    stack: Stack
    walls: Walls
    own: Localisation


def new_state(
    scene: Scene,
    goals: Floats,
    humans: int,
    robot: Robot,
    walls: Walls,
    own: Localisation,
    memo: Rollouts | None = None,
    rest: NDArray[np.float32] | None = None,
) -> State:
    """All arrays of a run, as the episode expects them; a memory of rollouts may serve one run after another."""
    rows, columns = scene.static.shape
    longest = 4 * max(rows, columns) + 2
    stack = stack_of(robot)
    samples = sample_table(stack)
    cells = stack.cells
    lidars = robot.lidars
    rays = max(lidar.rays for lidar in lidars)
    directions = np.zeros((len(lidars), rays, 2))
    for k, lidar in enumerate(lidars):
        directions[k, : lidar.rays] = ray_directions(lidar.rays, lidar.field_of_view_rad)
    return State(
        body=new_body(),
        nav=np.zeros(INTS, np.int64),
        times=np.zeros(REALS),
        goals=goals,
        path=np.zeros((3, longest, 2)),
        journal=np.zeros((JOURNAL, 7)),
        local=np.full((len(lidars) + 1, cells, cells), FREE, np.uint8),
        layers=np.full((len(lidars), rows, columns), UNKNOWN, np.uint8),
        global_master=np.zeros((rows, columns), np.uint8),
        costs=np.zeros(rows * columns, np.uint8),
        rest=rest if rest is not None else np.full(rows * columns, HIGH, np.float32),
        potential=np.zeros(rows * columns, np.float32),
        waiting=np.zeros(rows * columns, np.uint8),
        buffers=np.zeros((3, BUFFER), np.int32),
        cells=np.zeros((2, longest), np.float32),
        spans=np.zeros((max(columns, cells), 2), np.int64),
        ranges=np.zeros((len(lidars), rays)),
        directions=directions,
        scanned=np.zeros((len(lidars), 3)),
        legs=np.zeros((len(lidars), 2 * humans, 2)),
        noise=np.zeros(NOISE_TABLE),
        dropouts=np.zeros(NOISE_TABLE),
        delayed=np.zeros((max(1, stack.latency_ticks), 3)),
        zone_until=np.full(len(stack.zones), -np.inf),
        returns=np.zeros((len(lidars), rays if len(stack.monitor) else 0, 2)),
        samples=samples,
        memo=memo if memo is not None else rollouts(len(samples)),
        scratch=dwb.scratch(len(samples), cells),
        stack=stack,
        walls=walls,
        own=own,
    )
