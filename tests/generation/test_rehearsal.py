from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from rvsg.findings.feedback import rehearsing
from rvsg.generation.conversation import VlmGenerator
from rvsg.generation.generator import Proposal, Rehearsal, Walked, surprises
from rvsg.generation.heuristic import HeuristicGenerator
from rvsg.generation.result_facts import configuration_object
from rvsg.generation.vlm.model import Scripted
from rvsg.scenario.brief import Arrival, Brief
from rvsg.scenario.scenario import HumanConfiguration, Mission
from rvsg.simulation.kinematic import KinematicSimulator
from rvsg.world.world import World


def planned(people: HumanConfiguration, at: str, time_s: float, **changes: float) -> str:
    """The configuration as a model answers it, with one planned moment of the first person."""
    answer = configuration_object(people, "Somebody carries boxes.")
    answer["humans"][0] |= {"plan": [{"at": at, "time_s": time_s}], **changes}
    return json.dumps({"analysis": "as planned", **answer})


@pytest.fixture
def people(brief: Brief, warehouse: World) -> HumanConfiguration:
    scenario = HeuristicGenerator().propose(brief, warehouse).scenario
    return scenario.people


def generator(model: Scripted, warehouse: World, **options: int) -> VlmGenerator:
    """A generator whose rehearsals are simulated, and in which nobody is said to meet the robot."""
    simulated = rehearsing(KinematicSimulator(), warehouse, seed=1)

    def rehearse(mission: Mission, people: HumanConfiguration) -> Rehearsal:
        found = simulated(mission, people)
        return found.replace(people={name: walked.replace(met_s=None) for name, walked in found.people.items()})

    made = VlmGenerator(model, **options)
    made.rehearse = rehearse
    return made


@pytest.fixture
def propose(brief: Brief, warehouse: World) -> Callable[..., tuple[Proposal, Scripted]]:
    """The proposal of a model that gives these answers, and the model with what it was asked."""

    def propose(*answers: str, **options: int) -> tuple[Proposal, Scripted]:
        model = Scripted(answers)
        return generator(model, warehouse, **options).propose(brief, warehouse), model

    return propose


def test_a_plan_that_does_not_happen_goes_back_once(propose: Any, people: HumanConfiguration) -> None:
    late = people.humans[0].tasks[0].path[1]
    proposal, model = propose(planned(people, late, 19.0), planned(people, late, 19.0, start_delay_s=3.0))
    assert [call.purpose for call in proposal.calls] == ["new", "rehearse"]
    assert f"reaches {late} at" in model.asked[1].messages[-1].text
    assert "you planned 19 s" in model.asked[1].messages[-1].text
    assert proposal.scenario.people.humans[0].start_delay_s == 3.0


def test_an_impossible_plan_ends_after_the_rehearsals(propose: Any, people: HumanConfiguration) -> None:
    proposal, model = propose(*[planned(people, people.humans[0].tasks[0].path[1], 24.0)] * 6, rehearsals=5)
    assert len(model.asked) == 6 and proposal.scenario is not None


def test_an_invalid_answer_to_a_rehearsal_does_not_replace_a_valid_one(
    propose: Any, people: HumanConfiguration
) -> None:
    proposal, _ = propose(planned(people, people.humans[0].tasks[0].path[1], 24.0), "I would rather not.")
    assert configuration_object(proposal.scenario.people, "") == configuration_object(people, "")


def test_a_plan_that_happens_costs_no_call(brief: Brief, warehouse: World, people: HumanConfiguration) -> None:
    walked = {human.name: Walked(nearest_m=1.0, nearest_s=3.0) for human in people.humans}
    near = Rehearsal(robot=((0.0, "A1"),), arrival_s=20.0, people=walked)
    model = Scripted([json.dumps({"analysis": "", **configuration_object(people, "Work.")})] * 2)
    made = VlmGenerator(model)
    made.rehearse = lambda mission, people: near
    assert [call.purpose for call in made.propose(brief, warehouse).calls] == ["new"]


def test_the_first_message_says_where_the_robot_is_without_people(
    brief: Brief, warehouse: World, people: HumanConfiguration
) -> None:
    asked: list[int] = []

    def rehearse(mission: Mission, people: HumanConfiguration) -> Rehearsal:
        asked.append(len(people.humans))
        return Rehearsal(robot=((0.0, "E1"), (2.0, "E3")), arrival_s=19.5)

    model = Scripted([json.dumps({"analysis": "", **configuration_object(people, "Work.")})] * 2)
    made = VlmGenerator(model, rehearsals=0)
    made.rehearse = rehearse
    for seed in (3, 4):
        made.propose(brief.replace(seed=seed), warehouse)
    assert asked == [0]
    assert "0:E1, 2:E3; it arrives at 19.5 s" in model.asked[0].messages[1].text


