"""Nav2's collision monitor: its polygons scale the command to the base."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rvsg.core.errors import InvalidOptions
from rvsg.core.records import Pose
from rvsg.robots.robot import MonitorPolygon, load_robot
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.embedded.simulator import empty_room, simulate_agents
from rvsg.simulation.run import Run
from rvsg.stacks import LocalObservation, LocalPlanner, StackChoice, Task
from rvsg.world.world import Route

AHEAD = ((0.36, 0.6), (0.36, -0.6), (1.2, -0.6), (1.2, 0.6))


class Straight(LocalPlanner):
    """Drive a bend whatever is ahead."""

    answer_time_s = None

    def reset(self, task: Task) -> None:
        """Know nothing."""

    def command(self, seen: LocalObservation) -> tuple[float, float]:
        """Always the same."""
        return 0.4, 0.05


def run_with(*polygons: dict[str, Any], at: tuple[float, float] = (0.5, 0.0), start: float = -2.0) -> Run:
    tiago = load_robot("tiago_omni")
    monitor = tuple(MonitorPolygon(name=f"polygon {k}", **values) for k, values in enumerate(polygons))
    robot = tiago.replace(navigation=tiago.navigation.replace(collision_monitor=monitor))
    person = HumanAgent(name="person", start=at, goals=(at,), pauses_s=(0.0,), radius_m=0.3)
    route = Route(name="ahead", start=Pose(x=start, y=0.0), goal=Pose(x=-2.0, y=-2.3), time_limit_s=7.0)
    return simulate_agents(empty_room(), route, [person], robot=robot, seed=0, stack=StackChoice.of(Straight()))


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
    room, route = empty_room(), Route(name="a", start=Pose(x=-2.0, y=0.0), goal=Pose(x=1.0, y=0.0), time_limit_s=12.0)
    around = ((1.2, 1.2), (-1.2, 1.2), (-1.2, -1.2), (1.2, -1.2))
    polygon = {"name": "all", "action_type": "limit", "linear_limit": 0.2, "angular_limit": 2.0, "points": around}
    stack = StackChoice.of("nav2-dwb", {"collision_monitor": [polygon]})
    person = HumanAgent(name="person", start=(-0.5, 0.7), goals=((-0.5, 0.7),), pauses_s=(0.0,))
    free, slowed = (simulate_agents(room, route, [person], seed=0, stack=each) for each in (None, stack))
    middle = np.abs(slowed.trajectory.x + 0.5) < 0.2
    assert slowed.trajectory.v[middle].max() < 0.25 < free.trajectory.v.max()


def test_a_wrong_polygon_is_refused() -> None:
    with pytest.raises(InvalidOptions, check=lambda error: error.keys == ("collision_monitor[0].action_type",)):
        StackChoice.of("nav2-dwb", {"collision_monitor": [{"name": "a", "action_type": "jump"}]})
