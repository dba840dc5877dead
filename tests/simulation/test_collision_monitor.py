"""What limits the command to the base: Nav2's collision monitor, and safety fields of scanners."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.simulation.parts import TIAGO, Constant, route, standing

from rvsg.core.errors import InvalidOptions
from rvsg.robots.robot import MonitorPolygon, Robot, SafetyZone, load_robot
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.run import Run
from rvsg.stacks import StackChoice

AHEAD = ((0.36, 0.6), (0.36, -0.6), (1.2, -0.6), (1.2, 0.6))
AMR = load_robot("industrial_amr")


def run_with(*polygons: dict[str, Any], at: tuple[float, float] = (0.5, 0.0), start: float = -2.0) -> Run:
    """Drive a bend whatever is ahead."""
    monitor = tuple(MonitorPolygon(name=f"polygon {k}", **values) for k, values in enumerate(polygons))
    robot = TIAGO.replace(navigation=TIAGO.navigation.replace(collision_monitor=monitor))
    way, planner = route((start, 0.0), (-2.0, -2.3), 7.0), Constant((0.4, 0.05))
    return simulate_agents(empty_room(), way, [standing(*at, 0.3)], robot=robot, seed=0, stack=StackChoice.of(planner))


def test_stop_ends_every_motion() -> None:
    run = run_with({"action_type": "stop", "points": AHEAD})
    assert -1.0 < run.trajectory.x[-1] < -0.6
    assert run.trajectory.v[-1] == 0.0 and run.trajectory.omega[-1] == 0.0


@pytest.mark.parametrize(
    ("options", "speed"),
    [
        ({"action_type": "slowdown", "slowdown_ratio": 0.25}, 0.1),
        ({"action_type": "limit", "linear_limit": 0.3, "angular_limit": 1.0}, 0.3),
        ({"action_type": "limit", "linear_limit": 1.0, "angular_limit": 0.025}, 0.2),
    ],
)
def test_slowdown_and_limit_keep_the_curvature(options: dict[str, Any], speed: float) -> None:
    run = run_with({**options, "points": AHEAD}, at=(0.5, 0.75))
    near = (run.trajectory.x > -0.35) & (run.trajectory.x < -0.2)
    assert run.trajectory.v[near] == pytest.approx(speed, abs=1e-3)
    assert run.trajectory.omega[near] == pytest.approx(speed / 8.0, abs=1e-3)
    assert run.trajectory.v[:40].max() == pytest.approx(0.4)


def test_approach_slows_down_before_the_footprint_touches_the_wall() -> None:
    run = run_with({"action_type": "approach", "time_before_collision": 1.2}, at=(-2.0, 2.0), start=0.6)
    t = run.trajectory
    assert t.v[20:40] == pytest.approx(0.4) and t.v[-1] < 0.05
    assert 2.3 < t.x[-1] + 0.36 < 2.95
    assert ((t.v[40:] > 0.05) & (t.v[40:] < 0.35)).sum() > 5  # by and by, not at once


def test_the_most_restrictive_polygon_holds_and_few_points_do_nothing() -> None:
    slow = {"action_type": "slowdown", "slowdown_ratio": 0.5, "points": AHEAD}
    both = run_with(slow, {"action_type": "limit", "linear_limit": 0.1, "points": AHEAD}, at=(0.5, 0.75))
    assert both.trajectory.v[-1] == pytest.approx(0.1, abs=1e-3)
    blind = run_with({**slow, "min_points": 4000}, at=(0.5, 0.75))
    assert blind.trajectory.v[20:60] == pytest.approx(0.4)


def test_a_compiled_stack_drives_under_a_monitor() -> None:
    around = ((1.2, 1.2), (-1.2, 1.2), (-1.2, -1.2), (1.2, -1.2))
    polygon = {"name": "all", "action_type": "limit", "linear_limit": 0.2, "angular_limit": 2.0, "points": around}
    way, people = route((-2.0, 0.0), (1.0, 0.0), 12.0), [standing(-0.5, 0.7)]
    monitored = StackChoice.of("nav2-dwb", {"collision_monitor": [polygon]})
    free, slowed = (simulate_agents(empty_room(), way, people, seed=0, stack=each) for each in (None, monitored))
    middle = np.abs(slowed.trajectory.x + 0.5) < 0.2
    assert slowed.trajectory.v[middle].max() < 0.25 < free.trajectory.v.max()


def test_a_wrong_polygon_is_refused() -> None:
    with pytest.raises(InvalidOptions, check=lambda error: error.keys == ("collision_monitor[0].action_type",)):
        StackChoice.of("nav2-dwb", {"collision_monitor": [{"name": "a", "action_type": "jump"}]})


def watched_by(*zones: SafetyZone) -> Robot:
    return AMR.replace(safety_zones=zones)


def zone(speed: float, low: float, high: float, reach: float = 1.2) -> SafetyZone:
    corners = ((0.5, low), (reach, low), (reach, high), (0.5, high))
    return SafetyZone(name="zone", polygon=corners, speed_m_s=speed, release_s=0.5)


def run_past(robot: Robot, *people: tuple[float, float]) -> Run:
    """Drive 3 m straight ahead in an empty room among people who stand."""
    agents = [standing(*place, 0.3) for place in people]
    return simulate_agents(empty_room(), route((-2.0, 0.0), (1.5, 0.0), 8.0), agents, robot=robot, seed=0)


@pytest.mark.parametrize("speed", [0.3, 0.0])
def test_somebody_in_a_zone_beside_the_way_limits_the_speed(speed: float) -> None:
    fast, slow = (run_past(robot, (0.0, 0.95)) for robot in (watched_by(), watched_by(zone(speed, 0.35, 1.2))))
    assert fast.trajectory.v[np.abs(fast.trajectory.x + 0.6) < 0.1].max() > 0.5
    if speed > 0.0:
        assert slow.trajectory.v[np.abs(slow.trajectory.x + 0.5) < 0.1].max() <= speed + 1e-6
    else:
        assert slow.trajectory.x.max() < 0.0
        assert slow.trajectory.v[-1] == 0.0
    assert slow.trajectory.v.max() > 0.5


def test_a_zone_that_is_clear_limits_nothing() -> None:
    free, watched = run_past(watched_by()), run_past(watched_by(zone(0.0, -0.3, 0.3, 0.7)))
    assert watched.trajectory.v.max() == pytest.approx(free.trajectory.v.max())
