"""Arrays that the kernels share: the scene, which does not change in a run, and the state, which does."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rvsg.core.errors import InputError
from rvsg.robots.robot import Robot
from rvsg.simulation.costmap import FREE, INSCRIBED, LETHAL, UNKNOWN, inflate_static, inflation_kernel
from rvsg.simulation.embedded import dwb
from rvsg.simulation.embedded.base import new_body
from rvsg.simulation.embedded.costmap_filters import keepout_costs, speed_shares
from rvsg.simulation.embedded.lidar import ray_directions
from rvsg.simulation.embedded.localisation import Localisation, beam_scores
from rvsg.simulation.embedded.navfn import BUFFER, HIGH, conversion, reaches, rest_of_way
from rvsg.simulation.embedded.robot_parameters import Stack, inscribed_radius, max_range_m, scan_reach, stack_of
from rvsg.simulation.embedded.rollouts import Rollouts, rollouts, sample_table
from rvsg.simulation.embedded.walls import Walls, cell_borders, edges_of, new_walls, reach_of
from rvsg.world.world import OccupancyMap, World

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


K = TypeVar("K")
V = TypeVar("V")

TILE_M = 1.0
RASTER_M = 0.1
KEPT_GOALS = 32


class Scene(NamedTuple):
    """What does not change in a run.

    `static`, `inflated` (rows, columns): the map as costs and its inflation, in the map frame, lower left corner at
    `origin_x`, `origin_y`; `table`, `reach` NavFn's costs; `local_costs`, `global_costs` inflation kernels. `edges`
    (E, 4) are the lidar outlines in the world frame; tile t of the raster sees `tile_edges[tile_start[t] :
    tile_start[t + 1]]`. `closed` (a raster of 0.1 m in the world frame) says from where every ray returns.
    `keepout`, `local_shares`, `global_shares`: what filters of the local costmap, and speed filters of either, say of
    the cells of the map, see `costmap_filters`; empty without one.
    """

    static: Bytes
    inflated: Bytes
    table: Bytes
    reach: NDArray[np.float32]
    local_costs: Bytes
    global_costs: Bytes
    origin_x: float
    origin_y: float
    resolution: float
    edges: Floats
    tile_start: NDArray[np.int64]
    tile_edges: NDArray[np.int32]
    tile_x: float
    tile_y: float
    tile_columns: int
    tile_rows: int
    tile_reach: float
    keepout: Bytes
    local_shares: Floats
    global_shares: Floats


def latest(cache: OrderedDict[K, V], key: K, most: int, make: Callable[[], V]) -> V:
    """Return the value of a key, made where it is new; only the last `most` that were asked for are kept."""
    if key not in cache:
        cache[key] = make()
        while len(cache) > most:
            cache.popitem(last=False)
    cache.move_to_end(key)
    return cache[key]


class Surroundings:
    """A scene and what Python, not a kernel, asks of it."""

    def __init__(self, world: World, robot: Robot) -> None:
        self.robot = robot
        range_m = max_range_m(robot)
        occupancy = world.occupancy
        if occupancy.origin.yaw != 0.0:
            raise InputError(
                f"world {world.name}: the occupancy map is turned by {occupancy.origin.yaw} rad; "
                "the simulator needs an upright one. Rotate the map image and set the origin's yaw to 0."
            )
        static = np.full(occupancy.cells.shape, UNKNOWN, np.uint8)
        static[occupancy.cells == 0] = FREE
        static[occupancy.cells == 100] = LETHAL
        self.keepout, self.global_keepout = (keepout_costs(robot, occupancy, which) for which in ("local", "global"))
        self.local_shares, self.global_shares = (speed_shares(robot, occupancy, which) for which in ("local", "global"))
        if self.global_keepout.size:  # Nav2's filter takes an unknown cell for what its mask says
            static[(static == UNKNOWN) & (self.global_keepout != UNKNOWN)] = FREE
        self.edges, self.owner = lidar_edges(world)
        self.beam_scores = beam_scores(occupancy, robot.lidars[0].max_range_m)
        self.x, self.y, rows, columns = _extent(world, self.edges)
        self.closed = closed_region(self.edges, self.x, self.y, rows, columns, range_m)
        tiles = _tiles(rows, columns)
        self.wall_tiles = (
            *edges_by_tile(self.edges, self.x, self.y, tiles[1], tiles[0], reach_of(robot.outline)),
            tiles,
        )
        self.rests: OrderedDict[tuple[int, int], NDArray[np.float32]] = OrderedDict()
        maps, inscribed = robot.navigation.costmaps, inscribed_radius(robot)
        global_costs = inflation_kernel(
            occupancy.resolution, maps.global_inflation_m, maps.global_cost_scaling, inscribed
        )
        self.local_costs = inflation_kernel(
            maps.local_resolution_m, maps.local_inflation_m, maps.local_cost_scaling, inscribed
        )
        self.open_scene = _scene(self, static, global_costs, occupancy, range_m)
        near = scan_reach(robot)
        self.closed_scene = _scene(self, static, global_costs, occupancy, near) if self.closed.any() else None

    def walls(self) -> Walls:
        """Return what the robot's body cannot enter, for one run."""
        start, near, shape = self.wall_tiles
        return new_walls(self.edges, start, near, (self.x, self.y), shape, self.robot)

    def rest_of_way(self, scene: Scene, goals: Floats) -> NDArray[np.float32] | None:
        """The least cost from every cell to the goal, kept for the last few goals; None where it is not known.

        It is not for routes that lead through several poses, and for a goal in an obstacle or off the map.
        """
        column = int((goals[-1, 0] - scene.origin_x) / scene.resolution + 0.5)
        row = int((goals[-1, 1] - scene.origin_y) / scene.resolution + 0.5)
        rows, columns = scene.static.shape
        if len(goals) > 1 or not (0 < row < rows - 1 and 0 < column < columns - 1):
            return None
        if scene.inflated[row, column] >= INSCRIBED:
            return None
        grids = scene.inflated, scene.reach, scene.table
        return latest(self.rests, (row, column), KEPT_GOALS, lambda: rest_of_way(*grids, column, row))

    def is_inside_solid(self, x: float, y: float) -> bool:
        """Whether a point lies within what the lidar plane cuts of some object (outlines of one object: even-odd)."""
        ax, ay, bx, by = self.edges.T
        straddles = (ay > y) != (by > y)
        rise = np.where(straddles, by - ay, 1.0)
        left_of = straddles & (x < ax + (y - ay) / rise * (bx - ax))
        return bool((np.bincount(self.owner[left_of]) % 2 == 1).any()) if left_of.any() else False

    def scene_at(self, x: float, y: float) -> tuple[Scene, bool]:
        """The scene for a robot that starts at (x, y), and whether walls close off the place within lidar range."""
        column = int((x - self.x) / RASTER_M)
        row = int((y - self.y) / RASTER_M)
        rows, columns = self.closed.shape
        inside = 0 <= row < rows and 0 <= column < columns and bool(self.closed[row, column])
        if inside and self.closed_scene is not None:
            return self.closed_scene, True
        return self.open_scene, False


