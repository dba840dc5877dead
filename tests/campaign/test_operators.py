from __future__ import annotations

import numpy as np
import pytest
from tests.campaign.parts import WalkGenerator, plan, warehouse

from rvsg.campaign.attempt import Attempt
from rvsg.campaign.mutation import Operators
from rvsg.campaign.race import Candidate
from rvsg.generation.descriptions import TUNED, describe_new, tells_of
from rvsg.scenario.brief import Brief
from rvsg.scenario.requirement import Aim
from rvsg.scenario.scenario import Scenario

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


def test_our_own_text_is_written_anew_for_people_of_another_scenario(operators: Operators) -> None:
    parent, other = candidate(0, 0, told=None, seed=1), candidate(1, 1, told=None, seed=2)
    rng = np.random.default_rng(3)
    made = next(m for _ in range(200) if (m := operators._crossed(parent, [parent, other], rng)) is not None)
    lent = {human.tasks for human in other.scenario.people.humans}
    assert any(human.tasks in lent for human in made.people.humans)
    described = operators.describe(parent.scenario, made)
    after = parent.scenario.replace(people=made.people, description=described.description, idea=described.idea)
    assert tells_of(after, goods=True)
    assert described.description != parent.scenario.description


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
    assert tuned is not None
    described = operators.describe(ours.scenario, tuned)
    after = ours.scenario.replace(people=tuned.people, description=described.description, idea=described.idea)
    assert tells_of(after, goods=True)
