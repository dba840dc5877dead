from __future__ import annotations

import pytest

from rvsg.core.records import Pose
from rvsg.generation.descriptions import (
    EARLIER,
    TUNED,
    describe_changed,
    describe_new,
    describe_tuned,
    tells_of,
    work_of,
)
from rvsg.scenario.scenario import Human, HumanConfiguration, Mission, Pause, PersonKind, Scenario, Task
from rvsg.world.world import Route

ROUTE = Route(name="r", start=Pose(x=0, y=0, yaw=0), goal=Pose(x=5, y=0, yaw=0), time_limit_s=30)
MISSION = Mission(world="hall", world_id="world-0", route=ROUTE)


def person(speed_m_s: float = 1.2, pauses: tuple[Pause, ...] = (), places: int = 3, **more: object) -> Human:
    names = [f"Area {k + 1}" for k in range(places)]
    tasks = tuple(
        Task.between(a, b, (f"A{i + 1}", f"A{(i + 1) % places + 1}"), () if i else pauses)
        for i, (a, b) in enumerate(zip(names, [*names[1:], names[0]], strict=True))
    )
    return Human.model_validate({"name": "Human 1", "tasks": tasks, "speed_m_s": speed_m_s, **more})


def scenario(human: Human, description: str, idea: str = "") -> Scenario:
    people = HumanConfiguration(humans=(human,))
    return Scenario(mission=MISSION, people=people, description=description, idea=idea)


@pytest.mark.parametrize(
    ("human", "work", "errand"),
    [
        (person(pauses=(Pause(at="A1", duration_s=3.0),)), "checks goods on the way", "stops on the way"),
        (person(0.4), "moves a heavy load", "step by step"),
        (person(0.7), "carries a heavy load", "slow pace"),
        (person(places=2), "sorts and tidies", "to and fro"),
        (person(1.2), "brisk walk", "brisk pace"),
        (person(0.9), "steady walk", "steady pace"),
        (person(kind=PersonKind.WHEELCHAIR), "goes by wheelchair", "goes by wheelchair"),
    ],
)
def test_how_somebody_goes_about_it_has_words_for_both_kinds_of_place(human: Human, work: str, errand: str) -> None:
    assert work in work_of(human, goods=True)
    assert errand in work_of(human, goods=False)


def test_nobody_handles_goods_where_there_are_none() -> None:
    for human in (person(), person(0.4), person(0.7), person(places=2), person(0.9)):
        told = describe_changed(scenario(person(), "People visit."), [human], goods=False).description
        assert not any(word in told for word in ("goods", "load", "trolley", "sorts"))


@pytest.mark.parametrize("goods", [True, False])
def test_our_own_text_is_written_anew_after_tuning(goods: bool) -> None:
    described = describe_new([person()], "The hour.", goods=goods)
    before = scenario(person(), described.description, described.idea)
    assert tells_of(before, goods=goods)
    slow = HumanConfiguration(humans=(person(0.4),))
    after = describe_tuned(before, slow, goods=goods)
    assert work_of(slow.humans[0], goods=goods) in after.description
    assert work_of(before.people.humans[0], goods=goods) not in after.description
    assert tells_of(scenario(slow.humans[0], after.description, after.idea), goods=goods)


def test_a_models_text_says_that_the_numbers_were_tuned_once() -> None:
    before = scenario(person(), "Ann waits 5 s at the shelf.")
    assert not tells_of(before, goods=True)
    after = describe_tuned(before, HumanConfiguration(humans=(person(0.4),)), goods=True)
    assert after.description == f"Ann waits 5 s at the shelf. {TUNED}"
    again = describe_tuned(scenario(person(0.4), after.description), before.people, goods=True)
    assert again.description == after.description


def test_a_models_text_that_was_inherited_is_not_ours() -> None:
    assert not tells_of(scenario(person(), f"Ann works. {EARLIER}", "Ann works."), goods=True)


def test_a_scenario_without_a_text_keeps_none() -> None:
    assert describe_tuned(scenario(person(), ""), HumanConfiguration(humans=(person(0.4),)), goods=True) == ("", "")
