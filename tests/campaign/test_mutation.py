"""Mutation: changes of configurations, and the kinds of failure that guide them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.campaign.parts import WalkGenerator, plan, warehouse

from rvsg.generation.descriptions import TUNED, describe_new, tells_of
from rvsg.generation.forecast import forecaster_of
from rvsg.generation.people_sampler import box
from rvsg.runs.attempt import Attempt
from rvsg.runs.observation import FailureMode
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Aim
from rvsg.scenario.scenario import HumanConfiguration, Scenario
from rvsg.search.candidates import Candidate
from rvsg.search.mutation import Kinds, Operators, _closest, foreseen

TOLD = "Ann brings boxes to the shelf and waits there for 5 s."


def candidate(index: int, scenario_index: int, *, told: str | None, seed: int) -> Candidate:
    """A candidate described by a model, or where `told` is None by our own words."""
    brief = Brief(mission=plan().mission, requirement=None, seed=seed, scenario_index=scenario_index)
    proposal = WalkGenerator().propose(brief, warehouse())
    assert proposal.scenario is not None
    scenario: Scenario = proposal.scenario
    ours = describe_new(scenario.people.humans, "The hour.", goods=True)
    description, idea = (told, "") if told is not None else ours
    proposal = proposal.replace(scenario=scenario.replace(description=description, idea=idea))
    made = Candidate(Attempt(campaign="c", index=index, strategy="hybrid", brief=brief, proposal=proposal))
    made.badness, made.estimate = {1: 1.0}, float(-index)
    return made


@pytest.fixture
def operators() -> Operators:
    return Operators(plan().mission, warehouse(), Aim.SHARE)


def described(operators: Operators, scenario: Scenario, made: Any) -> Scenario:
    text = operators.describe(scenario, made)
    return scenario.replace(people=made.people, description=text.description, idea=text.idea)


def test_our_own_text_is_written_anew_for_people_of_another_scenario(operators: Operators) -> None:
    parent, other = candidate(0, 0, told=None, seed=1), candidate(1, 1, told=None, seed=2)
    rng = np.random.default_rng(3)
    made = next(m for _ in range(200) if (m := operators._crossed(parent, [parent, other], rng)) is not None)
    lent = {human.tasks for human in other.scenario.people.humans}
    assert any(human.tasks in lent for human in made.people.humans)
    after = described(operators, parent.scenario, made)
    assert tells_of(after, goods=True) and after.description != parent.scenario.description


def test_changes_that_were_tried_without_a_moved_object_are_new_beside_it(operators: Operators) -> None:
    alone, beside = candidate(0, 0, told=TOLD, seed=1), candidate(1, 0, told=TOLD, seed=1)
    pallet = box("pallet", (1.0, -4.0), (1.2, 0.8, 0.2), 0.0, 0.2)
    moved = beside.scenario.replace(mission=beside.scenario.mission.replace(moved=(pallet,)))
    beside.attempt = beside.attempt.replace(proposal=beside.attempt.proposal.replace(scenario=moved))

    def change(parent: Candidate, known: set[str]) -> Any:
        return operators.change(parent, [parent], np.random.default_rng(3), known)

    first = change(alone, set())
    tried = {alone.scenario.replace(people=first.people).situation}
    assert change(alone, tried) != first
    assert change(beside, tried) == first


def test_a_models_text_stays_with_its_own_people(operators: Operators) -> None:
    parent, other = candidate(0, 0, told=TOLD, seed=1), candidate(1, 1, told=TOLD, seed=2)
    rng = np.random.default_rng(3)
    assert all(operators._crossed(parent, [parent, other], rng) is None for _ in range(100))


def test_a_models_person_is_exchanged_for_the_same_one_of_another_configuration(operators: Operators) -> None:
    parent, sibling = candidate(0, 0, told=TOLD, seed=1), candidate(1, 0, told=TOLD, seed=1)
    first, *rest = sibling.scenario.people.humans
    slower = sibling.scenario.people.replace(humans=(first.replace(speed_m_s=0.4), *rest))
    changed = sibling.attempt.proposal.replace(scenario=sibling.scenario.replace(people=slower))
    sibling.attempt = sibling.attempt.replace(proposal=changed)
    rng = np.random.default_rng(3)
    made = [m for _ in range(100) if (m := operators._crossed(parent, [parent, sibling], rng)) is not None]
    names = [[task.name for task in human.tasks] for human in parent.scenario.people.humans]
    assert any(0.4 in [human.speed_m_s for human in each.people.humans] for each in made)
    for each in made:
        assert [[task.name for task in human.tasks] for human in each.people.humans] == names
        assert operators.describe(parent.scenario, each).description == f"{TOLD} {TUNED}"


def test_tuned_numbers_are_told_in_either_text(operators: Operators) -> None:
    rng = np.random.default_rng(4)
    model, ours = candidate(0, 0, told=TOLD, seed=1), candidate(1, 1, told=None, seed=2)
    tuned = operators._tuned(model, rng)
    assert tuned is not None
    assert operators.describe(model.scenario, tuned).description == f"{TOLD} {TUNED}"
    tuned = operators._tuned(ours, rng)
    assert tuned is not None and tells_of(described(operators, ours.scenario, tuned), goods=True)


CROSSED = FailureMode(place="Area 3", person="crosses its way ahead of it", robot="stops")
STOOD = FailureMode(place="Area 4", person="stands beside it", robot="drives on")


def raced(index: int, *badness: float) -> Candidate:
    made = Candidate(Attempt.model_construct(index=index))
    made.badness = dict(enumerate(badness))
    made.estimate = float(np.mean(badness)) if badness else -np.inf
    return made


@pytest.fixture
def shown() -> tuple[Kinds, list[Candidate]]:
    kinds = Kinds(limit=1.0)
    known = [raced(0, 2.0), raced(1, 1.5, 1.6), raced(2, 3.0), raced(3, 0.5)]
    shown = [(CROSSED,), (CROSSED, CROSSED), (STOOD,), ()]
    for each, modes in zip(known, shown, strict=True):
        kinds.place(each, modes)
    return kinds, known


def test_who_violates_surely_stands_for_a_kind(shown: tuple[Kinds, list[Candidate]]) -> None:
    kinds, known = shown
    assert {mode: c.index for mode, c in kinds.champions(known).items()} == {CROSSED: 1, STOOD: 2}
    assert kinds.met() == {("Area 3", CROSSED.person), ("Area 4", STOOD.person)}


def test_a_kind_that_one_run_shows_is_run_again(shown: tuple[Kinds, list[Candidate]]) -> None:
    kinds, known = shown
    assert [c.index for c in kinds.doubtful(known)] == [2]
    known[2].deviation = 0.1
    assert kinds.doubtful(known) == [], "what surely violates needs no second run"
    known[2].deviation = 1.0
    for again in ((STOOD,), (STOOD, STOOD)):
        known[2].badness[1] = 3.0
        kinds.place(known[2], again)
        assert kinds.doubtful(known) == []


def test_kinds_take_turns_to_be_changed(shown: tuple[Kinds, list[Candidate]]) -> None:
    kinds, known = shown
    changes: dict[int, int] = {}
    turns = []
    for _ in range(4):
        chosen = kinds.least_changed(known, changes)
        assert chosen is not None
        turns.append(chosen.index)
        changes[chosen.index] = changes.get(chosen.index, 0) + 1
    assert turns == [1, 2, 1, 2]
    assert Kinds(limit=1.0).least_changed(known, {}) is None


def test_the_closest_approach_of_a_forecast_has_a_place_and_a_person() -> None:
    """The robot drives along x at 0.5 m/s; somebody crosses from its left and is nearest 1 m ahead of it at 5 s."""
    time = np.arange(0.0, 10.0, 0.1)
    robot = 0.5 * time + 0j
    crossing = 3.5 + 1j * 0.8 * (5.0 - time)
    standing = np.full_like(robot, 2.5 + 0.9j)
    for person, kind in ((crossing, "crosses its way ahead of it"), (standing, "stands beside it")):
        met = _closest(np.stack([robot, person], axis=1), warehouse())
        assert met is not None and met[1] == kind


def test_every_configuration_is_foreseen_in_its_place_and_people_are_needed() -> None:
    mission, world = plan().mission, warehouse()
    proposals = [WalkGenerator().propose(Brief(mission=mission, requirement=None, seed=k), world) for k in (1, 2)]
    people = [p.scenario.people for p in proposals if p.scenario is not None]
    forecaster = forecaster_of(mission, world)
    first, second = (foreseen(forecaster, [each], world)[0] for each in people)
    assert first is not None and second is not None
    both = foreseen(forecaster, [people[0], HumanConfiguration(humans=()), people[1]], world)
    assert list(both) == [first, None, second]