def test_a_rehearsal_gives_a_value_and_asks_for_no_repair_where_the_time_limit_sets_it(
    brief: Brief, warehouse: World, people: HumanConfiguration
) -> None:
    requirement = brief.requirement
    assert requirement is not None
    simulated = rehearsing(KinematicSimulator(), warehouse, seed=1, requirement=requirement)
    value = simulated(brief.mission, people).value
    assert value is not None

    def proposed(*, capped: bool) -> tuple[Proposal, Scripted]:
        def rehearse(mission: Mission, people: HumanConfiguration) -> Rehearsal:
            found = simulated(mission, people)
            late = {name: walked.replace(met_s=None) for name, walked in found.people.items()}
            return found.replace(people=late, capped=capped)

        answer = planned(people, people.humans[0].tasks[0].path[1], 24.0)
        model = Scripted([answer, answer])
        made = VlmGenerator(model)
        made.rehearse = rehearse
        return made.propose(brief, warehouse), model

    proposal, model = proposed(capped=False)
    said = f"This run measured {value:.3g} {requirement.unit}"
    assert said in model.asked[1].messages[-1].text
    violated = "a violation" if requirement.violated_by(value) else "no violation"
    assert f"{said}, {violated}. " in model.asked[1].messages[-1].text
    assert proposal.rehearsals == ((proposal.scenario.replace(description="", idea=""), value),)
    assert [call.purpose for call in proposed(capped=True)[0].calls] == ["new"]
    stored = proposal.model_dump(mode="json")
    stored["rehearsals"] = [[scenario["people"], kept] for scenario, kept in stored["rehearsals"]]
    assert Proposal.model_validate(stored) == proposal, "as rehearsals were stored before they named objects"


def test_a_first_prompt_stays_within_ten_thousand_tokens(brief: Brief, warehouse: World) -> None:
    made = generator(Scripted([]), warehouse)
    text = sum(len(message.text) for message in made.first_prompts(brief, warehouse))
    assert text / 3.5 < 6_000  # the two pictures take about 2 200 tokens more


NEAR = Walked(nearest_m=1.0, nearest_s=2.0)
LATE = NEAR.replace(arrivals=(Arrival(at="C3", time_s=4.9, unhindered_s=2.0),))
LEAVES = NEAR.replace(begins_at="D9", left_s=2.0)


@pytest.mark.parametrize(
    ("walked", "plan", "told"),
    [
        (NEAR.replace(stuck_at="B2", stuck_s=3.0), {}, "gets stuck at B2 from 3 s on and does not walk further."),
        (NEAR.replace(nearest_m=6.0), {}, "never comes near the robot: the smallest distance is 6.0 m, at 2 s."),
        (LATE, {"C3": 2.0}, "reaches C3 at 4.9 s; you planned 2 s."),
        (LATE, {"C3": 4.0}, None),
        (LATE.replace(reacted_s=1.5), {"C3": 2.0}, None),  # who reacts does not walk as planned
        (LATE.replace(reacted_s=3.0), {"C3": 2.0}, "reaches C3 at 4.9 s; you planned 2 s."),
        (LATE, {"D4": 4.0}, "does not reach D4 during the run; you planned 4 s."),
        # What happens after the first encounter is what the test is for.
        (
            NEAR.replace(stood=((3.0, 6.0, "B2"), (12.0, 15.0, "C3")), met_s=9.0),
            {},
            "stands still at B2 from 3 to 6 s, held up by what is in the way.",
        ),
        (LEAVES, {"D9": 1.0}, None),
        (LEAVES, {"D9": 8.0}, "leaves D9 at 2.0 s and does not come back; you planned 8 s."),
        (LEAVES.replace(left_s=None), {"D9": 18.0}, None),
    ],
)
def test_what_goes_against_the_plan_is_a_surprise(walked: Walked, plan: dict[str, float], told: str | None) -> None:
    rehearsal = Rehearsal(robot=(), arrival_s=20.0, people={"Ann": walked})
    assert surprises(rehearsal, {"Ann": plan}) == (() if told is None else (f"Ann {told}",))


def test_a_rehearsal_knows_when_somebody_leaves_the_first_waypoint(
    brief: Brief, warehouse: World, people: HumanConfiguration
) -> None:
    first = people.humans[0].replace(start_delay_s=4.0)
    late = HumanConfiguration(humans=(first, *people.humans[1:]))
    walked = rehearsing(KinematicSimulator(), warehouse, seed=1)(brief.mission, late).people[first.name]
    assert walked.begins_at == first.tasks[0].path[0]
    assert 4.0 < walked.left_s < 7.0
