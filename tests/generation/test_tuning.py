from __future__ import annotations

import numpy as np
import pytest

from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.generation.search_space import LONGEST_PAUSE_S, SPEEDS_M_S, Mutations, TuningSpace
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import load_requirement
from rvsg.scenario.scenario import HumanConfiguration, Mission, Scenario, at_places
from rvsg.scenario.validity import about_turns, check
from rvsg.world.world_folder import load_world


def drafted(seed: int, requirement: str = "R1") -> tuple[Scenario, TuningSpace]:
    world = load_world("warehouse")
    mission = Mission(world=world.name, world_id=world.id, route=world.route("route_2"))
    needed = load_requirement(requirement).for_time_limit(mission.route.time_limit_s)
    brief = Brief(mission=mission, requirement=needed, seed=seed)
    scenario = HeuristicGenerator().propose(brief, world).scenario
    return scenario, TuningSpace(scenario.people, mission, world)


@pytest.mark.parametrize("requirement", ["R1", "R3"])
@pytest.mark.parametrize("seed", range(4))
def test_the_start_of_the_space_is_the_configuration_itself(seed: int, requirement: str) -> None:
    scenario, space = drafted(seed, requirement)
    assert ((space.start >= 0.0) & (space.start <= 1.0)).all()
    assert space.configuration(space.start) == scenario.people


def test_every_drawn_configuration_is_valid_plausible_and_keeps_who_works_where() -> None:
    for seed in range(3):
        scenario, space = drafted(seed, "R3")
        mutations = Mutations(space, np.random.default_rng(seed))
        for _ in range(15):
            people, words = mutations.draw()
            assert people != scenario.people
            assert words
            assert not check(people, scenario.mission, space.world)
            for human, before in zip(people.humans, scenario.people.humans, strict=True):
                areas = {part for task in human.tasks for part in task.name.split(" → ")} - space.world.grid.valid
                known = {part for task in before.tasks for part in task.name.split(" → ")} - space.world.grid.valid
                assert areas == known
                assert human.behaviour is before.behaviour
                assert SPEEDS_M_S[0] <= human.speed_m_s <= SPEEDS_M_S[1]
                changed = {p for task in human.tasks for p in task.pauses} - {p for t in before.tasks for p in t.pauses}
                assert all(pause.duration_s <= LONGEST_PAUSE_S for pause in changed if pause.doing is None)
                assert about_turns(human, space.world.grid) == ()
                for work in (task.work for task in at_places(human.tasks)):
                    least, most = work.doing.seconds
                    assert least <= work.duration_s <= most


def test_each_dimension_changes_what_it_is_named_for() -> None:
    scenario, space = drafted(1)
    seen = set()
    for i, dimension in enumerate(space.dimensions):
        for share in (0.02, 0.35, 0.98):
            vector = space.start.copy()
            vector[i] = share
            people = space.configuration(vector)
            if people is None:
                continue
            human, before = people.humans[dimension.human], scenario.people.humans[dimension.human]
            changes = {
                "delay": human.start_delay_s != before.start_delay_s,
                "speed": human.speed_m_s != before.speed_m_s,
                "begins": human.tasks[0].path[0] != before.tasks[0].path[0],
                "pause": human.tasks != before.tasks,
            }
            if changes.get(dimension.name):
                seen.add(dimension.name)
            others = [h for k, h in enumerate(people.humans) if k != dimension.human]
            assert others == [h for k, h in enumerate(scenario.people.humans) if k != dimension.human]
    assert seen == {"delay", "speed", "begins", "pause"}


ALL = ("speed_m_s", "start_delay_s", "pause_s", "start", "stops")


def test_what_is_fixed_stays_and_a_range_is_kept() -> None:
    """ "Never pause", and walk at 0.9 to 1.3 m/s."""
    scenario, space = drafted(1)
    first, *others = (human.name for human in scenario.people.humans)
    limits = {first: {**dict.fromkeys(ALL), "speed_m_s": (0.9, 1.3)}, **{name: dict.fromkeys(ALL) for name in others}}
    narrow = TuningSpace(scenario.people, scenario.mission, space.world, limits)
    assert [d.name for d in narrow.dimensions] == ["speed"]
    mutations = Mutations(narrow, np.random.default_rng(3))
    speeds = []
    for _ in range(20):
        people, _ = mutations.draw()
        assert people is not None
        speeds.append(people.humans[0].speed_m_s)
        same = people.humans[0].model_copy(update={"speed_m_s": scenario.people.humans[0].speed_m_s})
        assert (same, *people.humans[1:]) == scenario.people.humans
    assert 0.9 <= min(speeds) < max(speeds) <= 1.3
    limits[first] = dict.fromkeys(ALL)
    nothing = TuningSpace(scenario.people, scenario.mission, space.world, limits)
    assert Mutations(nothing, np.random.default_rng(3)).draw() == (None, "")


def test_a_group_whose_pace_is_outside_of_a_range_may_still_be_tuned() -> None:
    """Nobody's number could change where two people of a group walk slower than the model lets an optimiser choose."""
    scenario, space = drafted(1)
    first, second, *_ = scenario.people.humans
    pace = {"group": 1, "speed_m_s": 0.7, "start_delay_s": 0.0}
    people = HumanConfiguration(humans=tuple(human.model_copy(update=pace) for human in (first, second)))
    limits = {human.name: {"speed_m_s": (0.9, 1.3)} for human in people.humans}
    space = TuningSpace(people, scenario.mission, space.world, limits)
    assert Mutations(space, np.random.default_rng(3)).draw()[0] is not None
