from collections import Counter
from dataclasses import replace

import pytest

from rvsg.generation.random_search import RandomGenerator
from rvsg.scenario.brief import Brief
from rvsg.scenario.scenario import Mission
from rvsg.scenario.validity import warnings
from rvsg.world.grid import Grid
from rvsg.world.world_folder import load_world

WORLD = load_world("warehouse")
MISSION = Mission(world="warehouse", world_id=WORLD.id, route=WORLD.route("route_1"))


def brief(seed: int, **more: object) -> Brief:
    return Brief(mission=MISSION, requirement=None, seed=seed, **more)


def test_a_random_configuration_is_valid_as_it_is_drawn() -> None:
    for seed in range(60):
        proposal = RandomGenerator().propose(brief(seed), WORLD)
        assert proposal.first_findings == ()
        assert warnings(proposal.scenario.people, MISSION, WORLD) == ()


@pytest.mark.exhaustive
def test_numbers_of_tasks_and_areas_are_drawn_fairly() -> None:
    tasks: Counter[int] = Counter()
    areas: Counter[str] = Counter()
    for seed in range(150):
        scenario = RandomGenerator().propose(brief(seed), WORLD).scenario
        for human in scenario.people.humans:
            tasks[len(human.tasks)] += 1
            areas.update(task.start_area for task in human.tasks)
    assert set(tasks) == set(range(2, 21))
    assert max(tasks.values()) < 4 * min(tasks.values())
    assert len(areas) == len(WORLD.areas)
    assert max(areas.values()) < 1.6 * min(areas.values())


def test_seed_and_place_in_the_campaign_give_the_draw() -> None:
    generator = RandomGenerator()
    assert generator.propose(brief(3), WORLD) == generator.propose(brief(3), WORLD)
    others = [generator.propose(brief(4), WORLD), generator.propose(brief(3, scenario_index=1), WORLD)]
    assert all(other.scenario != generator.propose(brief(3), WORLD).scenario for other in others)


def test_a_world_without_labels_is_walked_between_waypoints() -> None:
    bare = replace(WORLD, areas=())
    mission = Mission(world="warehouse", world_id=bare.id, route=WORLD.route("route_1"))
    proposal = RandomGenerator().propose(Brief(mission=mission, requirement=None, seed=1), bare)
    assert proposal.scenario is not None


def test_a_world_without_anywhere_to_walk_is_answered_with_a_problem() -> None:
    bare = replace(WORLD, areas=(), grid=Grid(rows=("A",), columns=("1",), waypoints=(), hops=()))
    proposal = RandomGenerator().propose(brief(1), bare)
    assert proposal.scenario is None
    assert "fewer than two waypoints" in proposal.problems[0].reason


def test_a_world_of_three_waypoints_is_enough() -> None:
    names = [w for w in WORLD.grid.waypoints if w.name in ("E3", "E4", "E5")]
    grid = Grid(
        rows=WORLD.grid.rows, columns=WORLD.grid.columns, waypoints=tuple(names), hops=(("E3", "E4"), ("E4", "E5"))
    )
    tiny = replace(WORLD, areas=(), grid=grid)
    mission = Mission(world="warehouse", world_id=tiny.id, route=WORLD.route("route_1"))
    for seed in range(20):
        assert RandomGenerator().propose(Brief(mission=mission, requirement=None, seed=seed), tiny).scenario is not None


def test_a_number_of_tasks_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError):
        RandomGenerator(tasks=(0, 3))
