"""The offline generator: activities decide work, and worlds decide who takes part."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.generation.people_sampler import CHILD, MOVED, TROLLEY, WHEELCHAIR
from rvsg.generation.random_search import RandomGenerator
from rvsg.generation.workplaces import Place, follows, handles_goods, named_in, places_of, sentence
from rvsg.runs.runner import RunMaker, RunRequest
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Aim, load_requirement
from rvsg.scenario.scenario import Mission, PersonKind, Scenario
from rvsg.scenario.validity import check
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.world.world import World
from rvsg.world.world_folder import load_world

PLACES = tuple(
    Place(name, kind, ("A1",))
    for name, kind in (("Storage", "store"), ("Kitchen", "kitchen"), ("Table 1", "table"), ("Table 2", "table"))
)


def proposed(world: World, seed: int, humans: int = 2) -> Scenario:
    route = world.routes[seed % len(world.routes)]
    brief = Brief(
        mission=Mission.of(world, route), requirement=load_requirement("R1"), aim=Aim.SHARE, seed=seed, humans=humans
    )
    return HeuristicGenerator(tries=10).propose(brief, world).scenario


@pytest.fixture(scope="module")
def hospital() -> World:
    return load_world("hospital")


@pytest.mark.parametrize(
    ("activity", "named"),
    [
        ("brings boxes from Storage to the Kitchen", [["Storage"], ["Kitchen"]]),
        ("serves the tables", [["Table 1", "Table 2"]]),
        ("carries plates from table 2 to the kitchen.", [["Table 2"], ["Kitchen"]]),
        ("sings", []),
    ],
)
def test_an_activity_names_places_in_its_order(activity: str, named: list[list[str]]) -> None:
    assert [[place.name for place in places] for places in named_in(activity, PLACES)] == named


@pytest.mark.parametrize("seed", range(4))
def test_somebody_does_the_work_that_is_told(hospital: World, seed: int) -> None:
    scenario = proposed(hospital, seed)
    told = scenario.idea.removeprefix("The work of the hour: ").split(". ")[0]
    assert told in hospital.activities
    named = named_in(told, places_of(hospital, reachable_from=scenario.mission.route.start))
    assert any(follows(human, named) for human in scenario.people.humans)
    assert ".." not in scenario.description


def test_nobody_sorts_goods_where_there_are_none(hospital: World) -> None:
    places = places_of(hospital, reachable_from=hospital.routes[0].start)
    assert not handles_goods(places)
    words = " ".join(proposed(hospital, seed).description for seed in range(3))
    assert "goods" not in words and "loaded trolley" not in words
    assert sentence("take them back. ") == "take them back"


def test_an_activity_with_a_cart_is_done_with_a_trolley(hospital: World) -> None:
    work = "push a linen cart from the linen store along the corridor."
    carts = replace(hospital, activities=(work,), actors=(TROLLEY,))
    scenario = proposed(carts, 1)
    pushing = [human for human in scenario.people.humans if human.trolley is not None]
    named = named_in(work, places_of(carts, reachable_from=scenario.mission.route.start))
    assert any(follows(human, named) for human in pushing)
    assert ".." not in scenario.description and "pushes a trolley" in scenario.description


def test_the_world_says_which_work_needs_a_trolley(hospital: World) -> None:
    work, plain = "take linen to the linen store", "push a cart along the corridor"
    world = replace(hospital, activities=(work, plain))
    assert not world.needs_trolley(work) and world.needs_trolley(plain)
    said = replace(world, trolley_work={work: True, plain: False})
    assert said.needs_trolley(work) and not said.needs_trolley(plain)


def test_random_people_take_part_as_the_world_allows(hospital: World) -> None:
    mission = Mission.of(hospital, hospital.routes[0])

    def drawn(seed: int, world: World) -> Scenario:
        brief = Brief(mission=mission, requirement=None, seed=seed, humans=3)
        scenario = RandomGenerator().propose(brief, world).scenario
        assert check(scenario.people, scenario.mission, world) == ()
        return scenario

    found = [drawn(seed, replace(hospital, actors=(TROLLEY, CHILD, WHEELCHAIR, MOVED))) for seed in (1, 2)]
    people = [human for scenario in found for human in scenario.people.humans]
    assert any(human.trolley for human in people)
    assert {human.kind for human in people} > {PersonKind.ADULT}
    assert any(scenario.mission.moved for scenario in found)
    before = drawn(1, replace(hospital, actors=()))
    assert before.mission.moved == ()
    walks = [[[task.path for task in human.tasks] for human in each.people.humans] for each in (before, found[0])]
    assert walks[0] == walks[1]
    for seed in range(3):
        scenario = proposed(replace(hospital, actors=()), seed)
        assert {(human.kind, human.trolley) for human in scenario.people.humans} == {(PersonKind.ADULT, None)}
        assert scenario.mission.moved == ()


def test_objects_are_moved_only_where_the_checker_allows(hospital: World) -> None:
    found = [proposed(replace(hospital, actors=(MOVED,)), seed) for seed in range(4)]
    moved = [scenario for scenario in found if scenario.mission.moved]
    assert moved
    for scenario in moved:
        there = hospital.with_moved(scenario.mission.moved)
        assert check(scenario.people, scenario.mission, there) == ()
    kept = HeuristicGenerator(tries=5)
    assert kept.propose(Brief(mission=moved[0].mission, requirement=None, seed=9), hospital).scenario is not None


def test_a_campaign_runs_in_the_world_with_what_was_moved(hospital: World) -> None:
    seen: list[World] = []

    class Looking(KinematicSimulator):
        def run(self, scenario, world, *, seed):
            seen.append(world)
            return super().run(scenario, world, seed=seed)

    scenario = next(s for s in (proposed(hospital, seed) for seed in range(12)) if s.mission.moved)
    maker = RunMaker(Looking(), hospital)
    maker(RunRequest(scenario, 0))
    maker(RunRequest(scenario, 1))
    maker(RunRequest(scenario.replace(mission=scenario.mission.replace(moved=())), 0))
    assert [world.moved for world in seen] == [scenario.mission.moved, scenario.mission.moved, ()]
    assert seen[0] is seen[1] and seen[2] is hospital
