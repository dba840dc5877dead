"""Every offline generator passes the exam that plug-in writers are given, in every shipped world."""

import pytest
from tests.conformance.briefs import odd_briefs

from rvsg.generation.generator import Generator
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.generation.random_search import RandomGenerator
from rvsg.scenario.scenario import Mission
from rvsg.testing import check_generator
from rvsg.world.world_folder import load_world, shipped_worlds

GENERATORS: list[Generator] = [RandomGenerator(), HeuristicGenerator(tries=5, changes=10)]


@pytest.mark.parametrize("generator", GENERATORS, ids=lambda g: g.name)
@pytest.mark.parametrize(
    "world_name", [pytest.param(n, marks=() if n == "warehouse" else pytest.mark.slow) for n in shipped_worlds()]
)
def test_a_generator_keeps_its_promises(generator: Generator, world_name: str) -> None:
    world = load_world(world_name)
    mission = Mission(world=world.name, world_id=world.id, route=world.routes[0])
    briefs = odd_briefs(generator, mission, world)
    # The odd briefs are odd in every world; elsewhere than in the warehouse routes, and so forecasts, are long.
    check_generator(generator, briefs if world_name == "warehouse" else (briefs[0], *briefs[-2:]), world)