def lidar_edges(world: World) -> tuple[Floats, NDArray[np.int64]]:
    """Edges (E, 4) of what the lidar plane cuts, world frame, and the number of the object each belongs to.

    A world without objects of its own shows the borders of its occupied cells, straight runs joined.
    """
    found: list[Floats] = []
    owner: list[int] = []
    for number, thing in enumerate(world.solids):
        for outline in thing.slices:
            found.append(edges_of(np.asarray(outline, np.float64).reshape(-1, 2)))
            owner += [number] * len(found[-1])
    if not world.objects:
        occupancy = world.occupancy
        x, y = occupancy.origin.x + world.map_offset[0], occupancy.origin.y + world.map_offset[1]
        found.append(cell_borders(occupancy.cells == 100, occupancy.resolution, x, y))
        owner += [len(world.solids)] * len(found[-1])
    edges = np.concatenate(found) if found else np.zeros((0, 4))
    return np.ascontiguousarray(edges), np.array(owner, np.int64)


def closed_region(edges: Floats, x: float, y: float, rows: int, columns: int, range_m: float) -> NDArray[np.bool_]:
    """Where (a raster of 0.1 m) every lidar ray surely returns: places closed off by edges, smaller than the range."""
    free = np.ones((rows, columns), bool)
    for ax, ay, bx, by in edges:
        n = int(np.hypot(bx - ax, by - ay) / (0.3 * RASTER_M)) + 2
        share = np.linspace(0.0, 1.0, n)
        c = ((ax + share * (bx - ax) - x) / RASTER_M).astype(int)
        r = ((ay + share * (by - ay) - y) / RASTER_M).astype(int)
        free[r, c] = False
    regions, _ = ndimage.label(free)
    closed = np.zeros_like(free)
    outer = set(np.unique(np.concatenate([regions[0], regions[-1], regions[:, 0], regions[:, -1]])).tolist())
    for number, box in enumerate(ndimage.find_objects(regions), start=1):
        if number in outer or box is None:
            continue
        height = (box[0].stop - box[0].start) * RASTER_M
        width = (box[1].stop - box[1].start) * RASTER_M
        if np.hypot(height, width) < range_m:
            closed |= regions == number
    return closed


