"""The particle filter finds where the map lies; a robot that knows it never doubts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.simulation.parts import TIAGO, room_cells, world_of

from rvsg.core.kernels import kernel
from rvsg.simulation.embedded.localisation import (
    MAX_PARTICLES,
    MIN_PARTICLES,
    PARTICLES,
    UPDATES,
    Localisation,
    _drive,
    _look,
    _weigh,
    beam_score,
    beam_scores,
    known_offset,
    localise,
    particle_filter,
    to_map,
    to_world,
)
from rvsg.world.world import OccupancyMap

SHIFT = (0.2, -0.15)
LIDAR = TIAGO.lidars[0]
RNG = np.random.default_rng


@kernel
def take_in(own: Localisation, x: float, y: float, yaw: float, edges: np.ndarray, t: float = 0.0) -> bool:
    return localise(own, t, x, y, yaw, edges, np.zeros((0, 2)))


@kernel
def weigh_from(own: Localisation, x: float, y: float, yaw: float, edges: np.ndarray) -> None:
    _look(own, x, y, yaw, edges, np.zeros((0, 2)))
    _weigh(own)


@kernel
def move_differentially(own: Localisation, dx: float, dy: float, turn: float) -> None:
    _drive(own, dx, dy, turn)


@kernel
def there_and_back(frame: np.ndarray, x: float, y: float) -> tuple[float, float]:
    a, b = to_map(frame, x, y)
    return to_world(frame, a, b)


def room() -> tuple[OccupancyMap, np.ndarray]:
    """A mapped room of 8 x 6 m with a niche; the real one is shifted by SHIFT."""
    corners = [(0.025, 0.025), (7.975, 0.025), (7.975, 5.975), (0.025, 5.975)]
    block = [(3.0, 2.0), (4.5, 2.0), (4.5, 2.2), (3.0, 2.2)]
    edges = [
        [*np.add(a, SHIFT), *np.add(b, SHIFT)]
        for outline in (corners, block)
        for a, b in zip(outline, [*outline[1:], outline[0]], strict=True)
    ]
    return world_of(room_cells(8.0, 6.0, (3.0, 2.0, 4.5, 2.2))).occupancy, np.array(edges)


def filter_at(x: float, y: float, yaw: float, *, noise: float = 0.01, seed: int = 0) -> Localisation:
    """Return a filter at its start in the room."""
    occupancy, _ = room()
    return particle_filter(beam_scores(occupancy, 25.0), occupancy, LIDAR, (x, y, yaw), noise, RNG(seed))


def test_the_heaviest_particle_is_where_the_robot_really_is() -> None:
    _, edges = room()
    own = filter_at(5.0, 3.8, 1.0, noise=0.0)
    errors = np.linspace(-0.4, 0.4, 33)
    x, y = (grid.ravel() for grid in np.meshgrid(errors, errors))
    own.particles[0, : len(x)] = np.column_stack([5.0 + x, 3.8 + y, np.full(len(x), 1.0)])
    own.counts[PARTICLES] = len(x)
    weigh_from(own, 5.0, 3.8, 1.0, edges)
    best = int(np.argmax(np.diff(own.sums[: len(x)], prepend=0.0)))
    # AMCL's rounding puts the map half a cell lower than it is.
    assert (x[best], y[best]) == pytest.approx((-SHIFT[0] - 0.025, -SHIFT[1] - 0.025), abs=0.026)


def test_the_filter_comes_nearer_to_the_truth_than_it_began() -> None:
    _, edges = room()
    found = []
    for seed in range(4):
        own = filter_at(5.0, 3.8, 1.5708, seed=seed)
        for angle in 0.05 * np.arange(240):  # round and round
            x, y = 4.0 + math.cos(angle), 3.8 + math.sin(angle)
            take_in(own, x, y, angle + 0.5 * math.pi, edges)
        found.append((-own.frame[0] + own.frame[2] * y, -own.frame[1] - own.frame[2] * x))
        assert own.counts[UPDATES] >= 30
        assert MIN_PARTICLES <= own.counts[PARTICLES] <= MAX_PARTICLES
    assert math.dist(np.mean(found, axis=0), SHIFT) < 0.75 * math.hypot(*SHIFT)


def test_a_robot_that_hardly_moves_takes_in_the_first_scan_only() -> None:
    _, edges = room()
    own = filter_at(1.5, 4.0, 0.0)
    taken = [take_in(own, 1.5 + 0.001 * k, 4.0, 0.0, edges) for k in range(5)]
    assert taken == [True, False, False, False, False]


def differential(yaws: list[float], noise: float) -> Localisation:
    """A differential robot at the origin with a particle for each yaw; every normal number it draws is `noise`."""
    occupancy, _ = room()
    own = particle_filter(
        beam_scores(occupancy, 25.0), occupancy, LIDAR, (0.0, 0.0, 0.0), 0.0, RNG(0), differential=True
    )
    own.normals[:] = noise
    own.particles[0, : len(yaws)] = [(0.0, 0.0, yaw) for yaw in yaws]
    own.counts[PARTICLES] = len(yaws)
    return own


def test_a_differential_robots_particles_move_as_it_moves() -> None:
    own = differential([0.0, 0.5], noise=0.0)
    move_differentially(own, 0.3, 0.4, 0.2)
    turned = (0.3 * math.cos(0.5) - 0.4 * math.sin(0.5), 0.3 * math.sin(0.5) + 0.4 * math.cos(0.5))
    assert own.particles[0, 0] == pytest.approx([0.3, 0.4, 0.2])
    assert own.particles[0, 1] == pytest.approx([*turned, 0.7])
    own = differential([0.3], noise=0.0)
    move_differentially(own, 0.0, 0.009, 0.25)  # on the spot it has no direction
    assert own.particles[0, 0, 2] == pytest.approx(0.55)
    assert math.hypot(*own.particles[0, 0, :2]) == pytest.approx(0.009)


def test_a_differential_robot_doubts_a_way_back_as_much_as_a_way_ahead() -> None:
    ahead, back = differential([0.0], noise=1.0), differential([0.0], noise=1.0)
    move_differentially(ahead, 1.0, 0.0, 0.0)
    move_differentially(back, -1.0, 0.0, 0.0)
    assert back.particles[0, 0, :2] == pytest.approx(-ahead.particles[0, 0, :2])
    assert 0.0 < ahead.particles[0, 0, 0] < 1.0


def test_points_come_back_from_the_map() -> None:
    own = known_offset(0.3, -0.2)
    assert there_and_back(own.frame, 1.0, 2.0) == pytest.approx((1.0, 2.0))
    own.frame[2] = 0.4
    assert there_and_back(own.frame, 1.0, 2.0) == pytest.approx((1.0, 2.0))


def test_a_beam_counts_most_where_it_ends_on_something() -> None:
    scores = beam_score(np.array([0.0, 0.1, 0.2, 2.0]), 25.0)
    assert (np.diff(scores) < 0).all()
    assert scores[0] == pytest.approx(0.52**3)


def test_a_map_without_obstacles_scores_evenly() -> None:
    assert len(np.unique(beam_scores(world_of(np.zeros((5, 5), np.uint8)).occupancy, 25.0))) == 1


def test_an_estimate_holds_for_the_robots_pose_a_second_later() -> None:
    _, edges = room()
    own = filter_at(1.5, 4.0, 0.0)
    held, estimates = [own.present.copy()], []
    for k in range(40):
        take_in(own, 1.5 + 0.05 * k, 4.0, 0.0, edges, 0.1 * k)
        held.append(own.present.copy())
        estimates.append(own.frame[:3].copy())
    assert not held[10].any()
    for k in range(10, 40):
        assert held[k + 1] == pytest.approx(estimates[k - 10], abs=1e-12)


def test_more_estimates_than_can_wait_are_not_lost() -> None:
    _, edges = room()
    own = filter_at(1.5, 4.0, 0.0)
    for k in range(12):
        take_in(own, 1.5 + 0.3 * k, 4.0, 0.0, edges, 0.01 * k)
    take_in(own, 1.5 + 0.3 * 11, 4.0, 0.0, edges, 1.11)
    assert own.present == pytest.approx(own.frame[:3], abs=1e-12)
