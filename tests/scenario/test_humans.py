"""People of a scenario: their ways as coordinates, their reactions, and children, wheelchairs and trolleys."""

from __future__ import annotations

import pytest
from tests.scenario.small_world import GOOD, MISSION, WORLD, human, people

from rvsg.core.errors import UnknownName
from rvsg.scenario.scenario import (
    Behaviour,
    Human,
    HumanAgent,
    HumanConfiguration,
    Pause,
    Task,
    Trolley,
    decode,
    reaction_of,
)
from rvsg.scenario.validity import check


def walker(*ways: tuple[str, dict[str, float]], **more: object) -> HumanAgent:
    """Return somebody who walks these ways and pauses at these waypoints of each."""
    tasks = tuple(
        Task(name=path, path=path.split(), pauses=tuple(Pause(at=at, duration_s=s) for at, s in pauses.items()))
        for path, pauses in ways
    )
    (agent,) = decode(HumanConfiguration(humans=(human(*tasks, **more),)), WORLD.grid)
    return agent


@pytest.mark.parametrize(
    ("ways", "start_pause_s", "pauses_s"),
    [
        ([("A1 A2 A3", {}), ("A3 A2 A1", {})], 0.0, (0.0, 0.0, 0.0, 0.0)),
        ([("A1 A2", {"A2": 3, "A1": 1}), ("A2 A1", {"A2": 4})], 1.0, (1.0, 7.0)),
        ([("A1 A2", {}), ("A2 A1", {"A1": 4})], 0.0, (4.0, 0.0)),
        ([("A1 A2", {"A1": 1}), ("A2 A1", {"A1": 4})], 1.0, (5.0, 0.0)),
    ],
    ids=["none", "added up at a joint", "not at the start", "at the start if the first task asks for it"],
)
def test_goals_are_the_waypoints_of_all_tasks_with_joints_counted_once(
    ways: list[tuple[str, dict[str, float]]], start_pause_s: float, pauses_s: tuple[float, ...]
) -> None:
    agent = walker(*ways)
    assert agent.start == (0.0, 0.0)
    assert agent.goals == ((0.0, 0.0), (0.0, 1.0), (0.0, 2.0), (0.0, 1.0))[: len(pauses_s)]
    assert (agent.start_pause_s, agent.pauses_s) == (start_pause_s, pauses_s)


def test_a_name_that_the_grid_does_not_know_is_refused() -> None:
    with pytest.raises(UnknownName, check=lambda error: error.name == "A9"):
        walker(("A1 A9", {}))


def test_reactions_are_those_of_the_behaviour() -> None:
    assert reaction_of(Behaviour.CURIOUS, 1.2).speed_m_s == 1.2
    agent = walker(("A1", {}), behaviour=Behaviour.SCARED)
    assert (agent.reaction.distance_m, agent.reaction.speed_m_s) == (3.0, 0.6)


def of(**changes: object) -> Human:
    given = human(*GOOD).model_dump(mode="json", exclude={"radius_m", "speed_m_s"})
    return Human.model_validate(given | changes)


def test_an_adult_on_foot_has_the_record_it_always_had() -> None:
    written = of().model_dump(mode="json")
    assert not {"kind", "trolley"} & written.keys()
    assert HumanConfiguration(humans=(of(),)).id == HumanConfiguration(humans=(human(*GOOD),)).id
    assert decode(people(of()), WORLD.grid)[0].outline == ()


def test_a_kind_brings_its_size_and_speed() -> None:
    child, chair = of(kind="child"), of(kind="wheelchair")
    assert (child.radius_m, child.speed_m_s) == (0.25, 1.1)
    assert (chair.radius_m, chair.speed_m_s) == (0.33, 0.9)
    assert of(kind="child", speed_m_s=1.8).speed_m_s == 1.8
    assert Human.from_json(chair.to_json()) == chair
    assert decode(people(chair), WORLD.grid)[0].outline == chair.outline


def test_a_trolley_lies_ahead_of_who_pushes_it() -> None:
    outline = of(trolley={"length_m": 1.0, "width_m": 0.5}).outline
    assert min(x for x, _ in outline) == 0.35
    assert max(x for x, _ in outline) == 1.35
    assert {y for _, y in outline} == {-0.25, 0.25}


@pytest.mark.parametrize(
    ("rule", "changes"),
    [
        ("speed-out-of-range", {"kind": "wheelchair", "speed_m_s": 1.8}),
        ("speed-out-of-range", {"trolley": {}, "speed_m_s": 1.8}),
        ("size-out-of-range", {"kind": "child", "radius_m": 0.4}),
        ("trolley-pusher", {"kind": "child", "trolley": {}}),
        ("too-wide", {"trolley": {"width_m": 1.2}}),
        ("person-too-wide", {"radius_m": 0.9}),
    ],
)
def test_each_limit_is_found_and_named(rule: str, changes: dict[str, object]) -> None:
    assert rule in [finding.rule for finding in check(people(of(**changes)), MISSION, WORLD)]


def test_a_trolley_may_not_start_on_the_robot() -> None:
    start = MISSION.route.start
    person = human("walk about: B1 B2 B1").replace(trolley=Trolley(length_m=2.4))
    beside = person.replace(start=(start.x, start.y - 1.2), points={"a": (start.x, start.y + 1.5)})
    walked = beside.tasks[0].model_copy(update={"path": ("a", *beside.tasks[0].path)})
    found = check(people(beside.replace(tasks=(walked,))), MISSION, WORLD)
    assert "spawn-on-robot" in [finding.rule for finding in found]