def _extent(world: World, edges: Floats) -> tuple[float, float, int, int]:
    """Lower left corner and cells (rows, columns) of a raster of 0.1 m around map and outlines, 1 m to spare."""
    occupancy = world.occupancy
    x = occupancy.origin.x + world.map_offset[0]
    y = occupancy.origin.y + world.map_offset[1]
    rows, columns = occupancy.cells.shape
    xs = [x, x + columns * occupancy.resolution, *edges[:, 0], *edges[:, 2]]
    ys = [y, y + rows * occupancy.resolution, *edges[:, 1], *edges[:, 3]]
    return (
        float(min(xs)) - 1.0,
        float(min(ys)) - 1.0,
        int((max(ys) - min(ys) + 2.0) / RASTER_M) + 1,
        int((max(xs) - min(xs) + 2.0) / RASTER_M) + 1,
    )


def _tiles(rows: int, columns: int) -> tuple[int, int]:
    """Return the rows and columns of tiles of 1 m over a raster of 0.1 m."""
    return int(rows * RASTER_M / TILE_M) + 1, int(columns * RASTER_M / TILE_M) + 1


def _scene(around: Surroundings, static: Bytes, costs: Bytes, occupancy: OccupancyMap, reach_m: float) -> Scene:
    rows, columns = around.closed.shape
    tile_rows, tile_columns = _tiles(rows, columns)
    if reach_m > scan_reach(around.robot):
        tile_columns = tile_rows = 1
        start = np.array([0, len(around.edges)], np.int64)
        near = np.arange(len(around.edges), dtype=np.int32)
    else:
        start, near = edges_by_tile(around.edges, around.x, around.y, tile_columns, tile_rows, reach_m)
    inflated, keepout = inflate_static(static, costs), around.global_keepout
    if keepout.size:
        inflated = np.maximum(inflated, np.where(keepout == UNKNOWN, FREE, keepout))
    return Scene(
        static=static,
        inflated=inflated,
        table=conversion(),
        reach=reaches(),
        local_costs=around.local_costs,
        global_costs=costs,
        origin_x=float(occupancy.origin.x),
        origin_y=float(occupancy.origin.y),
        resolution=float(occupancy.resolution),
        edges=around.edges,
        tile_start=start,
        tile_edges=near,
        tile_x=around.x,
        tile_y=around.y,
        tile_columns=tile_columns,
        tile_rows=tile_rows,
        tile_reach=reach_m,
        keepout=around.keepout,
        local_shares=around.local_shares,
        global_shares=around.global_shares,
    )


def edges_by_tile(
    edges: Floats, x: float, y: float, columns: int, rows: int, reach: float
) -> tuple[Ints, NDArray[np.int32]]:
    """For every tile of 1 m the edges that may be within `reach` of it: starts (tiles + 1,), edge numbers."""
    ax, ay = edges[:, 0], edges[:, 1]
    dx, dy = edges[:, 2] - ax, edges[:, 3] - ay
    square = dx * dx + dy * dy
    divisor = np.where(square > 0.0, square, 1.0)
    far = reach + 0.7072 * TILE_M
    near = []
    for tile in range(rows * columns):
        to_x = ax - (x + (tile % columns + 0.5) * TILE_M)
        to_y = ay - (y + (tile // columns + 0.5) * TILE_M)
        share = np.clip(-(to_x * dx + to_y * dy) / divisor, 0.0, 1.0)
        near.append(np.flatnonzero((to_x + share * dx) ** 2 + (to_y + share * dy) ** 2 <= far * far))
    return np.cumsum([0, *map(len, near)], dtype=np.int64), np.concatenate(near).astype(np.int32)


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
 ) = range(dwb.CONTROLLER_INTS, dwb.CONTROLLER_INTS + 18)  # fmt: skip
INTS = dwb.CONTROLLER_INTS + 18
# ... and of the reals: times in s, places in m.
(PLAN_T, CONTROL_T, PROGRESS_X, PROGRESS_Y, PROGRESS_T, VALID_T, ACTION_T, ACTION_DONE, ACTION_X, ACTION_Y, ACTION_YAW,
 ACTION_DUE, LOCAL_T, GLOBAL_T, SMOOTH_T) = range(
    dwb.CONTROLLER_REALS, dwb.CONTROLLER_REALS + 15)  # fmt: skip
REALS = dwb.CONTROLLER_REALS + 15


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
    `own` localises the robot, and the plan before in the map; `journal` (J, 7), see `behaviour_tree`. `local`
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
    times = np.zeros(REALS)
    times[dwb.SHARE] = 1.0
    cells = stack.cells
    lidars = robot.lidars
    rays = max(lidar.rays for lidar in lidars)
    directions = np.zeros((len(lidars), rays, 2))
    for k, lidar in enumerate(lidars):
        directions[k, : lidar.rays] = ray_directions(lidar.rays, lidar.field_of_view_rad)
    return State(
        body=new_body(),
        nav=np.zeros(INTS, np.int64),
        times=times,
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
        scratch=dwb.scratch(cells),
        stack=stack,
        walls=walls,
        own=own,
    )
