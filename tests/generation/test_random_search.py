from collections import Counter
from dataclasses import replace
from itertools import pairwise

import pytest

from rvsg.generation.generator import Proposal
from rvsg.generation.random_search import RandomGenerator
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Mission
from rvsg.scenario.validity import warnings
from rvsg.world.grid import Grid
from rvsg.world.world import World
from rvsg.world.world_folder import load_world

WORLD = load_world("warehouse")


def drawn(seed: int, world: World = WORLD, **more: object) -> Proposal:
    mission = Mission.of(world, WORLD.route("route_1"))
    return RandomGenerator().propose(Brief(mission=mission, requirement=None, seed=seed, **more), world)


def test_a_random_configuration_is_valid_as_it_is_drawn() -> None:
    for seed in range(60):
        proposal = drawn(seed)
        assert proposal.first_findings == ()
        assert warnings(proposal.scenario.people, Mission.of(WORLD, WORLD.route("route_1")), WORLD) == ()


def test_seed_and_place_in_the_campaign_give_the_draw() -> None:
    assert drawn(3) == drawn(3)
    assert all(other.scenario != drawn(3).scenario for other in (drawn(4), drawn(3, scenario_index=1)))


def grid_of(*names: str) -> Grid:
    """The warehouse's grid with these waypoints only, in a chain."""
    waypoints = tuple(w for w in WORLD.grid.waypoints if w.name in names)
    return WORLD.grid.model_copy(update={"waypoints": waypoints, "hops": tuple(pairwise(names))})


def test_a_world_without_labels_is_walked_between_as_few_as_three_waypoints() -> None:
    assert drawn(1, replace(WORLD, areas=())).scenario is not None
    tiny = replace(WORLD, areas=(), grid=grid_of("E3", "E4", "E5"))
    assert all(drawn(seed, tiny).scenario is not None for seed in range(20))
    nowhere = drawn(1, replace(WORLD, areas=(), grid=grid_of()))
    assert nowhere.scenario is None and "fewer than two waypoints" in nowhere.problems[0].reason


@pytest.mark.exhaustive
def test_numbers_of_tasks_and_areas_are_drawn_fairly() -> None:
    tasks: Counter[int] = Counter()
    areas: Counter[str] = Counter()
    for seed in range(150):
        scenario = drawn(seed).scenario
        for human in scenario.people.humans:
            tasks[len(human.tasks)] += 1
            areas.update(task.start_area for task in human.tasks)
    assert set(tasks) == set(range(2, 21))
    assert max(tasks.values()) < 4 * min(tasks.values())
    assert len(areas) == len(WORLD.areas)
    assert max(areas.values()) < 1.6 * min(areas.values())


def test_a_number_of_tasks_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError):
        RandomGenerator(tasks=(0, 3))
