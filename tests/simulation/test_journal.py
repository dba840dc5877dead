"""Recoveries and paths that differ clearly from the one before are events of the run."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from rvsg.core.kernels import kernel
from rvsg.core.records import Pose
from rvsg.evaluation.detection import events_of
from rvsg.robots.robot import Robot, load_robot
from rvsg.scenario.scenario import HumanAgent
from rvsg.simulation.embedded import behaviour_tree
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.run import Recovery, Replan
from rvsg.world.grid import Grid
from rvsg.world.world import OccupancyMap, Route, World


@kernel
def far_and_long(old: np.ndarray, new: np.ndarray) -> tuple[float, float]:
    return behaviour_tree.deviation(old, old.shape[0], new, new.shape[0]), behaviour_tree.length(new, new.shape[0])


def test_the_deviation_of_a_path_is_its_largest_distance_from_the_one_before() -> None:
    s = np.linspace(0.0, 8.0, 321)
    old = np.column_stack([s, np.zeros_like(s)])
    bent = np.column_stack([s, np.minimum(1.5, np.minimum(s, 8.0 - s))])
    assert far_and_long(old, old[100:]) == pytest.approx((0.0, 5.5), abs=0.1)
    assert far_and_long(old, bent)[0] == pytest.approx(1.5, abs=0.1)


def room(*blocks: tuple[float, float, float, float]) -> World:
    """Return a closed room of 10 x 6 m with boxes (x0, y0, x1, y1)."""
    cells = np.zeros((120, 200), np.uint8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    for x0, y0, x1, y1 in blocks:
        cells[round(y0 / 0.05) : round(y1 / 0.05), round(x0 / 0.05) : round(x1 / 0.05)] = 100
    return World(
        name="room",
        title="A room",
        objects=(),
        occupancy=OccupancyMap(cells=cells, resolution=0.05, origin=Pose(x=0.0, y=0.0)),
        lidar_height_m=0.2,
        grid=Grid(rows=(), columns=(), waypoints=(), hops=()),
        areas=(),
        routes=(),
    )


def standing(x: float, y: float) -> HumanAgent:
    return HumanAgent(name="human", start=(x, y), goals=((x, y),), pauses_s=(1000.0,))


def drive(world: World, people: list[HumanAgent], robot: Robot | None = None) -> tuple:
    route = Route(name="across", start=Pose(x=1.0, y=3.0), goal=Pose(x=9.0, y=3.0), time_limit_s=60.0)
    run = simulate_agents(world, route, people, robot=robot, seed=0)
    return run, [e for e in run.events if isinstance(e, Replan)], [e for e in run.events if isinstance(e, Recovery)]


def test_a_person_in_one_of_two_gates_makes_the_planner_take_the_other() -> None:
    run, replans, _ = drive(
        room((5.0, 0.05, 5.5, 0.6), (5.0, 1.9, 5.5, 2.4), (5.0, 3.7, 5.5, 5.95)), [standing(5.25, 3.05)]
    )
    assert run.completed
    assert replans and replans[0].deviation_m > behaviour_tree.CLEARLY_M
    assert replans[0].length_m > 0.0 and 0.0 < replans[0].time_s < run.trajectory.t[-1]


def test_a_person_in_the_only_gate_makes_the_navigation_recover() -> None:
    run, _, recoveries = drive(room((5.0, 0.05, 5.5, 2.55), (5.0, 3.55, 5.5, 5.95)), [standing(5.25, 3.05)])
    assert not run.completed
    assert run.recoveries >= 2 and len(recoveries) >= run.recoveries
    assert [e.action for e in recoveries[:2]] == ["clear_costmaps", "spin"]
    assert all(a.until_s <= b.time_s + 1e-9 for a, b in pairwise(recoveries))
    waits = [e for e in recoveries if e.action == "wait"]
    assert all(e.until_s - e.time_s <= 5.2 for e in waits)
    kinds = [e.kind for e in events_of(run)]
    assert kinds.count("recovery") == len(recoveries)


def test_a_robot_that_cannot_turn_on_the_spot_never_spins() -> None:
    gate = room((5.0, 0.05, 5.5, 2.55), (5.0, 3.55, 5.5, 5.95))
    _, _, recoveries = drive(gate, [standing(5.25, 3.05)], load_robot("tugger"))
    assert recoveries and not any(e.action == "spin" for e in recoveries)
