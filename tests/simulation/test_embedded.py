"""The embedded simulator as a whole: an episode in the shipped warehouse."""

from __future__ import annotations

import numpy as np
import pytest

from rvsg.scenario.agents import HumanAgent
from rvsg.simulation.embedded import EmbeddedSimulator, simulate_agents
from rvsg.simulation.options import profile
from rvsg.simulation.run import Outcome, Run
from rvsg.world.load import load_world
from rvsg.world.world import World


@pytest.fixture(scope="module")
def warehouse() -> World:
    return load_world("warehouse")


def walker(world: World, *names: str) -> HumanAgent:
    places = tuple(world.grid.position(name) for name in names)
    return HumanAgent(name=names[0], start=places[0], goals=places, pauses_s=(0.0,) * len(places))


def equal(a: Run, b: Run) -> bool:
    pairs = [(getattr(a.trajectory, k), getattr(b.trajectory, k)) for k in vars(a.trajectory)]
    pairs += [(getattr(a.log, k), getattr(b.log, k)) for k in vars(a.log)] + [(a.imu, b.imu)]
    return a.outcome is b.outcome and all(np.array_equal(x, y) for x, y in pairs)


@pytest.mark.parametrize("name", ["default", "published-study"])
def test_the_robot_reaches_its_goal_among_people(warehouse: World, name: str) -> None:
    agents = [walker(warehouse, "G13", "F13", "F14"), walker(warehouse, "E20", "E19", "E18", "F18")]
    run = simulate_agents(warehouse, warehouse.route("route_1"), agents, options=profile(name), seed=1)
    assert run.outcome is Outcome.REACHED
    end = np.hypot(run.trajectory.x[-1] - run.goal[0], run.trajectory.y[-1] - run.goal[1])
    assert end <= 0.25 + 0.02
    assert 15.0 < run.log.t[-1] < 25.0
    assert np.allclose(np.diff(run.trajectory.t), 0.05)
    assert np.all(np.abs(np.diff(run.log.t[:-1]) - 0.505) < 0.02)
    assert len(run.imu) == pytest.approx(100 * run.trajectory.t[-1], abs=10)
    assert run.trajectory.v.max() == pytest.approx(0.5)


def test_equal_seeds_give_equal_runs_and_other_seeds_do_not(warehouse: World) -> None:
    agents = [walker(warehouse, "G13", "F13", "F14")]
    route = warehouse.route("route_1")
    first, again, other = (simulate_agents(warehouse, route, agents, seed=seed) for seed in (3, 3, 4))
    assert equal(first, again)
    assert not equal(first, other)


def test_the_options_tell_profile_and_noise() -> None:
    simulator = EmbeddedSimulator("published-study", noise={"lidar": 0})
    assert simulator.options["profile"] == "published-study"
    assert simulator.options["noise"]["lidar"] == 0.0  # type: ignore[index]
