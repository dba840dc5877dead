"""The warehouse, a scenario drawn in it and its run by the kinematic simulator."""

from __future__ import annotations

import pytest

from rvsg.generation.random_search import RandomGenerator
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Mission, Scenario
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.simulation.run import Run
from rvsg.world.world import World
from rvsg.world.world_folder import load_world


@pytest.fixture(scope="package")
def world() -> World:
    return load_world("warehouse")


@pytest.fixture(scope="package")
def scenario(world: World) -> Scenario:
    mission = Mission.of(world, world.route("route_1"))
    drawn = RandomGenerator().propose(Brief(mission=mission, requirement=None, seed=3), world).scenario
    assert drawn is not None
    return drawn


@pytest.fixture(scope="package")
def run(scenario: Scenario, world: World) -> Run:
    return KinematicSimulator().run(scenario, world, seed=1)
