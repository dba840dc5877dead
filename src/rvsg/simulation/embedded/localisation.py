"""Localisation of the robot: Nav2's AMCL, a particle filter on the front lidar.

The published robot did not drive where its map says. That map is shifted and slightly bent against the world, and AMCL
began each run around the spawn pose taken as map coordinates and found the shift only while driving, so the difference
between map and world changed all along a route. Algorithm and order of the steps are those of nav2_amcl (Humble), the
parameters those of PAL's public simulation of this robot (`tiago_omni_base_nav_public_sim.yaml`): front scan,
omnidirectional motion model, all odometry noise 0.2, likelihood field, 60 beams, 500 to 2000 particles by KLD sampling,
an update after 0.25 m (per axis) or 0.2 rad. One thing could not be read anywhere and was chosen by the published paths
of runs without people near (docs/explanation/fidelity.md): the spread of the first particles, that of a pose set by
hand in RViz. One difference: the estimate is the mean of all particles, not of their heaviest cluster.

AMCL stamps its estimate a second into the future (its transform tolerance). Who asks where the robot is now in the
map, as the planner and the global costmap do, gets the estimate of a second ago; who asks without a time how the map
lies in the odometry's frame, as DWB and the goal checker do for the plan, gets the newest.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rvsg.core.angles import wrap
from rvsg.core.kernels import inner
from rvsg.robots.robot import Lidar
from rvsg.simulation.embedded.lidar import full_scan
from rvsg.world.world import OccupancyMap

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


MAX_PARTICLES = 2000
MIN_PARTICLES = 500
MAX_BEAMS = 60
SIGMA_HIT_M = 0.2
Z_HIT = 0.5
Z_RAND = 0.5
DISTANCE_MAX_M = 2.0
ALPHA = 0.2
"""Odometry noise alpha1 to alpha5."""
START_SD = (0.5, 0.5, 0.2617)
"""Spread of the first particles (m, m, rad): variances 0.25, 0.25 and 0.0685, RViz's for a pose set by hand."""
NO_DIRECTION_M = 0.01
UPDATE_M = 0.25
UPDATE_RAD = 0.2
POPULATION_ERROR = 0.05
POPULATION_Z = 0.99
BIN_M = 0.5
BIN_RAD = math.radians(10.0)
TAKES_EFFECT_S = 1.0
"""The transform tolerance of AMCL: after that time an estimate holds for the robot's pose in the map."""
PENDING = 8
NORMALS = 65_536
UNIFORMS = 16_384

MAP_X, MAP_Y, MAP_YAW, LAST_X, LAST_Y, LAST_YAW = range(6)
PARTICLES, NORMAL_AT, UNIFORM_AT, UPDATES, ACTIVE, WAITING = range(6)


class Localisation(NamedTuple):
    """The map's place in the world as the robot believes it, and the particle filter that finds it.

    `frame` (6,): map from world as x, y, yaw (metres, radians) by the newest estimate, then the robot's pose in the
    world at the last update; `present` (3,): map from world by the estimate that holds for the robot's pose now;
    `coming` (8, 4): when the next ones hold (s), and they.
    `particles` (2, 2000, 3): poses in the map, and scratch space; `sums` (2000,) running sums of their weights;
    `counts` (6,): number of particles, places in the tables `normals` and `uniforms`, updates, whether it is active,
    how many estimates are to come.
    `scores` (rows, columns): what a beam that ends in a cell adds to a weight; `outside` the same off the map.
    """

    frame: Floats
    present: Floats
    coming: Floats = np.zeros((0, 4))
    particles: Floats = np.zeros((2, 0, 3))
    sums: Floats = np.zeros(0)
    counts: Ints = np.zeros(6, np.int64)
    normals: Floats = np.zeros(1)
    uniforms: Floats = np.zeros(1)
    bins: Ints = np.zeros(1, np.int64)
    ranges: Floats = np.zeros(0)
    directions: Floats = np.zeros((0, 2))
    scores: NDArray[np.float32] = np.zeros((1, 1), np.float32)
    origin_x: float = 0.0
    origin_y: float = 0.0
    resolution: float = 1.0
    outside: float = 0.0
    lidar_noise_m: float = 0.0
    mount_x: float = 0.0
    mount_y: float = 0.0
    mount_yaw: float = 0.0
    field_of_view: float = 0.0
    range_max: float = 0.0
    differential: bool = False
    """The motion model: that of a base that cannot move sideways, or of one that can."""


