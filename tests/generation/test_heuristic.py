import re
from collections import Counter

import pytest
from tests.scenario.small_world import MISSION as HALL_MISSION
from tests.scenario.small_world import WORLD as HALL

from rvsg.generation.aims import Aim, aim_of
from rvsg.generation.chance import RandomGenerator
from rvsg.generation.conformance import DISTANCE, SMOOTH, TIMELY, check_generator, odd_briefs
from rvsg.generation.forecast import Forecaster
from rvsg.generation.generator import Proposal
from rvsg.generation.ground import Ground
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.scenario.brief import Brief, Feedback, Remembered
from rvsg.scenario.requirement import Requirement
from rvsg.scenario.scenario import Human, Mission, Scenario
from rvsg.scenario.validity.sides import parts_of, sides
from rvsg.world.load import load_world

WORLD = load_world("warehouse")
MISSION = Mission(world="warehouse", world_id=WORLD.id, route=WORLD.route("route_1"))
FORECAST = Forecaster(Ground(WORLD, MISSION.route), MISSION.route.time_limit_s)
GENERATOR = HeuristicGenerator(tries=20, changes=30)


def proposal(seed: int = 1, **more: object) -> Proposal:
    brief = Brief(**{"mission": MISSION, "requirement": DISTANCE, "seed": seed, **more})  # type: ignore[arg-type]
    return GENERATOR.propose(brief, WORLD)


def scenario(seed: int = 1, **more: object) -> Scenario:
    found = proposal(seed, **more).scenario
    assert found is not None
    return found


def remembered(found: Scenario) -> Remembered:
    tasks = {h.name: tuple(t.name for t in h.tasks) for h in found.people.humans}
    return Remembered(description=found.description, tasks=tasks, mean=1.0, interval=(1.0, 1.0), scenario=found)


def gap(found: Scenario) -> float:
    return FORECAST(found.people.humans).mean_gap_m


def test_people_are_expected_nearer_to_the_robot_than_by_chance() -> None:
    aimed = [gap(scenario(seed)) for seed in range(10)]
    by_chance = []
    for seed in range(10):
        found = RandomGenerator().propose(Brief(mission=MISSION, requirement=None, seed=seed), WORLD).scenario
        assert found is not None
        by_chance.append(gap(found))
    assert max(aimed) < min(sum(by_chance) / 10, 1.0)


def test_every_person_works_between_labelled_areas_and_never_runs() -> None:
    for seed in range(10):
        for human in scenario(seed).people.humans:
            assert 0.4 <= human.speed_m_s <= 1.6
            for task in human.tasks:
                start, end = sides(task, WORLD)
                assert start.known and end.known and start.text and end.text


def test_the_description_tells_the_work_the_people_and_the_robots_task() -> None:
    found = scenario()
    assert any(activity in found.description for activity in WORLD.activities)
    for human in found.people.humans:
        assert human.name in found.description
    assert MISSION.route.purpose in found.description


def stops(human: Human) -> list[str]:
    return [parts_of(task.name, WORLD)[0] for task in human.tasks]


def test_a_refinement_keeps_the_work_of_the_hour_and_describes_what_its_own_people_do() -> None:
    first = scenario()
    feedback = Feedback(scenario=first, objectives=(1.0,), mean=1.0, interval=(1.0, 1.0))
    for index in range(1, 6):
        later = scenario(kind="refine", feedback=feedback, configuration_index=index)
        assert later.description.split(". ")[0] == first.description.split(". ")[0]
        assert later.people != first.people
        assert gap(later) < gap(first) + 0.3


@pytest.mark.parametrize("text", [None, "Two people restock shelves."])
def test_after_many_refinements_the_description_names_the_places_of_the_people_and_no_others(text: str | None) -> None:
    known = scenario() if text is None else scenario().replace(description=text)
    moved = 0
    for index in range(1, 13):
        feedback = Feedback(scenario=known, objectives=(1.0,), mean=1.0, interval=(1.0, 1.0))
        later = scenario(kind="refine", feedback=feedback, configuration_index=index)
        for human, was in zip(later.people.humans, known.people.humans, strict=True):
            if stops(human) != stops(was):
                moved += 1
            elif text is not None and human.name not in known.description:
                continue
            told = next(p for p in re.split(r"[;.] ?| (?=Human)", later.description) if p.startswith(human.name))
            where = re.split(r", | and ", told.split(": ")[1])
            assert where == list(dict.fromkeys(stops(human))), (later.description, human)
        known = later
    assert moved > 2


def test_refinements_of_one_configuration_differ_from_each_other() -> None:
    feedback = Feedback(scenario=scenario(), objectives=(1.0,), mean=1.0, interval=(1.0, 1.0))
    ids = {scenario(kind="refine", feedback=feedback, configuration_index=i).id for i in range(1, 6)}
    assert len(ids) >= 4


def places(found: Scenario) -> set[str]:
    return {part for h in found.people.humans for t in h.tasks for part in parts_of(t.name, WORLD)}


def test_memory_makes_new_scenarios_work_elsewhere() -> None:
    with_memory, without = Counter[bool](), Counter[bool]()
    for seed in range(8):
        known = scenario(seed)
        memory = (remembered(known), remembered(known), remembered(known))
        new, blind = scenario(seed + 100, memory=memory), scenario(seed + 100)
        with_memory.update(place in places(known) for place in places(new))
        without.update(place in places(known) for place in places(blind))
        assert new.description.split(". ")[0] != known.description.split(". ")[0]
    assert with_memory[True] / with_memory.total() < without[True] / without.total() - 0.1


def test_an_unguided_brief_is_not_aimed() -> None:
    assert "Unguided" in proposal(requirement=None).reasoning
    blind = [gap(scenario(seed, requirement=None)) for seed in range(10)]
    aimed = [gap(scenario(seed)) for seed in range(10)]
    assert sum(blind) > 2 * sum(aimed)


def test_the_reasoning_says_what_was_done_and_expected() -> None:
    text = proposal().reasoning
    assert "Of 20 people drawn" in text and "Expected: mean gap" in text


@pytest.mark.parametrize(
    ("metric", "formula", "aim"),
    [
        ("dto", None, Aim.SHARE),
        ("jerk", None, Aim.DISTURB),
        ("trg", None, Aim.DELAY),
        ("min_distance", None, Aim.MEET),
        ("contacts", None, Aim.MEET),
        (None, "always (gap > 0.2)", Aim.SHARE),
        ("something_else", None, Aim.SHARE),
    ],
)
def test_the_aim_follows_the_requirement(metric: str | None, formula: str | None, aim: Aim) -> None:
    requirement = Requirement(name="X", title="X", text="X", metric=metric, formula=formula)
    assert aim_of(requirement) is aim


def test_other_requirements_bring_about_other_work() -> None:
    blocked = [FORECAST(scenario(s, requirement=TIMELY).people.humans).blocked_s for s in range(5)]
    met = [FORECAST(scenario(s, requirement=SMOOTH).people.humans).meetings for s in range(5)]
    near = [FORECAST(scenario(s).people.humans) for s in range(5)]
    assert sum(blocked) > sum(f.blocked_s for f in near)
    assert sum(met) > sum(f.meetings for f in near)


def test_it_works_in_any_world_with_labels() -> None:
    check_generator(GENERATOR, odd_briefs(GENERATOR, HALL_MISSION, HALL), HALL)
