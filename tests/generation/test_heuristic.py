import re
from collections import Counter

import pytest
from tests.conformance.briefs import DISTANCE, SMOOTH, TIMELY, odd_briefs
from tests.scenario.small_world import MISSION as HALL_MISSION
from tests.scenario.small_world import WORLD as HALL

from rvsg.generation.forecast import Forecaster
from rvsg.generation.generator import Proposal
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.generation.random_search import RandomGenerator
from rvsg.generation.workplaces import WalkingGraph
from rvsg.scenario.brief import Brief, Feedback, Remembered
from rvsg.scenario.requirement import Aim, Requirement
from rvsg.scenario.rules import task_ends
from rvsg.scenario.scenario import (
    Behaviour,
    ForceFactors,
    Human,
    HumanConfiguration,
    Mission,
    Scenario,
    Task,
    at_places,
    ends_of,
)
from rvsg.scenario.validity import warnings
from rvsg.testing import check_generator
from rvsg.world.world_folder import load_world

WORLD = load_world("warehouse")
MISSION = Mission(world="warehouse", world_id=WORLD.id, route=WORLD.route("route_1"))
FORECAST = Forecaster(WalkingGraph(WORLD, MISSION.route), MISSION.route.time_limit_s)
AIMS = {DISTANCE: Aim.SHARE, SMOOTH: Aim.DISTURB, TIMELY: Aim.DELAY}
PATH = ("G13", "G14", "G15", "G16", "G17", "G18", "G19", "G20")
GENERATOR = HeuristicGenerator(tries=20, changes=30)


def proposal(seed: int = 1, **more: object) -> Proposal:
    given: dict[str, object] = {"mission": MISSION, "requirement": DISTANCE, "seed": seed, **more}
    brief = Brief(aim=AIMS.get(given["requirement"]), **given)
    return GENERATOR.propose(brief, WORLD)


def scenario(seed: int = 1, **more: object) -> Scenario:
    return proposal(seed, **more).scenario


def measured(found: Scenario) -> Feedback:
    return Feedback(scenario=found, objectives=(1.0,), mean=1.0, interval=(1.0, 1.0))


def refined(found: Scenario, seed: int = 1, index: int = 1, **more: object) -> Scenario:
    return scenario(seed, kind="refine", feedback=measured(found), configuration_index=index, **more)


def test_people_work_between_labelled_areas_never_run_and_are_described() -> None:
    for seed in range(10):
        found = scenario(seed)
        assert any(activity in found.description for activity in WORLD.activities)
        assert MISSION.route.purpose in found.description
        for human in found.people.humans:
            assert human.name in found.description
            assert 0.4 <= human.speed_m_s <= 1.6
            for task in human.tasks:
                start, end = task_ends(task, WORLD)
                assert start.known and end.known and start.text and end.text
    text = proposal().reasoning
    assert "Of 20 people drawn" in text and "Expected: mean gap" in text


def test_refinements_keep_the_work_of_the_hour_and_differ() -> None:
    first = scenario()
    found = [refined(first, index=index) for index in range(1, 6)]
    for later in found:
        assert later.description.split(". ")[0] == first.description.split(". ")[0]
        assert later.people != first.people
        assert gap(later) < gap(first) + 0.3
    assert len({later.id for later in found}) >= 4


@pytest.mark.parametrize("requirement", [DISTANCE, SMOOTH, TIMELY, None])
def test_nobody_starts_hard_by_the_robot(requirement: Requirement | None) -> None:
    for seed in range(3):
        found = scenario(seed, requirement=requirement)
        assert warnings(found.people, MISSION, WORLD) == ()
        assert warnings(refined(found, seed, requirement=requirement).people, MISSION, WORLD) == ()


def test_a_refinement_leads_away_who_started_hard_by_the_robot() -> None:
    first = scenario(1, requirement=SMOOTH)
    near = Human(name="Human 1", tasks=(Task(name="G13 → G20", path=PATH), Task(name="G20 → G13", path=PATH[::-1])))
    close = first.replace(people=HumanConfiguration(humans=(near, *first.people.humans[1:])))
    assert warnings(close.people, MISSION, WORLD) != ()
    assert warnings(refined(close, requirement=SMOOTH).people, MISSION, WORLD) == ()


def is_pair(found: Scenario) -> bool:
    """Whether two people work together, as is told; those who do set off together at one pace."""
    first, second = found.people.humans
    assert first.group == second.group
    assert found.description.count("together with") == (first.group is not None)
    if first.group is not None:
        assert (first.speed_m_s, first.start_delay_s) == (second.speed_m_s, second.start_delay_s)
    return first.group is not None


def test_two_people_may_work_together_to_hold_the_robot_up() -> None:
    found = [scenario(seed, requirement=TIMELY) for seed in range(16, 28)]
    pairs = [each for each in found if is_pair(each)]
    assert 1 <= len(pairs) < 12
    assert all(human.factors == ForceFactors() for each in found for human in each.people.humans)
    assert all("Human 2 works together with Human 1" in pair.description for pair in pairs)
    kept = []
    for seed, later in enumerate(pairs[:3]):
        for index in range(1, 7):
            later = refined(later, seed, index, requirement=TIMELY)
            kept.append(is_pair(later))
    assert set(kept) == {True, False}


