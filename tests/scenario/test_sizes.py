"""Children, wheelchairs and trolleys in the records and in the checker."""

from __future__ import annotations

import pytest
from tests.scenario.small_world import GOOD, MISSION, WORLD, human, people

from rvsg.scenario.scenario import Human, HumanConfiguration, PersonKind, Trolley, decode
from rvsg.scenario.validity import check


def of(**changes: object) -> Human:
    given = human(*GOOD).model_dump(mode="json", exclude={"radius_m", "speed_m_s"})
    return Human.model_validate(given | changes)


def rules(person: Human) -> list[str]:
    return [finding.rule for finding in check(people(person), MISSION, WORLD)]


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
    assert min(x for x, _ in outline) == 0.5
    assert max(x for x, _ in outline) == 1.5
    assert {y for _, y in outline} == {-0.25, 0.25}


@pytest.mark.parametrize(
    ("rule", "changes"),
    [
        ("speed-out-of-range", {"kind": "wheelchair", "speed_m_s": 1.8}),
        ("speed-out-of-range", {"trolley": {}, "speed_m_s": 1.8}),
        ("size-out-of-range", {"kind": "child", "radius_m": 0.4}),
        ("trolley-pusher", {"kind": "child", "trolley": {}}),
        ("too-wide", {"trolley": {"width_m": 1.2}}),
    ],
)
def test_each_limit_is_found_and_named(rule: str, changes: dict[str, object]) -> None:
    assert rule in rules(of(**changes))


def test_a_trolley_may_not_start_on_the_robot() -> None:
    start = MISSION.route.start
    person = human("walk about: B1 B2 B1").replace(trolley=Trolley(length_m=2.4))
    assert start is not None and PersonKind.ADULT is person.kind
    beside = person.replace(start=(start.x, start.y - 1.2), points={"a": (start.x, start.y + 1.5)})
    walked = beside.tasks[0].model_copy(update={"path": ("a", *beside.tasks[0].path)})
    found = check(people(beside.replace(tasks=(walked,))), MISSION, WORLD)
    assert "spawn-on-robot" in [finding.rule for finding in found]
