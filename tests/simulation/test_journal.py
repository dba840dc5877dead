"""Recoveries and paths that differ clearly from the one before are events of the run."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from tests.simulation.parts import room_cells, route, standing, world_of

from rvsg.core.kernels import kernel
from rvsg.evaluation.detection import events_of
from rvsg.robots.robot import Robot, load_robot
from rvsg.simulation.embedded import behaviour_tree
from rvsg.simulation.embedded.simulator import simulate_agents
from rvsg.simulation.events import Recovery, Replan
from rvsg.simulation.stacks.stack_choice import StackChoice


@kernel
def far_and_long(old: np.ndarray, new: np.ndarray) -> tuple[float, float]:
    return behaviour_tree.deviation(old, old.shape[0], new, new.shape[0]), behaviour_tree.length(new, new.shape[0])


def test_the_deviation_of_a_path_is_its_largest_distance_from_the_one_before() -> None:
    s = np.linspace(0.0, 8.0, 321)
    old = np.column_stack([s, np.zeros_like(s)])
    bent = np.column_stack([s, np.minimum(1.5, np.minimum(s, 8.0 - s))])
    assert far_and_long(old, old[100:]) == pytest.approx((0.0, 5.5), abs=0.1)
    assert far_and_long(old, bent)[0] == pytest.approx(1.5, abs=0.1)


def drive(gates: list[tuple[float, float]], robot: Robot | None = None) -> tuple:
    """Drive across a room of 10 x 6 m with a wall that has these gates, and a person in the middle one."""
    low, high = [0.05, *(end for _, end in gates)], [*(begin for begin, _ in gates), 5.95]
    blocks = [(5.0, a, 5.5, b) for a, b in zip(low, high, strict=True)]
    world, way = world_of(room_cells(10.0, 6.0, *blocks)), route((1.0, 3.0), (9.0, 3.0), 60.0)
    humble = StackChoice.of("nav2-dwb-humble")  # recovers where the planner finds no way; today's Nav2 gives up
    run = simulate_agents(world, way, [standing(5.25, 3.05)], robot=robot, seed=0, stack=humble)
    return run, [e for e in run.events if isinstance(e, Replan)], [e for e in run.events if isinstance(e, Recovery)]


def test_a_person_in_one_of_two_gates_makes_the_planner_take_the_other() -> None:
    run, replans, _ = drive([(0.6, 1.9), (2.4, 3.7)])
    assert run.completed
    assert replans and replans[0].deviation_m > behaviour_tree.CLEARLY_M
    assert replans[0].length_m > 0.0 and 0.0 < replans[0].time_s < run.trajectory.t[-1]


def test_a_person_in_the_only_gate_makes_the_navigation_recover() -> None:
    run, _, recoveries = drive([(2.55, 3.55)])
    assert not run.completed
    assert run.recoveries >= 2 and len(recoveries) >= run.recoveries
    assert [e.action for e in recoveries[:2]] == ["clear_costmaps", "spin"]
    assert all(a.until_s <= b.time_s + 1e-9 for a, b in pairwise(recoveries))
    waits = [e for e in recoveries if e.action == "wait"]
    assert all(e.until_s - e.time_s <= 5.2 for e in waits)
    kinds = [e.kind for e in events_of(run)]
    assert kinds.count("recovery") == len(recoveries)


def test_a_robot_that_cannot_turn_on_the_spot_never_spins() -> None:
    _, _, recoveries = drive([(2.55, 3.55)], load_robot("tugger"))
    assert recoveries and not any(e.action == "spin" for e in recoveries)
