"""The robot's body does not enter walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.simulation.parts import TIAGO, room_cells, route, world_of

from rvsg.robots.robot import Bumper, Robot, load_robot
from rvsg.simulation.embedded.episode import Episode, Outside
from rvsg.simulation.embedded.profiles import profile
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.embedded.state import Surroundings
from rvsg.simulation.embedded.walls import SLACK_M, Walls, clearance, free_pose, overlap
from rvsg.simulation.events import ObstacleContact
from rvsg.simulation.run import Outcome, Run
from rvsg.world.world import World
from rvsg.world.world_folder import load_world


def room_with_door(width_m: float) -> tuple[World, float]:
    """Two rooms of 6 x 8 m and a door between them; the world and the door's middle (y)."""
    count = round(width_m / 0.05)
    low, high = (80 - count // 2) * 0.05, (80 - count // 2 + count) * 0.05
    cells = room_cells(12.0, 8.0, (5.9, 0.0, 6.1, low), (5.9, high, 6.1, 8.0))
    return world_of(cells, -6.0, -4.0), 0.5 * (low + high) - 4.0


def through(robot: Robot, width_m: float, seed: int = 0, outside: Outside | None = None) -> tuple[Run, Walls]:
    world, y = room_with_door(width_m)
    run = simulate_agents(world, route((-1.5, y), (2.0, y), 40.0), [], robot=robot, seed=seed, outside=outside)
    return run, Surroundings(world, robot).walls()


def deepest(run: Run, walls: Walls) -> float:
    """The most of an outline that is inside the body at any time of the run, m."""
    path = run.trajectory
    return max(overlap(walls, *pose) for pose in zip(path.x, path.y, path.yaw, strict=True))


WIDE = TIAGO.replace(footprint=((0.4, 0.6), (-0.4, 0.6), (-0.4, -0.6), (0.4, -0.6)), body=None)


@pytest.mark.parametrize(("robot", "width_m", "seed"), [(TIAGO, 0.45, 0), (TIAGO, 0.45, 1), (WIDE, 0.60, 0)])
def test_a_door_too_narrow_is_not_passed(robot: Robot, width_m: float, seed: int) -> None:
    run, walls = through(robot, width_m, seed)
    assert run.outcome in (Outcome.NO_PATH, Outcome.ABORTED, Outcome.STUCK, Outcome.TIMED_OUT)
    assert run.trajectory.x.max() < 0.0
    assert deepest(run, walls) <= 2 * SLACK_M


@pytest.mark.parametrize("seed", [0, 1])
def test_a_door_wide_enough_is_passed_without_contact(seed: int) -> None:
    run, walls = through(TIAGO, 0.60, seed)
    assert run.outcome is Outcome.REACHED
    assert deepest(run, walls) == 0.0
    assert not run.events


def ahead(_: Episode) -> tuple[float, float]:
    return 0.4, 0.0


@pytest.mark.parametrize("bumper", [None, Bumper(release_s=1.0)])
def test_a_robot_driven_into_a_wall_stops_there_and_says_so(bumper: Bumper | None) -> None:
    run, walls = through(TIAGO.replace(bumper=bumper), 0.45, outside=Outside(stack=ahead))
    assert run.outcome is Outcome.STUCK
    assert deepest(run, walls) <= 2 * SLACK_M
    wall = -0.1
    assert run.trajectory.x[-1] == pytest.approx(wall - 0.3585, abs=2e-3)
    first = run.events[0]
    assert isinstance(first, ObstacleContact)
    assert first.speed_m_s == pytest.approx(0.4, abs=0.01)
    assert first.x == pytest.approx(wall, abs=0.01)
    assert abs(first.y) < 0.3
    assert first.time_s < 3.5
    assert run.trajectory.v[-1] == pytest.approx(0.0, abs=1e-3)
    assert len(run.events) == (1 if bumper is None else len(run.events))


def test_a_robot_leaves_a_wall_it_has_touched() -> None:
    def there_and_back(episode: Episode) -> tuple[float, float]:
        return (0.4, 0.0) if episode.t < 5.0 else (-0.4, 0.0)

    run, _ = through(TIAGO, 0.45, outside=Outside(stack=there_and_back))
    assert run.trajectory.x.max() == pytest.approx(-0.1 - 0.3585, abs=2e-3)
    assert run.trajectory.x[-1] < -2.0


def test_in_the_published_profile_the_body_passes_through_walls() -> None:
    world, y = room_with_door(0.45)
    way = route((-1.5, y), (2.0, y), 20.0)
    run = simulate_agents(world, way, [], options=profile("published-study"), outside=Outside(stack=ahead))
    assert run.trajectory.x.max() > 1.0
    assert not run.events


def test_every_shipped_route_begins_and_stays_free() -> None:
    world = load_world("warehouse")
    walls = Surroundings(world, TIAGO).walls()
    for way in world.routes:
        start = free_pose(walls, way.start)
        assert start is not None, way.name
        assert math.dist((start.x, start.y), (way.start.x, way.start.y)) <= 0.1
        assert overlap(walls, start.x, start.y, start.yaw) <= SLACK_M


def test_a_start_inside_a_wall_is_an_outcome() -> None:
    world, y = room_with_door(0.45)
    assert simulate_agents(world, route((-0.2, y + 1.0), (2.0, y)), []).outcome is Outcome.BLOCKED_START


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
def test_overlap_is_the_length_of_outlines_inside_the_body(turn: float) -> None:
    world, _ = room_with_door(0.45)
    walls = Surroundings(world, TIAGO).walls()
    assert overlap(walls, -2.0, 1.0, turn) == 0.0
    x, y = -0.1 - 0.2, 2.0
    shapely = pytest.importorskip("shapely")
    cos, sin = math.cos(turn), math.sin(turn)
    corners = [(x + a * cos - b * sin, y + a * sin + b * cos) for a, b in TIAGO.outline]
    lines = shapely.MultiLineString([((e[0], e[1]), (e[2], e[3])) for e in walls.edges])
    expected = shapely.Polygon(corners).intersection(lines).length
    assert overlap(walls, x, y, turn) == pytest.approx(expected, abs=1e-9)


def test_clearance_is_the_distance_to_the_nearest_outline() -> None:
    world, _ = room_with_door(0.45)
    walls = Surroundings(world, TIAGO).walls()
    assert clearance(walls, -0.5, 2.0) == pytest.approx(0.4)
    assert clearance(walls, -3.0, 0.0) == pytest.approx(walls.reach)


def scraping(robot: Robot) -> tuple[Run, Walls]:
    """Drive straight on at 0.3 m/s, askew into the long wall of a room at y = 3.95."""
    world, _ = room_with_door(1.0)
    way = route((-4.0, 2.9, math.radians(35)), (-1.0, 0.0), 8.0)
    run = simulate_agents(world, way, [], robot=robot, seed=0, outside=Outside(stack=lambda _: (0.3, 0.0)))
    return run, Surroundings(world, robot).walls()


def test_an_omnidirectional_base_slides_along_a_wall() -> None:
    run, walls = scraping(TIAGO)
    touch = next(event for event in run.events if isinstance(event, ObstacleContact))
    path = run.trajectory
    after = path.t > touch.time_s + 0.2
    assert path.x[-1] - path.x[after][0] > 0.5
    assert deepest(run, walls) <= 2 * SLACK_M


def test_a_differential_base_turns_away_from_a_wall_and_moves_only_ahead() -> None:
    robot = load_robot("industrial_amr").replace(bumper=None, safety_zones=())
    run, walls = scraping(robot)
    path = run.trajectory
    assert run.events and abs(path.yaw[-1]) < math.radians(5)
    step_x, step_y, middle = np.diff(path.x), np.diff(path.y), path.yaw[:-1] + 0.5 * np.diff(path.yaw)
    aside = np.abs(step_y * np.cos(middle) - step_x * np.sin(middle))
    assert aside.max() < 1e-3
    assert deepest(run, walls) <= 2 * SLACK_M


def test_a_base_with_steered_wheels_stops_at_a_wall() -> None:
    run, walls = scraping(load_robot("tugger").replace(safety_zones=()))
    path = run.trajectory
    assert run.events
    assert np.hypot(path.x[-1] - path.x[-40], path.y[-1] - path.y[-40]) < 0.01
    assert np.ptp(path.yaw) < 0.01
    assert deepest(run, walls) <= 2 * SLACK_M


@pytest.mark.slow
@pytest.mark.parametrize("name", ["office", pytest.param("hospital", marks=pytest.mark.exhaustive)])
def test_no_shipped_route_is_lost_at_a_door_jamb(name: str) -> None:
    world = load_world(name)
    for way in world.routes:
        run = simulate_agents(world, way, [], seed=1)
        assert run.outcome is Outcome.REACHED, (way.name, run.events)