def test_a_provoking_person_is_asked_for_told_of_and_kept() -> None:
    provoking = HeuristicGenerator(tries=5, changes=10, provoking=True)
    brief = Brief(mission=MISSION, requirement=SMOOTH, aim=Aim.DISTURB, seed=1)
    found = provoking.propose(brief, WORLD).scenario
    assert [h.behaviour is Behaviour.THREATENING for h in found.people.humans] == [True, False]
    assert "steps in front of the robot" in found.description
    for index in range(1, 5):
        later = brief.replace(kind="refine", feedback=measured(found), configuration_index=index)
        found = provoking.propose(later, WORLD).scenario
        assert found.people.humans[0].behaviour is Behaviour.THREATENING
    blind = provoking.propose(brief.replace(requirement=None), WORLD).scenario
    assert blind.people.humans[0].behaviour is Behaviour.REGULAR


def test_other_requirements_bring_about_other_work() -> None:
    blocked = [FORECAST(scenario(s, requirement=TIMELY).people.humans).blocked_s for s in range(10)]
    met = [FORECAST(scenario(s, requirement=SMOOTH).people.humans).meetings for s in range(10)]
    near = [FORECAST(scenario(s).people.humans) for s in range(10)]
    assert sum(blocked) > sum(f.blocked_s for f in near)
    assert sum(met) > sum(f.meetings for f in near)


def remembered(found: Scenario) -> Remembered:
    tasks = {h.name: tuple(t.name for t in h.tasks) for h in found.people.humans}
    return Remembered(description=found.description, tasks=tasks, mean=1.0, interval=(1.0, 1.0), scenario=found)


def gap(found: Scenario) -> float:
    return FORECAST(found.people.humans).mean_gap_m


def test_people_are_expected_nearer_to_the_robot_than_by_chance() -> None:
    aimed = [gap(scenario(seed)) for seed in range(10)]
    briefs = [Brief(mission=MISSION, requirement=None, seed=seed) for seed in range(10)]
    by_chance = [gap(RandomGenerator().propose(brief, WORLD).scenario) for brief in briefs]
    blind = [gap(scenario(seed, requirement=None)) for seed in range(10)]
    assert max(aimed) < min(sum(by_chance) / 10, 1.5)
    assert sum(blind) > 2 * sum(aimed) and "Unguided" in proposal(requirement=None).reasoning


def stops(human: Human) -> list[str]:
    return [ends_of(task)[0] for task in human.tasks]


@pytest.mark.parametrize("text", [None, "Two people restock shelves."])
def test_after_many_refinements_the_description_names_the_places_of_the_people_and_no_others(text: str | None) -> None:
    known = scenario(2, requirement=SMOOTH)
    known = known if text is None else known.replace(description=text)
    moved = 0
    for index in range(1, 19):
        later = refined(known, 2, index, requirement=SMOOTH)
        for human, was in zip(later.people.humans, known.people.humans, strict=True):
            if stops(human) != stops(was):
                moved += 1
            elif text is not None and human.name not in known.description:
                continue
            if human.group is not None:
                continue  # told with the mate's
            told = next(p for p in re.split(r"[;.] ?| (?=Human)", later.description) if p.startswith(human.name))
            told_work = re.findall(r"(\w+s(?: over)?) at ([^,]+?) for (\d+) s", told.split(": ")[1])
            works = [(task.work, ends_of(task)[1]) for task in at_places(human.tasks)]
            assert told_work == [(w.doing.words, at, f"{w.duration_s:.0f}") for w, at in works], later.description
        known = later
    assert moved > 2


def places(found: Scenario) -> set[str]:
    return {part for h in found.people.humans for t in h.tasks for part in ends_of(t)}


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


def test_who_is_to_hold_the_robot_up_is_on_the_way_when_it_sets_off() -> None:
    moving = 0
    for seed in range(16):
        found = scenario(seed, requirement=TIMELY)
        for human in found.people.humans:
            whole = at_places(human.tasks)
            if whole == human.tasks or human.group is not None:
                continue
            moving += 1
            begin = human.tasks[0].path[0]
            assert begin in whole[0].path[1:-1]
            assert begin not in told_places(found.description)
            assert all(a.path[-1] == b.path[0] for a, b in zip(whole, [*whole[1:], whole[0]], strict=True))
    assert moving >= 5


def told_places(description: str) -> list[str]:
    return re.findall(r"[A-M][0-9]+", description)


def test_some_people_do_not_step_aside_and_only_where_it_matters() -> None:
    def heedless(requirement: Requirement | None) -> int:
        return sum(
            human.behaviour is Behaviour.IMPASSIVE
            for seed in range(5)
            for human in scenario(seed, requirement=requirement).people.humans
        )

    assert heedless(DISTANCE) == heedless(None) == 0
    assert 1 <= heedless(SMOOTH) < 10
    assert 1 <= heedless(TIMELY) < 10


def test_it_works_in_any_world_with_labels() -> None:
    check_generator(GENERATOR, odd_briefs(GENERATOR, HALL_MISSION, HALL), HALL)