def known_offset(x: float, y: float) -> Localisation:
    """A robot that knows its place: the map lies at the constant offset world - map = (x, y)."""
    return Localisation(frame=np.array([-x, -y, 0.0, 0.0, 0.0, 0.0]), present=np.array([-x, -y, 0.0]))


def particle_filter(
    scores: NDArray[np.float32],
    occupancy: OccupancyMap,
    lidar: Lidar,
    start: tuple[float, float, float],
    lidar_noise_m: float,
    rng: np.random.Generator,
    *,
    differential: bool = False,
) -> Localisation:
    """AMCL at its start: particles around `start` (x, y, yaw), the robot's pose in the world taken as one in the map.

    Of the lidar's rays it uses every n-th, n = (rays - 1) // 59, as Nav2 does. `differential` chooses the motion model.
    """
    skip = max(1, (lidar.rays - 1) // (MAX_BEAMS - 1))
    angles = np.arange(0, lidar.rays, skip) * (lidar.field_of_view_rad / (lidar.rays - 1))
    counts = np.zeros(6, np.int64)
    particles = np.zeros((2, MAX_PARTICLES, 3))
    particles[0] = np.array(start) + rng.standard_normal((MAX_PARTICLES, 3)) * START_SD
    counts[PARTICLES] = MAX_PARTICLES
    counts[ACTIVE] = 1
    return Localisation(
        frame=np.array([0.0, 0.0, 0.0, *start]),
        present=np.zeros(3),
        coming=np.zeros((PENDING, 4)),
        particles=particles,
        sums=np.zeros(MAX_PARTICLES),
        counts=counts,
        normals=rng.standard_normal(NORMALS),
        uniforms=rng.random(UNIFORMS),
        bins=np.zeros(MAX_PARTICLES, np.int64),
        ranges=np.zeros(len(angles)),
        directions=np.column_stack([np.cos(angles), np.sin(angles)]),
        scores=scores,
        origin_x=float(occupancy.origin.x),
        origin_y=float(occupancy.origin.y),
        resolution=float(occupancy.resolution),
        outside=float(beam_score(np.array(DISTANCE_MAX_M), lidar.max_range_m)),
        lidar_noise_m=lidar_noise_m,
        mount_x=lidar.x,
        mount_y=lidar.y,
        mount_yaw=lidar.yaw,
        field_of_view=lidar.field_of_view_rad,
        range_max=lidar.max_range_m,
        differential=differential,
    )


def beam_score(distance: Floats, range_max_m: float) -> Floats:
    """(0.5 exp(-d²/2σ²) + 0.5/range)³ of a beam that ends at distance d from the nearest occupied cell."""
    hit = Z_HIT * np.exp(-(distance**2) / (2.0 * SIGMA_HIT_M**2))
    score: Floats = (hit + Z_RAND / range_max_m) ** 3
    return score


def beam_scores(occupancy: OccupancyMap, range_max_m: float) -> NDArray[np.float32]:
    """`beam_score` of every cell of the map; distances count up to 2 m."""
    occupied = occupancy.cells == 100
    distance = np.full(occupied.shape, DISTANCE_MAX_M)
    if occupied.any():
        distance = np.minimum(ndimage.distance_transform_edt(~occupied) * occupancy.resolution, DISTANCE_MAX_M)
    return beam_score(distance, range_max_m).astype(np.float32)


@inner
def to_map(frame: Floats, x: float, y: float) -> tuple[float, float]:
    """A point of the world in the map, as the robot believes it."""
    cos = math.cos(frame[MAP_YAW])
    sin = math.sin(frame[MAP_YAW])
    return cos * x - sin * y + frame[MAP_X], sin * x + cos * y + frame[MAP_Y]


@inner
def to_world(frame: Floats, x: float, y: float) -> tuple[float, float]:
    """A point of the map in the world, as the robot believes it."""
    cos = math.cos(frame[MAP_YAW])
    sin = math.sin(frame[MAP_YAW])
    dx = x - frame[MAP_X]
    dy = y - frame[MAP_Y]
    return cos * dx + sin * dy, cos * dy - sin * dx


@inner
def localise(own: Localisation, t: float, x: float, y: float, yaw: float, edges: Floats, legs: Floats) -> bool:
    """Take in a front scan of time t at the pose (x, y, yaw) if the robot moved enough; says if it did.

    The first scan is always taken in. `edges` (E, 4) and `legs` (L, 2) are what the lidar sees, in the world.
    """
    _hold(own, t)
    dx = x - own.frame[LAST_X]
    dy = y - own.frame[LAST_Y]
    turn = wrap(yaw - own.frame[LAST_YAW])
    if own.counts[UPDATES] > 0:
        if abs(dx) <= UPDATE_M and abs(dy) <= UPDATE_M and abs(turn) <= UPDATE_RAD:
            return False
        if own.differential:
            _drive(own, dx, dy, turn)
        else:
            _move(own, dx, dy, turn)
    own.frame[LAST_X] = x
    own.frame[LAST_Y] = y
    own.frame[LAST_YAW] = yaw
    _look(own, x, y, yaw, edges, legs)
    _weigh(own)
    _resample(own)
    _estimate(own, x, y, yaw)
    _announce(own, t)
    own.counts[UPDATES] += 1
    return True


@inner
def _announce(own: Localisation, t: float) -> None:
    """The newest estimate will hold for the robot's pose in a second."""
    if own.counts[WAITING] == PENDING:
        _hold(own, own.coming[0, 0])
    row = own.coming[own.counts[WAITING]]
    row[0] = t + TAKES_EFFECT_S
    for j in range(3):
        row[1 + j] = own.frame[j]
    own.counts[WAITING] += 1


@inner
def _hold(own: Localisation, t: float) -> None:
    """Let the estimates whose time has come hold for the robot's pose."""
    while own.counts[WAITING] > 0 and own.coming[0, 0] <= t + 1e-9:
        for j in range(3):
            own.present[j] = own.coming[0, 1 + j]
        own.counts[WAITING] -= 1
        for i in range(own.counts[WAITING]):
            for j in range(4):
                own.coming[i, j] = own.coming[i + 1, j]


@inner
def _normal(own: Localisation) -> float:
    """The next number of the table of normals."""
    at = own.counts[NORMAL_AT]
    own.counts[NORMAL_AT] = (at + 1) % own.normals.size
    return float(own.normals[at])


@inner
def _move(own: Localisation, dx: float, dy: float, turn: float) -> None:
    """Omnidirectional motion model: the way, its direction and the turn, each with noise, for every particle.

    Yaws are not wrapped, here as in nav2_amcl, so that a cloud about ±π does not fall into two halves of bins.
    """
    particles = own.particles[0]
    way = math.sqrt(dx * dx + dy * dy)
    direction = wrap(math.atan2(dy, dx) - own.frame[LAST_YAW])
    sd = math.sqrt(ALPHA * (way * way + turn * turn))
    for i in range(own.counts[PARTICLES]):
        heading = particles[i, 2] + direction
        ahead = way + sd * _normal(own)
        turned = turn + sd * _normal(own)
        aside = sd * _normal(own)
        particles[i, 0] += ahead * math.cos(heading) + aside * math.sin(heading)
        particles[i, 1] += ahead * math.sin(heading) - aside * math.cos(heading)
        particles[i, 2] += turned


@inner
def _drive(own: Localisation, dx: float, dy: float, turn: float) -> None:
    """Differential motion model: a turn, a straight way and another turn, each with noise, for every particle.

    As nav2_amcl: a way below 1 cm has no direction, and the noise of driving backwards is that of driving forwards.
    """
    particles = own.particles[0]
    way = math.sqrt(dx * dx + dy * dy)
    first = 0.0 if way < NO_DIRECTION_M else wrap(math.atan2(dy, dx) - own.frame[LAST_YAW])
    second = wrap(turn - first)
    noise = min(abs(first), abs(wrap(first - math.pi)))
    other = min(abs(second), abs(wrap(second - math.pi)))
    first_sd = math.sqrt(ALPHA * (noise * noise + way * way))
    way_sd = math.sqrt(ALPHA * (way * way + noise * noise + other * other))
    second_sd = math.sqrt(ALPHA * (other * other + way * way))
    for i in range(own.counts[PARTICLES]):
        heading = particles[i, 2] + first - first_sd * _normal(own)
        ahead = way - way_sd * _normal(own)
        particles[i, 0] += ahead * math.cos(heading)
        particles[i, 1] += ahead * math.sin(heading)
        particles[i, 2] = heading + second - second_sd * _normal(own)


@inner
def _look(own: Localisation, x: float, y: float, yaw: float, edges: Floats, legs: Floats) -> None:
    """Cast the filter's beams of the front lidar into `ranges`."""
    step = math.atan2(own.directions[1, 1], own.directions[1, 0])
    bearing = yaw + own.mount_yaw - 0.5 * own.field_of_view
    from_x = x + own.mount_x * math.cos(yaw) - own.mount_y * math.sin(yaw)
    from_y = y + own.mount_x * math.sin(yaw) + own.mount_y * math.cos(yaw)
    full_scan(own.ranges, own.directions, step, from_x, from_y, bearing, edges, legs)
    for k in range(own.ranges.size):
        own.ranges[k] += own.lidar_noise_m * _normal(own)


@inner
def _weigh(own: Localisation) -> None:
    """Running sums of the particles' weights, 1 + the score of every beam with a return (likelihood field).

    AMCL rounds to cells, half a cell off the map's own convention.
    """
    rows, columns = own.scores.shape
    scale = 1.0 / own.resolution
    bearing = own.mount_yaw - 0.5 * own.field_of_view
    total = 0.0
    for i in range(own.counts[PARTICLES]):
        particle = own.particles[0, i]
        cos = math.cos(particle[2])
        sin = math.sin(particle[2])
        x = (particle[0] - own.origin_x + own.mount_x * cos - own.mount_y * sin) * scale + 0.5
        y = (particle[1] - own.origin_y + own.mount_x * sin + own.mount_y * cos) * scale + 0.5
        cos = math.cos(particle[2] + bearing) * scale
        sin = math.sin(particle[2] + bearing) * scale
        weight = 1.0
        for k in range(own.ranges.size):
            reach = own.ranges[k]
            if reach >= own.range_max:
                continue
            column = x + reach * (own.directions[k, 0] * cos - own.directions[k, 1] * sin)
            row = y + reach * (own.directions[k, 0] * sin + own.directions[k, 1] * cos)
            if column >= 0.0 and row >= 0.0 and column < columns and row < rows:
                weight += own.scores[int(row), int(column)]
            else:
                weight += own.outside
        total += weight
        own.sums[i] = total


@inner
def _enough(kinds: int) -> int:
    """KLD sampling (Fox 2003): how many particles so many occupied bins need."""
    if kinds <= 1:
        return MAX_PARTICLES
    b = 2.0 / (9.0 * (kinds - 1))
    x = 1.0 - b + math.sqrt(b) * POPULATION_Z
    needed = math.ceil((kinds - 1) / (2.0 * POPULATION_ERROR) * x * x * x)
    return min(MAX_PARTICLES, max(MIN_PARTICLES, needed))


@inner
def _resample(own: Localisation) -> None:
    """Draw particles by weight until there are enough for the bins (0.5 m, 0.5 m, 10°) that they occupy."""
    last = own.counts[PARTICLES] - 1
    kinds = 0
    made = 0
    while made < MAX_PARTICLES:
        at = own.counts[UNIFORM_AT]
        own.counts[UNIFORM_AT] = (at + 1) % own.uniforms.size
        wanted = own.uniforms[at] * own.sums[last]
        low = 0
        high = last
        while low < high:
            middle = (low + high) // 2
            if own.sums[middle] > wanted:
                high = middle
            else:
                low = middle + 1
        drawn = own.particles[0, low]
        for j in range(3):
            own.particles[1, made, j] = drawn[j]
        made += 1
        cell = math.floor(drawn[0] / BIN_M) * 4096 + math.floor(drawn[1] / BIN_M)
        kind = cell * 256 + math.floor(drawn[2] / BIN_RAD)
        known = False
        for k in range(kinds):
            if own.bins[k] == kind:
                known = True
                break
        if not known:
            own.bins[kinds] = kind
            kinds += 1
        if made > _enough(kinds):
            break
    for i in range(made):
        for j in range(3):
            own.particles[0, i, j] = own.particles[1, i, j]
    own.counts[PARTICLES] = made


@inner
def _estimate(own: Localisation, x: float, y: float, yaw: float) -> None:
    """The map's place in the world: the particles' mean pose against the robot's pose (x, y, yaw) in the world."""
    n = own.counts[PARTICLES]
    mean_x = 0.0
    mean_y = 0.0
    cos = 0.0
    sin = 0.0
    for i in range(n):
        mean_x += own.particles[0, i, 0]
        mean_y += own.particles[0, i, 1]
        cos += math.cos(own.particles[0, i, 2])
        sin += math.sin(own.particles[0, i, 2])
    turn = wrap(math.atan2(sin, cos) - yaw)
    own.frame[MAP_X] = mean_x / n - (x * math.cos(turn) - y * math.sin(turn))
    own.frame[MAP_Y] = mean_y / n - (x * math.sin(turn) + y * math.cos(turn))
    own.frame[MAP_YAW] = turn
