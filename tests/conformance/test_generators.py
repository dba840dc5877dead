"""Every offline generator passes the exam that plug-in writers are given, in every shipped world."""

import pytest

from rvsg.generation.chance import RandomGenerator
from rvsg.generation.conformance import check_generator, odd_briefs
from rvsg.generation.generator import Generator
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.scenario.scenario import Mission
from rvsg.world.load import load_world, shipped_worlds

GENERATORS: list[Generator] = [RandomGenerator(), HeuristicGenerator(tries=15, changes=30)]


@pytest.mark.parametrize("generator", GENERATORS, ids=lambda g: g.name)
@pytest.mark.parametrize("world_name", shipped_worlds())
def test_a_generator_keeps_its_promises(generator: Generator, world_name: str) -> None:
    world = load_world(world_name)
    for route in world.routes[:2]:
        mission = Mission(world=world.name, world_id=world.id, route=route)
        check_generator(generator, odd_briefs(generator, mission, world), world)
